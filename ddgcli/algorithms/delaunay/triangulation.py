"""Intrinsic Delaunay triangulations: the same surface, vertices and metric, with better edges (chapter 10).

A. Bobenko, B. Springborn, "A discrete Laplace-Beltrami operator for simplicial surfaces", 2007; M. Fisher
et al., "An algorithm for the construction of intrinsic Delaunay triangulations", 2006.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.delaunay.flips import SideArrays, flip_until_delaunay
from ddgcli.errors import MeshError, counted
from ddgcli.geometry.intrinsic import corner_cotan, half_angle_tangent
from ddgcli.mesh.double_cover import CoverVertices, cover_vertices
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.remedies import remedy
from ddgcli.mesh.require import refuse_repeated_vertices, require
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import NEXT, Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators.mollify import Mollification, all_flat, mollify_lengths

log = logging.getLogger("ddgcli")

ANGLE_TOLERANCE = 1e-9  # radians by which opposite angles may sum to more than pi and still count as Delaunay
# excess of the shorter sides over the longest, relative to it, below which lengths need extended precision
CAP_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class IntrinsicDelaunay:
    """An intrinsic Delaunay triangulation and the record of its flips.

    Parameters
    ----------
    mesh : IntrinsicMesh
        With gluing; vertices as in the input.
    flips, rounds : int
    mollification : Mollification
        The lengths at the start of the flips, and the degenerate faces.
    remaining_edges : int
        Edges whose opposite angles exceed pi by more than 1e-9, but which rounding prevents from flipping.
    crossings : (m, 3) ndarray of int64, optional
        Normal coordinates of the sides (see `normal_coordinates`), if they were tracked.
    flipped_sides : (k,) ndarray of int64
        Sides of the input whose edge was flipped; empty unless `list_flipped`.
    notes : tuple of str
        Changes of the input, and decisions by a tolerance.
    cover : CoverVertices, optional
        Vertices of the orientation double cover at the corners of the faces, if flips of a one-sided surface
        were tracked.
    """

    mesh: IntrinsicMesh
    flips: int
    rounds: int
    mollification: Mollification
    remaining_edges: int = 0
    crossings: NDArray[np.int64] | None = None
    flipped_sides: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    notes: tuple[str, ...] = ()
    cover: CoverVertices | None = None


def flip_to_delaunay(
    mesh: TriangleMesh | IntrinsicMesh,
    *,
    track: bool = False,
    list_flipped: bool = False,
    max_rounds: int | None = None,
) -> IntrinsicDelaunay:
    """Compute the intrinsic Delaunay triangulation of a surface by edge flips.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
        A surface without edges of three faces, oriented or one-sided; vertices with several fans are allowed.
        An IntrinsicMesh with gluing may be any Delta-complex (self-edges, several edges between two
        vertices).
    track : bool
        Track normal coordinates, which `common_subdivision` and `one_sided_subdivision` need.
    list_flipped : bool
        List the sides whose edges were flipped.
    max_rounds : int, optional
        Bound on the batches of flips; by default far above what any surface needs.

    Returns
    -------
    IntrinsicDelaunay

    Raises
    ------
    MeshError
        For a non-manifold edge, faces of opposite orientation where the surface has two sides (with
        `list_flipped`, also a one-sided surface), or side lengths that are not valid lengths.

    Notes
    -----
    Every interior edge ends with opposite angles summing to pi at most (up to 1e-9); boundary edges stay.
    Angles are compared and lengths updated through half-angle tangents, which keep their relative precision
    on slivers. Where positions are given and caps would lose their heights in float64 lengths, the flips work
    in extended precision.
    """
    glued = glue(mesh)
    twisted = glued.topology.twisted
    if twisted is not None and list_flipped:
        require_oriented(glued, "this record of the flips")
    start = working_lengths(mesh, glued)
    notes = [str(start)] if len(start.faces) else []
    scale = length_scale(start.length)
    state = SideArrays.of(glued.faces, glued.topology.side_twin, start.length / scale)
    state.twisted = None if twisted is None else twisted.ravel().copy()
    cover = cover_vertices(glued.topology) if track and twisted is not None else None
    if cover is not None:
        state.tail, state.mirror = cover.corner.ravel().copy(), cover.mirror
    if track:
        state.crossings = np.full(3 * glued.n_faces, -1, dtype=np.int64)
    if list_flipped:
        state.input_side = np.arange(3 * glued.n_faces)
    flips, rounds, ended = flip_until_delaunay(state, max_rounds=max_rounds)
    if cover is not None:
        cover = replace(cover, corner=state.tail.reshape(-1, 3).copy())
        state.tail = cover.below[state.tail]
    result = unglue(state, glued, scale)
    remaining = 0 if ended and not state.refused else int(non_delaunay_edges(result).sum())
    if remaining:
        notes.append(remaining_note(remaining))
    for note in notes:
        log.warning(note)
    crossings = None if state.crossings is None else state.crossings.reshape(-1, 3)
    flipped = np.zeros(0, dtype=np.int64) if state.input_side is None else _missing(state.input_side)
    return IntrinsicDelaunay(result, flips, rounds, start, remaining, crossings, flipped, tuple(notes), cover)


def _missing(indices: NDArray) -> NDArray[np.int64]:
    """Indices below len(indices) that do not occur in the array, whose entries -1 are ignored."""
    missing = np.ones(len(indices) + 1, dtype=bool)
    missing[indices] = False
    return missing[:-1].nonzero()[0]


def glue(mesh: TriangleMesh | IntrinsicMesh) -> IntrinsicMesh:
    """Intrinsic mesh of a surface: its side lengths and an explicit gluing of its sides.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh

    Returns
    -------
    IntrinsicMesh

    Raises
    ------
    MeshError
        Where faces do not pair up, or a length is negative or not finite.
    """
    topology = mesh.topology
    if topology.n_faces == 0:
        raise MeshError("no triangles; the intrinsic Delaunay triangulation needs a surface")
    if topology.gluing is None:
        topology = Topology(topology.faces, topology.n_vertices, *_twins(mesh))
    elif not _is_gluing(topology):
        raise MeshError("the gluing does not pair sides that run from b to a with sides that run from a to b")
    length = mesh.side_length
    if not (length.min() >= 0 and length.max() < np.inf):
        bad = np.flatnonzero(~(np.isfinite(length) & (length >= 0)).all(axis=1))[0]
        raise MeshError(
            f"face {bad} has a side length that is negative or not finite ({length[bad]}); correct it"
        )
    return IntrinsicMesh(topology, length, mesh.points)


def _twins(mesh: TriangleMesh | IntrinsicMesh) -> tuple[NDArray[np.int64], NDArray[np.bool_] | None]:
    """(m, 3) gluing of a simplicial mesh, and the twisted sides of a one-sided surface.

    MeshError where faces do not pair up, or a surface with two sides is not oriented.
    """
    topology = mesh.topology
    turned = topology.misoriented_edges
    if len(turned) or len(topology.nonmanifold_edges) or len(topology.repeated_vertex_faces):
        require_surface(mesh, "the intrinsic Delaunay triangulation", one_sided=True)
    if not len(turned):
        return topology.side_twin, None
    is_turned = np.zeros(topology.n_edges, dtype=bool)
    is_turned[turned] = True
    return topology.side_twin, is_turned[topology.side_edge]


def require_oriented(mesh: TriangleMesh | IntrinsicMesh, subject: str) -> None:
    """Raise MeshError on a one-sided surface."""
    if mesh.topology.one_sided_face.any():
        raise MeshError(
            f"the surface is one-sided; {subject} needs two sides: {remedy('one side', mesh.topology)}"
        )


def require_surface(mesh: TriangleMesh | IntrinsicMesh, subject: str, *, one_sided: bool = False) -> None:
    """Raise an error for a mesh whose faces cannot be glued in pairs.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    subject : str
        Subject of the message.
    one_sided : bool
        Whether components without an orientation are accepted.

    Raises
    ------
    MeshError
    """
    refuse_repeated_vertices(mesh)
    require(mesh, subject, sized=False)
    try:
        need = {"sized": False, "manifold_edges": True, "oriented": True, "one_sided": one_sided}
        require(mesh, subject, **need)
    except MeshError as error:
        raise MeshError(f"{error}; the operator 'tufted' of laplacian supports such meshes") from None


def _is_gluing(topology: Topology) -> bool:
    twin = topology.side_twin.ravel()
    side = np.flatnonzero(twin >= 0)
    partner = twin[side]
    tail = topology.side_tail[partner]
    end = topology.side_head[partner]
    if topology.twisted is not None:
        twisted = topology.twisted.ravel()[side]
        end = np.where(twisted, tail, end)
    return bool(
        (twin[partner] == side).all() and (partner != side).all() and (topology.side_tail[side] == end).all()
    )


def check_area(mesh: TriangleMesh | IntrinsicMesh) -> None:
    """Raise an error for a surface without area, as the flips do, at little cost on others.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh

    Raises
    ------
    MeshError
    """
    if all_flat(mesh.side_length):
        working_lengths(mesh, glue(mesh))  # in extended precision some face may have an area


def working_lengths(mesh: TriangleMesh | IntrinsicMesh, glued: IntrinsicMesh) -> Mollification:
    """Side lengths for the flips, mollified where a triangle has no area.

    In extended precision if the mesh has positions and caps so flat that float64 lengths would lose their
    heights (float64 on platforms without extended precision).

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
        The input.
    glued : IntrinsicMesh
        The same by `glue`.

    Returns
    -------
    Mollification

    Raises
    ------
    MeshError
        When no face has an area.
    """
    length = glued.side_length
    if len(_caps(length, CAP_TOLERANCE)) == 0:
        return Mollification(length, np.zeros(0, dtype=np.int64))
    if isinstance(mesh, TriangleMesh):
        corners = mesh.points.astype(np.longdouble)[mesh.faces]
        scale = np.abs(corners).max() or 1.0
        length = scale * np.sqrt((((corners[:, NEXT] - corners) / scale) ** 2).sum(axis=2))
    return mollify_lengths(length, glued.topology.side_edge)


def _caps(length: NDArray, least: float) -> NDArray[np.int64]:
    """Faces whose two shorter sides together exceed the longest by at most a fraction `least` of it."""
    a, b, c = length.T
    longest = np.maximum(np.maximum(a, b), c)
    return np.flatnonzero(a + b + c <= (2.0 + least) * longest)


def length_scale(length: NDArray) -> float:
    """Power of two near the mean length: dividing by it is exact and keeps products in range.

    Parameters
    ----------
    length : ndarray of float64

    Returns
    -------
    float
        1 if the mean is zero.
    """
    mean = float(length.mean()) if length.size else 1.0
    return float(2.0 ** np.round(np.log2(mean))) if mean > 0 else 1.0


def unglue(state: SideArrays, mesh: IntrinsicMesh, scale: float, *, n_new: int = 0) -> IntrinsicMesh:
    """The mesh in the work arrays.

    Parameters
    ----------
    state : SideArrays
    mesh : IntrinsicMesh
        The input of the work arrays.
    scale : float
        Factor from the lengths of the work arrays to those of the mesh.
    n_new : int
        Number of vertices added to those of the input; the result then has no positions.

    Returns
    -------
    IntrinsicMesh
    """
    twisted = None if state.twisted is None else state.twisted.reshape(-1, 3)
    n, gluing = mesh.n_vertices + n_new, state.twin[:-1].reshape(-1, 3)
    topology = Topology(state.tail.reshape(-1, 3), n, gluing, twisted)
    return IntrinsicMesh(topology, scale * state.length.reshape(-1, 3), None if n_new else mesh.points)


def remaining_note(count: int) -> str:
    """Warning of edges that are not Delaunay after the flips.

    Parameters
    ----------
    count : int

    Returns
    -------
    str
    """
    edges = counted(count, "edge of flat triangles is", "edges of flat triangles are")
    return f"{edges} not flipped: rounding decides the Delaunay test"


def non_delaunay_edges(mesh: TriangleMesh | IntrinsicMesh) -> NDArray[np.bool_]:
    """Interior edges whose opposite angles sum to more than pi, beyond a tolerance.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh

    Returns
    -------
    (m, 3) ndarray of bool
        True at one side of each such edge.
    """
    angle = 2.0 * np.arctan(half_angle_tangent(mesh.side_length))
    opposite = angle[:, [2, 0, 1]].ravel()
    twin = mesh.topology.side_twin.ravel()
    first = twin > np.arange(len(twin))
    total = opposite + opposite[np.maximum(twin, 0)]
    return (first & (total > np.pi + ANGLE_TOLERANCE)).reshape(-1, 3)


def negative_cotan_edges(mesh: TriangleMesh | IntrinsicMesh) -> int:
    """Count the edges of negative cotangent weight, boundary edges included.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh

    Returns
    -------
    int
        Without weights that are zero up to 1e-9 of their terms.
    """
    cotan = corner_cotan(mesh.side_length)[:, [2, 0, 1]].ravel()
    edge = mesh.topology.side_edge.ravel()
    weight, size = (sum_by_index(edge, c, mesh.topology.n_edges) for c in (cotan, np.abs(cotan)))
    return int((weight < -ANGLE_TOLERANCE * np.maximum(size, 1.0)).sum())
