"""Options of the compared command: parsed by that command, restricted to those that a comparison uses."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import click

from ddgcli.cli.multi_value import repeat_options
from ddgcli.cli.parameters import option_names
from ddgcli.errors import ParameterError

TIME_OPTIONS = ("steps", "duration", "step", "tolerance")
SHELL_OPTIONS = ("effect_lines", "pinned", "material", "settings")
FLUID_OPTIONS = ("effect_lines", "vorticity", "flow", "viscosity")
FLOW_OPTIONS = ("flow", "energy", "boundary", "fix_area", "fix_volume")
MAP_OPTIONS = ("operator", "subdivide")  # of laplacian, with `maps`
SOURCE_OPTIONS = ("source", "source_point", "source_face")

# command -> (options of the problem, the same in every row; options that choose methods and parameters)
COMPARABLE_OPTIONS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "curvature": ((), ("scheme", "radius")),
    "delaunay": ((), ("refine", "max_points", "subdivide")),
    "laplacian": ((), ("eigen", "operator", "mass", "subdivide")),
    "geodesic": (
        SOURCE_OPTIONS,
        ("method", "tolerance", "operator", "heat_time", "heat_refine", "subdivide"),
    ),
    "shell-sim": ((*SHELL_OPTIONS, "model"), (*TIME_OPTIONS, "integrator")),
    "fluid-sim": ((*FLUID_OPTIONS, "model"), (*TIME_OPTIONS, "integrator")),
    "willmore-flow": (FLOW_OPTIONS, (*TIME_OPTIONS, "integrator")),
}


@dataclass(frozen=True)
class CommandCall:
    """Call of the compared command.

    Attributes
    ----------
    path : str
    options : dict
        Options that the caller set, by parameter name.
    problem_arguments : str
        Options of the problem, quoted for a shell; the command of every row repeats them.
    """

    path: str
    options: dict[str, Any]
    problem_arguments: str


def parse(compared: str, words: tuple[str, ...]) -> CommandCall:
    """Parse INPUT and options with the compared command's parser; messages name its options from here on.

    Raises
    ------
    click.UsageError
        If that command refuses them.
    ParameterError
        If an option changes nothing in a comparison.
    """
    context = click.get_current_context()
    group = context.find_root().command
    command = group.get_command(context, compared)  # type: ignore[attr-defined]
    context.meta["ddgcli.options"] = option_names(command) | context.meta["ddgcli.options"]
    words_of_call = repeat_options(command, list(words))
    try:
        inner = command.make_context(compared, list(words_of_call), parent=context.parent)
    except click.MissingParameter as error:
        raise click.UsageError(f"tradeoff {compared} needs an INPUT", context) from error
    except click.NoSuchOption as error:
        own = [name for option in context.command.params for name in option.opts if name.startswith("--")]
        raise click.NoSuchOption(
            error.option_name, possibilities=_similar_options(error, own), ctx=context
        ) from error
    problem_options, method_options = COMPARABLE_OPTIONS[compared]
    options = {
        name: value
        for name, value in inner.params.items()
        if inner.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE
    }
    path = next((options.pop(name) for name in ("mesh_path", "scene_path") if name in options), None)
    if path is None:
        raise click.UsageError(f"tradeoff {compared} needs an INPUT", context)
    for name in options:
        if name not in (*problem_options, *method_options):
            opts = {p.name: p.opts[0] for p in command.params}
            accepted = ", ".join(sorted(opts[n] for n in (*problem_options, *method_options)))
            raise ParameterError(
                f"{opts[name]} changes nothing that tradeoff {compared} compares; it takes {accepted}"
            )
    import shlex

    arguments = [
        word for name, pair in _pairs(command, words_of_call) if name in problem_options for word in pair
    ]
    return CommandCall(path, options, shlex.join(arguments))


def _similar_options(error: click.NoSuchOption, own: list[str]) -> list[str]:
    import difflib

    return sorted({*(error.possibilities or []), *difflib.get_close_matches(error.option_name, own)})


def _pairs(command: click.Command, words: list[str]) -> Iterator[tuple[str, list[str]]]:
    """(parameter name, its words) of every option in a call."""
    options = {opt: p for p in command.params if isinstance(p, click.Option) for opt in p.opts}
    rest = iter(words)
    for word in rest:
        head, equals, _ = word.partition("=")
        if head not in options or word == "--":
            continue
        option = options[head]
        alone = bool(equals) or option.is_flag or option.count
        yield str(option.name), [word] if alone else [word, next(rest, "")]
