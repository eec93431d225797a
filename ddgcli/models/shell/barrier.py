"""Barrier and friction between vertices and surfaces with a closed-form distance."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.solids import Surface
from ddgcli.mechanics.terms import BarrierPotential, Dissipation, Mode, Potential, TimedPositions
from ddgcli.mesh.vectors import row_dot, tangential
from ddgcli.models.shell.context import ShellContext
from ddgcli.models.shell.obstacle_motion import PlacedMotion
from ddgcli.models.shell.surfaces import PosedSurface
from ddgcli.scenes.scene import Scene

STANDARD_GRAVITY = 9.81  # m/s^2, of scenes without gravity
MIN_START_DISTANCE = 1e-3  # over the gap; a barrier there has 800 times its pressure at half the gap
REPULSION_DISTANCE = 0.1  # over the gap; a vertex that starts nearer is repelled by many gaps
SLIP_FRACTION = 1e-4  # default slip speed over the speed of a fall


class Barrier(BarrierPotential):
    """Energy -k A (d - g)^2 ln(d / g) of every vertex at a distance d below g, with its rest area A.

    The logarithmic barrier of [Li et al., "Incremental potential contact", 2020]. `weight` (n,) is k A;
    `closest` is the least expected distance over the gap, where a fall is stopped.
    """

    name = "contact"

    def __init__(self, surface: Surface, gap: float, weight: NDArray, closest: float = 0.5) -> None:
        self.surface, self.range, self.weight, self.closest = surface, gap, weight, closest
        self.stencil = np.arange(len(weight))[:, None]

    def near(self, x: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Vertices within the gap, their distances and the gradients of these."""
        d, normal = self.surface.gap(x)
        near = np.flatnonzero(d < self.range)
        return near, d[near], normal[near]

    def energy(self, x: NDArray) -> float:
        near, d, _ = self.near(x)
        if (d <= 0).any():
            return np.inf
        return -float(np.sum(self.weight[near] * (d - self.range) ** 2 * np.log(d / self.range)))

    def slope(self, near: NDArray, d: NDArray) -> NDArray:
        """Derivatives of the energies by the distances."""
        away, log = d - self.range, np.log(d / self.range)
        return -self.weight[near] * (2 * away * log + away**2 / d)

    def gradient(self, x: NDArray) -> NDArray[np.float64]:
        near, d, normal = self.near(x)
        total = np.zeros_like(x)
        total[near] = self.slope(near, d)[:, None] * normal
        return total

    def blocks(self, x: NDArray, mode: Mode) -> NDArray[np.float64]:
        block = np.zeros((len(x), 3, 3))
        if mode == "material":
            return block  # stiffness damping does not act on contact
        near, d, normal = self.near(x)
        second = self.weight[near] * curvature(d / self.range)
        block[near] = second[:, None, None] * normal[:, :, None] * normal[:, None, :]
        if mode == "exact":
            block[near] += self.slope(near, d)[:, None, None] * self.surface.hessian(x[near])
        return block

    def collision_free_fraction(self, x: NDArray, move: NDArray) -> float:
        return float(min(1.0, 0.9 * self.surface.reach(x, move).min(initial=np.inf)))

    def outside(self, x: NDArray) -> tuple[int, float] | None:
        d = self.surface.gap(x)[0]
        worst = int(np.argmin(d))
        return (worst, float(d[worst])) if not d[worst] > 0 else None

    def expected_stiffness(self, x: NDArray) -> NDArray[np.float64]:
        s = np.minimum(self.surface.gap(x)[0] / self.range, self.closest)  # a shell may start nearer
        return self.weight * curvature(np.maximum(s, MIN_START_DISTANCE))

    def surface_velocity(self, x: NDArray) -> NDArray[np.float64]:
        """(n, 3) velocities of the surface at points."""
        return np.zeros_like(x)


