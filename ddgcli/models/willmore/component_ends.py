"""Ends of components in mean curvature flow: each shrinks to a point or to lines at its own time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import SolveError
from ddgcli.geometry.intrinsic import face_area
from ddgcli.mesh.ragged import unique_keys
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.willmore.constraints import areas
from ddgcli.models.willmore.descent import is_folded, mean_curvature_step
from ddgcli.models.willmore.endings import COLLAPSE, singular
from ddgcli.models.willmore.energies import EnergyBuilder
from ddgcli.models.willmore.step_rules import COLLAPSED_AREA_FRACTION, FOLDED_AREA_FRACTION
from ddgcli.simulation.model import Ending


@dataclass(frozen=True, eq=False)
class ComponentEnds:
    """Which components of a surface have ended, and when.

    Parameters
    ----------
    time : (c,) ndarray
        In the input's unit; nan while a component moves.
    singular : (c,) ndarray of bool
        It has shrunk to lines, or its faces became too slender; the others that ended shrank to points.
    """

    time: NDArray[np.float64]
    singular: NDArray[np.bool_]

    @classmethod
    def none(cls, n_components: int) -> ComponentEnds:
        """Of a surface all of whose components move."""
        return cls(np.full(n_components, np.nan), np.zeros(n_components, dtype=bool))

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, NDArray]) -> ComponentEnds:
        """The ends that `arrays` holds; of no component where it holds none."""
        if "end_time" not in arrays:
            return cls.none(0)
        return cls(np.asarray(arrays["end_time"]), np.asarray(arrays["singular"]) > 0)

    def arrays(self) -> dict[str, NDArray]:
        """The ends as arrays of floats; none of no component."""
        if not len(self.time):
            return {}
        return {"end_time": self.time, "singular": self.singular.astype(np.float64)}

    @property
    def ending(self) -> Ending:
        """Why a flow ends, all of whose components have."""
        if not self.singular.any():
            return COLLAPSE
        return singular(float(self.time[self.singular].max()))

    @property
    def moves(self) -> NDArray[np.bool_]:
        """(c,) components that have not ended."""
        return np.isnan(self.time)

    def with_collapsed(self, components: NDArray, time: float) -> ComponentEnds:
        """The ends with those of components (c,) of bool that shrank to points at a time."""
        return ComponentEnds(np.where(components, time, self.time), self.singular)

    def with_singular(self, components: NDArray, time: float) -> ComponentEnds:
        """The ends with those of components (c,) of bool that became singular at a time."""
        return ComponentEnds(np.where(components, time, self.time), self.singular | components)

    def remaining(self, topology: Topology, component: NDArray) -> Topology:
        """The faces of the components that move.

        Parameters
        ----------
        topology : Topology
        component : (n,) ndarray of int
            Of each vertex.

        Returns
        -------
        Topology
            The same one where all of its components move, or none.
        """
        moves = self.moves[component[topology.faces[:, 0]]]
        if moves.all() or not moves.any():
            return topology
        return Topology(topology.faces[moves], topology.n_vertices)


def component_step(
    mesh: TriangleMesh, component: NDArray, free: NDArray, dt: float, first_area: NDArray
) -> tuple[TriangleMesh, NDArray[np.bool_], NDArray[np.bool_]]:
    """Step of mean curvature flow, and the components that end in it.

    Parameters
    ----------
    mesh : TriangleMesh
    component : (n,) ndarray of int
        Of each vertex.
    free : (k,) ndarray of int
        Vertices that may move.
    dt : float
        In length^2.
    first_area : (c,) ndarray
        Of each component at the start of the flow.

    Returns
    -------
    moved : TriangleMesh
        Components that became singular are as before the step.
    collapsed, singular : (c,) ndarray of bool
    """
    moved, failed = _stepped(mesh, component, free, dt, len(first_area))
    moving = np.bincount(component[free], minlength=len(first_area)) > 0
    collapsed = moving & ~failed & (areas(moved, component) < COLLAPSED_AREA_FRACTION * first_area)
    before, after = (_folded_share(surface, component, len(first_area)) for surface in (mesh, moved))
    folded = moving & ~collapsed & (before <= FOLDED_AREA_FRACTION) & (after > FOLDED_AREA_FRACTION)
    singular = failed | folded
    return with_components_of(mesh, moved, singular, component), collapsed, singular


def _stepped(
    mesh: TriangleMesh, component: NDArray, free: NDArray, dt: float, n_components: int
) -> tuple[TriangleMesh, NDArray[np.bool_]]:
    """The surface after a step, and the components (c,) that could not take it: they stay."""
    failed = np.zeros(n_components, dtype=bool)
    try:
        return mean_curvature_step(mesh, free, dt), failed
    except SolveError:  # of one matrix for all components: only each one alone shows which
        points = np.array(mesh.points)
    for k in unique_keys(component[free]).tolist():
        own = free[component[free] == k]
        try:
            points[own] = mean_curvature_step(mesh, own, dt).points[own]
        except SolveError:
            failed[k] = True
    return mesh.moved_unchecked(points), failed


def _folded_share(mesh: TriangleMesh, component: NDArray, n_components: int) -> NDArray[np.float64]:
    """Share (c,) of each component's area that lies on faces folded over."""
    own, area = component[mesh.faces[:, 0]], face_area(mesh.side_length)
    total = sum_by_index(own, area, n_components)
    folded = sum_by_index(own, np.where(is_folded(mesh), area, 0.0), n_components)
    return np.divide(folded, total, out=np.zeros(n_components), where=total > 0)


def with_components_of(
    before: TriangleMesh, after: TriangleMesh, components: NDArray, component: NDArray
) -> TriangleMesh:
    """A surface after a step, with some components as before it.

    Parameters
    ----------
    before, after : TriangleMesh
    components : (c,) ndarray of bool
    component : (n,) ndarray of int
        Of each vertex, -1 where no face uses it.

    Returns
    -------
    TriangleMesh
    """
    stays = (component >= 0) & components[component]
    return after.moved_unchecked(np.where(stays[:, None], before.points, after.points))


def not_finite(mesh: TriangleMesh, component: NDArray, energy_kind: EnergyBuilder) -> NDArray[np.bool_]:
    """Components whose energy is not finite.

    Parameters
    ----------
    mesh : TriangleMesh
    component : (n,) ndarray of int
        Of each vertex.
    energy_kind : callable
        Topology -> Energy.

    Returns
    -------
    (c,) ndarray of bool
    """
    own, bad = component[mesh.faces[:, 0]], np.zeros(component.max() + 1, dtype=bool)
    for k in unique_keys(own).tolist():
        single = Topology(mesh.faces[own == k], mesh.n_vertices)
        bad[k] = not math.isfinite(energy_kind(single).value(mesh.points))
    return bad
