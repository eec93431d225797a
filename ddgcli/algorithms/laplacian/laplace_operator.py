"""The Laplacian of a mesh as the `laplacian` command hands it out: which operator, which mass, how good."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ddgcli.algorithms.delaunay.triangulation import flip_to_delaunay
from ddgcli.errors import MeshError, ParameterError
from ddgcli.mesh.require import require
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
from ddgcli.operators.mollify import Mollified, mollified_mesh
from ddgcli.operators.tufted import tufted_cover

log = logging.getLogger("ddgcli")

OPERATORS = ("cotan", "intrinsic-delaunay", "tufted", "uniform")
MASSES = {"lumped": lumped_mass, "voronoi": voronoi_mass, "galerkin": galerkin_mass}


@dataclass(frozen=True, eq=False)
class LaplaceOperator:
    """Stiffness and mass of a mesh.

    Parameters
    ----------
    name, mass_name : str
    stiffness, mass : (n, n) csr_array
        L positive semidefinite and M, so that L x = lambda M x; rows of vertices without faces are empty.
    surface : TriangleMesh or IntrinsicMesh
        The triangulation they were assembled on.
    facts : dict
        What was done: flips, mollified faces, ...
    """

    name: str
    mass_name: str
    stiffness: csr_array
    mass: csr_array
    surface: SurfaceMesh
    facts: dict[str, Any] = field(default_factory=dict)

    @property
    def used(self) -> NDArray[np.int64]:
        """Vertices that a face uses."""
        return np.flatnonzero(self.mass.diagonal() > 0)


def laplace_operator(
    mesh: TriangleMesh,
    operator: str | None = None,
    mass: str = "lumped",
    *,
    most_rounds: int | None = None,
) -> LaplaceOperator:
    """Stiffness and mass of the chosen operator.

    Parameters
    ----------
    mesh : TriangleMesh
        Any triangle soup for `cotan`, `tufted` and `uniform`; for `intrinsic-delaunay` an oriented surface
        without edges of three faces.
    operator : {'cotan', 'intrinsic-delaunay', 'tufted', 'uniform'}, optional
        Default `intrinsic-delaunay`, and `tufted` where the mesh is not manifold or not oriented (told).
    mass : {'lumped', 'voronoi', 'galerkin'}
        Of the triangulation that the operator lives on.
    most_rounds : int, optional
        Bound on the batches of Delaunay flips (see `flip_to_delaunay`); past it weights may be negative.

    Raises
    ------
    MeshError
        For a mesh without area, or one that cannot have the operator; the message names one that can.
    """
    if operator is not None and operator not in OPERATORS:
        raise ParameterError(f"operator {operator!r} is not one of {', '.join(OPERATORS)}")
    if mass not in MASSES:
        raise ParameterError(f"mass {mass!r} is not one of {', '.join(MASSES)}")
    require(mesh, "laplacian")
    mesh = _without_repeated_corners(mesh)
    name = operator or _default_operator(mesh)
    if name == "intrinsic-delaunay":
        _require_surface(mesh)
    _tell_isolated(mesh)
    surface, share, facts = _triangulation(name, mesh, most_rounds)
    L = uniform_stiffness(mesh) if name == "uniform" else share * stiffness(surface)
    return LaplaceOperator(name, mass, csr_array(L), csr_array(share * MASSES[mass](surface)), surface, facts)


def _triangulation(
    name: str, mesh: TriangleMesh, most_rounds: int | None
) -> tuple[SurfaceMesh, float, dict[str, Any]]:
    """The triangulation to assemble on, the share of it that the mesh is, and what was mended and flipped."""
    if name in ("cotan", "uniform"):
        surface, mended = mollified_mesh(mesh)
        if len(mended.faces):
            log.warning("%s", mended)
        return surface, 1.0, _mended(mended)
    flipped = flip_to_delaunay(tufted_cover(mesh) if name == "tufted" else mesh, most_rounds=most_rounds)
    facts = {"flips": flipped.flips} | _mended(flipped.mollified)
    return flipped.mesh, 0.5 if name == "tufted" else 1.0, facts


def _mended(mended: Mollified) -> dict[str, Any]:
    if len(mended.faces) == 0:
        return {}
    return {"mollified_faces": len(mended.faces), "mollified_edges": mended.edges}


def _default_operator(mesh: TriangleMesh) -> str:
    topology = mesh.topology
    if topology.is_manifold and topology.is_oriented:
        return "intrinsic-delaunay"
    reason = "not manifold" if not topology.is_manifold else "not consistently oriented"
    log.warning("the mesh is %s: the tufted Laplacian is used", reason)
    return "tufted"


def _require_surface(mesh: TriangleMesh) -> None:
    topology = mesh.topology
    if len(topology.nonmanifold_edges) or not topology.is_oriented:
        edge = (
            topology.nonmanifold_edges if len(topology.nonmanifold_edges) else topology.misoriented_edges
        )[0]
        a, b = topology.edges[edge]
        what = "more than two faces" if len(topology.nonmanifold_edges) else "faces of opposite orientation"
        raise MeshError(
            f"edge {a}-{b} joins {what}: the mesh cannot have the operator 'intrinsic-delaunay'; "
            "use --operator tufted (or cotan)"
        )


def _without_repeated_corners(mesh: TriangleMesh) -> TriangleMesh:
    """The mesh without faces that name a vertex twice; they carry neither area nor stiffness."""
    a, b, c = mesh.faces.T
    bad = (a == b) | (b == c) | (c == a)
    if not bad.any():
        return mesh
    log.warning(
        "%d faces name a vertex twice (first: face %d) and are left out", bad.sum(), np.flatnonzero(bad)[0]
    )
    kept = TriangleMesh(mesh.points, Topology(mesh.faces[~bad], mesh.n_vertices))
    require(kept, "laplacian")
    return kept


def _tell_isolated(mesh: TriangleMesh) -> None:
    isolated = np.flatnonzero(~mesh.topology.referenced_vertex)
    if len(isolated):
        log.warning(
            "%d vertices belong to no face (first: vertex %d): their rows are empty and their values 0",
            len(isolated),
            isolated[0],
        )


def negative_weights(L: csr_array) -> int:
    """Number of edges with negative weight (positive off-diagonal entry) beyond rounding."""
    coo = L.tocoo()
    diagonal = L.diagonal()
    upper = coo.row < coo.col
    row, col, value = coo.row[upper], coo.col[upper], coo.data[upper]
    return int((value > 1e-12 * np.maximum(diagonal[row], diagonal[col])).sum())


def symmetry_residual(L: csr_array) -> float:
    """Largest |L - L'| relative to the largest |L|."""
    return float(abs(L - L.T).max() / (abs(L).max() or 1.0))
