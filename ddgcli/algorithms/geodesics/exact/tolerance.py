"""Whether slack pays: what the near part of an exact run cost tells what the rest will, with and without.

Slack drops windows, but then any vertex may be bent around and launches windows of its own. Where exact
windows are few (small meshes, rough ones) that costs more than it saves, and the exact distance, which is
within any tolerance, is the cheaper one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.exact.wavefront import Wavefront

# least squares over 66 runs of eleven meshes (3k to 100k faces), each within a quarter of its time
WINDOWS_A_LAUNCH, WINDOWS_A_ROUND = 15.0, 1800.0
LAUNCHES = 1.25  # a vertex, under slack
SHARE, AT_LEAST = 0.1, 1000  # of the vertices that are measured exactly first
BUNDLED, ROOT = 40.0, 4.4  # windows that those of a vertex cost in bundles: so many, and times their root
SPARE = 2.0  # of the error among the near ones for that of all: farther parts may be rougher
SAFE = 0.85  # of the cost of going on: what slack must promise to cost at most


@dataclass(frozen=True, eq=False)
class NearestVertices:
    """The nearest vertices, measured exactly.

    Parameters
    ----------
    distance : (n,) ndarray of float64
        Upper bounds; final up to `radius`.
    radius : float
    final : int
        Number of the final ones.
    density, growth : float
        Windows a vertex in the outer three quarters, launches included; the power of the number of final
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
    def measured(cls, wavefront: Wavefront, most_windows: float) -> NearestVertices:
        """Run a wavefront until a tenth of the vertices are final; it can go on from there."""
        enough = max(SHARE * wavefront.tables.n_vertices, AT_LEAST)
        final, work = [0], [0.0]
        for part in (0.25, 1.0):
            wavefront.run(most_windows=most_windows, enough=part * enough)
            final.append(wavefront.final)
            work.append(wavefront.windows + WINDOWS_A_LAUNCH * wavefront.origins.count)
        density = np.diff(work) / np.maximum(np.diff(final), 1)
        middle = (final[1] + final[2]) / max(final[1], 1)  # of the outer part over that of the inner
        growth = np.log(max(density[1], 1.0) / max(density[0], 1.0)) / np.log(max(middle, 2.0))
        near = np.sort(wavefront.distance)[: wavefront.final]
        radius = float(near[-1]) if len(near) else 0.0
        return cls(
            wavefront.distance.copy(), radius, wavefront.final, float(density[1]), float(np.clip(growth, -0.5, 0.5)),
            wavefront.windows, wavefront.rounds,
        )  # fmt: skip

    def error_of(self, distance: NDArray) -> float:
        """Twice the largest excess of distances over these where they are final, relative to the radius."""
        inside = self.distance <= self.radius
        return SPARE * float((distance - self.distance)[inside].max(initial=0.0)) / (self.radius or 1.0)

    def slack_pays(self, slack: float, reachable: int) -> bool:
        """Whether starting anew with slack costs less than going on without, to that many vertices."""
        n, near = float(reachable), float(self.final)
        if not 0 < near < n:
            return False
        middle, power = 0.625 * near, self.growth + 1.0
        rest = self.density * middle / power * ((n / middle) ** power - (near / middle) ** power)
        rest = min(rest, BUNDLED * (n - near) + ROOT * np.sqrt(rest * (n - near)))
        rounds = self.rounds * np.sqrt(n / near)
        going_on = rest + WINDOWS_A_ROUND * (rounds - self.rounds)
        windows = 1.3 / (slack + 0.004) + WINDOWS_A_LAUNCH * LAUNCHES
        anew = n * windows + WINDOWS_A_ROUND * rounds / (1.0 + 1.5 * slack)
        return bool(anew < SAFE * going_on)
