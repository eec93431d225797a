"""Arguments, options and parameter types that several subcommands share."""

from __future__ import annotations

import functools
import itertools
import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Any

import click
from click.core import ParameterSource

from ddgcli.choices import LINEAR_SOLVERS, MAX_ELEVATION, MAX_PIXELS, MAX_SUBDIVISIONS, MIN_PIXELS
from ddgcli.errors import ParameterError


@dataclass(frozen=True)
class CommonOptions:
    """Values of the options of every subcommand."""

    outputs: tuple[str, ...] = ()
    output_format: str | None = None
    input_format: str | None = None
    as_json: bool = False
    full: bool = False
    colors: str | None = None
    plot: str | None = None
    view: dict[str, Any] | None = None
    show: str | None = None
    size: tuple[int, int] | None = None
    progress: bool | None = None
    verbose: int = 0
    quiet: bool = False
    units_note: str | None = None
    seed: int = 0
    threads: int | None = None
    dry_run: bool = False

    @property
    def shows_all_results(self) -> bool:
        """Whether the summary has all results, not the short list alone."""
        return self.as_json or self.full

    @property
    def exceeds_short_summary(self) -> bool:
        """Whether the run writes a file or draws a picture, or shows more than the short summary."""
        return self.shows_all_results or bool(self.outputs) or self.plot is not None


class Real(click.ParamType):
    """A finite number, optionally above a bound; click's FloatRange accepts nan and inf."""

    name = "number"

    def __init__(self, *, above: float | None = None, least: float | None = None) -> None:
        self.above, self.least = above, least

    def convert(self, value: Any, param: Any, ctx: Any) -> float:
        try:
            x = float(value)
        except ValueError:
            self.fail(f"{value!r} is not a number", param, ctx)
        if not math.isfinite(x):
            self.fail(f"{value!r} is not finite", param, ctx)
        if self.above is not None and x <= self.above:
            self.fail(f"{value} is not greater than {self.above:g}", param, ctx)
        if self.least is not None and x < self.least:
            self.fail(f"{value} is less than {self.least:g}", param, ctx)
        return x


def _number(text: str) -> int:
    """A vertex or face index, no longer than arrays can hold; ValueError for anything else."""
    number = int(text)
    if abs(number) >= 2**63:
        raise ValueError(text)
    return number


class Ids(click.ParamType):
    """ID or ID,ID,..."""

    name = "ids"

    def convert(self, value: Any, param: Any, ctx: Any) -> list[int]:
        try:
            return [_number(x) for x in str(value).split(",")]
        except ValueError:
            self.fail(f"{value!r} is not a vertex index, or vertex indices such as 3,17,42", param, ctx)


def joined_ids(ctx: click.Context, param: click.Parameter, value: tuple[list[int], ...]) -> tuple[int, ...]:
    """Callback of a repeatable option of `Ids`: one tuple of all numbers."""
    return tuple(itertools.chain.from_iterable(value))


class Numbers(click.ParamType):
    """A fixed number of finite numbers, separated by commas."""

    name = "numbers"

    def __init__(self, count: int, example: str) -> None:
        self.count, self.example = count, example

    def convert(self, value: Any, param: Any, ctx: Any) -> list[float]:
        words = str(value).split(",")
        if len(words) != self.count:
            self.fail(f"{value!r} is not {self.count} numbers such as {self.example}", param, ctx)
        return [REAL_NUMBER.convert(x, param, ctx) for x in words]


class FacePoint(click.ParamType):
    """F:b0,b1,b2."""

    name = "face point"

    def convert(self, value: Any, param: Any, ctx: Any) -> tuple[int, list[float]]:
        head, _, tail = str(value).partition(":")
        try:
            face = _number(head)
        except ValueError:
            self.fail(f"{head!r} in {value!r} is not a face index", param, ctx)
        return face, Numbers(3, "0.2,0.3,0.5").convert(tail, param, ctx)


