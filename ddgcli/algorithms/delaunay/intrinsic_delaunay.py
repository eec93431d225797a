"""Intrinsic Delaunay triangulation of a surface, with refinement, transfer of functions, and statistics.

The module of a further result is imported for that result only: solvers take a tenth of a second.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.delaunay.triangulation import (
    IntrinsicDelaunay,
    check_area,
    flip_to_delaunay,
    glue,
    length_scale,
    negative_cotan_edges,
    non_delaunay_edges,
    remaining_note,
    require_surface,
    working_lengths,
)
from ddgcli.geometry.cures import cure_of_bad_shapes
from ddgcli.geometry.extrinsic import face_area_vector
from ddgcli.geometry.intrinsic import BLOCK_FACES, corner_angle, corner_cotan, face_area
from ddgcli.geometry.unfolding import face_corner_angle
from ddgcli.linalg.residual_gate import within_residuals
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh, SurfaceMesh
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import NEXT, PREVIOUS
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import row_matrix, vector_length
from ddgcli.operators.mollify import mollify_mesh

if TYPE_CHECKING:
    from ddgcli.algorithms.delaunay.common_subdivision import CommonSubdivision
    from ddgcli.algorithms.delaunay.dual import CircumcentricDual
    from ddgcli.algorithms.delaunay.refine import RefinementResult
    from ddgcli.algorithms.delaunay.transfer import TransferResult

log = logging.getLogger("ddgcli")

# arrays of the output that a transferred array must not replace
OWN_ARRAYS = (
    "points",
    "faces",
    "face_edge_lengths",
    "neighbors",
    "twisted",
    "input_face",
    "input_barycentric",
    "vertex_kind",
)


# fields of the accuracy block that `within_residuals` checks
RESIDUALS = (
    "area_residual", "angle_defect_residual", "overlay_area_residual", "overlay_length_residual",
    "transfer_integral_residual", "dual_area_residual", "dual_length_residual",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class DelaunayResult:
    """An intrinsic Delaunay triangulation with results, accuracy and transferred functions.

    Parameters
    ----------
    mesh : IntrinsicMesh
    results, accuracy : dict
        Blocks of the summary.
    vertex : dict of str to ndarray
        Arrays on its vertices: `input_face` and `input_barycentric` after refinement, and transferred ones.
    transferred : dict of str to TransferResult
    subdivision : CommonSubdivision, optional
    dual : CircumcentricDual, optional
    converged : bool
        False if refinement reached the limit on points, or edges are not Delaunay by rounding.
    """

    mesh: IntrinsicMesh
    results: dict[str, Any]
    accuracy: dict[str, Any]
    vertex: dict[str, NDArray]
    transferred: dict[str, TransferResult] = field(default_factory=dict)
    subdivision: CommonSubdivision | None = None
    dual: CircumcentricDual | None = None
    converged: bool = True

    @property
    def dual_arrays(self) -> AnnotatedMesh:
        """The triangulation with the arrays of its circumcentric dual."""
        if self.dual is None:
            return AnnotatedMesh(self.mesh)
        dual = self.dual
        return AnnotatedMesh(
            self.mesh,
            vertex={"dual_area": dual.dual_area},
            face={"circumcentre": dual.circumcentre, "circumradius": dual.circumradius},
            edge={
                "edges": self.mesh.topology.edges,
                "edge_faces": dual.edge_faces,
                "edge_length": dual.edge_length,
                "dual_length": dual.dual_length,
            },
        )


def check_query(
    mesh: TriangleMesh, degrees: float | None = None, transferred: dict[str, NDArray] | None = None
) -> None:
    """Raise the errors of `intrinsic_delaunay`, before it computes.

    Parameters
    ----------
    mesh : TriangleMesh
    degrees : float, optional
        Least angle of the refinement.
    transferred : dict of str to ndarray, optional
        Functions on vertices to transfer.
    """
    if transferred:
        from ddgcli.algorithms.delaunay.transfer import check_transferable

        check_transferable(transferred, OWN_ARRAYS)
    if degrees is not None:
        from ddgcli.algorithms.delaunay.refine import check_refinement

        check_refinement(mesh, degrees)
    else:
        require_surface(mesh, "the intrinsic Delaunay triangulation", one_sided=True)
        check_area(mesh)


def intrinsic_delaunay(
    mesh: TriangleMesh,
    *,
    degrees: float | None = None,
    max_points: int | None = None,
    subdivide: bool = False,
    transferred: dict[str, NDArray] | None = None,
    dual: bool = False,
    condition: bool = False,
    seed: int = 0,
) -> DelaunayResult:
    """Compute the intrinsic Delaunay triangulation of a surface, optionally refined, with its statistics.

    Parameters
    ----------
    mesh : TriangleMesh
    degrees, max_points
        See `refine`; None: no refinement.
    subdivide : bool
        Also compute the common subdivision.
    transferred : dict of str to ndarray, optional
        Arrays on the input's vertices to transfer; implies the common subdivision.
    dual : bool
        Also compute the circumcentric dual.
    condition : bool
        Also measure the condition numbers of the Laplacians.
    seed : int
        Seed of the random choice among faces in refinement.

    Returns
    -------
    DelaunayResult

    Raises
    ------
    MeshError
        For a surface that is not oriented, or has edges of three faces.
    ParameterError
        For an angle or an array that cannot be used.
    """
    check_query(mesh, degrees, transferred)
    subdivide = subdivide or bool(transferred)
    refined: RefinementResult | None = None
    if degrees is None:
        flipped = flip_to_delaunay(mesh, track=subdivide)
    else:
        from ddgcli.algorithms.delaunay.refine import refine

        refined = refine(mesh, degrees, max_points=max_points, seed=seed, track=subdivide)
        flipped = refined.triangulation
    results: dict[str, Any] = {
        "flips": flipped.flips if refined is None else refined.flips,
        "steiner_points": flipped.mesh.n_vertices - mesh.n_vertices,
        "before": triangulation_statistics(mesh, _metric(mesh, flipped), condition=condition),
        "after": triangulation_statistics(flipped.mesh, condition=condition),
    }
    vertex: dict[str, NDArray] = {}
    if refined is not None:
        results["refinement"] = refinement_counts(refined)
        where = refined.steiner.behind_vertices(mesh)
        vertex = {"input_face": where.face, "input_barycentric": where.barycentric}
    accuracy: dict[str, Any] = metric_residuals(mesh, flipped.mesh)
    cut = _subdivision(mesh, flipped, refined) if subdivide else None
    transfers: dict[str, TransferResult] = {}
    if cut is not None:
        results["overlay"] = subdivision_counts(cut)
        accuracy |= subdivision_residuals(cut, mesh)
        if transferred:
            from ddgcli.algorithms.delaunay.transfer import transfer_to_intrinsic

            transfers = transfer_to_intrinsic(cut, transferred)
            results["transfer"] = {name: {"l2_change": one.change} for name, one in transfers.items()}
            accuracy["transfer_integral_residual"] = max(one.integral_residual for one in transfers.values())
            vertex |= {name: one.values for name, one in transfers.items()}
    cells: CircumcentricDual | None = None
    if dual:
        from ddgcli.algorithms.delaunay.dual import circumcentric_dual

        cells = circumcentric_dual(flipped.mesh)
        results["dual"] = {"negative_edges": cells.negative_edges, "least_area": float(cells.dual_area.min())}
        accuracy["dual_area_residual"] = cells.area_residual
        accuracy["dual_length_residual"] = cells.length_residual
    remaining = results["after"]["non_delaunay_edges"]  # angles of the final lengths, not of the flips
    if remaining and not flipped.remaining_edges:
        log.warning(remaining_note(remaining))
    converged = (refined is None or refined.converged) and max(remaining, flipped.remaining_edges) == 0
    converged &= within_residuals(accuracy, RESIDUALS, partial(cure_of_bad_shapes, mesh))
    return DelaunayResult(flipped.mesh, results, accuracy, vertex, transfers, cut, cells, converged)


def _subdivision(
    mesh: TriangleMesh, flipped: IntrinsicDelaunay, refined: RefinementResult | None
) -> CommonSubdivision:
    from ddgcli.algorithms.delaunay.common_subdivision import BaseTriangulation, common_subdivision
    from ddgcli.algorithms.delaunay.one_sided import one_sided_subdivision

    base = BaseTriangulation.itself(mesh) if refined is None else refined.base
    if flipped.cover is not None:
        return one_sided_subdivision(flipped, base.mesh)
    return common_subdivision(flipped, base)


def _metric(mesh: TriangleMesh, flipped: IntrinsicDelaunay) -> SurfaceMesh:
    """The input with the lengths at the start of the flips, for comparison with the result."""
    if len(flipped.mollification.faces) == 0:
        return mesh
    return IntrinsicMesh(mesh.topology, working_lengths(mesh, glue(mesh)).length, mesh.points)


def refinement_counts(refined: RefinementResult) -> dict[str, int]:
    """Counts of refinement: batches, exceptions at sharp vertices, faces below the bound."""
    return {
        "batches": refined.batches,
        "sharp_vertices": refined.sharp_vertices,
        "coincident_vertices": refined.coincident_vertices,
        "excepted_faces": refined.excepted_faces,
        "unreached_faces": refined.unreached_faces,
    }


def subdivision_counts(cut: CommonSubdivision) -> dict[str, int]:
    """Vertices by kind and triangles of a common subdivision."""
    kinds = np.bincount(cut.vertex_kind, minlength=3)
    names = ("input_vertices", "steiner_points", "crossings")
    return {**{name: int(k) for name, k in zip(names, kinds)}, "faces": cut.mesh.n_faces}


def subdivision_residuals(cut: CommonSubdivision, mesh: TriangleMesh) -> dict[str, float]:
    """Errors of a common subdivision.

    Returns
    -------
    dict
        `overlay_area_residual`: change of the area, relative; `overlay_length_residual`: largest difference
        between an intrinsic edge and its straight line over the input, relative to its length.
    """
    scale = length_scale(mesh.side_length)
    area, cut_area = (face_area(m.side_length / scale).sum() for m in (mesh, cut.mesh))
    change = float(abs(cut_area - area) / area) if area > 0 else float("nan")
    return {"overlay_area_residual": change, "overlay_length_residual": cut.length_residual}


def overlay_mesh(cut: CommonSubdivision, transferred: dict[str, TransferResult]) -> AnnotatedMesh:
    """Common subdivision as a mesh with its labels and the interpolants of the input's functions.

    Parameters
    ----------
    cut : CommonSubdivision
    transferred : dict of str to TransferResult

    Returns
    -------
    AnnotatedMesh
        Vertex array `vertex_kind`, face arrays `input_face` and `intrinsic_face`, and the functions by name.
    """
    arrays = {name: cut.from_input @ one.input_values for name, one in transferred.items()}
    return AnnotatedMesh(
        cut.mesh,
        vertex={"vertex_kind": cut.vertex_kind, **arrays},
        face={"input_face": cut.input_face, "intrinsic_face": cut.intrinsic_face},
    )


def triangulation_statistics(
    mesh: SurfaceMesh, mollified: SurfaceMesh | None = None, *, condition: bool = False
) -> dict[str, Any]:
    """Counts and angles of one triangulation.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    mollified : TriangleMesh or IntrinsicMesh, optional
        The same mesh without degenerate faces, for the matrix.
    condition : bool

    Returns
    -------
    dict
        `non_delaunay_edges` (interior, opposite angles above pi + 1e-9), `negative_cotan_edges` (boundary
        edges included), `min_angle_degrees`, `max_angle_degrees`, `self_edges`, `multi_edges` (edges that
        share both ends with another one), `dirichlet_energy` of the positions (None where there are none),
        and `laplacian_condition` if `condition` is True.
    """
    angle = np.degrees(corner_angle(mesh.side_length))
    least_angle, greatest_angle = float(angle.min()), float(angle.max())
    del angle
    edges = np.sort(mesh.topology.edges, axis=1)
    loop = edges[:, 0] == edges[:, 1]
    proper = mollify_mesh(mollified or mesh)[0]  # the flips have warned of degenerate faces
    statistics = {
        "non_delaunay_edges": int(non_delaunay_edges(mesh).sum()),
        "negative_cotan_edges": negative_cotan_edges(mesh),
        "min_angle_degrees": least_angle,
        "max_angle_degrees": greatest_angle,
        "self_edges": int(loop.sum()),
        "multi_edges": _repeated(edges[~loop], mesh.n_vertices),
        "dirichlet_energy": None if mesh.points is None else dirichlet_energy(proper, mesh.points),
    }
    if condition:
        from ddgcli.linalg.condition import condition_number
        from ddgcli.operators.laplacian import stiffness

        statistics["laplacian_condition"] = condition_number(stiffness(proper))
    return statistics


def _repeated(edges: NDArray, n_vertices: int) -> int:
    """Number of edges whose two ends are those of another edge."""
    key = np.sort(edges[:, 0] * np.int64(n_vertices) + edges[:, 1])
    same = key[1:] == key[:-1]
    return int((np.append(same, False) | np.append(False, same)).sum())


def dirichlet_energy(mesh: SurfaceMesh, values: NDArray) -> float:
    """Half the Dirichlet integral of the interpolants of vertex values (n,) or (n, k), summed over columns.

    For the positions on the input triangulation it is the area; every Delaunay flip lowers it (Rippa 1990).
    A sum over sides: the product with the matrix would cancel where cotangents are large (needles).
    """
    values, energy = row_matrix(values), 0.0
    for begin in range(0, mesh.n_faces, BLOCK_FACES):
        block = slice(begin, begin + BLOCK_FACES)
        corner = values[mesh.faces[block]]
        difference = corner[:, NEXT] - corner
        cotan = corner_cotan(mesh.side_length[block])[:, PREVIOUS]  # side j is opposite corner j + 2
        energy += 0.25 * float(np.einsum("fj,fjk,fjk->", cotan, difference, difference))
    return energy


def metric_residuals(before: SurfaceMesh, after: SurfaceMesh) -> dict[str, float]:
    """Residuals of the metric after flips and insertions, which preserve it in exact arithmetic.

    Returns
    -------
    dict
        `area_residual`: change of the area relative to it; `angle_defect_residual`: largest change of an
        angle defect (inserted vertices must have none) relative to a full turn.
    """
    scale = length_scale(before.side_length)  # areas of tiny and huge surfaces leave the range of float64
    area0, area1 = _area(before, scale), _area(after, scale)
    change = _defect(after)
    change[: before.n_vertices] -= _defect(before)
    return {
        "area_residual": float(abs(area1 - area0) / area0) if area0 > 0 else float("nan"),
        "angle_defect_residual": float(np.abs(change).max(initial=0.0) / (2 * np.pi)),
    }


def _area(mesh: SurfaceMesh, scale: float) -> float:
    """Area over scale squared, from positions if the mesh has them: lengths lose the heights of caps."""
    if isinstance(mesh, TriangleMesh):
        return float(vector_length(face_area_vector(mesh.moved(mesh.points / scale))).sum())
    return float(face_area(mesh.side_length / scale).sum())


def _defect(mesh: SurfaceMesh) -> NDArray[np.float64]:
    """(n,) angle defects, from positions if the mesh has them."""
    topology = mesh.topology
    total = sum_by_index(mesh.faces, face_corner_angle(mesh), mesh.n_vertices)
    full = np.where(topology.boundary_vertex, np.pi, 2 * np.pi)
    return np.where(topology.referenced_vertex, full - total, 0.0)
