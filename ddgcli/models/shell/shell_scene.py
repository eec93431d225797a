"""The shells of a scene: from the scene to models, and from their frames to results."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

from ddgcli.choices import SHELL_FACE_ARRAYS
from ddgcli.models.shell import model
from ddgcli.scenes.scene import Scene
from ddgcli.scenes.scene_model import ReadArray, ReadMesh
from ddgcli.simulation.account import Account
from ddgcli.simulation.model import Model, Schedule, parts_of_step
from ddgcli.simulation.outcome import Outcome

if TYPE_CHECKING:
    from ddgcli.mechanics.system import System
    from ddgcli.mesh.triangle_mesh import TriangleMesh
    from ddgcli.models.shell.context import ShellContext

# overhead of a shortest step of `avi`, over the cost of one evaluation of all elements
SHORTEST_STEP_SHARE = 0.3


class ShellScene:
    """The shells of a scene, a `SceneModel`.

    Parameters
    ----------
    scene : Scene
    account : Account
    read_mesh, read_array : callable
        Read a file that the scene names.
    modes, buckling : int, optional
        Number of vibration modes and of buckling modes to compute at the end.
    """

    moving = True
    energy_label = "energy [J]"
    periods = None

    def __init__(
        self,
        scene: Scene,
        account: Account,
        read_mesh: ReadMesh,
        read_array: ReadArray,
        modes: int | None = None,
        buckling: int | None = None,
    ) -> None:
        self.n_modes, self.n_buckling = modes, buckling
        self.analysis: dict[str, Any] = {}
        contexts = model.contexts(scene, read_mesh)
        self.scene, self.account = scene, account
        self.splits = scene.has_effect("fracture")
        self.contexts = {name: context for name, (context, _) in contexts.items()}
        self.meshes = {name: context.mesh for name, context in self.contexts.items()}
        self.sha256 = {name: sha for name, (_, sha) in contexts.items()}
        for context in self.contexts.values():
            self.sha256 |= {name: placed.sha256 for name, placed in context.obstacles.items()}

    @cached_property
    def systems(self) -> dict[str, System]:
        """System of each group of coupled shells, by name."""
        systems = model.systems(self.scene, self.contexts, self.account)
        model.warn_of_unused_obstacles(self.scene)
        return systems

    @property
    def final_names(self) -> tuple[str, ...]:
        """Names of arrays that `final` may return."""
        counts = {"mode": self.n_modes, "buckling": self.n_buckling}
        shapes = [f"{name}_{k:03d}" for name, count in counts.items() for k in range(count or 0)]
        return (*SHELL_FACE_ARRAYS, *shapes)

    @cached_property
    def order(self) -> list[tuple[str, int]]:
        """Name of the system and number of vertices of each shell."""
        from ddgcli.models.shell.groups import groups

        owner = {name: g.name for g in groups(self.scene, self.contexts) for name in g.shells}
        return [(owner[name], context.mesh.n_vertices) for name, context in self.contexts.items()]

    def assembled(self, schedule: Schedule) -> dict[str, Any]:
        from ddgcli.models.shell.dry_run import assembled

        return assembled(self.scene, self.contexts, self.systems, schedule)

    def cost_facts(self) -> dict[str, Any]:
        from ddgcli.models.shell.dry_run import cost_facts

        counts = {"modes": self.n_modes, "buckling": self.n_buckling}
        return cost_facts(self.scene, self.contexts) | counts

    def linear_solver(self) -> str | None:
        from ddgcli.models.shell.dry_run import step_solver

        return step_solver(self.scene, self.systems)

    def parts_of_step(self, schedule: Schedule) -> float:
        """Cost of a step of the schedule, in evaluations of all elements."""
        if self.scene.time.integrator == "avi":
            from ddgcli.mechanics.asynchronous import evaluations

            counts = [evaluations(system, schedule.dt) for system in self.systems.values()]
            return max(own + SHORTEST_STEP_SHARE * shortest for own, shortest in counts)
        limit = min((model.largest_step for model in self.models().values()), default=math.inf)
        return parts_of_step(schedule.dt, limit, adaptive=schedule.tolerance is not None)

    def models(self) -> dict[str, Model]:
        if self.n_modes or self.n_buckling:
            from ddgcli.models.shell import last_frame

            at_end = self.scene.time.integrator == "static"
            time = self.scene.time.duration if at_end else 0.0
            last_frame.check_analysis(self.systems, time if self.n_buckling else None)
        return model.models(self.scene, self.contexts, self.systems)

    def _at_end(
        self, outcome: Outcome
    ) -> tuple[dict[str, ShellContext], dict[str, System], list[tuple[str, int]]]:
        """Contexts, systems and order at the last frame: those at the start, unless a shell broke."""
        if not self.splits or outcome.last is None:
            return self.contexts, self.systems, self.order
        from ddgcli.models.shell.epochs import contexts_of_frame

        contexts = contexts_of_frame(self.contexts, outcome.last)
        order = [(owner, c.mesh.n_vertices) for (owner, _), c in zip(self.order, contexts.values())]
        return contexts, model.systems(self.scene, contexts, self.account), order

    def face(self) -> dict[str, Any]:
        return {}

    def schedule(self) -> Schedule:
        """Schedule of the scene; modes and buckling loads take no step, except to an equilibrium."""
        schedule = self.scene.schedule()
        analysed = self.n_modes or self.n_buckling
        if not analysed or self.scene.time.integrator == "static":
            return schedule
        return replace(schedule, steps=0, tolerance=None)

    def final(self, outcome: Outcome) -> tuple[dict[str, Any], dict[str, Any]]:
        """(vertex, face) arrays of the last frame: modes, strains, stresses and moments."""
        from ddgcli.models.shell.last_frame import final

        contexts, systems, order = self._at_end(outcome)
        vertex, face, self.analysis = final(outcome, contexts, systems, order, self.n_modes, self.n_buckling)
        return vertex, face

    def obstacle_poses(self, time: float) -> dict[str, Any]:
        from ddgcli.models.shell.obstacle_motion import displacement_row

        moving = [o for o in self.scene.objects if o.role == "obstacle" and o.moving]
        return {o.name: displacement_row(o, self.obstacle_middle(o), time) for o in moving}

    def obstacle_middle(self, obstacle: Any) -> Any:
        """Middle of an obstacle in the coordinates of its section or mesh file."""
        from ddgcli.models.shell.obstacle_motion import middle_of

        if obstacle.mesh is None:
            return middle_of(obstacle)
        points = next(c.obstacles[obstacle.name].mesh.points for c in self.contexts.values())
        points = points * (obstacle.scale or 1.0)
        return 0.5 * (points.min(axis=0) + points.max(axis=0))

    def failure_reason(self, outcome: Outcome) -> str:
        from ddgcli.models.shell import report

        contexts, systems, order = self._at_end(outcome)
        static = self.scene.time.integrator == "static"
        least = report.rounding(outcome, systems, order)
        reason = report.failure_reason(outcome, least, static=static)
        if static and not outcome.failure:
            from ddgcli.models.shell.groups import points_at_end
            from ddgcli.models.shell.load_rounding import load_rounding_reason

            end = points_at_end(outcome, systems, order)
            meshes: dict[str, list[TriangleMesh]] = {name: [] for name in systems}
            for (owner, _), context in zip(order, contexts.values()):
                meshes[owner].append(context.mesh)
            reason = load_rounding_reason(end, systems, meshes, outcome.end.time) or reason
        return reason

    def summary(self, outcome: Outcome) -> tuple[dict[str, Any], dict[str, Any]]:
        from ddgcli.models.shell import report

        static = self.scene.time.integrator == "static"
        _, systems, order = self._at_end(outcome)
        results, accuracy = report.summary(outcome, systems, order, static=static)
        if not static and outcome.steps:
            from ddgcli.models.shell.crossings import crossings

            results |= crossings(outcome, self.contexts, systems, order)
        return {**results, **self.analysis}, accuracy
