"""Remedies that depend on the mesh: for ill-conditioned systems, and for components in pieces."""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import counted
from ddgcli.geometry.extrinsic import dihedral_angle, folded_edges
from ddgcli.geometry.t_junctions import t_junctions
from ddgcli.mesh.coincident_faces import crack_faces, flat_gaps
from ddgcli.mesh.components import connected_labels
from ddgcli.mesh.flat_cells import without_flat_cells
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.ragged import repeated_rows
from ddgcli.mesh.remedies import remedy
from ddgcli.mesh.repair import merged_points
from ddgcli.mesh.require_solid import MAX_TRIED, fold_message
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh, unit_side_blocks
from ddgcli.mesh.vectors import cross, dot, vector_length

THIN_TRIANGLE = 1e-5  # area over squared longest side below which a triangle alone leaves such errors


def remedy_for_bad_shapes(mesh: SurfaceMesh | TetMesh) -> str:
    """What to do about cells whose shapes cause large rounding errors, for error messages.

    Thin triangles that have area are left by the repair; their vertices have to move.

    Parameters
    ----------
    mesh : TriangleMesh, IntrinsicMesh or TetMesh

    Returns
    -------
    str
        The advice; names a repair if the repair changes this mesh.
    """
    if isinstance(mesh, TetMesh):
        if not 0 < len(mesh.flat_tetrahedra) < len(mesh.tetrahedra):
            return "thin tetrahedra leave rounding errors; move their vertices, or mesh the body again"
        return f"cells without volume leave rounding errors; {remedy('no volume')}"
    if isinstance(mesh, TriangleMesh) and _repair_helps(mesh):
        return f"faces without area or folded onto others leave rounding errors; {remedy('folds')}"
    return "thin triangles leave rounding errors; move their vertices, or mesh the surface again"


def _repair_helps(mesh: TriangleMesh) -> bool:
    """Whether the repair removes faces, or parts folded ones and no thin triangles are left."""
    n_flat = len(mesh.flat_faces)
    if n_flat:
        return n_flat < mesh.n_faces
    return len(folded_edges(dihedral_angle(mesh))) > 0 and not _has_thin_triangles(mesh)


def _has_thin_triangles(mesh: TriangleMesh) -> bool:
    for _, side in unit_side_blocks(mesh):
        double_area = vector_length(cross(side[:, 0], side[:, 1]).T)
        if (double_area < 2.0 * THIN_TRIANGLE * dot(side, side).max(axis=0)).any():
            return True
    return False


def warn_of_solid(mesh: TetMesh) -> None:
    """Warn of cells that overlap, of boundary faces that lie on each other, and of bodies in pieces.

    Parameters
    ----------
    mesh : TetMesh
    """
    log = logging.getLogger("ddgcli")
    if message := fold_message(mesh):
        log.warning(
            "%s: integrals count their volume twice, and Betti numbers are those of a body in space with the "
            "same boundary; move vertices, or mesh the body again", message,
        )  # fmt: skip
    if n_gaps := len(flat_gaps(mesh)):
        log.warning(
            "%s between boundary faces that lie on each other, where a flat tetrahedron is missing: the body "
            "is cut open there; %s", counted(n_gaps, "flat gap", "flat gaps"), _gap_remedy(mesh),
        )  # fmt: skip
    if len(crack := crack_faces(mesh)):
        log.warning(
            "%s at the positions of another one of the same body, first that of vertices %s: the body is "
            "cracked there; %s", counted(len(crack), "boundary face lies", "boundary faces lie"),
            "-".join(map(str, mesh.boundary.faces[crack[0]].tolist())), _crack_remedy(mesh),
        )  # fmt: skip
    warn_of_pieces(mesh)


def _gap_remedy(mesh: TetMesh) -> str:
    """How to close flat gaps: by a repair that is tried here, unless there are too many."""
    gaps = flat_gaps(mesh, merged=False)
    is_welded = len(gaps) == len(flat_gaps(mesh))
    if len(gaps) <= MAX_TRIED:
        after = mesh if is_welded else _welded_solid(mesh)
        if len(flat_gaps(TetMesh(after.points, without_flat_cells(after).tetrahedra))):
            return "no repair closes all of them; mesh the body again"
    return remedy("flat gaps" if is_welded else "flat gaps of pieces")


