"""Wedge, interior product and Lie derivative of forms, with the identities that they keep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddgcli.errors import ParameterError, renamed_parameters
from ddgcli.mesh.fields import finite_values
from ddgcli.operators.dec import Complex, complex_of
from ddgcli.operators.whitney import (
    SpaceMesh,
    check_degrees,
    degree_of,
    interior_product,
    lie_derivative,
    wedge,
)

# places of the forms of degree 0, 1, ... by dimension; the cells of tetrahedra are their `face`, as in files
PLACES = {2: ("vertex", "edge", "face"), 3: ("vertex", "edge", "triangle", "face")}
ELEMENTS = {2: ("vertices", "edges", "faces"), 3: ("vertices", "edges", "triangles", "tetrahedra")}


@dataclass(frozen=True, eq=False)
class FormProducts:
    """Forms by name, each on its simplices, and relative residuals of exact identities.

    Parameters
    ----------
    degree : dict of str to int
    vertex, edge, triangle, face : dict of str to ndarray
        `face` holds forms on the cells of the mesh, `triangle` those on the faces of tetrahedra.
    accuracy : dict of str to float
        `leibniz_residual`: d (a ^ b) - da ^ b -+ a ^ db, where a ^ b is not a form of the highest degree.
        `lie_commutation_residual`: d L_X a - L_X d a.
    """

    degree: dict[str, int] = field(default_factory=dict)
    vertex: dict[str, NDArray] = field(default_factory=dict)
    edge: dict[str, NDArray] = field(default_factory=dict)
    triangle: dict[str, NDArray] = field(default_factory=dict)
    face: dict[str, NDArray] = field(default_factory=dict)
    accuracy: dict[str, float] = field(default_factory=dict)

    def add(self, name: str, degree: int, form: NDArray, dimension: int) -> None:
        """Put a form on the simplices of its degree."""
        self.degree[name] = degree
        getattr(self, PLACES[dimension][degree])[name] = form


def form_products(mesh: SpaceMesh, pairs: Mapping[str, tuple[NDArray, NDArray] | None]) -> FormProducts:
    """Products of forms and vector fields.

    Parameters
    ----------
    mesh : TriangleMesh or TetMesh
        A surface is an oriented manifold.
    pairs : mapping of {'wedge', 'interior_product', 'lie_derivative'} to two arrays, or None
        Two forms; or a field, (n, 3) or (m, 3), and a form. The length of a form is that of the simplices
        of its degree. Absent and None products are left out.

    Returns
    -------
    FormProducts
        Arrays by name, and relative residuals of their identities (Leibniz rule; Lie derivative and d
        commute).

    Raises
    ------
    ParameterError
        For arrays that are not forms or fields of the mesh, or products that are zero by their degrees.
    """
    complex_ = complex_of(mesh)
    d, n = [*complex_.derivatives, None], complex_.dimension
    out = FormProducts()
    for name, pair in pairs.items():
        if pair is None:
            continue
        try:
            first, form = operands(complex_, name, *pair)
            degree = degree_of(complex_, form)
            if name == "wedge":
                p = degree_of(complex_, first)
                product = wedge(complex_, first, form)
                out.add(name, p + degree, product, n)
                if p + degree < n:
                    terms = [
                        wedge(complex_, d[p] @ first, form),
                        (-1.0) ** p * wedge(complex_, first, d[degree] @ form),
                    ]
                    size = _size(first) * _size(form)
                    out.accuracy["leibniz_residual"] = _relative(
                        d[p + degree] @ product - sum(terms), size, *terms
                    )
                continue
            if name == "interior_product":
                out.add(name, degree - 1, interior_product(mesh, first, form), n)
                continue
            derivative = lie_derivative(mesh, first, form)
            out.add(name, degree, derivative, n)
            if degree < n:
                after, before = d[degree] @ derivative, lie_derivative(mesh, first, d[degree] @ form)
                length = float(np.sqrt(np.median(complex_.metric.squared_distance[:, 0, 1])))
                out.accuracy["lie_commutation_residual"] = _relative(
                    after - before, _size(first) * _size(form) / length, after, before, derivative
                )
        except ParameterError as error:
            raise ParameterError(error.message, parameter=name) from error
    return out


def check_products(mesh: SpaceMesh, pairs: Mapping[str, tuple[NDArray, NDArray]]) -> None:
    """Raise the errors of `form_products`, without computing the products.

    Parameters
    ----------
    mesh : TriangleMesh or TetMesh
    pairs : mapping of str to two arrays
        As in `form_products`.

    Raises
    ------
    ParameterError
    """
    complex_ = complex_of(mesh)
    for name, pair in pairs.items():
        try:
            operands(complex_, name, *pair)
        except ParameterError as error:
            raise ParameterError(error.message, parameter=name) from error


def operands(
    complex_: Complex, name: str, first: ArrayLike, form: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Arguments of a product: two forms, or the vectors of a field on the cells and a form.

    Parameters
    ----------
    complex_ : Complex
    name : {'wedge', 'interior_product', 'lie_derivative'}
    first, form : array_like
        As in `form_products`.

    Returns
    -------
    (form or (m, 3) ndarray, form)

    Raises
    ------
    ParameterError
        For arrays that are not forms or fields, or products that are zero by their degrees.
    """
    with renamed_parameters("form"):
        second = form_values(complex_, form)
        degree = degree_of(complex_, second)
    with renamed_parameters("first"):
        if name == "wedge":
            one = form_values(complex_, first)
            check_degrees(complex_, degree_of(complex_, one), degree)
            return one, second
        vectors = cell_vectors(complex_, first)
    if name == "interior_product" and degree == 0:
        raise ParameterError(
            f"a 0-form has no interior product; name values on {_listed(ELEMENTS[complex_.dimension][1:])}",
            parameter="form",
        )
    return vectors, second


