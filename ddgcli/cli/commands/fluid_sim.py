"""`ddgcli fluid-sim`."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import click

from ddgcli.choices import VELOCITY_GLYPHS
from ddgcli.cli.simulation.options import SceneCall, scene_options
from ddgcli.errors import ParameterError

if TYPE_CHECKING:
    from ddgcli.cli.simulation.plot import Picture
    from ddgcli.cli.simulation.scene_run import ReadArray, ReadMesh
    from ddgcli.scenes.scene import Scene
    from ddgcli.simulation.account import Account
    from ddgcli.simulation.model import Model, Schedule
    from ddgcli.simulation.outcome import Outcome


@click.command(
    "fluid-sim",
    epilog="Choosing an integrator: conservative (volumes: energy), the default, for accuracy; circulation "
    "for steps many cells long; covector on stretched triangles; energy to conserve energy exactly. See "
    "docs/fluid-sim.md and docs/accuracy/fluid-sim.md.",
)
@scene_options
@click.option("--vorticity", metavar="ARRAY", help="Quick form: vertex array, .npy or expression in x, y, z.")
@click.option(
    "--flow",
    metavar="NAME",
    help="Quick form: initial flow: taylor-vortices, vortex-pair, rotation, taylor-green, jet, "
    "rossby-haurwitz, shear-layer or vortex-ring.",
)
@click.option(
    "--glyphs", type=click.Choice(VELOCITY_GLYPHS), default=VELOCITY_GLYPHS[0], show_default=True,
    help="Velocity in the picture.",
)  # fmt: skip
@click.option("--viscosity", metavar="NU", help="Quick form: kinematic viscosity [m^2/s].")
def command(call: SceneCall, glyphs: str, **quick: Any) -> None:
    """Simulate incompressible flow on a surface or in a volume.

    SCENE is a .toml file, or a mesh with the options of the quick form.

    \b
    Examples:
      ddgcli fluid-sim taylor_vortices.toml -o taylor.vtkhdf
      ddgcli fluid-sim sphere.obj --vorticity '5*z' --duration 2 --dt 0.02 -o run.vtkhdf
      ddgcli fluid-sim torus.ply --flow vortex-pair --effect harmonic --viscosity 1e-3
    """
    from ddgcli.cli.simulation.scene_run import run_scene
    from ddgcli.models.fluid.scene import KIND

    if glyphs != VELOCITY_GLYPHS[0] and call.common.plot is None:
        raise ParameterError("--glyphs is for pictures; draw one with --plot")
    run_scene(
        call, KIND, partial(Fluids, glyphs=glyphs), *quick_lines({"effect_lines": call.effect_lines, **quick})
    )


def quick_lines(options: Mapping[str, Any]) -> tuple[tuple[str, ...], dict[str, Any]]:
    """Lines of effects that the options of the quick form mean; the object has no keys of its own there."""
    flows = {key: options[key] for key in ("vorticity", "flow") if options.get(key) is not None}
    lines = [f"initial {key}={json.dumps(value)}" for key, value in flows.items()]
    if options.get("viscosity") is not None:
        lines.append(f"viscosity nu={_number(options['viscosity'])}")
    return (*lines, *options.get("effect_lines", ())), {}


def _number(text: str) -> str:
    """A number as it is, anything else (a number with a unit) as a text of TOML."""
    try:
        return repr(float(text))
    except ValueError:
        return json.dumps(text)


class Fluids:
    """The fluids of a scene, as `cli.scene_run.Physics`."""

    moving = False
    splits = False
    final_names = ()

    def __init__(
        self, scene: Scene, account: Account, read_mesh: ReadMesh, read_array: ReadArray,
        glyphs: str = VELOCITY_GLYPHS[0],
    ) -> None:  # fmt: skip
        from ddgcli.models.fluid import model

        contexts = model.contexts(scene, read_mesh, read_array)
        self.contexts = {name: context for name, (context, _) in contexts.items()}
        self.scene = model.with_default_integrator(scene, self.contexts.values())
        self.account = account
        self.meshes = {name: context.mesh for name, context in self.contexts.items()}
        self.sha256 = {name: sha for name, (_, sha) in contexts.items()}
        self.largest, self.glyphs = 0.0, glyphs

    @cached_property
    def fluids(self) -> dict[str, Any]:
        from ddgcli.models.fluid import model

        return model.build(self.scene, self.contexts, self.account)

    def assembled(self, schedule: Schedule) -> dict[str, Any]:
        from ddgcli.models.fluid import report

        return report.assembled(self.scene, self.fluids, schedule, self.account)

    def cost_facts(self) -> dict[str, Any]:
        return {}

    def linear_solver(self) -> str | None:
        return None

    def parts_of_step(self, schedule: Schedule) -> float:
        from ddgcli.cli.forecast.prediction import parts_of_step

        limit = min((fluid.step_limit() for fluid in self.fluids.values()), default=math.inf)
        return parts_of_step(schedule.dt, limit, adaptive=schedule.tolerance is not None)

    def models(self) -> dict[str, Model]:
        return {name: fluid.model() for name, fluid in self.fluids.items()}

    def face(self) -> dict[str, Any]:
        from ddgcli.models.fluid import report

        return report.face_arrays(list(self.meshes.values()))

    def schedule(self) -> Schedule:
        return self.scene.schedule()

    def final(self, outcome: Outcome) -> tuple[dict[str, Any], dict[str, Any]]:
        return {}, {}

    def obstacle_poses(self, time: float) -> dict[str, Any]:
        return {}  # obstacles of fluids are cut out of the mesh and stay

    def picture(self) -> Picture:
        from ddgcli.cli.simulation.plot import Picture
        from ddgcli.models.fluid.report import wraps

        reach = self.largest or 1.0  # vortices are small and count: no robust limits
        # vorticity at rough walls is large, that of volumes a length: robust limits there
        in_volume = any(context.is_volume for context in self.contexts.values())
        robust = in_volume or any(fluid.setting.no_slip for fluid in self.fluids.values())
        limits = None if robust else (-reach, reach)
        return Picture(
            "vorticity", "vorticity [1/s]", limits, shown=~wraps(list(self.meshes.values())),
            arrows="velocity", glyphs=self.glyphs,
            energy=f"kinetic energy over density [m{'⁵' if in_volume else '⁴'}/s²]",
        )  # fmt: skip

    def failure_reason(self, outcome: Outcome) -> str:
        return ""

    def summary(self, outcome: Outcome) -> tuple[dict[str, Any], dict[str, Any]]:
        from ddgcli.models.fluid import report

        self.largest = outcome.largest.get("vorticity", 0.0)
        results, accuracy = report.summary(outcome, self.fluids)
        reason = {"stopped_because": outcome.failure} if outcome.failure else {}
        return {**results, **reason}, accuracy
