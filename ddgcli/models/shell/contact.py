"""Effect `contact`: shells do not pass through planes and spheres; with Coulomb friction."""

# mypy: disable-error-code="valid-type"

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from ddgcli.mechanics.terms import Mode, Potential
from ddgcli.models.shell.context import ShellContext
from ddgcli.scenes.sections import Key, Section
from ddgcli.scenes.units import quantity
from ddgcli.simulation.effects import Effect

STANDARD_GRAVITY = 9.81
ENERGY_SAFETY_FACTOR = 2.0  # waves may bring a vertex more than the energy of its own fall
HALF_GAP = 2 * 0.5 * np.log(2) + 0.5  # slope of the barrier at half its range, in units of its stiffness


class Contact(Section):
    """A barrier between vertices and obstacles, zero beyond `gap`, infinite at the surface."""

    pairs: list[list[str]] = Field(min_length=1, description='[["shell", "obstacle"], ...]')
    friction: quantity("", "coefficient of friction", ge=0) = 0.0
    gap: quantity("m", "distance at which contact begins; default: the thickness", gt=0) | None = None
    stiffness: quantity("Pa", "pressure at half the gap; default: what stops the first fall", gt=0) | None = (
        None
    )
    slip: quantity("m/s", "speed below which friction grows in proportion", gt=0) = 1e-3