def _crack_remedy(mesh: TetMesh) -> str:
    """How to close a crack: by a weld, unless bodies touch after it that it does not join."""
    joined = _welded_solid(mesh)
    topology = joined.boundary.topology
    if np.bincount(joined.cell_triangle.ravel()).max() > 2 or not topology.is_manifold:
        return "a weld does not join all of its sides; mesh the body again unless it is meant"
    return f"unless it is meant, {remedy('cracks')}"


def _welded_solid(mesh: TetMesh) -> TetMesh:
    points, place = merged_points(mesh.points)
    return TetMesh(points, place[mesh.tetrahedra])


def warn_of_pieces(mesh: TriangleMesh | TetMesh) -> None:
    """Warn of components whose boundaries meet at equal positions: a mesh in pieces, which a weld joins.

    Where edges (faces) of the boundaries do not coincide, as at T-junctions, a weld makes vertices of several
    fans instead. No warning where a weld would only undo a split of fans: at edges with three faces and more,
    or at vertices of surfaces that touch there alone.

    Parameters
    ----------
    mesh : TriangleMesh or TetMesh
    """
    if isinstance(mesh, TetMesh):
        what, side, defect = "body", "face", "bodies in pieces"
        of_vertex, rim = mesh.vertex_component, mesh.boundary.faces
    else:
        what, side, defect = "surface", "edge", "equal positions"
        of_vertex, rim = mesh.topology.vertex_component, mesh.topology.edges[mesh.topology.boundary_edges]
    n = int(of_vertex.max(initial=-1)) + 1
    if not len(rim) or n < 2:
        return
    boundary, ends = np.unique(rim, return_inverse=True)
    place = merged_points(mesh.points[boundary])[1]
    label = connected_labels(of_vertex[boundary], n + place, n + int(place.max()) + 1)[1][:n]
    n_touching = int((np.bincount(label)[label] > 1).sum())
    if n_touching:
        advice = remedy(defect)
        coincide = len(repeated_rows(np.sort(place[ends.reshape(rim.shape)], axis=1))) > 0
        if isinstance(mesh, TriangleMesh):
            gains = _weld_joins_sheets(mesh) if coincide else len(t_junctions(_welded(mesh))[1]) > 0
            if not gains:
                return
        if not coincide:
            advice = f"no {side}s of theirs coincide (T-junctions), so that a weld joins vertices alone; "
            advice += remedy("slits") if side == "edge" else "divide the faces so that they match"
        logging.getLogger("ddgcli").warning(
            "%d of %d components have boundary vertices at equal positions, where nothing connects them: the "
            "%s is in pieces; %s", n_touching, n, what, advice,
        )  # fmt: skip


def weld_advice(mesh: SurfaceMesh, unreached: NDArray[np.bool_]) -> str:
    """Advice to weld the mesh, where an unreached vertex has the position of a reached one.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    unreached : (n,) ndarray of bool
        Vertices that a propagation did not reach.

    Returns
    -------
    str
        The advice after a semicolon; empty where a weld connects nothing, or joins sheets only at edges of
        three faces or at single vertices, which many commands refuse.
    """
    if not isinstance(mesh, TriangleMesh):
        return ""
    place, used = merged_points(mesh.points)[1], mesh.topology.referenced_vertex
    meet = np.isin(place[used & unreached], place[used & ~unreached]).any()
    return f"; {remedy('equal positions')}" if meet and _weld_joins_sheets(mesh) else ""


def _weld_joins_sheets(mesh: TriangleMesh) -> bool:
    """Whether a weld gains edges of two faces: not where it undoes a split of fans, at edges with three."""
    n_before, n_after = ((m.topology.edge_face_count == 2).sum() for m in (mesh, _welded(mesh)))
    return bool(n_after > n_before)


def _welded(mesh: TriangleMesh) -> TriangleMesh:
    """The mesh with one vertex at each position, without the faces that then name a vertex twice."""
    points, place = merged_points(mesh.points)
    faces = place[mesh.faces]
    return TriangleMesh.from_arrays(points, faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)])
