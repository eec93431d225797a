"""`ddgcli shell-sim`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import click

from ddgcli.cli.options import Ids, joined_ids
from ddgcli.cli.simulation.options import SceneCall, scene_options
from ddgcli.errors import ParameterError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ddgcli.cli.simulation.plot import Picture
    from ddgcli.models.shell.shell_scene import ShellScene
    from ddgcli.scenes.scene import Scene
    from ddgcli.scenes.scene_model import ReadArray, ReadMesh
    from ddgcli.simulation.account import Account
    from ddgcli.simulation.outcome import Outcome

TIME_STEP_OPTIONS = ("steps", "duration", "step", "frame_every", "tolerance")


@click.command(
    "shell-sim",
    epilog="Choosing an integrator: newmark (the default, second order); implicit-euler for stiff motion "
    "without fine detail; verlet, or avi on graded meshes, where the stable step is long enough; static for "
    "equilibria. Others: implicit-midpoint, symplectic-euler, bdf2. See docs/shell-sim.md and "
    "docs/accuracy/shell-sim.md.",
)
@scene_options("bending=midedge, stretching=edges", "the size of the object")
@click.option(
    "--pin",
    "pinned",
    type=Ids(),
    multiple=True,
    callback=joined_ids,
    metavar="ID...",
    help="Quick form: pin these vertices.",
)
@click.option(
    "--material",
    metavar="NAME",
    help="Quick form: material preset: cotton, silk, felt, leather, paper, leaf, rubber, plastic, aluminium, "
    "steel or glass.",
)
@click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="KEY=VALUE",
    help="Quick form: set a key of the object, in TOML.",
)
@click.option(
    "--modes",
    type=click.IntRange(1, 1000),
    metavar="K",
    help="Compute K vibration modes about the start, or the equilibrium of `static`; no time steps.",
)
@click.option(
    "--buckling", type=click.IntRange(1, 1000), metavar="K",
    help="Compute the K lowest load factors at which the shell buckles (linear theory); no time steps.",
)  # fmt: skip
def command(call: SceneCall, modes: int | None, buckling: int | None, **quick: Any) -> None:
    """Simulate thin elastic shells: SCENE is a .toml file, or a mesh with the options of the quick form.

    \b
    Examples:
      ddgcli shell-sim hat.toml -o hat.vtkhdf
      ddgcli shell-sim sheet.obj --effect stretching --effect bending --effect gravity --pin 0 -o run.vtkhdf
    """
    from ddgcli.cli.simulation.scene_run import run_scene
    from ddgcli.models.shell.scene import KIND
    from ddgcli.models.shell.shell_scene import ShellScene

    lines, extra = quick_lines({"effect_lines": call.effect_lines, **quick})

    def build(scene: Scene, account: Account, read_mesh: ReadMesh, read_array: ReadArray) -> ShellScene:
        if (modes or buckling) and scene.time.integrator != "static":
            _require_no_steps(call, "modes" if modes else "buckling")
        return ShellScene(scene, account, read_mesh, read_array, modes, buckling)

    run_scene(call, KIND, build, _picture, lines, extra)


def _require_no_steps(call: SceneCall, analysis: str) -> None:
    """Refuse options of time steps, and of their continuation, beside an analysis that takes none."""
    if call.resume:
        raise ParameterError(f"`{analysis}` takes no time steps; leave --resume out", parameter="resume")
    for name in TIME_STEP_OPTIONS:
        if name in call.overrides:
            raise ParameterError(
                f"`{analysis}` takes no time steps; leave this out, or use `integrator=static`",
                parameter="dt" if name == "step" else name,
            )


def quick_lines(options: Mapping[str, Any]) -> tuple[tuple[str, ...], dict[str, Any]]:
    """Effect lines and object keys that the options of the quick form stand for."""
    from ddgcli.cli.simulation.scene_input import toml_settings

    pinned, material = options.get("pinned"), options.get("material")
    lines = (*options.get("effect_lines", ()), *([f"pin vertices={list(pinned)}"] if pinned else []))
    named = {"material": material} if material else {}
    return lines, {**named, **toml_settings(options.get("settings", ()))}


def _picture(shells: ShellScene, outcome: Outcome) -> Picture:
    from ddgcli.cli.simulation.plot import Picture

    return Picture("strain", "strain", shape=_shape(shells.analysis, outcome.final_vertex))


def _shape(analysis: Mapping[str, Any], vertex: Mapping[str, NDArray]) -> tuple[str, NDArray] | None:
    """Title and displacement of the lowest buckling shape, else of the lowest mode that is not rigid."""
    import numpy as np

    from ddgcli.mechanics.modes import ZERO_FREQUENCY

    if "buckling_000" in vertex:
        return f"buckling at {analysis['load_factors'][0]:.4g} times the loads", vertex["buckling_000"]
    if "mode_000" not in vertex:
        return None
    frequencies = analysis["frequencies"]
    sizes = np.abs(frequencies)
    k = int(np.argmax(sizes > ZERO_FREQUENCY * sizes.max()))
    kind = "unstable mode" if frequencies[k] < 0 else "mode" if sizes[k] else "rigid motion"
    return f"{kind} {k}: {frequencies[k]:.4g} Hz", vertex[f"mode_{k:03d}"]