class PlaneGap:
    """Signed distance to a half-space."""

    def __init__(self, point: Any, normal: Any) -> None:
        self.point = np.array(point, dtype=float)
        self.normal = np.array(normal, dtype=float) / np.linalg.norm(normal)

    def gap(self, x: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """(distance, normal, curvature of the surface of equal distance)."""
        d = (x - self.point) @ self.normal
        return d, np.broadcast_to(self.normal, x.shape), np.zeros(len(x))

    def reach(self, x: NDArray, move: NDArray) -> NDArray[np.float64]:
        """Fraction of each move at which the distance is zero, inf where it never is."""
        d, speed = (x - self.point) @ self.normal, move @ self.normal
        return np.where(speed < 0, d / np.where(speed < 0, -speed, 1.0), np.inf)


class SphereGap:
    """Signed distance to a ball."""

    def __init__(self, center: Any, radius: float) -> None:
        self.center, self.radius = np.array(center, dtype=float), radius

    def gap(self, x: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        away = x - self.center
        distance = np.sqrt(np.einsum("ni,ni->n", away, away))
        return distance - self.radius, away / distance[:, None], 1 / distance

    def reach(self, x: NDArray, move: NDArray) -> NDArray[np.float64]:
        away = x - self.center
        a = np.einsum("ni,ni->n", move, move)
        b = np.einsum("ni,ni->n", away, move)
        c = np.einsum("ni,ni->n", away, away) - self.radius**2
        inside = b * b - a * c
        hits = (b < 0) & (inside >= 0) & (a > 0)
        root = np.sqrt(np.where(hits, inside, 0.0))
        return np.where(hits, c / np.where(hits, root - b, 1.0), np.inf)


class Barrier:
    """Energy -k A (d - g)^2 ln(d / g) of every vertex nearer than g, A its area at rest.

    `weight` (n,) is k A; `closest` the part of the gap that is left where the vertices have spent what energy
    they bring.
    """

    name = "contact"

    def __init__(
        self, surface: PlaneGap | SphereGap, gap: float, weight: NDArray, closest: float = 0.5
    ) -> None:
        self.surface, self.range, self.weight, self.closest = surface, gap, weight, closest
        self.stencil = np.arange(len(weight))[:, None]

    def _near(self, x: NDArray) -> tuple[NDArray, NDArray, NDArray, NDArray]:
        d, normal, curvature = self.surface.gap(x)
        near = np.flatnonzero(d < self.range)
        return near, d[near], normal[near], curvature[near]

    def energy(self, x: NDArray) -> float:
        near, d, _, _ = self._near(x)
        if (d <= 0).any():
            return np.inf
        return -float(np.sum(self.weight[near] * (d - self.range) ** 2 * np.log(d / self.range)))

    def _slope(self, near: NDArray, d: NDArray) -> NDArray:
        away, log = d - self.range, np.log(d / self.range)
        return -self.weight[near] * (2 * away * log + away**2 / d)

    def gradient(self, x: NDArray) -> NDArray[np.float64]:
        near, d, normal, _ = self._near(x)
        total = np.zeros_like(x)
        total[near] = self._slope(near, d)[:, None] * normal
        return total

    def blocks(self, x: NDArray, mode: Mode) -> NDArray[np.float64]:
        near, d, normal, curvature = self._near(x)
        block = np.zeros((len(x), 3, 3))
        if mode == "material":
            return block  # stiffness damping leaves contact alone
        second = self.weight[near] * _curvature(d / self.range)
        outer = normal[:, :, None] * normal[:, None, :]
        block[near] = second[:, None, None] * outer
        if mode == "exact":
            bent = self._slope(near, d) * curvature
            block[near] += bent[:, None, None] * (np.eye(3) - outer)
        return block

    def longest(self, x: NDArray, move: NDArray) -> float:
        return float(min(1.0, 0.9 * self.surface.reach(x, move).min(initial=np.inf)))

    def outside(self, x: NDArray) -> tuple[int, float] | None:
        d = self.surface.gap(x)[0]
        worst = int(np.argmin(d))
        return (worst, float(d[worst])) if not d[worst] > 0 else None

    def stiffest(self) -> NDArray[np.float64]:
        return self.weight * _curvature(self.closest)


def _curvature(s: Any) -> Any:
    """Second derivative of -(s - 1)^2 ln s."""
    over = (1 - s) / s
    return -2 * np.log(s) + 4 * over + over**2


def _closest(energy: float) -> float:
    """The s in (0, 1) where -(s - 1)^2 ln s has a value, by bisection in ln s; at least 0.05.

    A barrier that is left less of its gap is too soft for the fall: steps that cross it are made shorter.
    """
    low, high = float(np.log(0.05)), 0.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if -(np.expm1(middle) ** 2) * middle > energy else (low, middle)
    return float(np.exp(high))


class Friction:
    """Coulomb friction of a barrier: normal force and tangent plane are those at the start of the step."""

    name = "contact"

    def __init__(self, barrier: Barrier, coefficient: float, slip: float) -> None:
        self.barrier, self.coefficient, self.slip = barrier, coefficient, slip

    @property
    def stencil(self) -> NDArray[np.int64]:
        return self.barrier.stencil

    def frozen(self, x: NDArray, dt: float) -> Potential:
        near, d, normal, _ = self.barrier._near(x)
        bound = -self.coefficient * self.barrier._slope(near, d)
        return Sliding(self.name, self.stencil, near, bound, normal, self.slip)


class Sliding:
    """R = sum bound f(|v tangential|), f' = 2 s - s^2 with s = speed / slip up to 1, then 1."""

    def __init__(
        self, name: str, stencil: NDArray, near: NDArray, bound: NDArray, normal: NDArray, slip: float
    ) -> None:
        self.name, self.stencil = name, stencil
        self.near, self.bound, self.normal, self.slip = near, bound, normal, slip

    def _tangential(self, v: NDArray) -> tuple[NDArray, NDArray]:
        v = v[self.near]
        t = v - np.einsum("ni,ni->n", v, self.normal)[:, None] * self.normal
        return t, np.sqrt(np.einsum("ni,ni->n", t, t))

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


def build(parameters: Contact, context: ShellContext) -> list[Barrier | Friction]:
    key: Key = ("effects", "contact")
    shell = context.shell
    gap, density = float(parameters.gap or shell.thickness or 0), float(shell.density or 0)
    parts: list[Barrier | Friction] = []
    for pair in parameters.pairs:
        surface = _obstacle_of(pair, parameters.pairs, context, key)
        if surface is None:
            continue
        energy = density * _impact(context, surface)
        pressure = float(parameters.stiffness or max(2 * energy / gap, 10 * STANDARD_GRAVITY * density))
        stiffness = pressure / (HALF_GAP * gap)
        closest = _closest(ENERGY_SAFETY_FACTOR * energy * HALF_GAP / (pressure * gap))
        barrier = Barrier(surface, gap, stiffness * context.vertex_area, closest)
        inside = barrier.outside(np.asarray(context.mesh.points))
        if inside is not None:
            raise ValueError(
                f"vertex {inside[0]} of {shell.name!r} starts {-inside[1]:.3g} m inside "
                f"{_other(pair, shell.name)!r}; move one of them"
            )
        parts.append(barrier)
        if parameters.friction:
            parts.append(Friction(barrier, parameters.friction, parameters.slip))
    return parts


def _impact(context: ShellContext, surface: PlaneGap | SphereGap) -> float:
    """Energy per mass of the shell's first fall."""
    height = float(np.clip(surface.gap(np.asarray(context.mesh.points))[0], 0, None).max())
    return 0.5 * float(np.sum(np.square(context.shell.velocity))) + STANDARD_GRAVITY * height


def _other(pair: list[str], name: str) -> str:
    return pair[1] if pair[0] == name else pair[0]


def _obstacle_of(
    pair: list[str], pairs: list[list[str]], context: ShellContext, key: Key
) -> PlaneGap | SphereGap | None:
    """The surface that this shell meets in a pair, or None where the pair is not about it."""
    scene = context.scene
    if [sorted(p) for p in pairs].count(sorted(pair)) > 1:
        scene.refuse((*key, "pairs"), f"the pair {pair} stands more than once; leave one")
    if len(pair) != 2:
        scene.refuse(key, f"a pair of contact is two names, found {pair}")
    roles = sorted(scene.find(name, (*key, "pairs")).role for name in pair)
    if roles != ["obstacle", "shell"]:
        scene.refuse(
            (*key, "pairs"), f"contact pairs a shell with an obstacle, found {pair} ({' and '.join(roles)})"
        )
    if context.shell.name not in pair:
        return None
    obstacle = scene.find(_other(pair, context.shell.name), key)
    if obstacle.plane is not None:
        return PlaneGap(obstacle.plane.point, obstacle.plane.normal)
    return SphereGap(obstacle.sphere.center, obstacle.sphere.radius)


EFFECT = Effect("contact", Contact, build, "a distance of each vertex; work only within the gap", ("shell",))
