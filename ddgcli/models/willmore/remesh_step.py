"""When a flow remeshes its surface, and what a remeshing may change."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import SolveError
from ddgcli.geometry.intrinsic import corner_angle
from ddgcli.geometry.normals import sphere_normals
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.willmore.area_energy import signed_volume
from ddgcli.models.willmore.constraints import area
from ddgcli.models.willmore.descent import folded_faces
from ddgcli.models.willmore.edge_flips import improved
from ddgcli.models.willmore.energies import ENERGIES
from ddgcli.models.willmore.remeshing import LONGEST, SHORTEST, Remesh, remeshed, target_length
from ddgcli.models.willmore.state import FlowState, Remeshing

INTERVAL = 5  # steps between remeshings
MAX_REMESHES = 30
MAX_SHARE_OUTSIDE = 0.05  # of the edges, too long or too short, above which the surface is remeshed
MIN_ANGLE = np.radians(20.0)  # or where an angle is smaller
# of the area in h^2 W, of the volume in h^2 sqrt(W A): h^2 the mean of the squared edges, W = int H^2
MAX_CHANGE = 0.25


@dataclass(frozen=True)
class RemeshTarget:
    """Lengths of edges.

    Parameters
    ----------
    length : float
        At unit size.
    adaptive : bool
        Shorter where the surface is curved.
    """

    length: float
    adaptive: bool = False


def remeshed_state(
    state: FlowState,
    target: RemeshTarget,
    movable: NDArray[np.bool_],
    energy: Callable[[TriangleMesh], float],
    restored: Callable[[FlowState], TriangleMesh],
) -> FlowState | None:
    """The state with edges near the target; None where none is due, or it would change the surface.

    Parameters
    ----------
    state : FlowState
    target : RemeshTarget
    movable : (n,) ndarray of bool
    energy : callable
        TriangleMesh -> energy.
    restored : callable
        FlowState -> its surface, back on the constraints.

    Returns
    -------
    FlowState or None

    Notes
    -----
    A remeshing is kept where no face folds, area and volume change by O(h^2) only, and the energy after it is
    below that after the one before, so that flow and remeshing come to an end.
    """
    past = state.remeshing
    waiting = state.steps > 0 and state.steps < past.step + INTERVAL
    mesh = TriangleMesh(state.points, state.topology)
    if waiting or past.count >= MAX_REMESHES or not _is_due(mesh, target):
        return None
    origin = np.arange(mesh.n_vertices) if past.origin is None else past.origin
    result = remeshed(Remesh(mesh, origin), movable, target.length, target.adaptive, sphere_normals)
    if result is None or not _same_surface(mesh, result.mesh):
        return None
    changed = replace(
        state, points=result.mesh.points, topology=result.mesh.topology, motion=None,
        remeshing=replace(past, origin=result.origin), lowest_second=math.inf, energy_then=math.inf,
    )  # fmt: skip
    try:
        points = restored(changed).points
    except SolveError:
        return None
    after = energy(TriangleMesh(points, result.mesh.topology))
    if not (math.isfinite(after) and (past.count == 0 or after < past.energy)):
        return None
    record = Remeshing(result.origin, past.count + 1, past.change + after - state.energy, state.steps, after)
    return replace(changed, points=points, energy=after, remeshing=record)


def improved_state(
    state: FlowState,
    movable: NDArray[np.bool_],
    energy: Callable[[TriangleMesh], float],
    restored: Callable[[FlowState], TriangleMesh],
) -> FlowState | None:
    """The state with flips and slides before the first step.

    Parameters
    ----------
    state, movable, energy, restored
        As in `remeshed_state`.

    Returns
    -------
    FlowState or None
        None where there is nothing to flip or slide.
    """
    mesh = improved(TriangleMesh(state.points, state.topology), sphere_normals, movable)
    if mesh is None:
        return None
    mesh = restored(replace(state, points=mesh.points, topology=mesh.topology))
    return replace(
        state, points=mesh.points, topology=mesh.topology, energy=energy(mesh),
        redistributions=int(not np.array_equal(mesh.points, state.points)),
        flips=int(mesh.topology is not state.topology),
    )  # fmt: skip


def _is_due(mesh: TriangleMesh, target: RemeshTarget) -> bool:
    """Whether edges are far from the target, or angles small."""
    if corner_angle(mesh.side_length).min() < MIN_ANGLE:
        return True
    aim = target_length(mesh, target.length, target.adaptive, sphere_normals)
    ratio = mesh.side_length / (0.5 * (aim[mesh.faces] + aim[np.roll(mesh.faces, -1, axis=1)]))
    return float(np.mean((ratio > LONGEST) | (ratio < SHORTEST))) > MAX_SHARE_OUTSIDE


def _same_surface(before: TriangleMesh, after: TriangleMesh) -> bool:
    """Whether no face has folded, the topology stays, and area and volume change by O(h^2) only."""
    one, other = before.topology, after.topology
    if (one.euler_characteristic, one.n_components) != (other.euler_characteristic, other.n_components):
        return False
    if folded_faces(after) > folded_faces(before):
        return False
    squared = max(float(np.mean(mesh.side_length**2)) for mesh in (before, after))
    size = area(before)
    bending = sum(ENERGIES["cotan"].of(mesh).value(mesh.points) for mesh in (before, after))
    if abs(area(after) - size) > MAX_CHANGE * squared * bending:
        return False
    volumes = [signed_volume(mesh.points, mesh.faces) for mesh in (before, after)]
    bound = MAX_CHANGE * squared * math.sqrt(bending * size)
    return not one.is_closed or abs(volumes[1] - volumes[0]) <= bound
