"""Discrete conformal maps of surfaces of any topology to the plane, with cones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.conformal.cone_metric import ANGLE_TOLERANCE, ConeMetric, cone_metric
from ddgcli.algorithms.conformal.distortion import distortion_arrays, mean_and_largest
from ddgcli.algorithms.conformal.layout import Layout, flat_layout
from ddgcli.algorithms.conformal.overlay import flat_overlay, flat_overlay_mesh
from ddgcli.algorithms.conformal.ptolemy import DecoratedTriangulation
from ddgcli.algorithms.conformal.targets import ConformalTargets, conformal_targets
from ddgcli.algorithms.delaunay.common_subdivision import CommonSubdivision
from ddgcli.algorithms.delaunay.triangulation import (
    IntrinsicDelaunay,
    flip_to_delaunay,
    glue,
    working_lengths,
)
from ddgcli.errors import MeshError, ParameterError, counted
from ddgcli.geometry.intrinsic import face_area
from ddgcli.linalg.residual_gate import LARGEST_RESIDUAL
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators.mollify import Mollification
from ddgcli.progress import ProgressCallback
from ddgcli.representation import short_repr

OPERATORS = ("intrinsic-delaunay", "cotan")  # triangulations whose conformal class is defined


@dataclass(frozen=True, eq=False)
class ConformalMap:
    """A discrete conformal map of a surface to the plane.

    Parameters
    ----------
    mesh : TriangleMesh
        The input.
    flat : IntrinsicMesh
        The flat triangulation, with the lengths of the new metric; its vertices are the input's.
    scale : (n,) ndarray of float64
        Logarithmic scale factors.
    metric : ConeMetric
    layout : Layout
    delaunay : IntrinsicDelaunay
        The triangulation before the Ptolemy flips.
    plain : IntrinsicMesh
        The input by the lengths that the flips started from.
    """

    mesh: TriangleMesh
    flat: IntrinsicMesh
    scale: NDArray[np.float64]
    metric: ConeMetric
    layout: Layout
    delaunay: IntrinsicDelaunay
    plain: IntrinsicMesh

    __repr__ = short_repr

    @property
    def uv(self) -> NDArray[np.float64] | None:
        """(n, 2) coordinates of the input's vertices; None where a seam gives some of them several."""
        z = self.layout.per_vertex(self.flat.faces, self.mesh.n_vertices)
        return None if z is None else np.stack([z.real, z.imag], axis=1)

    @property
    def converged(self) -> bool:
        """Whether every angle sum is the prescribed one to 1e-10, and the layout is that of the metric."""
        return self.metric.converged and bool(self.layout.residual <= LARGEST_RESIDUAL)

    @property
    def summary(self) -> dict[str, Any]:
        """Counts and ranges: flips, iterations, seam edges, scale factors, distortion where there is no
        seam."""
        state = self.metric.triangulation
        facts: dict[str, Any] = {
            "delaunay_flips": self.delaunay.flips,
            "ptolemy_flips": state.flips,
            "newton_iterations": self.metric.iterations,
            "degenerate_faces": self.metric.degenerate_faces,
            "seam_edges": int(self.layout.seam.sum()) // 2,
            "log_scale_factor": {"min": float(self.scale.min()), "max": float(self.scale.max())},
        }
        if not self.layout.seam.any():
            facts["conformal_distortion"] = mean_and_largest(
                self.mesh, self.distortion()["conformal_distortion"]
            )
        return facts

    @property
    def accuracy(self) -> dict[str, float]:
        """`angle_sum_residual` in radians, and `layout_residual` relative to the size of the layout."""
        return {"angle_sum_residual": self.metric.residual, "layout_residual": self.layout.residual}

    @cached_property
    def subdivision(self) -> CommonSubdivision:
        """Common subdivision of the input and the flat triangulation."""
        return flat_overlay(self.mesh, self.plain, self.delaunay, self.metric.triangulation, self.scale)

    def overlay(self) -> AnnotatedMesh:
        """The common subdivision with `uv` on its vertices, cut open along the seams."""
        return flat_overlay_mesh(self.subdivision, self.layout)

    def distortion(self) -> dict[str, NDArray[np.float64]]:
        """Distortion on the faces of the input, linear from vertex to vertex; empty where there are seams."""
        uv = self.uv
        return {} if uv is None else distortion_arrays(self.mesh, uv[self.mesh.faces])


