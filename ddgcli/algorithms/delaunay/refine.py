"""Intrinsic Delaunay refinement: Steiner points until no angle is smaller than asked (chapter 10, section 4).

L. P. Chew, "Guaranteed-quality mesh generation for curved surfaces", 1993, and J. Ruppert, "A Delaunay
refinement algorithm for quality 2-dimensional mesh generation", 1995, on intrinsic triangulations as in
N. Sharp et al., "Navigating intrinsic triangulations", 2019. Circumcentres of bad triangles are inserted; one
that would come too near a boundary edge, or beyond it, splits that edge instead. Insertions go in batches
that do not meet.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.delaunay.common_subdivision import Base
from ddgcli.algorithms.delaunay.refine_batches import Refinement
from ddgcli.algorithms.delaunay.steiner_base import SteinerPoints, with_steiner_points
from ddgcli.algorithms.delaunay.triangulation import Flipped, flip_to_delaunay, require_surface
from ddgcli.errors import ParameterError
from ddgcli.geometry.intrinsic import corner_angle
from ddgcli.mesh.repair import one_vertex_a_fan
from ddgcli.mesh.require import require
from ddgcli.mesh.triangle_mesh import TriangleMesh

log = logging.getLogger("ddgcli")


@dataclass(frozen=True, eq=False)
class Refined:
    """A refined intrinsic triangulation.

    Parameters
    ----------
    flipped : Flipped
        The intrinsic Delaunay triangulation of input vertices and Steiner points, with normal coordinates.
    base : Base
        The input with the Steiner points inserted, which those coordinates refer to.
    steiner : SteinerPoints
        Where they lie on the input.
    flips : int
        While points were inserted.
    batches : int
    sharp_vertices, coincident_vertices : int
        Interior vertices and boundary corners of total angle below 60 degrees; vertices joined to another one
        by a side of length zero.
    excepted_faces : int
        Faces at or beside those whose smallest angle stays below the one asked.
    unreached_faces : int
        Other such faces: 0 unless the points ran out.
    reached : bool
    """

    flipped: Flipped
    base: Base
    steiner: SteinerPoints
    flips: int
    batches: int
    sharp_vertices: int
    coincident_vertices: int
    excepted_faces: int
    unreached_faces: int
    reached: bool


def refine(mesh: TriangleMesh, degrees: float, *, max_points: int | None = None, seed: int = 0) -> Refined:
    """Insert Steiner points until no intrinsic angle is smaller than `degrees`.

    Parameters
    ----------
    mesh : TriangleMesh
        Oriented, without edges of three faces. A vertex where several fans of faces meet is refined around as
        one vertex for each fan.
    degrees : float
        Above 0 and at most 33; up to 25 the batches end on every surface, up to 30 on nearly every one.
    max_points : int, optional
        At most so many Steiner points; by default ten for each vertex, and 100,000 at least.
    seed : int
        Of the choice of the faces that a batch tries, where there are more than it may try.

    Raises
    ------
    ParameterError, MeshError
    """
    if not 0 < degrees <= 33:
        raise ParameterError(
            f"refinement to {degrees:g} degrees does not end; ask for at most 33 (25 is safe)"
        )
    require_surface(mesh, "refinement")
    require(mesh, "refinement", extent=True)
    limit = max(100_000, 10 * mesh.n_vertices) if max_points is None else max_points
    fanned, original = one_vertex_a_fan(mesh)
    work = Refinement(fanned, np.radians(degrees), limit, seed)
    while work.advance():
        pass
    steiner = work.places.steiner()
    base = with_steiner_points(mesh, steiner)
    flipped = flip_to_delaunay(base.mesh, track=True)
    small = (corner_angle(flipped.mesh.side_length) < np.radians(degrees) * (1 - 1e-6)).any(axis=1)
    beside = _near(flipped, original[work.pinned])
    unreached = int((small & ~beside).sum())
    if work.exhausted:
        log.warning(
            f"refinement stopped at {limit} Steiner points with {unreached} faces still below "
            f"{degrees:g} degrees; raise --max-points"
        )
    return Refined(
        flipped=flipped,
        base=base,
        steiner=steiner,
        flips=work.flips,
        batches=work.batches,
        sharp_vertices=int(work.sharp.sum()),
        coincident_vertices=int(work.coincident.sum()),
        excepted_faces=int((small & beside).sum()),
        unreached_faces=unreached,
        reached=unreached == 0,
    )


def _near(flipped: Flipped, vertex: NDArray) -> NDArray[np.bool_]:
    """(m,) faces at one of the vertices, or beside such a face: in the reach kept free of points."""
    pinned = np.zeros(flipped.mesh.n_vertices, dtype=bool)
    pinned[vertex] = True
    faces = flipped.mesh.faces
    ring = np.zeros_like(pinned)
    ring[faces[np.any(pinned[faces], axis=1)]] = True
    return np.asarray(np.any(ring[faces], axis=1))
