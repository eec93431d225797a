"""The fluids of a scene: from the scene to models, and from their frames to results."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any

from ddgcli.mesh.periodic import Periods
from ddgcli.models.fluid import model
from ddgcli.scenes.scene import Scene
from ddgcli.scenes.scene_model import ReadArray, ReadMesh
from ddgcli.simulation.account import Account
from ddgcli.simulation.frames import joined_mesh
from ddgcli.simulation.model import Model, Schedule, parts_of_step
from ddgcli.simulation.outcome import Outcome


class FluidScene:
    """The fluids of a scene, a `SceneModel`.

    Parameters
    ----------
    scene : Scene
    account : Account
    read_mesh, read_array : callable
        Read a file that the scene names.
    """

    moving = False
    splits = False
    final_names = ()

    def __init__(self, scene: Scene, account: Account, read_mesh: ReadMesh, read_array: ReadArray) -> None:
        contexts = model.contexts(scene, read_mesh, read_array)
        self.contexts = {name: context for name, (context, _) in contexts.items()}
        self.scene = model.with_default_integrator(scene, self.contexts.values())
        self.account = account
        self.meshes = {name: context.mesh for name, context in self.contexts.items()}
        self.sha256 = {name: sha for name, (_, sha) in contexts.items()}

    @cached_property
    def fluids(self) -> dict[str, Any]:
        return model.build(self.scene, self.contexts, self.account)

    def assembled(self, schedule: Schedule) -> dict[str, Any]:
        from ddgcli.models.fluid import report

        return report.assembled(self.scene, self.fluids, schedule, self.account)

    def cost_facts(self) -> dict[str, Any]:
        return {}

    def linear_solver(self) -> str | None:
        return None

    def parts_of_step(self, schedule: Schedule) -> float:
        limit = min((fluid.step_limit() for fluid in self.fluids.values()), default=math.inf)
        return parts_of_step(schedule.dt, limit, adaptive=schedule.tolerance is not None)

    @property
    def energy_label(self) -> str:
        in_volume = any(context.is_volume for context in self.contexts.values())
        return f"kinetic energy over density [m{'⁵' if in_volume else '⁴'}/s²]"

    @property
    def periods(self) -> Periods | None:
        of_fluid = {name: context.period for name, context in self.contexts.items()}
        if not any(period.any() for period in of_fluid.values()):
            return None
        return Periods(of_fluid, joined_mesh(list(self.meshes.values()))[1])

    def models(self) -> dict[str, Model]:
        return {name: fluid.model() for name, fluid in self.fluids.items()}

    def face(self) -> dict[str, Any]:
        from ddgcli.models.fluid import report

        return report.face_arrays(list(self.contexts.values()))

    def schedule(self) -> Schedule:
        return self.scene.schedule()

    def final(self, outcome: Outcome) -> tuple[dict[str, Any], dict[str, Any]]:
        return {}, {}

    def obstacle_poses(self, time: float) -> dict[str, Any]:
        return {}  # obstacles of fluids are cut out of the mesh and stay

    def failure_reason(self, outcome: Outcome) -> str:
        return ""

    def summary(self, outcome: Outcome) -> tuple[dict[str, Any], dict[str, Any]]:
        from ddgcli.models.fluid import report

        results, accuracy = report.summary(outcome, self.fluids)
        reason = {"stopped_because": outcome.failure} if outcome.failure else {}
        return {**results, **reason}, accuracy