def conformal_map(
    mesh: TriangleMesh,
    *,
    cones: Mapping[int, float] | None = None,
    boundary: str = "free",
    boundary_values: NDArray | None = None,
    operator: str | None = None,
    progress: ProgressCallback | None = None,
) -> ConformalMap:
    """Map a surface of any topology to the plane by a discrete conformal map with prescribed cones.

    Parameters
    ----------
    mesh : TriangleMesh
        A connected oriented manifold.
    cones, boundary, boundary_values
        See `conformal_targets`.
    operator : {'intrinsic-delaunay', 'cotan'}, optional
        Triangulation that defines the conformal class: the intrinsic Delaunay triangulation, which depends on
        the surface alone (the default), or the input's.
    progress : callable, optional

    Returns
    -------
    ConformalMap

    Raises
    ------
    MeshError, ParameterError
        See `conformal_targets`; also for sides so short beside others of their face that the rounding of a
        scale factor changes angles by more than the tolerance of the angle sums.

    Notes
    -----
    M. Gillespie, B. Springborn, K. Crane, "Discrete Conformal Equivalence of Polyhedral Surfaces", 2021; the
    boundary conditions are those of R. Sawhney, K. Crane, "Boundary First Flattening", 2017. Boundary edges
    are not flipped, so that a solution exists if triangles at the boundary are not too thin.
    """
    targets, start, plain = check_conformal_map(mesh, cones, boundary, boundary_values, operator)
    if operator == "cotan":
        flipped = IntrinsicDelaunay(plain, 0, 0, start, crossings=np.full((mesh.n_faces, 3), -1))
    else:
        flipped = flip_to_delaunay(mesh, track=True)
    crossings = np.full((mesh.n_faces, 3), -1) if flipped.crossings is None else flipped.crossings
    state = DecoratedTriangulation.of(flipped.mesh, crossings)
    metric = cone_metric(state, mesh.n_vertices, targets, progress)
    scale = metric.scale
    if not targets.fixed.any():  # the scale is free: keep the area
        before, after = (
            face_area(length.reshape(-1, 3)).sum()
            for length in (flipped.mesh.side_length, state.scaled_length(scale))
        )
        scale = scale + 0.5 * np.log(before / after)
    flat = state.mesh(state.scaled_length(scale), mesh.n_vertices)
    return ConformalMap(mesh, flat, scale, metric, flat_layout(flat, targets.cone), flipped, plain)


def check_conformal_map(
    mesh: TriangleMesh,
    cones: Mapping[int, float] | None,
    boundary: str,
    boundary_values: NDArray | None,
    operator: str | None,
) -> tuple[ConformalTargets, Mollification, IntrinsicMesh]:
    """Targets, side lengths and start of a conformal map; raises the errors of `conformal_map`.

    Parameters
    ----------
    mesh, cones, boundary, boundary_values, operator
        As in `conformal_map`.

    Returns
    -------
    targets : ConformalTargets
    lengths : Mollification
    start : IntrinsicMesh
    """
    if operator is not None and operator not in OPERATORS:
        raise ParameterError(f"{operator!r} is not one of {', '.join(OPERATORS)}", parameter="operator")
    targets = conformal_targets(mesh, cones, boundary, boundary_values)
    glued = glue(mesh)
    start = working_lengths(mesh, glued)
    _require_attainable_angles(start.length)
    return targets, start, IntrinsicMesh(glued.topology, start.length, mesh.points)


def _require_attainable_angles(length: NDArray) -> None:
    """Raise MeshError for faces whose angles rounding changes by more than the tolerance of angle sums.

    A change d of the scale factor at one end of a short side s beside long sides l turns them against it by
    about d l / s.
    """
    shortest, longest = length.min(axis=1), length.max(axis=1)
    bad = np.flatnonzero(np.finfo(np.float64).eps * longest > ANGLE_TOLERANCE * shortest)
    if len(bad):
        face, distance = bad[0], float(2.0 * shortest[bad].max())
        weld = f", or merge them with `repair=weld={distance:.1g} drop_degenerate split_fans`"
        if len(bad) == len(length):  # nothing would be left
            weld = ""
        faces = counted(len(bad), "face has", "faces have")
        raise MeshError(
            f"{faces} sides (first: face {face}) of {shortest[face]:.2g} beside "
            f"{longest[face]:.2g}: rounding changes their angles by more than {ANGLE_TOLERANCE:g} radians; "
            f"move their vertices apart{weld}"
        )
