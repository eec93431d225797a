"""Intrinsic Delaunay refinement: Steiner points until no angle is below a bound (chapter 10, section 4).

L. P. Chew, "Guaranteed-quality mesh generation for curved surfaces", 1993, and J. Ruppert, "A Delaunay
refinement algorithm for quality 2-dimensional mesh generation", 1995, on intrinsic triangulations as in
N. Sharp et al., "Navigating intrinsic triangulations", 2019. Circumcentres of bad triangles are inserted; if
one would encroach on a boundary edge, or lie beyond it, that edge is split instead. Points with disjoint
cavities are inserted in one batch.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.delaunay.common_subdivision import BaseTriangulation
from ddgcli.algorithms.delaunay.refine_batches import Refinement
from ddgcli.algorithms.delaunay.steiner_base import SteinerPoints, with_steiner_points
from ddgcli.algorithms.delaunay.triangulation import IntrinsicDelaunay, flip_to_delaunay, require_surface
from ddgcli.choices import MAX_POINTS_PER_VERTEX, MAX_REFINEMENT_DEGREES, MIN_MAX_POINTS
from ddgcli.errors import ParameterError, counted
from ddgcli.geometry.intrinsic import corner_angle
from ddgcli.linalg.residual_gate import LARGEST_RESIDUAL
from ddgcli.mesh.repair import one_vertex_a_fan
from ddgcli.mesh.require import require
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators.mollify import check_mollifiable

log = logging.getLogger("ddgcli")


@dataclass(frozen=True, eq=False)
class RefinementResult:
    """A refined intrinsic triangulation.

    Parameters
    ----------
    triangulation : IntrinsicDelaunay
        The intrinsic Delaunay triangulation of input vertices and Steiner points.
    base : BaseTriangulation
        The input with the Steiner points inserted; the normal coordinates refer to it.
    steiner : SteinerPoints
        Positions of the Steiner points on the input.
    flips : int
        Number of flips during the insertion.
    batches : int
    sharp_vertices, coincident_vertices : int
        Interior vertices and boundary corners of total angle below 60 degrees; vertices connected to another
        one by a side of length zero.
    excepted_faces : int
        Faces at or next to those whose smallest angle stays below the bound.
    unreached_faces : int
        Other faces below the bound: 0 unless the limit on points, or of rounding, was reached.
    converged : bool
    """

    triangulation: IntrinsicDelaunay
    base: BaseTriangulation
    steiner: SteinerPoints
    flips: int
    batches: int
    sharp_vertices: int
    coincident_vertices: int
    excepted_faces: int
    unreached_faces: int
    converged: bool


def check_refinement(mesh: TriangleMesh, degrees: float) -> None:
    """Raise the errors of `refine`, before it computes.

    Parameters
    ----------
    mesh : TriangleMesh
    degrees : float
        Least angle to reach.

    Raises
    ------
    ParameterError
        When the refinement might not end at this angle.
    MeshError
    """
    if degrees <= 0:
        raise ParameterError(f"must be above 0 degrees, not {degrees:g}", parameter="degrees")
    if not degrees <= MAX_REFINEMENT_DEGREES:
        raise ParameterError(
            f"refinement to {degrees:g} degrees does not end; use at most {MAX_REFINEMENT_DEGREES:g} "
            "(25 always succeeds)",
            parameter="degrees",
        )
    require_surface(mesh, "refinement")
    require(mesh, "refinement", extent=True)
    check_mollifiable(mesh)


def refine(
    mesh: TriangleMesh, degrees: float, *, max_points: int | None = None, seed: int = 0, track: bool = True
) -> RefinementResult:
    """Insert Steiner points until no intrinsic angle is smaller than `degrees`.

    Parameters
    ----------
    mesh : TriangleMesh
        Oriented, without edges of three faces. A vertex with several fans of faces counts as one vertex for
        each fan.
    degrees : float
        Above 0 and at most 33; refinement ends on every surface up to 25, on nearly every one up to 30.
    max_points : int, optional
        Largest number of Steiner points; by default ten for each vertex, and at least 100,000.
    seed : int
        Seed of the random choice of faces for a batch.
    track : bool
        Track normal coordinates, which `common_subdivision` needs.

    Returns
    -------
    RefinementResult

    Raises
    ------
    ParameterError
        An angle outside the range.
    MeshError
        A surface that is not oriented, or has edges of three faces.
    """
    check_refinement(mesh, degrees)
    limit = max(MIN_MAX_POINTS, MAX_POINTS_PER_VERTEX * mesh.n_vertices) if max_points is None else max_points
    insertions = _insert(mesh, np.radians(degrees), limit, seed)
    base = with_steiner_points(mesh, insertions.steiner)
    flipped = flip_to_delaunay(base.mesh, track=track)
    small = (corner_angle(flipped.mesh.side_length) < np.radians(degrees) * (1 - 1e-6)).any(axis=1)
    beside = _near(flipped, insertions.pinned)
    unreached = int((small & ~beside).sum())
    if insertions.exhausted:
        log.warning(
            f"refinement stopped at {counted(limit, 'Steiner point', 'Steiner points')} with "
            f"{counted(unreached, 'face', 'faces')} still below "
            f"{degrees:g} degrees; increase `max_points`"
        )
    if insertions.has_rounded:
        log.warning(
            f"refinement stopped at {counted(len(insertions.steiner), 'Steiner point', 'Steiner points')}: "
            f"in thin faces rounding has changed the area by more than {100 * LARGEST_RESIDUAL:g} %"
        )
    return RefinementResult(
        triangulation=flipped,
        base=base,
        steiner=insertions.steiner,
        flips=insertions.flips,
        batches=insertions.batches,
        sharp_vertices=insertions.sharp,
        coincident_vertices=insertions.coincident,
        excepted_faces=int((small & beside).sum()),
        unreached_faces=unreached,
        converged=unreached == 0,
    )


class _Insertions(NamedTuple):
    """Steiner points, and the data of `Refinement` that do not refer to its triangulation."""

    steiner: SteinerPoints
    pinned: NDArray[np.int64]
    flips: int
    batches: int
    sharp: int
    coincident: int
    exhausted: bool
    has_rounded: bool


def _insert(mesh: TriangleMesh, angle: float, limit: int, seed: int) -> _Insertions:
    """Insert points until no angle is smaller, or as many as the limit allows."""
    fanned, original = one_vertex_a_fan(mesh)
    work = Refinement(fanned, angle, limit, seed)
    while work.advance():
        pass
    return _Insertions(
        steiner=work.locations.steiner(),
        pinned=original[work.pinned],
        flips=work.flips,
        batches=work.batches,
        sharp=int(work.sharp.sum()),
        coincident=int(work.coincident.sum()),
        exhausted=work.exhausted,
        has_rounded=work.has_rounded,
    )


def _near(flipped: IntrinsicDelaunay, vertex: NDArray) -> NDArray[np.bool_]:
    """(m,) whether a face has one of the vertices, or shares a vertex with such a face."""
    pinned = np.zeros(flipped.mesh.n_vertices, dtype=bool)
    pinned[vertex] = True
    faces = flipped.mesh.faces
    ring = np.zeros_like(pinned)
    ring[faces[np.any(pinned[faces], axis=1)]] = True
    return np.asarray(np.any(ring[faces], axis=1))
