"""Scenes of fluids run through the one time loop, as benches and tests need them."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.common.measure import cpu_seconds
from ddgcli.io.scene_file import parse_scene
from ddgcli.models.fluid.model import FluidModel, build, contexts
from ddgcli.models.fluid.scene import KIND
from ddgcli.scenes.scene import resolve
from ddgcli.simulation.account import Account
from ddgcli.simulation.model import Observation
from ddgcli.simulation.time_loop import evolve


@dataclass(frozen=True, eq=False)
class FluidRun:
    """Fluid, its frames, and what the run cost.

    Parameters
    ----------
    fluid : FluidModel
    observations : list of Observation
    seconds : float
        Of all steps, without the set-up [CPU s].
    account : Account
    solves_of_start : int
        Solves before the first step.
    steps : int
        Steps taken, more than those of the scene where these are divided.
    """

    fluid: FluidModel
    observations: list[Observation]
    seconds: float
    account: Account
    solves_of_start: int
    steps: int

    def series(self, name: str) -> NDArray[np.float64]:
        """A scalar of every frame."""
        return np.array([observation.scalar[name] for observation in self.observations])


def run_fluid(
    effects: str,
    time: str,
    shape: str = 'mesh = "given"',
    mesh: Any = None,
    objects: str = "",
    account: Account | None = None,
) -> FluidRun:
    """Run a scene with one fluid.

    Parameters
    ----------
    effects, time : str
        Lines of the tables [effects] and [time].
    shape : str
        The fluid's shape; by default `mesh`.
    mesh : TriangleMesh or TetMesh, optional
    objects : str
        Further tables [[object]].
    account : Account, optional
    """
    text = f'[time]\n{time}\n[[object]]\nname = "f"\nrole = "fluid"\n{shape}\n{objects}[effects]\n{effects}\n'
    scene, account = resolve(parse_scene(text), KIND, {}), account or Account()
    source = SimpleNamespace(mesh=mesh, vertex={}, face={}, sha256="", notes=())
    fluids = {name: context for name, (context, _) in contexts(scene, lambda _: source, np.load).items()}
    fluid = build(scene, fluids, account)["f"]
    snapshots = evolve({"f": fluid.model()}, scene.schedule(), account)
    all_snapshots = [next(snapshots)]
    solves, began = account.calls.get("solver", 0), cpu_seconds()
    all_snapshots += list(snapshots)
    seconds, observations = cpu_seconds() - began, [snapshot.observations["f"] for snapshot in all_snapshots]
    return FluidRun(fluid, observations, seconds, account, solves, all_snapshots[-1].steps)
