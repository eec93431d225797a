"""`ddgcli fluid-sim`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import click

from ddgcli.choices import VELOCITY_GLYPHS
from ddgcli.cli.simulation.options import SceneCall, scene_options
from ddgcli.errors import ParameterError

if TYPE_CHECKING:
    from ddgcli.cli.simulation.plot import Picture
    from ddgcli.models.fluid.fluid_scene import FluidScene
    from ddgcli.simulation.outcome import Outcome


@click.command(
    "fluid-sim",
    epilog="Choosing an integrator: conservative (volumes: energy), the default, for accuracy; circulation "
    "for steps many cells long; covector on stretched triangles; energy to conserve energy exactly. See "
    "docs/fluid-sim.md and docs/accuracy/fluid-sim.md.",
)
@scene_options("viscosity=bochner", "the size of the flow")
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
    from ddgcli.models.fluid.fluid_scene import FluidScene
    from ddgcli.models.fluid.scene import KIND

    if glyphs != VELOCITY_GLYPHS[0] and call.common.plot is None:
        raise ParameterError("--glyphs is for pictures; draw one with --plot")
    lines, extra = quick_lines({"effect_lines": call.effect_lines, **quick})
    run_scene(call, KIND, FluidScene, partial(_picture, glyphs=glyphs), lines, extra)


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


def _picture(fluids: FluidScene, outcome: Outcome, glyphs: str) -> Picture:
    from ddgcli.cli.simulation.plot import Picture

    reach = outcome.largest.get("vorticity", 0.0) or 1.0  # vortices are small and count: no robust limits
    # vorticity at rough walls is large, that of volumes a length: robust limits there
    in_volume = any(context.is_volume for context in fluids.contexts.values())
    robust = in_volume or any(fluid.setting.no_slip for fluid in fluids.fluids.values())
    return Picture(
        "vorticity", "vorticity [1/s]", None if robust else (-reach, reach),
        arrows="velocity", glyphs=glyphs,
    )  # fmt: skip
