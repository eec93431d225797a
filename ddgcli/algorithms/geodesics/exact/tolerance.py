"""Predict from the nearest vertices whether a tolerance saves time.

A tolerance drops windows, but then paths may bend at any vertex, and every vertex launches windows. Where
exact windows are few (small or rough meshes) that costs more than it saves; the exact distance, which is
within any tolerance, is then cheaper.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.exact.wavefront import Wavefront

# Cost model in units of one window; least squares over 66 runs of eleven meshes (3k to 100k faces) predicts
# each
# time within 25 %.
LAUNCH_COST, ROUND_COST = 15.0, 1800.0
LAUNCHES_PER_VERTEX = 1.25  # with a tolerance
NEAR_FRACTION, MIN_NEAR_VERTICES = 0.1, 1000  # vertices that are computed exactly first
BUNDLE_COST, BUNDLE_ROOT_COST = (
    40.0,
    4.4,
)  # windows of one vertex in bundles: constant, and factor of their root
ERROR_SAFETY_FACTOR = 2.0  # farther parts may be rougher than the near ones
MAX_COST_RATIO = 0.85  # of the predicted cost with the tolerance to that without


@dataclass(frozen=True, eq=False)
class NearestVertices:
    """Exact distances of the vertices nearest to the sources, and the work that they took.

    Parameters
    ----------
    distance : (n,) ndarray of float64
        Upper bounds; final up to `radius`.
    radius : float
    final : int
        Number of the final ones.
    density, growth : float
        Windows per vertex in the outer three quarters, launches included; the power of the number of final
        vertices with which that grows.
    windows, rounds : int
        Work done.
    """

    distance: NDArray[np.float64]
    radius: float
    final: int
    density: float
    growth: float
    windows: int
    rounds: int

    @classmethod
    def measure(
        cls, wavefront: Wavefront, most_windows: float, most_vertices: float = np.inf
    ) -> NearestVertices:
        """Run a wavefront until a tenth of the vertices are final; another run continues it."""
        enough = max(min(NEAR_FRACTION * wavefront.tables.n_vertices, most_vertices), MIN_NEAR_VERTICES)
        final, work = [0], [0.0]
        for fraction in (0.25, 1.0):
            wavefront.run(most_windows=most_windows, enough=fraction * enough)
            final.append(wavefront.final)
            work.append(wavefront.windows + LAUNCH_COST * wavefront.origins.count)
        density = np.diff(work) / np.maximum(np.diff(final), 1)
        middle = (final[1] + final[2]) / max(final[1], 1)  # of the outer part over that of the inner
        growth = np.log(max(density[1], 1.0) / max(density[0], 1.0)) / np.log(max(middle, 2.0))
        near = np.sort(wavefront.distance)[: wavefront.final]
        radius = float(near[-1]) if len(near) else 0.0
        return cls(
            wavefront.distance.copy(), radius, wavefront.final, float(density[1]),
            float(np.clip(growth, -0.5, 0.5)), wavefront.windows, wavefront.rounds,
        )  # fmt: skip

    def error_of(self, distance: NDArray) -> float:
        """Twice the largest excess of distances over these where they are final, relative to the radius."""
        inside = self.distance <= self.radius
        return (
            ERROR_SAFETY_FACTOR
            * float((distance - self.distance)[inside].max(initial=0.0))
            / (self.radius or 1.0)
        )

    def further_work(self, reachable: int) -> float:
        """Windows beyond the nearest vertices, launches included, by the growth of their density."""
        n, near = float(reachable), float(self.final)
        if not 0 < near < n:
            return 0.0
        middle, power = 0.625 * near, self.growth + 1.0
        return float(self.density * middle / power * ((n / middle) ** power - (near / middle) ** power))

    def slack_saves_time(self, slack: float, reachable: int) -> bool:
        """True if a new run with slack is cheaper than continuing the exact run to `reachable` vertices."""
        n, near = float(reachable), float(self.final)
        if not 0 < near < n:
            return False
        rest = self.further_work(reachable)
        rest = min(rest, BUNDLE_COST * (n - near) + BUNDLE_ROOT_COST * np.sqrt(rest * (n - near)))
        rounds = self.rounds * np.sqrt(n / near)
        exact_cost = rest + ROUND_COST * (rounds - self.rounds)
        windows = 1.3 / (slack + 0.004) + LAUNCH_COST * LAUNCHES_PER_VERTEX
        slack_cost = n * windows + ROUND_COST * rounds / (1.0 + 1.5 * slack)
        return bool(slack_cost < MAX_COST_RATIO * exact_cost)
