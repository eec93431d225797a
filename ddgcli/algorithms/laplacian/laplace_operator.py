"""The Laplacian of a mesh with a choice of operator and mass matrix, and measures of its quality."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ddgcli.algorithms.delaunay.triangulation import flip_to_delaunay
from ddgcli.choices import LAPLACE_OPERATORS, MASSES
from ddgcli.errors import MeshError, ParameterError, counted
from ddgcli.geometry.remedies import warn_of_pieces, warn_of_solid
from ddgcli.mesh.require import require
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators.laplacian import (
    SurfaceMesh,
    galerkin_mass,
    lumped_mass,
    stiffness,
    uniform_stiffness,
    voronoi_mass,
)
from ddgcli.operators.mollify import Mollification, all_flat, mollify_mesh
from ddgcli.operators.tufted import tufted_cover
from ddgcli.representation import short_repr

log = logging.getLogger("ddgcli")

MASS_FUNCTIONS = {"lumped": lumped_mass, "voronoi": voronoi_mass, "galerkin": galerkin_mass}


@dataclass(frozen=True, eq=False)
class LaplaceOperator:
    """Stiffness and mass of a mesh.

    Parameters
    ----------
    name, mass_name : str
    stiffness, mass : (n, n) csr_array
        L positive semidefinite and M, so that L x = lambda M x; rows of vertices without faces are empty.
    surface : TriangleMesh or IntrinsicMesh
        The triangulation on which they are assembled; of tetrahedra their boundary.
    preparation : dict
        Counts of the preparation: flips, mollified faces, mollified edges.
    dimension : int
        2 for a surface, 3 for tetrahedra: the mass is in length^dimension.
    """

    name: str
    mass_name: str
    stiffness: csr_array
    mass: csr_array
    surface: SurfaceMesh
    preparation: dict[str, Any] = field(default_factory=dict)
    dimension: int = 2

    __repr__ = short_repr

    @property
    def referenced_vertices(self) -> NDArray[np.int64]:
        """Vertices that a face or tetrahedron uses."""
        return np.flatnonzero(self.mass.diagonal() > 0)

    def integrated(self, values: NDArray, parameter: str) -> NDArray[np.float64]:
        """M f for finite (n, ...) values; ParameterError of `parameter` where sums of it overflow."""
        with np.errstate(over="ignore", invalid="ignore"):
            result = self.mass @ values
            total = np.abs(result).sum()
        if not np.isfinite(total):
            measure = {2: "area", 3: "volume"}[self.dimension]
            raise ParameterError(
                f"values of up to {np.abs(values).max():.3g} are too large: their integral over the "
                f"{measure} of {self.mass.sum():.3g} overflows; rescale the array",
                parameter=parameter,
            )
        return result


def laplace_operator(
    mesh: TriangleMesh | TetMesh,
    operator: str | None = None,
    mass: str = "lumped",
    *,
    max_rounds: int | None = None,
) -> LaplaceOperator:
    """Stiffness and mass of the chosen operator.

    Parameters
    ----------
    mesh : TriangleMesh or TetMesh
        Any triangle soup for `cotan`, `tufted` and `uniform`; for `intrinsic-delaunay` a surface without
        edges of three faces, oriented or one-sided. Tetrahedra have `cotan` (the default) and `uniform`, with
        lumped or galerkin mass (see `solid_matrices`).
    operator : {'cotan', 'intrinsic-delaunay', 'tufted', 'uniform'}, optional
        Default `intrinsic-delaunay`, and `tufted` with a warning if the mesh is not manifold or not oriented.
    mass : {'lumped', 'voronoi', 'galerkin'}
        Mass matrix of the operator's triangulation.
    max_rounds : int, optional
        Bound on the batches of Delaunay flips (see `flip_to_delaunay`); past it weights may be negative.

    Returns
    -------
    LaplaceOperator

    Raises
    ------
    MeshError
        For a mesh without area, or one that the operator does not support; the message names one that does.
    ParameterError
        Unknown operator or mass.
    """
    check_names(operator, mass)
    if isinstance(mesh, TetMesh):
        return _solid_operator(mesh, operator or "cotan", mass)
    require(mesh, "laplacian")
    mesh = _without_repeated_corners(mesh)
    name = operator or _default_operator(mesh)
    if name == "intrinsic-delaunay":
        _require_surface(mesh)
    _warn_of_isolated_vertices(mesh.topology.referenced_vertex)
    warn_of_pieces(mesh)
    surface, share, preparation = _triangulation(name, mesh, max_rounds)
    L = uniform_stiffness(mesh) if name == "uniform" else share * stiffness(surface)
    return LaplaceOperator(
        name, mass, csr_array(L), csr_array(share * MASS_FUNCTIONS[mass](surface)), surface, preparation
    )


def check_names(operator: str | None, mass: str) -> None:
    """Raise ParameterError for an operator or a mass that does not exist."""
    if operator is not None and operator not in LAPLACE_OPERATORS:
        raise ParameterError(
            f"{operator!r} is not one of {', '.join(LAPLACE_OPERATORS)}", parameter="operator"
        )
    if mass not in MASSES:
        raise ParameterError(f"{mass!r} is not one of {', '.join(MASSES)}", parameter="mass")


def check_operator(mesh: TriangleMesh | TetMesh, operator: str | None, mass: str) -> None:
    """Raise the errors of `laplace_operator`, without the matrices.

    Parameters
    ----------
    mesh : TriangleMesh or TetMesh
    operator : str or None
    mass : str
        As in `laplace_operator`.

    Raises
    ------
    ParameterError, MeshError
    """
    check_names(operator, mass)
    if isinstance(mesh, TetMesh):
        from ddgcli.algorithms.laplacian.solid_operator import check_solid_operator

        check_solid_operator(mesh, operator or "cotan", mass)
        return
    require(mesh, "laplacian")
    cleaned = _without_repeated_corners(mesh)
    if operator == "intrinsic-delaunay":
        _require_surface(cleaned)
    if all_flat(cleaned.side_length):
        _triangulation(operator or _default_operator(cleaned), cleaned, None)


def _solid_operator(mesh: TetMesh, name: str, mass: str) -> LaplaceOperator:
    from ddgcli.algorithms.laplacian.solid_operator import solid_matrices

    L, M = solid_matrices(mesh, name, mass)
    _warn_of_isolated_vertices(mesh.vertex_component >= 0, "tetrahedron")
    warn_of_solid(mesh)
    return LaplaceOperator(name, mass, L, M, mesh.boundary, dimension=3)


def _triangulation(
    name: str, mesh: TriangleMesh, max_rounds: int | None
) -> tuple[SurfaceMesh, float, dict[str, Any]]:
    """The triangulation to assemble on, the mesh's share of its area, and counts of what was changed."""
    if name in ("cotan", "uniform"):
        surface, mollification = mollify_mesh(mesh)
        if len(mollification.faces):
            log.warning("%s", mollification)
        return surface, 1.0, _mollification_counts(mollification)
    flipped = flip_to_delaunay(tufted_cover(mesh) if name == "tufted" else mesh, max_rounds=max_rounds)
    preparation = {"flips": flipped.flips} | _mollification_counts(flipped.mollification)
    return flipped.mesh, 0.5 if name == "tufted" else 1.0, preparation