class View(click.ParamType):
    """View direction: a name or elevation,azimuth in degrees, and after a colon the up axis."""

    name = "view"

    def convert(self, value: Any, param: Any, ctx: Any) -> dict[str, Any]:
        if isinstance(value, dict):
            return value
        place, _, up = str(value).partition(":")
        if up not in ("", "x", "y", "z"):
            self.fail(f"{up!r} is not an up axis: x, y or z", param, ctx)
        up_axis: dict[str, Any] = {"up": up} if up else {}
        if place in ("x", "y", "z", "iso"):
            return {"view": place, **up_axis}
        try:
            elevation, azimuth = (float(angle) for angle in place.split(","))
        except ValueError:
            self.fail(f"{value!r} is not x, y, z, iso or ELEVATION,AZIMUTH (then :UP)", param, ctx)
        if not (math.isfinite(elevation) and math.isfinite(azimuth)):
            self.fail(f"{value!r} is not finite", param, ctx)
        if abs(elevation) > MAX_ELEVATION:
            self.fail(f"elevation {elevation:g} in {value!r} is beyond {MAX_ELEVATION} degrees", param, ctx)
        return {"view": (elevation, azimuth), **up_axis}


class Size(click.ParamType):
    """WIDTHxHEIGHT in pixels."""

    name = "size"

    def convert(self, value: Any, param: Any, ctx: Any) -> tuple[int, int]:
        if isinstance(value, tuple):
            return value
        width, _, height = str(value).lower().partition("x")
        if not (width.isdecimal() and height.isdecimal()):
            self.fail(f"{value!r} is not WIDTHxHEIGHT in pixels, such as 1920x1080", param, ctx)
        if not all(MIN_PIXELS <= int(side) <= MAX_PIXELS for side in (width, height)):
            self.fail(f"{value!r}: each side has {MIN_PIXELS} to {MAX_PIXELS} pixels", param, ctx)
        return int(width), int(height)


def page_size(size: tuple[int, int] | None, inches: float | None = None) -> dict[str, Any]:
    """`width`, `height` and `dpi` of a drawing function for a size in pixels; nothing for None."""
    if size is None:
        return {}
    from ddgcli.plots.page import PAGE_WIDTH, size_in_inches

    return size_in_inches(size, inches or PAGE_WIDTH)


def use_solver(name: str | None) -> None:
    """Let the linear algebra of this run use a solver; None leaves the default."""
    if name is None:
        return
    before = os.environ.get("DDGCLI_SOLVER")
    os.environ["DDGCLI_SOLVER"] = name

    def restore() -> None:
        os.environ.pop("DDGCLI_SOLVER")
        if before is not None:
            os.environ["DDGCLI_SOLVER"] = before

    click.get_current_context().call_on_close(restore)


REAL_NUMBER = Real()
POSITIVE_NUMBER = Real(above=0)
NONNEGATIVE_NUMBER = Real(least=0)

mesh_arg = click.argument("mesh_path", metavar="MESH", type=click.Path(readable=False))
subdivide = click.option(
    "--subdivide",
    type=click.IntRange(0, MAX_SUBDIVISIONS),
    default=0,
    metavar="N",
    help="First split every face in four at its edge midpoints, N times: the same surface, more unknowns.",
)
solver = click.option(
    "--solver",
    type=click.Choice(LINEAR_SOLVERS),
    help="Solver of definite systems: multigrid (an extra) and conjugate-gradients store no factors, whose "
    "memory grows faster than the mesh.  [default: auto, DDGCLI_SOLVER]",
)
scene_arg = click.argument("scene_path", metavar="SCENE", required=False, type=click.Path(readable=False))