class MovingBarrier(Barrier):
    """The barrier of a moving surface at one time."""

    def __init__(
        self, surface: Surface, motion: PlacedMotion, gap: float, weight: NDArray, closest: float, time: float
    ) -> None:
        pose = motion.pose(time)
        super().__init__(PosedSurface(surface, pose), gap, weight, closest)
        self.fixed, self.motion, self.pose, self.time = surface, motion, pose, time

    def at(self, time: float) -> MovingBarrier:
        if time == self.time:
            return self
        moved = MovingBarrier(self.fixed, self.motion, self.range, self.weight, self.closest, time)
        moved.obstacle = self.obstacle
        return moved

    def travel_work(self, x: NDArray, before: TimedPositions, after: TimedPositions) -> float:
        """Energy in J that the surface adds between two times by its travel, with the force at x."""
        return -float(np.vdot(self.gradient(x), self.motion.travel(before, after)))

    def surface_velocity(self, x: NDArray) -> NDArray[np.float64]:
        return self.pose.velocities(x)

    def carried(self, x: NDArray, since: float) -> NDArray[np.float64]:
        """Positions x of an earlier time, with those near the surface moved along with it until now.

        Within `reach` = gap + travel a vertex keeps its position relative to the surface; the others stay
        outside, because the surface travels less far.
        """
        before = self.motion.pose(since)
        near = self.pose.points(before.body(x)) - x
        d = PosedSurface(self.fixed, before).gap(x)[0]
        return x + carry_weight(d, near, self.range)[:, None] * near


def carry_weight(distance: NDArray, travel: NDArray, gap: float) -> NDArray[np.float64]:
    """Weights with which vertices follow the motion of a surface.

    Parameters
    ----------
    distance : (n,) ndarray of float64
        Distance of each vertex from the surface.
    travel : (n, 3) ndarray of float64
        Displacement of the surface at each vertex.
    gap : float
        Range of the barrier.

    Returns
    -------
    (n,) ndarray of float64
        In [0, 1]; 1 near the surface.
    """
    reach = gap + np.sqrt(row_dot(travel, travel))
    return np.clip(2.0 - distance / reach, 0.0, 1.0)


def curvature(s: Any) -> Any:
    """Second derivative of -(s - 1)^2 ln s."""
    over = (1 - s) / s
    return -2 * np.log(s) + 4 * over + over**2


def closest_part(energy: float) -> float:
    """Solution s in (0, 1) of -(s - 1)^2 ln s = energy, by bisection in ln s.

    Solutions below 0.05 are not needed: such a barrier is too soft for the fall, and steps that cross it are
    shortened.

    Parameters
    ----------
    energy : float
        Energy to be stored, over the stiffness of the barrier.

    Returns
    -------
    float
        Distance over the range of the barrier, at least 0.05.
    """
    low, high = float(np.log(0.05)), 0.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if -(np.expm1(middle) ** 2) * middle > energy else (low, middle)
    return float(np.exp(high))


def fall_acceleration(scene: Scene) -> float:
    """Acceleration from which contact derives its default stiffness and slip speed.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    float
        In m/s^2: that of the effect `gravity`, or 9.81 without it.
    """
    sections = [section for effect, section, _ in scene.effects if effect.name == "gravity"]
    largest = max((float(np.linalg.norm(section.acceleration)) for section in sections), default=0.0)
    return largest or STANDARD_GRAVITY


def stopping_pressure(scene: Scene, energy: float, density: float, gap: float) -> float:
    """Default pressure at half the gap, which stops a fall.

    Parameters
    ----------
    scene : Scene
    energy : float
        Energy of the fall, in J/m^2.
    density : float
        Density of the shell, in kg/m^2.
    gap : float
        In m.

    Returns
    -------
    float
        In Pa; at least ten times the weight per area.
    """
    return max(2 * energy / gap, 10 * fall_acceleration(scene) * density)


def slip_speed(slip: float | None, contexts: list[ShellContext], velocity: NDArray | None = None) -> float:
    """Speed below which friction is proportional to the speed.

    By default a small fraction of the speed after a fall through the size of the shells with their initial
    speeds: bodies held by friction creep by at most that fraction of the size during such a fall.

    Parameters
    ----------
    slip : float or None
        Speed that the scene specifies, in m/s.
    contexts : list of ShellContext
    velocity : (3,) ndarray, optional
        Velocity of the obstacle, in m/s.

    Returns
    -------
    float
        In m/s.
    """
    if slip is not None:
        return float(slip)
    size = max(float(np.ptp(np.asarray(context.mesh.points), axis=0).max()) for context in contexts)
    still = np.zeros(3) if velocity is None else velocity
    squares = [float(np.sum(np.square(np.array(context.shell.velocity) - still))) for context in contexts]
    return SLIP_FRACTION * float(np.sqrt(2 * fall_acceleration(contexts[0].scene) * size + max(squares)))


