"""The compared command's own options, parsed by that command, and which of them a comparison can take."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import click

from ddgcli.cli.multi_value import spread
from ddgcli.errors import ParameterError

TIME = ("steps", "duration", "step", "tolerance")
QUICK_SHELL = ("effect_lines", "pinned", "material", "settings")
QUICK_FLUID = ("effect_lines", "vorticity", "flow", "viscosity")
WISHES = ("flow", "energy", "boundary", "fix_area", "fix_volume")
SOURCES = ("source", "source_point", "source_face")

# command -> (options of the question, the same in every row; options that choose methods and dials)
TAKES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "curvature": ((), ("scheme", "radius")),
    "delaunay": ((), ("refine", "max_points", "subdivide")),
    "laplacian": ((), ("eigen", "operator", "mass", "subdivide")),
    "geodesic": (
        SOURCES,
        ("method", "tolerance", "operator", "heat_time", "heat_refine", "subdivide"),
    ),
    "shell-sim": (QUICK_SHELL, (*TIME, "integrator")),
    "fluid-sim": (QUICK_FLUID, (*TIME, "integrator")),
    "willmore-flow": (WISHES, (*TIME, "integrator")),
}


@dataclass(frozen=True)
class Given:
    """What was said to the compared command.

    Attributes
    ----------
    path : str
    asked : dict
        Options that were given, by parameter name.
    kept : str
        Those of the question, as they were given: they stand in the command of every row.
    """

    path: str
    asked: dict[str, Any]
    kept: str


def parse(compared: str, words: tuple[str, ...]) -> Given:
    """Read INPUT and options as the compared command would.

    Raises
    ------
    click.UsageError
        Whatever that command refuses.
    ParameterError
        On an option that changes nothing in a comparison.
    """
    context = click.get_current_context()
    group = context.find_root().command
    command = group.get_command(context, compared)  # type: ignore[attr-defined]
    spreaded = spread(command, list(words))
    try:
        inner = command.make_context(compared, list(spreaded), parent=context.parent)
    except click.MissingParameter as error:
        raise click.UsageError(f"tradeoff {compared} needs an INPUT", context) from error
    except click.NoSuchOption as error:
        own = [name for option in context.command.params for name in option.opts if name.startswith("--")]
        raise click.NoSuchOption(error.option_name, possibilities=_near(error, own), ctx=context) from error
    question, dials = TAKES[compared]
    given = {
        name: value
        for name, value in inner.params.items()
        if inner.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE
    }
    path = next((given.pop(name) for name in ("mesh_path", "scene_path") if name in given), None)
    if path is None:
        raise click.UsageError(f"tradeoff {compared} needs an INPUT", context)
    for name in given:
        if name not in (*question, *dials):
            named = {p.name: p.opts[0] for p in command.params}
            takes = ", ".join(sorted(named[n] for n in (*question, *dials)))
            raise ParameterError(
                f"{named[name]} changes nothing that tradeoff {compared} compares; it takes {takes}"
            )
    import shlex

    kept = [word for name, pair in _pairs(command, spreaded) if name in question for word in pair]
    return Given(path, given, shlex.join(kept))


def _near(error: click.NoSuchOption, own: list[str]) -> list[str]:
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
