"""The common subdivision of an input and its flat triangulation, with coordinates in the plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.conformal.distortion import distortion_arrays
from ddgcli.algorithms.conformal.layout import Layout
from ddgcli.algorithms.conformal.projective_lines import projective_lines_over
from ddgcli.algorithms.conformal.ptolemy import DecoratedTriangulation
from ddgcli.algorithms.delaunay.common_subdivision import (
    BaseTriangulation,
    CommonSubdivision,
    common_subdivision,
)
from ddgcli.algorithms.delaunay.overlay_lines import lines_over
from ddgcli.algorithms.delaunay.triangulation import IntrinsicDelaunay
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.sides import next_side
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh


@dataclass(frozen=True, eq=False)
class _LinePlacement:
    """Positions of crossings: straight lines where no Ptolemy flip made an edge, else projective ones.

    Parameters
    ----------
    plain : IntrinsicMesh
        The input by the lengths that the flips started from.
    state : DecoratedTriangulation
    scale : (n,) ndarray of float64
    """

    plain: IntrinsicMesh
    state: DecoratedTriangulation
    scale: NDArray[np.float64]

    def __call__(
        self, base: TriangleMesh, base_side: NDArray, count: NDArray, length: NDArray
    ) -> tuple[NDArray, NDArray, float]:
        state, number = self.state, np.arange(len(self.state.length))
        side = number[(state.crossings > 0) & (number < state.twin[:-1])]
        flipped = state.flipped[side]
        along, share = np.empty((2, len(base_side)))
        residual = 0.0
        for mask, projective in ((~flipped, False), (flipped, True)):
            points = np.repeat(mask, count)
            line = base_side[points], count[mask], length[mask]
            crossings = projective_lines_over(self.plain, *line) if projective else lines_over(base, *line)
            along[points], share[points], error = crossings
            residual = max(residual, error)
        at = np.repeat(side, count)
        # barycentric coordinates in the scaled metric: weights of the ends divided by their factors
        ratio = np.exp(self.scale[state.tail[at]] - self.scale[state.head[at]])
        along = along * ratio / (1.0 - along + along * ratio)
        return along, share, residual


def flat_overlay(
    mesh: TriangleMesh, plain: IntrinsicMesh, flipped: IntrinsicDelaunay, state: DecoratedTriangulation,
    scale: NDArray,
) -> CommonSubdivision:  # fmt: skip
    """Common subdivision of the input and the flat triangulation.

    Parameters
    ----------
    mesh : TriangleMesh
        The input.
    plain : IntrinsicMesh
        The input with the lengths of the map's start.
    flipped : IntrinsicDelaunay
        With tracked crossings.
    state : DecoratedTriangulation
        After the flips of the map.
    scale : (n,) ndarray of float64
        Logarithmic scale factors.

    Returns
    -------
    CommonSubdivision

    Notes
    -----
    Crossings are those of the discrete conformal map, which is projective on the faces that the Ptolemy flips
    started from, if these are the input's. Where Delaunay flips in the metric of the input came before, the
    map is still a homeomorphism with the same vertices, but crossings with edges of later Ptolemy flips are
    placed as if all flips had been Ptolemy flips.
    """
    topology = Topology(state.tail.reshape(-1, 3), mesh.n_vertices, state.twin[:-1].reshape(-1, 3))
    target = IntrinsicMesh(topology, state.length.reshape(-1, 3), mesh.points)
    record = IntrinsicDelaunay(
        target,
        flipped.flips + state.flips,
        0,
        flipped.mollification,
        crossings=state.crossings.reshape(-1, 3),
    )
    return common_subdivision(
        record, BaseTriangulation.itself(mesh), place_lines=_LinePlacement(plain, state, scale)
    )


def flat_overlay_mesh(cut: CommonSubdivision, layout: Layout) -> AnnotatedMesh:
    """The common subdivision, cut open along the seams.

    Parameters
    ----------
    cut : CommonSubdivision
    layout : Layout
        Of the flat triangulation.

    Returns
    -------
    AnnotatedMesh
        With the vertex array `uv` and distortion on faces.
    """
    m = cut.intrinsic.n_faces
    corner_z = layout.z[layout.corner].ravel()
    side, along = cut.half_side, cut.half_along
    head = next_side(side)
    half_z = corner_z[side] * (1.0 - along) + corner_z[head] * along
    # one name for each plane vertex, and for each crossing or, on seams, each side of it
    half = np.arange(len(side))
    name = np.where(layout.seam[side], half, half & ~1) + len(layout.z)
    names, z = np.concatenate([layout.corner.ravel(), name]), np.concatenate([corner_z, half_z])
    vertex = np.full(3 * m + len(half), -1)
    vertex[cut.corner.ravel()] = cut.mesh.faces.ravel()
    at = cut.corner.ravel()
    _, first, number = np.unique(names[at], return_index=True, return_inverse=True)
    first_corner = at[first]
    faces = number.reshape(-1, 3)
    uv = np.stack([z[first_corner].real, z[first_corner].imag], axis=1)
    opened = TriangleMesh(cut.mesh.points[vertex[first_corner]], Topology(faces, len(first_corner)))
    return AnnotatedMesh(
        opened,
        vertex={
            "uv": uv,
            "vertex_kind": cut.vertex_kind[vertex[first_corner]],
            "overlay_vertex": vertex[first_corner],
        },
        face={
            "input_face": cut.input_face,
            "intrinsic_face": cut.intrinsic_face,
            **distortion_arrays(opened, uv[faces]),
        },
    )