class Friction(Dissipation):
    """Coulomb friction of a barrier, with the normal forces and tangent planes at which it is frozen."""

    name = "contact"

    def __init__(self, barrier: Barrier, coefficient: float, slip: float) -> None:
        self.barrier, self.coefficient, self.slip = barrier, coefficient, slip
        self.obstacle, self.stencil = barrier.obstacle, barrier.stencil

    def frozen(self, x: NDArray, dt: float) -> Potential:
        near, d, normal = self.barrier.near(x)
        # a moving surface may be where a vertex was before
        near, d, normal = near[d > 0], d[d > 0], normal[d > 0]
        bound = -self.coefficient * self.barrier.slope(near, d)
        wall = self.wall_velocity(x[near])
        return Sliding(self.name, self.stencil, near, bound, normal, self.slip, wall)

    def wall_velocity(self, x: NDArray) -> NDArray[np.float64]:
        """(n, 3) velocities of the surface at points."""
        return self.barrier.surface_velocity(x)


class MovingFriction(Friction):
    """Friction of a moving surface, which can add energy.

    The velocity of the surface is that of `wall`, the barrier at a later time; by default that of `barrier`.
    """

    active = True
    barrier: MovingBarrier

    def __init__(
        self, barrier: MovingBarrier, coefficient: float, slip: float, wall: MovingBarrier | None = None
    ) -> None:
        super().__init__(barrier, coefficient, slip)
        self.wall = wall or barrier

    def wall_velocity(self, x: NDArray) -> NDArray[np.float64]:
        at_surface = self.wall.pose.points(self.barrier.pose.body(x))
        return self.wall.surface_velocity(at_surface)

    def at(self, time: float) -> MovingFriction:
        return MovingFriction(self.barrier.at(time), self.coefficient, self.slip)

    def lagged(self, time: float) -> MovingFriction:
        """The friction with the normal forces of an earlier time."""
        return MovingFriction(self.barrier.at(time), self.coefficient, self.slip, self.barrier)


class Sliding(Potential):
    """R = sum bound f(speed), with f' = 2 s - s^2 and s = min(speed / slip, 1).

    The speed is that of a vertex along the surface, relative to the velocity (k, 3) of the surface, `wall`.
    """

    def __init__(
        self,
        name: str,
        stencil: NDArray,
        near: NDArray,
        bound: NDArray,
        normal: NDArray,
        slip: float,
        wall: NDArray,
    ) -> None:
        self.name, self.stencil = name, stencil
        self.near, self.bound, self.normal, self.slip, self.wall = near, bound, normal, slip, wall

    def _tangential(self, v: NDArray) -> tuple[NDArray, NDArray]:
        v = v[self.near] - self.wall
        t = tangential(v, self.normal)
        return t, np.sqrt(row_dot(t, t))

    def energy(self, x: NDArray) -> float:
        speed = self._tangential(x)[1]
        s = np.minimum(speed / self.slip, 1.0)
        return float(np.sum(self.bound * (self.slip * (s**2 - s**3 / 3) + np.maximum(speed - self.slip, 0))))

    def gradient(self, x: NDArray) -> NDArray[np.float64]:
        t, speed = self._tangential(x)
        total = np.zeros_like(x)
        total[self.near] = (self.bound * self._over(speed))[:, None] * t
        return total

    def _over(self, speed: NDArray) -> NDArray:
        """f'(speed) / speed."""
        return np.where(
            speed < self.slip,
            (2 - np.minimum(speed / self.slip, 1)) / self.slip,
            1 / np.maximum(speed, self.slip),
        )

    def blocks(self, x: NDArray, mode: Mode) -> NDArray[np.float64]:
        t, speed = self._tangential(x)
        block = np.zeros((len(x), 3, 3))
        unit = t / np.maximum(speed, 1e-300)[:, None]
        along = unit[:, :, None] * unit[:, None, :]
        plane = np.eye(3) - self.normal[:, :, None] * self.normal[:, None, :]
        second = np.where(speed < self.slip, 2 * (1 - np.minimum(speed / self.slip, 1)) / self.slip, 0.0)
        wide = (self.bound * self._over(speed))[:, None, None]
        block[self.near] = wide * (plane - along) + (self.bound * second)[:, None, None] * along
        return block
