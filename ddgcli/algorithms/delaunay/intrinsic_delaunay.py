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
    remaining_note,
    require_surface,
    working_lengths,
)
from ddgcli.algorithms.delaunay.triangulation_statistics import metric_residuals, triangulation_statistics
from ddgcli.errors import ParameterError, renamed_parameters
from ddgcli.geometry.intrinsic import face_area
from ddgcli.geometry.remedies import remedy_for_bad_shapes
from ddgcli.linalg.residual_gate import within_residuals
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh, SurfaceMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.representation import short_repr

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

    __repr__ = short_repr

    def overlay(self) -> AnnotatedMesh:
        """The common subdivision as a mesh, with the interpolants of the transferred functions.

        Returns
        -------
        AnnotatedMesh
            Vertex array `vertex_kind` (0 input vertex, 1 Steiner point, 2 crossing), face arrays `input_face`
            and `intrinsic_face`, and the functions by name.

        Raises
        ------
        ParameterError
            When it was not computed.
        """
        cut = self.subdivision
        if cut is None:
            raise ParameterError("the common subdivision was not computed; require it first")
        arrays = {name: cut.from_input @ one.input_values for name, one in self.transferred.items()}
        return AnnotatedMesh(
            cut.mesh,
            vertex={"vertex_kind": cut.vertex_kind, **arrays},
            face={"input_face": cut.input_face, "intrinsic_face": cut.intrinsic_face},
        )

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

        with renamed_parameters(arrays="transferred"):
            check_transferable(transferred, OWN_ARRAYS)
    if degrees is not None:
        from ddgcli.algorithms.delaunay.refine import check_refinement

        check_refinement(mesh, degrees)
    else:
        require_surface(mesh, "the intrinsic Delaunay triangulation", one_sided=True)
        check_area(mesh)


def _transfer(
    cut: CommonSubdivision,
    functions: dict[str, NDArray],
    results: dict[str, Any],
    accuracy: dict[str, Any],
) -> dict[str, TransferResult]:
    """Transfer functions to the intrinsic triangulation; adds its entries of results and accuracy."""
    from ddgcli.algorithms.delaunay.transfer import transfer_to_intrinsic

    transfers = transfer_to_intrinsic(cut, functions)
    results["transfer"] = {name: {"l2_change": one.change} for name, one in transfers.items()}
    accuracy["transfer_integral_residual"] = max(one.integral_residual for one in transfers.values())
    return transfers


def _dual(mesh: IntrinsicMesh, results: dict[str, Any], accuracy: dict[str, Any]) -> CircumcentricDual:
    """Circumcentric dual; adds its entries of results and accuracy."""
    from ddgcli.algorithms.delaunay.dual import circumcentric_dual

    cells = circumcentric_dual(mesh)
    results["dual"] = {"negative_edges": cells.negative_edges, "least_area": float(cells.dual_area.min())}
    accuracy["dual_area_residual"] = cells.area_residual
    accuracy["dual_length_residual"] = cells.length_residual
    return cells


def _triangulate(
    mesh: TriangleMesh, degrees: float | None, max_points: int | None, seed: int, *, track: bool
) -> tuple[IntrinsicDelaunay, RefinementResult | None]:
    """The triangulation by flips, or by the refinement to a least angle."""
    if degrees is None:
        return flip_to_delaunay(mesh, track=track), None
    from ddgcli.algorithms.delaunay.refine import refine

    refined = refine(mesh, degrees, max_points=max_points, seed=seed, track=track)
    return refined.triangulation, refined


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
    flipped, refined = _triangulate(mesh, degrees, max_points, seed, track=subdivide)
    results: dict[str, Any] = {
        "flips": flipped.flips if refined is None else refined.flips,
        "steiner_points": flipped.mesh.n_vertices - mesh.n_vertices,
        "before": triangulation_statistics(mesh, _metric(mesh, flipped), condition=condition),
        "after": triangulation_statistics(flipped.mesh, condition=condition),
    }
    vertex: dict[str, NDArray] = {}
    if refined is not None:
        results["refinement"] = refinement_counts(refined)
        where = refined.steiner.after_vertices(mesh)
        vertex = {"input_face": where.face, "input_barycentric": where.barycentric}
    accuracy: dict[str, Any] = metric_residuals(mesh, flipped.mesh)
    cut = _subdivision(mesh, flipped, refined) if subdivide else None
    transfers: dict[str, TransferResult] = {}
    if cut is not None:
        results["overlay"] = subdivision_counts(cut)
        accuracy |= subdivision_residuals(cut, mesh)
        if transferred:
            transfers = _transfer(cut, transferred, results, accuracy)
            vertex |= {name: one.values for name, one in transfers.items()}
    cells = _dual(flipped.mesh, results, accuracy) if dual else None
    remaining = results["after"]["non_delaunay_edges"]  # angles of the final lengths, not of the flips
    if remaining and not flipped.remaining_edges:
        log.warning(remaining_note(remaining))
    converged = (refined is None or refined.converged) and max(remaining, flipped.remaining_edges) == 0
    converged &= within_residuals(accuracy, RESIDUALS, partial(remedy_for_bad_shapes, mesh))
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
