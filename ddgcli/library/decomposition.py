"""Hodge decomposition, harmonic fields and homology."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddgcli.algorithms.hodge import hodge_analysis as analysis
from ddgcli.algorithms.hodge.harmonic import HarmonicBasis
from ddgcli.algorithms.hodge.harmonic import harmonic_basis as core_harmonic_basis
from ddgcli.algorithms.hodge.homology import BettiNumbers, Boundary
from ddgcli.algorithms.hodge.homology import betti_numbers as core_betti_numbers
from ddgcli.choices import FIELD_BOUNDARIES
from ddgcli.errors import ParameterError
from ddgcli.library.mesh_arguments import accepts_arrays
from ddgcli.library.result import Measurement

__all__ = ["betti_numbers", "harmonic_basis", "hodge_decomposition", "homology_generators"]

FIELD_PLACES = ("", "vertex", "face", "edge")


@accepts_arrays("surface", "tetrahedra")
def hodge_decomposition(
    mesh: analysis.SpaceMesh,
    field: ArrayLike,
    boundary: Boundary = "tangential",
    *,
    place: Literal["", "vertex", "face", "edge"] = "",
) -> Measurement:
    """Split a field into its exact, coexact and harmonic parts.

    Parameters
    ----------
    mesh : TriangleMesh, TetMesh or (points, cells) pair
        Manifold and oriented.
    field : (m, 3), (n, 3) or (e,) array_like of float
        Vectors on faces (tetrahedra), vectors on vertices, or a 1-form: integrals along the edges
        (`mesh.topology.edges` of a surface).
    boundary : {'tangential', 'normal'}
        Harmonic fields are tangential to the boundary, or normal to it.
    place : {'vertex', 'face', 'edge'}, optional
        Elements that carry the values; needed where the shape of `field` fits two kinds.

    Returns
    -------
    Measurement
        `vertex`, `face` or `edge`, the place of the field, holds `exact`, `coexact`, `harmonic` in its shape;
        `vertex["potential"]` (n,), and `copotential` on faces (of 1-forms) or edges; `results` the L2
        `norms`, `betti_numbers` and `generators`; `accuracy` the `orthogonality`, `reconstruction_residual`,
        `harmonic_residual`, relative to the field.

    Raises
    ------
    MeshError
        For a mesh that is not manifold or not oriented.
    ParameterError
        When the shape of the field fits no kind of element, or two.

    References
    ----------
    K. Poelke, K. Polthier, "Boundary-aware Hodge decompositions for piecewise constant vector fields", 2016.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> mesh = ddg.torus(24, 12)
    >>> height = ddg.d0(mesh) @ mesh.points[:, 2]  # the differential of a function is exact
    >>> parts = ddg.hodge_decomposition(mesh, height)
    >>> bool(abs(parts.edge["exact"] - height).max() < 1e-10)
    True
    """
    _check(mesh, boundary)
    if place not in FIELD_PLACES:
        raise ParameterError(
            f"unknown place {place!r}; choose one of {', '.join(FIELD_PLACES[1:])}", parameter="place"
        )
    measured = analysis.hodge_analysis(mesh, (np.atleast_1d(field), place), boundary, False)
    arrays = measured.annotated
    return Measurement(
        mesh,
        arrays.vertex,
        arrays.face,
        arrays.edge,
        measured.results,
        measured.accuracy,
        converged=measured.converged,
    )


def _check(mesh: analysis.SpaceMesh, boundary: str) -> None:
    """Refuse meshes without a decomposition, and unknown boundary conditions."""
    analysis.check_mesh(mesh)
    if boundary not in FIELD_BOUNDARIES:
        raise ParameterError(
            f"{boundary!r} is not one of {', '.join(FIELD_BOUNDARIES)}", parameter="boundary"
        )


@accepts_arrays("surface", "tetrahedra")
def betti_numbers(mesh: analysis.SpaceMesh) -> BettiNumbers:
    """Ranks of the homology of a surface or a solid.

    Parameters
    ----------
    mesh : TriangleMesh, TetMesh or (points, cells) pair
        Manifold and oriented.

    Returns
    -------
    BettiNumbers
        `absolute` and `relative` (to the boundary): tuples by degree.

    Raises
    ------
    MeshError
        For a mesh that is not manifold or not oriented.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> ddg.betti_numbers(ddg.torus(12, 6)).absolute
    (1, 2, 1)
    """
    analysis.check_mesh(mesh)
    return core_betti_numbers(mesh)


@accepts_arrays("surface", "tetrahedra")
def harmonic_basis(mesh: analysis.SpaceMesh, boundary: Boundary = "tangential") -> HarmonicBasis:
    """Orthonormal basis of the harmonic 1-forms.

    Parameters
    ----------
    mesh : TriangleMesh, TetMesh or (points, cells) pair
        Manifold and oriented.
    boundary : {'tangential', 'normal'}
        Harmonic fields are tangential to the boundary, or normal to it.

    Returns
    -------
    HarmonicBasis
        `forms` (b, e), integrals along the edges, with b the first Betti number (relative for 'normal');
        `residual`, the largest weak divergence or curl relative to the forms.

    Raises
    ------
    MeshError
        For a mesh that is not manifold or not oriented.

    References
    ----------
    D. Arnold, R. Falk, R. Winther, "Finite element exterior calculus, homological techniques, and
    applications", 2006.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> mesh = ddg.torus(16, 8)
    >>> basis = ddg.harmonic_basis(mesh)
    >>> len(basis.forms), bool(abs(ddg.d1(mesh) @ basis.forms.T).max() < 1e-10)
    (2, True)
    """
    _check(mesh, boundary)
    return core_harmonic_basis(mesh, boundary)


@accepts_arrays("surface", "tetrahedra")
def homology_generators(mesh: analysis.SpaceMesh) -> list[NDArray[np.int64]]:
    """Closed edge loops that generate the first homology, short ones first.

    Parameters
    ----------
    mesh : TriangleMesh, TetMesh or (points, cells) pair
        Manifold and oriented.

    Returns
    -------
    list of (k,) ndarray of int64
        Vertices of each loop in order; the start is not repeated.

    Raises
    ------
    MeshError
        For a mesh that is not manifold or not oriented.

    References
    ----------
    D. Eppstein, "Dynamic generators of topologically embedded graphs", 2003.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> len(ddg.homology_generators(ddg.torus(12, 6)))
    2
    """
    loops = analysis.hodge_analysis(mesh, None, "tangential", False).results["generators"]
    return [np.array(loop, dtype=np.int64) for loop in loops]
