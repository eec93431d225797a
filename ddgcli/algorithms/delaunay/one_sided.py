"""The common subdivision of a one-sided surface, from that of its orientation double cover.

Flips of the surface are flips of the cover in pairs, so that the triangulation of the cover is symmetric: one
half of its subdivision is the subdivision of the surface.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.delaunay.common_subdivision import (
    BaseTriangulation,
    CommonSubdivision,
    CrossingPositions,
    common_subdivision,
)
from ddgcli.algorithms.delaunay.normal_coordinates import crossings_of
from ddgcli.algorithms.delaunay.overlay_pieces import Labels
from ddgcli.algorithms.delaunay.triangulation import IntrinsicDelaunay, glue
from ddgcli.errors import MeshError
from ddgcli.mesh.double_cover import (
    CoverVertices,
    cover_vertices,
    covering_sides,
    double_cover,
    reversed_sides,
)
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.ragged import repeat_with_place
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh


def one_sided_subdivision(flipped: IntrinsicDelaunay, mesh: TriangleMesh) -> CommonSubdivision:
    """The common subdivision of a one-sided surface and its intrinsic triangulation by tracked flips.

    Parameters
    ----------
    flipped : IntrinsicDelaunay
        As returned by `flip_to_delaunay(mesh, track=True)`.
    mesh : TriangleMesh

    Returns
    -------
    CommonSubdivision
        With `lifted`, the subdivision of the double cover. Its `crossings` have positions, but the order of
        half-crossings on twisted sides is that of the cover alone.
    """
    if flipped.cover is None:
        raise MeshError("the flips were not tracked; call flip_to_delaunay(..., track=True)")
    sheets = cover_vertices(glue(mesh).topology)
    faces = Topology(sheets.faces, len(sheets.below))
    cover = TriangleMesh(mesh.points[sheets.below], faces)
    lifted = common_subdivision(_lifted_flips(flipped), BaseTriangulation.itself(cover))
    return _projected(lifted, flipped, mesh, sheets)


def _lifted_flips(flipped: IntrinsicDelaunay) -> IntrinsicDelaunay:
    """The triangulation of the double cover, with its normal coordinates."""
    topology, cover = flipped.mesh.topology, flipped.cover
    gluing = double_cover(topology).gluing
    lifted = Topology(cover.faces, len(cover.below), gluing)  # type: ignore[union-attr]
    mesh = IntrinsicMesh(lifted, covering_sides(flipped.mesh.side_length))
    return replace(flipped, mesh=mesh, crossings=covering_sides(flipped.crossings), cover=None)  # type: ignore[arg-type]


def _projected(
    lifted: CommonSubdivision, flipped: IntrinsicDelaunay, mesh: TriangleMesh, sheets: CoverVertices
) -> CommonSubdivision:
    """The half of a subdivision of the cover that lies in the first copies of the input's faces."""
    m, intrinsic = mesh.n_faces, flipped.mesh
    positions, number = _projected_crossings(lifted, flipped, mesh)
    vertex = np.concatenate([sheets.below, mesh.n_vertices + number])
    half = np.flatnonzero(lifted.input_face < m)
    points = positions.points()
    return CommonSubdivision(
        input=mesh,
        intrinsic=intrinsic,
        mesh=TriangleMesh(points, Topology(vertex[lifted.mesh.faces[half]], len(points))),
        input_face=lifted.input_face[half],
        intrinsic_face=lifted.intrinsic_face[half] % m,
        vertex_kind=positions.kind(),
        length_residual=lifted.length_residual,
        crossings=positions,
        lifted=lifted,
    )


def _projected_crossings(
    lifted: CommonSubdivision, flipped: IntrinsicDelaunay, mesh: TriangleMesh
) -> tuple[CrossingPositions, NDArray[np.int64]]:
    """Crossings of the surface, and the number there of each crossing of the cover."""
    m, cover = mesh.n_faces, lifted.crossings
    halves = crossings_of(flipped.crossings, flipped.mesh.topology.side_twin)  # type: ignore[arg-type]
    index, place = repeat_with_place(np.arange(len(halves.side)), halves.count[halves.side])
    side = halves.side[index]
    half = cover.halves.at(side, place)
    # on the second copy of the face the side runs the other way
    mirrored = cover.halves.at(reversed_sides(side, m), halves.count[side] - 1 - place)
    number = np.full(len(cover.share), -1, dtype=np.int64)
    number[half >> 1] = number[mirrored >> 1] = np.arange(len(half))

    at, forward = half >> 1, (half & 1) == 0
    along = np.where(forward, cover.along[at], 1.0 - cover.along[at])
    crossed, share = cover.labels.crossed[at], cover.share[at]
    back = crossed >= 3 * m
    crossed = np.where(back, reversed_sides(crossed, m), crossed)
    share = np.where(back, 1.0 - share, share)
    base = BaseTriangulation.itself(mesh)
    labels = Labels(crossed, base.beside, cover.labels.holder[:m] % m)
    return CrossingPositions(flipped.mesh, base, halves, labels, share, along), number