_OUTPUT_OPTIONS = (
    click.option("-o", "--output", "outputs", multiple=True, metavar="PATH",
                 help="Write the result; the extension selects the format. Repeatable; -: standard output."),
    click.option("--output-format", metavar="EXT", help="Format of -o -, as a file extension."),
    click.option(
        "--input-format",
        metavar="EXT",
        help="Format of the input, if its name has no known extension or it is - (standard input).",
    ),
    click.option("--json", "as_json", is_flag=True, help="Print the summary as one JSON object."),
    click.option("--full", is_flag=True, help="Print the whole summary; the default is a short one."),
)  # fmt: skip
_PICTURE_OPTIONS = (
    click.option(
        "--colors",
        metavar="ARRAY",
        help="Store ARRAY as vertex colours in -o PATH (.ply, .glb, .obj), with their range as metadata.",
    ),
    click.option("--plot", metavar="PATH", help="Write a picture of the result (.png, .svg, .pdf)."),
    click.option(
        "--view",
        type=View(),
        metavar="VIEW",
        help="View of a picture: x, y, z, iso or ELEVATION,AZIMUTH (degrees); an up axis may follow: iso:y.  "
        "[default: along the normal of a flat surface, else the iso view that shows most]",
    ),
    click.option(
        "--show", metavar="ARRAY", help="Array that a picture shows.  [default: the command's main result]"
    ),
    click.option(
        "--size",
        type=Size(),
        metavar="WIDTHxHEIGHT",
        help="Size of a picture in pixels.  [default: 1400x1050]",
    ),
)
_PICTURE_NAMES = ("colors", "plot", "view", "show", "size")
_FURTHER_OPTIONS = (
    click.option("--progress/--no-progress", default=None, help="Progress bar on standard error."),
    click.option("-v", "--verbose", count=True, help="Print more on standard error."),
    click.option("-q", "--quiet", is_flag=True, help="Print nothing but errors."),
    click.option("--units-note", metavar="TEXT", help="Note on the units, recorded in the output."),
    click.option(
        "--seed",
        type=click.IntRange(min=0),
        metavar="N",
        default=0,
        show_default=True,
        help="Seed of random numbers.",
    ),
    click.option("--threads", type=click.IntRange(min=1), metavar="N",
                 help="Threads of the linear algebra.  [default: 1, or OMP_NUM_THREADS]"),
    click.option("--dry-run", is_flag=True,
                 help="Check the input, predict peak memory and seconds, and write nothing."),
)  # fmt: skip


def grouped_options(
    name: str, kind: type, declarations: Sequence[Callable]
) -> Callable[[Callable], Callable]:
    """Decorator that adds options to a command and passes their values as one argument.

    Parameters
    ----------
    name : str
        Name of the argument.
    kind : dataclass
        Its fields are named as the parameters of the options.
    declarations : sequence of click.option(...)
        In the order of --help.
    """

    def decorate(command: Callable) -> Callable:
        @functools.wraps(command)
        def call(*args: Any, **kwargs: Any) -> Any:
            values = {field.name: kwargs.pop(field.name, None) for field in fields(kind)}
            return command(*args, **{name: kind(**values)}, **kwargs)

        for option in reversed(declarations):
            call = option(call)
        return call

    return decorate


common = grouped_options("common", CommonOptions, (*_OUTPUT_OPTIONS, *_PICTURE_OPTIONS, *_FURTHER_OPTIONS))


def _common_without(*names: str) -> Callable[[Callable], Callable]:
    """The common options without the picture options of these names."""
    pictures = [o for o, name in zip(_PICTURE_OPTIONS, _PICTURE_NAMES, strict=True) if name not in names]
    return grouped_options("common", CommonOptions, (*_OUTPUT_OPTIONS, *pictures, *_FURTHER_OPTIONS))


common_of_edges = _common_without("colors", "show")  # of pictures and outputs without colours
common_of_charts = _common_without("colors", "view", "show")
# of commands that draw nothing
common_without_pictures = grouped_options("common", CommonOptions, (*_OUTPUT_OPTIONS, *_FURTHER_OPTIONS))


def refuse_options(reason: str, *names: str) -> None:
    """Raise ParameterError that names all of these parameters that are on the command line.

    All at once, so that an error for one option is not followed by an error for the next.
    """
    context = click.get_current_context()
    words = [
        parameter.opts[0]
        for parameter in context.command.params
        if parameter.name in names
        and context.get_parameter_source(parameter.name) is ParameterSource.COMMANDLINE
    ]
    if len(words) == 1:
        raise ParameterError(f"{words[0]} is {reason}; leave it out")
    if words:
        raise ParameterError(f"{', '.join(words[:-1])} and {words[-1]} are {reason}; leave them out")
