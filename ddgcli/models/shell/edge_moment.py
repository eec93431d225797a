"""Moments on boundary edges: couples that turn the directors of the edges."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.hinges import HingeFrame, angle_gradient
from ddgcli.mechanics.terms import (
    Arrays,
    Memory,
    Mode,
    Potential,
    ProportionalLoad,
    RampedLoad,
    at_last_point,
)
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.models.shell.context import ShellContext
from ddgcli.models.shell.hinge import angle_hessian, wrapped
from ddgcli.models.shell.midedge import MidedgeBending, inward_directions, one_sided_frame, side_corners
from ddgcli.models.shell.tensor_potential import TensorPotential


class EdgeMoment(TensorPotential):
    """Potential of couples on boundary edges, positive if they bend the shell towards convex.

    The rotation of the director is its rotation p relative to the face normal, less the rotation of the face
    relative to a fixed direction. Mid-edge bending is minimised over p under the couple m l, too: this adds
    -m l p(x), which is linear in the angles of the shell. Without directors the couple acts on the face.

    A couple of constant magnitude has an energy only while the edge keeps its direction; otherwise the force
    is exact, and the energy approximate.

    Parameters
    ----------
    couple : (c,) ndarray
        In N m.
    side : (c,) ndarray
        Flat indices of the boundary sides.
    corner : (c, 3) ndarray
        Tail, head and apex of the sides.
    direction : (c, 3) ndarray
        Unit vectors into the faces at rest.
    bending : MidedgeBending or None
    turn : (c,) ndarray
        Rotations of the faces at the last accepted step, from which angles are measured: so they can exceed
        a full turn.
    """

    name = "load"
    exact_energy = False

    def __init__(
        self,
        couple: NDArray,
        side: NDArray,
        corner: NDArray,
        direction: NDArray,
        bending: MidedgeBending | None,
        turn: NDArray | None = None,
    ) -> None:
        self.couple, self.side, self.corner = couple, side, corner
        self.direction, self.bending = direction, bending
        self.turn = np.zeros(len(side)) if turn is None else turn
        self.weight = np.zeros(0) if bending is None else bending.side_weights(side, couple)
        stencils = [np.column_stack([corner, corner[:, 0]])]
        if bending is not None:
            stencils = [*bending.angle_stencils(), *stencils]
        self.stencil = np.concatenate(stencils)

    @property
    def is_zero(self) -> bool:
        return not np.any(self.couple)

    def scaled(self, factor: float) -> EdgeMoment:
        """The moments times a factor."""
        return EdgeMoment(
            factor * self.couple, self.side, self.corner, self.direction, self.bending, self.turn
        )

    def counted_from(self, turn: NDArray) -> EdgeMoment:
        """The same moments, with angles measured from other rotations of the faces."""
        return EdgeMoment(self.couple, self.side, self.corner, self.direction, self.bending, turn)

    @at_last_point
    def _hinge_frame(self, x: NDArray) -> HingeFrame:
        return one_sided_frame(x, self.corner, self.direction)

    def turns(self, x: NDArray) -> NDArray[np.float64]:
        """(c,) rotations of the faces, within half a turn of those at the last step."""
        return self.turn + wrapped(self._hinge_frame(x).angle - self.turn)

    def added_rotations(self) -> NDArray[np.float64] | float:
        """Rotations that the couples add to the edge directors; 0 without directors."""
        return 0.0 if self.bending is None else self.bending.rotations_of(self.side, self.couple)

    def energy(self, x: NDArray) -> float:
        inner = 0.0 if self.bending is None else float(self.weight @ self.bending.strain(x))
        return inner + float(self.couple @ self.turns(x))

    def gradient(self, x: NDArray) -> NDArray[np.float64]:
        slope = self.couple[:, None, None] * angle_gradient(self._hinge_frame(x))[:, :3]
        total = sum_by_index(self.corner, slope, len(x))
        return total if self.bending is None else total + self.bending.pulled_back(x, self.weight)

    def blocks(self, x: NDArray, mode: Mode) -> NDArray[np.float64]:
        if mode != "exact":
            return np.zeros((len(self.stencil), 12, 12))
        face = self.couple[:, None, None] * angle_hessian(self._hinge_frame(x))
        if self.bending is None:
            return face
        return np.concatenate([self.weight[:, None, None] * self.bending.angle_hessians(x), face])


@dataclass(frozen=True, eq=False)
class EdgeTurns(Memory):
    """Memory of the rotations of the faces under an edge moment, so that they can exceed half a turn."""

    potential: Any
    effect: str = "load"

    def _moment(self) -> EdgeMoment:
        inner = self.potential
        return inner.potential if isinstance(inner, RampedLoad | ProportionalLoad) else inner

    def initial(self) -> Arrays:
        return {"turn": np.zeros(len(self._moment().side))}

    def at(self, memory: Arrays) -> Any:
        moment = self._moment().counted_from(memory["turn"])
        ramped = isinstance(self.potential, RampedLoad | ProportionalLoad)
        return replace(self.potential, potential=moment) if ramped else moment

    def commit(self, x: NDArray, memory: Arrays) -> Arrays:
        turn = self._moment().counted_from(memory["turn"]).turns(x)
        return memory if np.array_equal(turn, memory["turn"]) else {"turn": turn}


def edge_moment(context: ShellContext, vertices: NDArray, moment: float) -> Potential:
    """Potential of moments on the boundary edges that join some vertices.

    Parameters
    ----------
    context : ShellContext
    vertices : (k,) ndarray of int64
    moment : float
        Moment per length of the edges, in N m per metre.

    Returns
    -------
    Potential

    Raises
    ------
    ValueError
        If no boundary edge joins two of the vertices, or a pin clamps one that does.
    """
    topology, mesh = context.mesh.topology, context.mesh
    is_boundary = topology.side_twin.ravel() < 0
    ends = np.isin(topology.side_tail, vertices) & np.isin(topology.side_head, vertices)
    side = np.flatnonzero(is_boundary & ends)
    if not len(side):
        raise ValueError(
            "no edge of the boundary joins two of these vertices; a moment on vertices or a box acts on "
            "boundary edges, one on an interior edge needs edge = [a, b]"
        )
    directors = [p for p in context.terms.get("bending", []) if isinstance(p, MidedgeBending)]
    bending = directors[0] if directors else None
    if bending is not None and np.isin(side, bending.clamps.side).any():
        raise ValueError("a moment acts on an edge whose direction a pin clamps; leave out one of them")
    couple = moment * mesh.side_length.ravel()[side]
    direction = inward_directions(np.asarray(mesh.points), side_corners(topology)[side])
    return EdgeMoment(couple, side, side_corners(topology)[side], direction, bending)