def _listed(names: Sequence[str]) -> str:
    return " or ".join((", ".join(names[:-1]), names[-1]))


def form_values(complex_: Complex, array: ArrayLike) -> NDArray[np.float64]:
    """Numbers of a form.

    Parameters
    ----------
    complex_ : Complex
    array : array_like

    Returns
    -------
    (k,) ndarray of float64

    Raises
    ------
    ParameterError
        For an array of more dimensions, or numbers that are not finite.
    """
    values = np.asarray(array, dtype=np.float64)
    if values.ndim != 1:
        raise ParameterError(
            f"an array of shape {values.shape} is not a form; name numbers on "
            f"{_listed(ELEMENTS[complex_.dimension])}"
        )
    return finite_values(values, "element", what="the form")


def cell_vectors(complex_: Complex, array: ArrayLike) -> NDArray[np.float64]:
    """Vectors of a field on cells; those on vertices are averaged over the corners.

    Parameters
    ----------
    complex_ : Complex
    array : (n, 3) or (m, 3) array_like

    Returns
    -------
    (m, 3) ndarray of float64

    Raises
    ------
    ParameterError
        For an array of another shape, or numbers that are not finite.
    """
    vectors = finite_values(array, "row", what="the field")
    if vectors.shape == (len(complex_.corners), 3):
        return vectors
    if vectors.shape == (complex_.counts[0], 3):
        return vectors[complex_.corners].mean(axis=1)
    raise ParameterError(
        f"an array of shape {vectors.shape} is not a field; name vectors on the {complex_.counts[0]} "
        f"vertices or {len(complex_.corners)} {ELEMENTS[complex_.dimension][-1]}"
    )


def _size(values: NDArray) -> float:
    """Largest absolute value."""
    return float(np.abs(values).max(initial=0.0))


def _relative(difference: NDArray, size: float, *terms: NDArray) -> float:
    """Largest difference over the largest term, or over the size of what cancels in terms that vanish."""
    return _size(difference) / (max(size, *map(_size, terms)) or 1.0)
