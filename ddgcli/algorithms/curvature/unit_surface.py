"""A surface at unit size with the quantities that are exact on the polyhedron; warnings of its defects."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature import measures as exact
from ddgcli.algorithms.curvature import totals
from ddgcli.algorithms.curvature.balance import RegionBalance, upper_half
from ddgcli.algorithms.curvature.grid_coordinates import precision_steps
from ddgcli.algorithms.curvature.one_sided import double_covered
from ddgcli.errors import MeshError, counted
from ddgcli.geometry.extrinsic import edge_blocks, folded_edges, single_edge_length
from ddgcli.geometry.faces import Faces
from ddgcli.geometry.remedies import warn_of_pieces
from ddgcli.mesh.remedies import remedy
from ddgcli.mesh.repair import faces_to_turn, reverse_faces
from ddgcli.mesh.require import check_size
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import bounding_box

_log = logging.getLogger("ddgcli")

VOLUME_ROUNDING = 1e-13  # of the volume at unit size, over the area: two coincident sheets enclose none

TWO_SIDED_SCHEMES = ("normal-cycle", "corrected", "normal-voting")


@dataclass(frozen=True, eq=False)
class UnitSurface:
    """The mesh at unit size, consistently oriented where it is orientable, with its exact quantities.

    `volume` is None unless the surface is closed and two-sided. `balance` has the residuals of
    `RegionBalance` for half the surface, None where it is one-sided or not manifold. `cover` is None but of a
    one-sided manifold: there it is its double cover, whose vertex `copy[v]` stands for v. `steps` are
    those of `precision_steps` at unit size.
    """

    mesh: TriangleMesh
    faces: Faces
    scale: float
    orientable: bool
    volume: float | None
    area: NDArray
    defect: NDArray
    normal: NDArray
    dihedral: NDArray
    edge_length: NDArray
    vector: NDArray
    link_conormal: NDArray
    link_length: NDArray
    balance: dict[str, float] | None
    cover: UnitSurface | None = None
    copy: NDArray | None = None
    steps: NDArray | None = None

    @property
    def area_vector(self) -> NDArray[np.float64] | None:
        """(3, n) sum of the faces' normals times twice their areas over each star, all on one side.

        None of a surface that is one-sided and not manifold: there stars have no sides.
        """
        if self.cover is not None:
            return self.cover.faces.doubled_star[:, self.copy]
        return self.faces.doubled_star if self.orientable else None


def one_sided_error(mesh: TriangleMesh, scheme: str) -> MeshError:
    """Error of a scheme that requires two sides, on a surface that has one.

    Parameters
    ----------
    mesh : TriangleMesh
    scheme : str

    Returns
    -------
    MeshError
    """
    return MeshError(
        f"the surface is one-sided (not orientable) and {scheme} needs two sides; "
        f"use `scheme=quadric` or `scheme=cotan`, or {remedy('one side', mesh.topology)}"
    )


def prepare_surface(mesh: TriangleMesh, scheme: str) -> UnitSurface:
    """Scale a surface to unit size, measure what is exact on polyhedra, and warn of its defects.

    Parameters
    ----------
    mesh : TriangleMesh
    scheme : str
        For the warnings.

    Returns
    -------
    UnitSurface
        Scaled by a power of two, which is exact; faces oriented where the surface is orientable.

    Raises
    ------
    MeshError
        When the surface has no extent or no area.
    """
    in_face = mesh.topology.referenced_vertex
    low, high = mesh.bounding_box if in_face.all() else bounding_box(mesh.points[in_face])
    middle = low / 2 + high / 2
    extent = float(np.maximum(high - middle, middle - low).max())
    check_size(extent)
    scale = 2.0 ** round(math.log2(extent))
    points = mesh.points - middle
    points /= scale
    unit = mesh.moved_unchecked(points)
    orientable = mesh.topology.is_oriented or mesh.topology.is_orientable
    if not mesh.topology.is_oriented:
        unit = _oriented(unit, faces_to_turn(unit))
    faces = Faces.of(unit)
    measures = _measures(faces, unit.topology)  # first: it stores normals and areas of the faces
    volume = exact.volume_of(faces) if unit.topology.is_closed and orientable else None
    _warn_of_defects(unit, faces, orientable, scheme, volume)
    surface = _unit_surface(unit, faces, measures, scale, orientable, volume)
    if (steps := precision_steps(mesh.points)) is not None:
        surface = replace(surface, steps=steps / scale)
    _warn_of_folds(surface)
    if orientable or not unit.topology.is_manifold:
        return surface
    cover, copy = double_covered(unit)
    faces = Faces.of(cover)
    measures = _measures(faces, cover.topology)
    return replace(surface, cover=_unit_surface(cover, faces, measures, scale, True, None), copy=copy)


def _measures(faces: Faces, topology: Topology) -> list[NDArray[np.float64]]:
    """Area, defect, vector, link conormal and link length of each vertex."""
    return exact.star_measures(faces, topology, exact.link_conormal, exact.link_length)


def _warn_of_folds(surface: UnitSurface) -> None:
    folded = folded_edges(surface.dihedral)
    if len(folded):
        _log.warning(
            "%s folded by 180 degrees (first: vertices %d-%d): whether such a fold is convex is "
            "rounding, and so are the signs of its curvature and its part of the total mean curvature",
            counted(len(folded), "edge is", "edges are"),
            *surface.mesh.topology.edges[folded[0]],
        )


def _unit_surface(
    mesh: TriangleMesh,
    faces: Faces,
    measures: list[NDArray[np.float64]],
    scale: float,
    orientable: bool,
    volume: float | None,
) -> UnitSurface:
    """The surface of `_measures`."""
    area, defect, vector, conormal, link = measures
    normal = totals.filled_normals(faces, mesh.topology)
    dihedral, edge_length, balance = _edge_measures(faces, mesh.topology, normal)
    return UnitSurface(
        mesh,
        faces,
        scale,
        orientable,
        volume,
        area,
        defect,
        normal,
        dihedral,
        edge_length,
        vector,
        conormal,
        link,
        balance,
    )


def _edge_measures(
    faces: Faces, topology: Topology, normal: NDArray
) -> tuple[NDArray[np.float64], NDArray[np.float64], dict[str, float] | None]:
    """Dihedral angles and lengths of the edges, and the balance of half the surface where it has sides."""
    angle, length = np.zeros(topology.n_edges), single_edge_length(faces.points, topology)
    has_balance = topology.is_oriented and topology.is_manifold
    balance = RegionBalance(faces, topology, normal, upper_half(faces)) if has_balance else None
    for block in edge_blocks(faces.points, topology, normal):
        angle[block.edge], length[block.edge] = block.angle, block.length
        if balance is not None:
            balance.add(block, block.angle)
    return angle, length, None if balance is None else balance.residuals()


def _oriented(mesh: TriangleMesh, turn: NDArray) -> TriangleMesh:
    if turn.any():
        _log.warning(
            "%s oriented against the neighbours (first: face %d), and turned over for the measurement",
            counted(int(turn.sum()), "face is", "faces are"),
            np.flatnonzero(turn)[0],
        )
    return reverse_faces(mesh, turn)


def _warn_of_defects(
    mesh: TriangleMesh, faces: Faces, orientable: bool, scheme: str, volume: float | None
) -> None:
    topology = mesh.topology
    flat = np.flatnonzero(faces.flat)
    if len(flat) == mesh.n_faces:
        raise MeshError("no face has area; curvature needs a surface: check the coordinates")
    if not orientable:
        if scheme in TWO_SIDED_SCHEMES:
            raise one_sided_error(mesh, scheme)
        _log.warning(
            "the surface is one-sided (not orientable): the signs of mean and principal curvature hold only "
            "locally, and the total mean curvature is undefined"
        )
    if len(flat):
        _log.warning("%s no area (first: face %d)", counted(len(flat), "face has", "faces have"), flat[0])
    if not topology.is_manifold:
        _log.warning(
            "the surface is not manifold (%s with more than two faces, %s with several fans): "
            "curvature there is that of the whole star, and dihedral angles of such edges are 0",
            counted(len(topology.nonmanifold_edges), "edge", "edges"),
            counted(len(topology.nonmanifold_vertices), "vertex", "vertices"),
        )
    warn_of_pieces(mesh)
    spare = int((~topology.referenced_vertex).sum())
    if spare:
        words = counted(spare, "vertex belongs", "vertices belong")
        _log.warning("%s to no face of the surface: all values there are 0", words)
    if volume is not None and volume < -VOLUME_ROUNDING * float(faces.area.sum()):
        _log.warning(
            "the faces point inward (negative volume): mean and principal curvatures change their sign"
        )
