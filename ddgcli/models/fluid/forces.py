"""Force of the fluid on the obstacles that cut a plane, from the weak form: no pressure is computed.

For a flow w with the value e on an obstacle without slip and 0 on other walls, the momentum equation gives

    F . e = - (du/dt, w) - int omega (n x u) . w - nu int omega curl w,

whichever w: here that of a stream function that is y (for e = x) or -x (for e = y) on the obstacle's vertices
and 0 elsewhere. Such forces converge as fast as the energy, twice as fast as stresses at the wall
(V. John, "Higher order finite element methods and multigrid solvers in a benchmark problem", 2002). The part
of effects that is a gradient (hydrostatic pressure) is not in it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import NEXT
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.fluid.conservative import rate
from ddgcli.models.fluid.diffusion import VelocityDiffusion
from ddgcli.models.fluid.extent import is_horizontal
from ddgcli.models.fluid.phases import FluidSetting
from ddgcli.models.fluid.state import FluidState


class ObstacleForces:
    """Forces on every obstacle without slip, per density and depth [m^3/s^2]."""

    def __init__(self, setting: FluidSetting, scheme: VelocityDiffusion) -> None:
        self.space, self.scheme = setting.space, scheme
        slips = np.zeros(setting.space.n, dtype=bool) if setting.slip is None else setting.slip
        self.tests = {
            name: self._test(setting, rim)
            for name, rim in setting.context.obstacles.items()
            if not slips[rim].any()
        }

    def _test(self, setting: FluidSetting, rim: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(2, n) stream functions of the flows w for e = x and e = y, and (2, n) their curls."""
        space, points = self.space, setting.context.points
        topology = space.mesh.topology
        phi = np.where(rim & topology.boundary_vertex, np.stack([points[:, 1], -points[:, 0]]), 0.0)
        face, k = np.nonzero(topology.side_twin < 0)
        tail, head = space.faces[face, k], space.faces[face, NEXT[k]]
        own = rim[tail] & rim[head]
        along = 0.5 * (points[head] - points[tail])[:, :2].T * own
        ends = np.concatenate([tail, head])
        closing = np.stack([sum_by_index(ends, np.tile(a, 2), space.n) for a in along])
        return phi, np.stack([space.stiffness @ p for p in phi]) + closing

    def of(self, state: FluidState) -> dict[str, NDArray[np.float64]]:
        """(2,) force along x and y on each obstacle."""
        space, scheme = self.space, self.scheme
        phi = scheme.free_stream_function(state["vorticity"])
        x = np.concatenate([phi, state["coefficients"]])
        time = state.time
        moving = scheme.moving_at(time) if scheme.in_time else scheme.moving
        vorticity = scheme.active * (scheme.curl @ x + moving)
        push, turn, _ = rate(space, vorticity, state["coefficients"], True, time=time)
        friction = scheme.rate(x, time)
        inside = len(space.free)
        change = np.zeros(space.n)
        change[space.free] = space.factor.solve((push[space.free] + friction[:inside]), refine=False)
        turn = turn + friction[inside:]  # a frozen flow is held by a force, as the effect force would
        if space.lift_in_time is not None:
            stream = space.lift_in_time.rate(time)
            change += stream
            turn = turn - space.part_of(stream)
        slowing = space.stiffness @ change
        if len(turn):
            slowing += space.circulation_around(space.edge_inner * (turn @ space.harmonic))
        omega = scheme.weight * (scheme.curl @ x + moving)
        return {
            name: test @ (push - slowing) - scheme.nu * (curl @ omega)
            for name, (test, curl) in self.tests.items()
        }


def obstacle_forces(setting: FluidSetting, scheme: VelocityDiffusion) -> ObstacleForces | None:
    """Forces of a flow on the obstacles in a plane of constant z.

    Parameters
    ----------
    setting : FluidSetting
    scheme : VelocityDiffusion

    Returns
    -------
    ObstacleForces or None
        None without obstacles, and elsewhere than in such a plane.
    """
    context = setting.context
    if not context.obstacles or not isinstance(context.mesh, TriangleMesh):
        return None
    return ObstacleForces(setting, scheme) if is_horizontal(context) else None
