"""The state of a flow, and the criteria that end it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.intrinsic import face_area
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.willmore.component_ends import ComponentEnds
from ddgcli.models.willmore.endings import small_area_fall
from ddgcli.models.willmore.secant_pairs import SecantPairs
from ddgcli.models.willmore.step_rules import (
    ENERGY_ROUNDING,
    FILM_REST_FALL,
    NEWTON_REST_GRADIENT,
    REST_FALL,
    REST_GRADIENT,
)
from ddgcli.simulation.model import Ending

ENERGY_UNIT = 1.0  # energies are free of units; rounding of smaller ones is compared with this


@dataclass(frozen=True)
class Stop:
    """When a flow ends early; None leaves a criterion out.

    Parameters
    ----------
    gradient : float or None
        Dimensionless size of the gradient, |grad|_L2 area / energy; for films the deviation of 2 H.
    fall : float or None
        Relative fall of the energy in a step.
    mesh_error : bool
        End where no energy is left, and near rest where the gradient's part along the surface, made by the
        mesh alone, outweighs the part across.
    """

    gradient: float | None = None
    fall: float | None = None
    mesh_error: bool = False


DEFAULT_STOP = Stop(REST_GRADIENT, REST_FALL, True)
CONFORMAL_STOP = Stop(1e-6, 1e-4)  # curvature and energy are discretised apart: the end is no closer
NEWTON_STOP = Stop(NEWTON_REST_GRADIENT, None, True)
# along the normals a membrane has a minimum on most meshes
CONSTRAINED_NEWTON_STOP = Stop(NEWTON_REST_GRADIENT)
FILM_STOP = Stop(6e-7, FILM_REST_FALL)  # of 2 H times the radius: its largest deviation from a constant


@dataclass(frozen=True, eq=False)
class Remeshing:
    """What remeshing has done so far.

    Parameters
    ----------
    origin : (n,) ndarray of int64, optional
        Vertex of the input, -1 where new; None where all are those of the input.
    count : int
    change : float
        Of the energy by all of them.
    step : int
        Before which the last one was.
    energy : float
        After the last one.
    """

    origin: NDArray[np.int64] | None = None
    count: int = 0
    change: float = 0.0
    step: int = 0
    energy: float = math.inf


@dataclass(frozen=True, eq=False)
class FlowState:
    """A surface on its way, at unit size.

    Parameters
    ----------
    points : (n, 3) ndarray
    topology : Topology
        Of its faces, which flips change.
    energy : float
    time : float
        Flow time so far, in the input's unit.
    dt : float
        Next step of the descent, for the surface at unit size.
    steps : int
        Taken so far.
    increases, area_increases : int
        Steps so far over which the energy, or the area, rose.
    ending : Ending or None
        Why the flow ends here.
    lowest_second : float
        Lowest value so far of the second energy.
    energy_then : float
        Where the second energy was lowest.
    redistributions, flips : int
        Steps so far after which vertices slid along the surface, and edges flipped.
    large_constant_steps : int
        Steps so far, in time, by the larger constant of the Rosenbrock method.
    motion : (n, 3) ndarray, optional
        Of the last step of the descent, for momentum.
    pairs : SecantPairs
        Of the last steps of the descent, for quasi-Newton motions.
    remeshing : Remeshing
    self_intersections : int
        Pairs of faces that crossed at the last check.
    ends : ComponentEnds
        Of the components of mean curvature flow in time, of which `topology` has those that move.
    """

    points: NDArray[np.float64]
    topology: Topology
    energy: float
    time: float
    dt: float
    steps: int = 0
    increases: int = 0
    area_increases: int = 0
    ending: Ending | None = None
    lowest_second: float = math.inf
    energy_then: float = math.inf
    redistributions: int = 0
    flips: int = 0
    large_constant_steps: int = 0
    motion: NDArray[np.float64] | None = None
    remeshing: Remeshing = field(default_factory=lambda: Remeshing())
    pairs: SecantPairs = SecantPairs()
    self_intersections: int = 0
    ends: ComponentEnds = field(default_factory=lambda: ComponentEnds.none(0))

    def arrays(self, descent: bool, pairs: bool) -> dict[str, NDArray]:
        """The state as arrays of fixed shape, of the descent also the faces and the last motion, or pairs."""
        numbers = [
            self.energy, self.time, self.dt, self.steps, self.increases, self.area_increases,
            self.lowest_second, self.energy_then, self.redistributions, self.flips,
            self.remeshing.count, self.remeshing.change, self.remeshing.step, self.remeshing.energy,
            self.self_intersections, self.large_constant_steps,
        ]  # fmt: skip
        arrays: dict[str, NDArray] = {"points": self.points, "numbers": np.array(numbers, dtype=np.float64)}
        if descent:
            arrays["faces"] = self.topology.faces
        if self.remeshing.origin is not None:
            arrays["origin"] = self.remeshing.origin
        arrays |= self.ends.arrays()
        if pairs:
            arrays |= self.pairs.arrays(len(self.points))
        elif descent:
            arrays["motion"] = np.zeros_like(self.points) if self.motion is None else self.motion
        return arrays

    @classmethod
    def of_arrays(cls, arrays: dict[str, NDArray], topology: Topology, free: int) -> FlowState:
        """The state of arrays; `topology` where they hold no faces; `free` vertices move."""
        numbers = map(float, arrays["numbers"])
        energy, time, dt, steps, rises, area_rises, lowest, then, slides, flips, *last = numbers
        if "faces" in arrays:
            topology = Topology(arrays["faces"], len(arrays["points"]))
        remeshing = Remeshing(arrays.get("origin"), int(last[0]), last[1], int(last[2]), last[3])
        return cls(
            arrays["points"], topology, energy, time, dt, int(steps), int(rises), int(area_rises),
            lowest_second=lowest, energy_then=then, redistributions=int(slides), flips=int(flips),
            motion=arrays.get("motion"), remeshing=remeshing, pairs=SecantPairs.of_arrays(arrays, free),
            self_intersections=int(last[4]), large_constant_steps=int(last[5]),
            ends=ComponentEnds.of_arrays(arrays),
        )  # fmt: skip


def rounding_scale(energy: float) -> float:
    """Scale of the rounding errors of an energy.

    Parameters
    ----------
    energy : float

    Returns
    -------
    float
    """
    return max(abs(energy), ENERGY_UNIT)


def after_curvature_step(
    state: FlowState, moved: TriangleMesh, energy: float, dt: float, before: float, stop: Stop
) -> FlowState:
    """State after a timed step of mean curvature flow.

    Parameters
    ----------
    state : FlowState
    moved : TriangleMesh
        The surface after the step, of bending energy `energy`.
    energy, dt : float
    before : float
        Area before the step.
    stop : Stop
        Of the criteria `fall` is that of the area.

    Returns
    -------
    FlowState
    """
    after = float(face_area(moved.side_length).sum())
    ending = None
    if stop.fall is not None and before - after < stop.fall * before:
        ending = small_area_fall(stop.fall)
    return replace(
        state, points=moved.points, energy=energy, time=state.time + dt, ending=ending,
        steps=state.steps + 1,
        increases=state.increases + (energy - state.energy > ENERGY_ROUNDING * rounding_scale(state.energy)),
        area_increases=state.area_increases + (after > before * (1.0 + ENERGY_ROUNDING)),
    )  # fmt: skip
