"""Errors of the diagonal Hodge stars on constant forms, and the warning of Laplacians that have them."""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.vectors import row_cross
from ddgcli.operators.dec import Complex
from ddgcli.operators.stars import Star, diagonal_star

MAX_STAR_ERROR = 0.05  # above which spectra are off by more than coarse meshes excuse
FLAT_SHARE = 1e-9  # of the largest norm: forms below vanish on the surface

log = logging.getLogger("ddgcli")


def star_errors(complex_: Complex, points: NDArray, star: Star) -> dict[int, float]:
    """Largest relative error of the squared norms of constant forms, by degree.

    Constant forms of space, restricted to a surface. On finer meshes of the same kind it stays as it is, and
    so does an error of the spectra of Laplacians, which is about half of it to all of it.

    Parameters
    ----------
    complex_ : Complex
    points : (n, 3) ndarray of float64
    star : {'circumcentric', 'barycentric', 'galerkin'}
        Of `galerkin` the diagonal star that is inverted in its place.

    Returns
    -------
    dict of int to float
        Degrees 1 to the dimension - 1: on functions and forms of the highest degree every star is exact.
    """
    size = float(np.ptp(points, axis=0).max(initial=0.0)) or 1.0  # squares stay in the floating-point range
    edge = (points[complex_.edges[:, 1]] - points[complex_.edges[:, 0]]) / size
    corner = points[complex_.faces] / size
    forms = {1: edge}
    if complex_.dimension == 2:
        # the cotangents of a triangle are exact on its constant forms
        norm = _products(diagonal_star(complex_, 1, "circumcentric"), edge)
        exact = {1: norm}
    else:
        forms[2] = 0.5 * row_cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        volume = float(np.sum(complex_.metric.measure))
        exact = {1: volume / size**2 * np.eye(3), 2: volume / size**4 * np.eye(3)}
    return {
        degree: _deviation(_products(diagonal_star(complex_, degree, star), form), exact[degree])
        for degree, form in forms.items()
    }


def _products(diagonal: NDArray, forms: NDArray) -> NDArray[np.float64]:
    """(3, 3) inner products of the forms of the three axes (k, 3)."""
    return forms.T @ (diagonal[:, None] * forms)


def _deviation(norm: NDArray, exact: NDArray) -> float:
    """Largest relative difference of two quadratic forms, where the second one is positive."""
    if not (np.isfinite(norm).all() and np.isfinite(exact).all()):
        return float("nan")
    values, axes = np.linalg.eigh(exact)
    positive = values > FLAT_SHARE * values.max(initial=0.0)
    if not positive.any():
        return 0.0
    scaled = axes[:, positive] / np.sqrt(values[positive])
    return float(np.abs(np.linalg.eigvalsh(scaled.T @ norm @ scaled) - 1.0).max())


def warn_of_star_errors(errors: dict[int, float], star: Star, dimension: int) -> None:
    """Warn where the stars that Laplacians use are far off on constant forms.

    Parameters
    ----------
    errors : dict of int to float
        As returned by `star_errors`.
    star : {'circumcentric', 'barycentric', 'galerkin'}
    dimension : int
    """
    large = {degree: error for degree, error in errors.items() if error > MAX_STAR_ERROR}
    if not large:
        return
    # `galerkin` has the diagonal star in codifferentials alone
    steps = (1,) if star == "galerkin" else (-1, 0, 1)
    laplacians = sorted({degree + step for degree in large for step in steps})
    remedy = "take a Delaunay mesh without obtuse rims, or a more regular one"
    if star == "barycentric":
        remedy = "use `star=galerkin`"
    log.warning(
        "the %s star errs by %s on constant forms, and the spectra of %s by up to as much, on finer meshes "
        "of this kind too; %s",
        "diagonal" if star == "galerkin" else star,
        " and ".join(f"{error:.2g} (degree {degree})" for degree, error in large.items()),
        ", ".join(f"laplacian{k}" for k in laplacians if k <= dimension),
        remedy,
    )
