"""`ddgcli shell-sim`."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any

import click

from ddgcli.cli.simulation.options import SceneCall, scene_options

if TYPE_CHECKING:
    from ddgcli.cli.simulation.plot import Picture
    from ddgcli.cli.simulation.scene_run import ReadArray, ReadMesh
    from ddgcli.mechanics.system import System
    from ddgcli.scenes.scene import Scene
    from ddgcli.simulation.account import Account
    from ddgcli.simulation.model import Model, Schedule
    from ddgcli.simulation.outcome import Outcome


@click.command(
    "shell-sim",
    epilog="Which: newmark (second order) unless motion is stiff and detail unwanted, then "
    "implicit-euler; verlet where its stable step is long enough. See docs/shell-sim.md and "
    "docs/accuracy/shell-sim.md.",
)
@scene_options
@click.option(
    "--pin", "pinned", type=int, multiple=True, metavar="ID", help="Quick form: hold a vertex. Repeatable."
)
@click.option("--material", metavar="NAME", help="Quick form: material preset.")
@click.option(
    "--set", "settings", multiple=True, metavar="KEY=VALUE", help="Quick form: a key of the object, in TOML."
)
def command(call: SceneCall, **quick: Any) -> None:
    """Move thin elastic shells: SCENE (.toml, or a mesh for the quick form) in, a trajectory out.

    \b
    Examples:
      ddgcli shell-sim hat.toml -o hat.vtkhdf
      ddgcli shell-sim sheet.obj --effect stretching --effect bending --effect gravity --pin 0 -o run.vtkhdf
    """
    from ddgcli.cli.simulation.scene_run import run_scene
    from ddgcli.models.shell.scene import KIND

    lines, extra = quick_lines({"effect_lines": call.effect_lines, **quick})
    run_scene(call, KIND, Shells, lines, extra)


def quick_lines(options: Mapping[str, Any]) -> tuple[tuple[str, ...], dict[str, Any]]:
    """Lines of effects and keys of the object that the options of the quick form mean."""
    from ddgcli.cli.simulation.scene_input import toml_settings

    pinned, material = options.get("pinned"), options.get("material")
    lines = (*options.get("effect_lines", ()), *([f"pin vertices={list(pinned)}"] if pinned else []))
    named = {"material": material} if material else {}
    return lines, {**named, **toml_settings(options.get("settings", ()))}


class Shells:
    """The shells of a scene, as `cli.scene_run.Physics`."""

    moving = True

    def __init__(self, scene: Scene, account: Account, read_mesh: ReadMesh, read_array: ReadArray) -> None:
        from ddgcli.models.shell import model

        contexts = model.contexts(scene, read_mesh)
        self.scene, self.account = scene, account
        self.contexts = {name: context for name, (context, _) in contexts.items()}
        self.meshes = {name: context.mesh for name, context in self.contexts.items()}
        self.sha256 = {name: sha for name, (_, sha) in contexts.items()}
        for context in self.contexts.values():
            self.sha256 |= {name: placed.sha256 for name, placed in context.obstacles.items()}

    @cached_property
    def systems(self) -> dict[str, System]:
        """Masses and terms by shell."""
        from ddgcli.models.shell import model

        return model.systems(self.scene, self.contexts, self.account)

    @cached_property
    def order(self) -> list[tuple[str, int]]:
        """System and number of vertices of each shell."""
        from ddgcli.models.shell.groups import groups

        owner = {name: g.name for g in groups(self.scene, self.contexts) for name in g.shells}
        return [(owner[name], context.mesh.n_vertices) for name, context in self.contexts.items()]

    def assembled(self, schedule: Schedule) -> dict[str, Any]:
        from ddgcli.models.shell import report

        return report.assembled(self.scene, self.contexts, self.systems, schedule)

    def models(self) -> dict[str, Model]:
        from ddgcli.models.shell import model

        return model.models(self.scene, self.contexts, self.systems)

    def face(self) -> dict[str, Any]:
        return {}

    def picture(self) -> Picture:
        from ddgcli.cli.simulation.plot import Picture

        return Picture("strain", "strain")

    def doubt(self, outcome: Outcome) -> str:
        from ddgcli.models.shell import report

        return report.doubt(outcome, report.rounding(outcome, self.systems, self.order))

    def summary(self, outcome: Outcome) -> tuple[dict[str, Any], dict[str, Any]]:
        from ddgcli.models.shell import report

        static = self.scene.time.integrator == "static"
        return report.summary(outcome, self.systems, static, self.order)