def _mollification_counts(mollification: Mollification) -> dict[str, Any]:
    if len(mollification.faces) == 0:
        return {}
    return {"mollified_faces": len(mollification.faces), "mollified_edges": mollification.edges}


def _default_operator(mesh: TriangleMesh) -> str:
    topology = mesh.topology
    if topology.is_manifold and not _opposite_faces(topology).size:
        return "intrinsic-delaunay"
    reason = "not manifold" if not topology.is_manifold else "not consistently oriented"
    log.warning("the mesh is %s: using `operator=tufted`", reason)
    return "tufted"


def _require_surface(mesh: TriangleMesh) -> None:
    topology = mesh.topology
    opposite = _opposite_faces(topology)
    if len(topology.nonmanifold_edges) or len(opposite):
        edge = (topology.nonmanifold_edges if len(topology.nonmanifold_edges) else opposite)[0]
        a, b = topology.edges[edge]
        what = "more than two faces" if len(topology.nonmanifold_edges) else "faces of opposite orientation"
        raise MeshError(
            f"edge {a}-{b} joins {what}, which `operator=intrinsic-delaunay` does not support; "
            "use `operator=tufted` or `operator=cotan`"
        )


def _opposite_faces(topology: Topology) -> NDArray[np.int64]:
    """Edges between faces of opposite orientation, but for one-sided components, which have none."""
    bad = topology.misoriented_edges
    if not len(bad):
        return bad
    return bad[topology.orientable_component[topology.vertex_component[topology.edges[bad, 0]]]]


def _without_repeated_corners(mesh: TriangleMesh) -> TriangleMesh:
    """The mesh without faces that name a vertex twice, which have neither area nor stiffness."""
    bad = mesh.topology.repeated_vertex_faces
    if not len(bad):
        return mesh
    log.warning(
        "%s a vertex twice (first: face %d): left out", counted(len(bad), "face names", "faces name"), bad[0]
    )
    cleaned = TriangleMesh(mesh.points, Topology(np.delete(mesh.faces, bad, axis=0), mesh.n_vertices))
    require(cleaned, "laplacian")
    return cleaned


def _warn_of_isolated_vertices(referenced: NDArray, cell: str = "face") -> None:
    isolated = np.flatnonzero(~referenced)
    if len(isolated):
        log.warning(
            "%s to no %s (first: vertex %d): rows there are empty and values 0",
            counted(len(isolated), "vertex belongs", "vertices belong"),
            cell,
            isolated[0],
        )


def negative_weights(L: csr_array) -> int:
    """Number of edges with negative weight, that is a positive off-diagonal entry, beyond rounding.

    Parameters
    ----------
    L : (n, n) csr_array
        Stiffness.

    Returns
    -------
    int
    """
    diagonal = L.diagonal()
    positive = np.flatnonzero(L.data > 0)  # these are few but for the diagonal
    if len(positive) == np.count_nonzero(diagonal > 0):
        return 0
    row = np.repeat(np.arange(L.shape[0], dtype=L.indices.dtype), np.diff(L.indptr)).take(positive)
    col = L.indices.take(positive)
    upper = np.flatnonzero(row < col)
    largest = np.maximum(diagonal.take(row.take(upper)), diagonal.take(col.take(upper)))
    return int((L.data.take(positive.take(upper)) > 1e-12 * largest).sum())


def symmetry_residual(L: csr_array) -> float:
    """Largest entry of |L - L'| relative to the largest of |L|.

    Parameters
    ----------
    L : (n, n) csr_array

    Returns
    -------
    float
    """
    transposed = L.tocsc()  # the arrays of L' by rows
    if np.array_equal(transposed.indptr, L.indptr) and np.array_equal(transposed.indices, L.indices):
        difference = np.abs(transposed.data - L.data).max(initial=0.0)
    else:
        difference = abs(L - L.T).max()
    return float(difference / (np.abs(L.data).max(initial=0.0) or 1.0))
