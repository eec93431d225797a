"""Options of the simulators: time, resuming, and those of scenes in one argument.

Nothing here imports numpy, so that --help stays fast.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import click

from ddgcli.cli import options
from ddgcli.cli.options import CommonOptions
from ddgcli.errors import ParameterError

CURVE_TIME_UNIT = "length^2; elastic: length^4"
FLOW_TIME_UNIT = "length^4; mean-curvature: length^2"


def _time(unit: str, steps: str, error: str) -> tuple[Callable, ...]:
    """Options of the time axis, whose unit is `unit`; `error` is what errors of steps are relative to."""
    return (
        click.option("--steps", type=click.IntRange(1, 10**9), metavar="N", help=steps),
        click.option("--duration", type=options.POSITIVE_NUMBER, help=f"Length of the run [{unit}]."),
        click.option("--dt", "step", type=options.POSITIVE_NUMBER, help=f"Time step [{unit}]."),
        click.option("--frame-every", type=options.POSITIVE_NUMBER, help=f"Time between frames [{unit}]."),
        click.option(
            "--tolerance",
            type=options.POSITIVE_NUMBER,
            help=f"Adaptive steps: largest error of a step, relative to {error}.",
        ),
        click.option("--integrator", metavar="NAME", help="Time scheme."),
    )


_TIME_NAMES = ("steps", "duration", "step", "frame_every", "tolerance", "integrator")
_RESUME = click.option(
    "--resume",
    metavar="RUN.part",
    type=click.Path(readable=False),
    help="Continue an interrupted run from its last whole frame.",
)
_SCENE: tuple[Callable, ...] = (
    click.option("--effect", "effect_lines", multiple=True, metavar="'NAME KEY=VALUE ...'",
                 help="Quick form: add an effect, with its parameters in TOML. Repeatable."),
    click.option("--effects", "list_effects", is_flag=True, help="List the effects and their parameters."),
    click.option("--schema", is_flag=True, help="Print the JSON Schema of scenes, for editors."),
)  # fmt: skip


@dataclass(frozen=True)
class SceneCall:
    """Arguments of a simulator of scenes.

    Parameters
    ----------
    path : str, optional
        A scene (.toml) or the mesh of the quick form.
    common : CommonOptions
    overrides : dict
        Keys of [time] given as options, `steps` and `model`.
    resume : str, optional
        The .part to continue.
    effect_lines : tuple of str
        Lines of effects in the quick form.
    list_effects, schema : bool
        Print this instead of running.
    """

    path: str | None
    common: CommonOptions
    overrides: dict[str, Any] = field(default_factory=dict)
    resume: str | None = None
    effect_lines: tuple[str, ...] = ()
    list_effects: bool = False
    schema: bool = False


class FlowInput(click.Argument):
    """Input of a flow, which a resumed run needs again: its trajectory holds a hash of it alone."""

    def process_value(self, ctx: click.Context, value: Any) -> Any:
        try:
            return super().process_value(ctx, value)
        except click.MissingParameter as error:
            if ctx.params.get("resume"):
                message = "--resume needs the input again, with the options of the run."
                raise click.MissingParameter(message, ctx, self) from error
            raise


def flow_time_options(command: Callable) -> Callable:
    """Add the options of time for flows, whose time is a power of a length, and --resume."""
    return _with_time(command, _time(FLOW_TIME_UNIT, "Steps to take.", "the radius"))


def curve_time_options(command: Callable) -> Callable:
    """Add the same options for flows of curves, which have one time scheme."""
    return _with_time(command, _time(CURVE_TIME_UNIT, "Number of steps.", "the size of the curves")[:-1])


def _with_time(command: Callable, time: tuple[Callable, ...]) -> Callable:
    """Add time options to a command."""

    @functools.wraps(command)
    def with_arguments(*args: Any, **kwargs: Any) -> Any:
        overrides = {name: kwargs.pop(name, None) for name in _TIME_NAMES}
        if overrides["steps"] and overrides["duration"]:
            raise ParameterError("`steps` and `duration` exclude each other; give one")
        return command(*args, overrides={k: v for k, v in overrides.items() if v is not None}, **kwargs)

    for option in reversed((*time, _RESUME)):
        with_arguments = option(with_arguments)
    return with_arguments


def scene_options(models: str, error: str) -> Callable[[Callable], Callable]:
    """Decorator that adds SCENE, the common options, those of time and of scenes, in one `call: SceneCall`.

    `models` are examples of --model, `error` is what errors of steps are relative to.
    """
    model = click.option(
        "--model", "model", multiple=True, metavar="EFFECT=NAME",
        help=f"Select another model of an effect: {models}. Repeatable.",
    )  # fmt: skip
    time = _time("s", "Number of equal steps; overrides the scene's duration.", error)

    def decorate(command: Callable) -> Callable:
        @functools.wraps(command)
        def with_arguments(scene_path: str | None, **kwargs: Any) -> Any:
            names = kwargs.pop("model")
            values = {name: kwargs.pop(name) for name in SceneCall.__dataclass_fields__ if name != "path"}
            if names:
                values["overrides"] = {**values["overrides"], "model": list(names)}
            return command(SceneCall(scene_path, **values), **kwargs)

        for option in reversed((_SCENE[0], model, *_SCENE[1:])):
            with_arguments = option(with_arguments)
        return options.scene_arg(options.common(_with_time(with_arguments, time)))

    return decorate
