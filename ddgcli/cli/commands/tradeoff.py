"""`ddgcli tradeoff`."""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ddgcli.choices import CONSERVED_QUANTITIES, ERROR_NORMS, ERROR_PARTS, MECHANICAL_EXAMPLES
from ddgcli.cli import options
from ddgcli.cli.commands.tradeoff_options import (
    COMPARABLE_OPTIONS,
    MAP_OPTIONS,
    SOURCE_OPTIONS,
    CommandCall,
    parse,
)
from ddgcli.cli.forecast.check_cost import dry_run_of
from ddgcli.cli.forecast.use import InputSize
from ddgcli.cli.options import CommonOptions
from ddgcli.cli.parameters import with_option_names
from ddgcli.cli.run import Run
from ddgcli.errors import ParameterError, renamed_parameters

if TYPE_CHECKING:
    from ddgcli.tradeoff.candidates import Problem, Row, Table

COMMANDS = tuple(COMPARABLE_OPTIONS)
SIMULATORS = ("shell-sim", "fluid-sim", "willmore-flow")


@click.command(
    "tradeoff",
    context_settings={"ignore_unknown_options": True},
    epilog="Choosing a method: --within ERROR reports the cheapest configuration; use --norm mean if "
    "single vertices (at creases) have large errors. See docs/tradeoff.md, and docs/accuracy/ for plots "
    "on problems with known answers.",
)
@click.argument("compared", metavar="COMMAND", type=click.Choice(COMMANDS))
@click.argument("words", metavar="INPUT [OPTIONS OF COMMAND]", nargs=-1, type=click.UNPROCESSED)
@click.option(
    "--within",
    type=options.POSITIVE_NUMBER,
    metavar="ERROR",
    help="Report the cheapest row whose error is at most ERROR.",
)
@click.option(
    "--norm",
    type=click.Choice(ERROR_NORMS),
    default="max",
    show_default=True,
    help="Error of --within and of the Pareto front.",
)
@click.option(
    "--error",
    "error_part",
    type=click.Choice(ERROR_PARTS),
    help="Simulators and flows: compare by the distance from the limit of small steps and fine meshes (both, "
    "default), or by the error in time or of the mesh alone.",
)
@click.option("--truth", metavar="SHAPE", help="Known exact shape: sphere:R, torus:R,r, ellipsoid:a,b,c ...")
@click.option(
    "--conserved",
    type=click.Choice(CONSERVED_QUANTITIES),
    help="shell-sim: compare integrators by the drift of this quantity; INPUT is a scene, pendulum or "
    "oscillator.",
)
@click.option(
    "--maps",
    is_flag=True,
    help="laplacian: compare the maps of --parameterize by their conformal distortion.",
)
@click.option(
    "--budget",
    type=options.POSITIVE_NUMBER,
    metavar="SECONDS",
    default=60.0,
    show_default=True,
    help="Time for the whole comparison; slower rows are left out.",
)
@click.option(
    "--repeat",
    type=click.IntRange(min=1),
    metavar="N",
    default=5,
    show_default=True,
    help="Timed queries per row.",
)
@options.common_of_charts
def command(
    compared: str,
    words: tuple[str, ...],
    within: float | None,
    norm: str,
    error_part: str | None,
    truth: str | None,
    conserved: str | None,
    maps: bool,
    budget: float,
    repeat: int,
    common: CommonOptions,
) -> None:
    """Show what accuracy costs in time: the methods of COMMAND on INPUT, error against seconds.

    COMMAND is curvature, delaunay, laplacian, geodesic, shell-sim, fluid-sim or willmore-flow. Every method
    runs with several values of its parameters against the most accurate reference within the budget, or
    against a known exact answer. * marks the Pareto front: no other row is better in both time and error.

    COMMAND's own options follow INPUT. Options of the problem (--source, --eigen, --duration, --effect, ...)
    apply to every row; an option that chooses a method or a parameter (--method heat, --refine 20) restricts
    the rows.

    \b
    Examples:
      ddgcli tradeoff geodesic bunny.ply --source 5 --within 1e-3
      ddgcli tradeoff laplacian bunny.ply --eigen 20 --mass lumped -o rows.csv
      ddgcli tradeoff laplacian face.obj --maps --norm mean
      ddgcli tradeoff curvature sphere.ply --truth sphere:1 --plot tradeoff.png
      ddgcli tradeoff shell-sim hat.toml --dt 1e-3 --integrator newmark --budget 120
    """
    call = parse(compared, words)
    has_error_parts = compared in SIMULATORS and conserved is None
    if error_part is not None and not has_error_parts:
        raise ParameterError("parts of the error are those of simulators and flows; leave it out",
                             parameter="error")  # fmt: skip
    shown_part = (error_part or ERROR_PARTS[0]) if has_error_parts else None
    comparison: dict[str, Any] = {"error": shown_part, "conserved": conserved, "maps": maps}
    run = Run(
        "tradeoff",
        common,
        formats=(".csv", ".json"),
        compared=compared,
        within=within,
        norm=norm,
        truth=truth,
        budget=budget,
        repeat=repeat,
        **{name: value for name, value in comparison.items() if value},
        **call.options,
    )
    if common.dry_run and compared in ("shell-sim", "fluid-sim") and not _is_example(call.path):
        _end_dry_run(run, dry_run_of([compared, *words]), budget)
    problem = _problem(run, compared, call, truth, conserved, maps, error_part or ERROR_PARTS[0])
    if common.dry_run and _is_example(call.path):
        _end_dry_run(run, _cost_of_example(run), budget)
    measure(run, problem, partial(row_command, compared, call), within, norm, repeat, budget)


def measure(
    run: Run,
    problem: Problem,
    command_of: Callable[[Row], str],
    within: float | None,
    norm: str,
    repeat: int,
    budget: float,
) -> None:
    """Measure the rows of a problem, write and draw them, and print the summary."""
    from ddgcli.tradeoff.measure import run_problem
    from ddgcli.tradeoff.pareto import assign_verdicts
    from ddgcli.tradeoff.report import results_of, text_table

    run.begin()
    progress = run.progress("tradeoff")
    table = run_problem(problem, repeat=repeat, budget=budget, began=run.clock.began, progress=progress)
    cheapest = assign_verdicts(table, within, norm)
    names = click.get_current_context().meta["ddgcli.options"]
    table.undecided = with_option_names(table.undecided, names)
    table.left_out = [(row, with_option_names(why, names)) for row, why in table.left_out]
    results = results_of(table, problem, command_of, cheapest=cheapest, within=within, norm=norm)
    finish = partial(
        run.finish,
        results,
        {"reference_uncertainty": results["reference_uncertainty"]},
        converged=not table.interrupted and (within is None or cheapest is not None),
        text=text_table(table, problem, results),
        exit_code=130 if table.interrupted else 1,
    )
    write(run, results)
    try:
        if table.rows:
            run.commit_outputs()  # a picture that fails does not undo them
            run.plot(lambda path: draw(path, table, results, within, options.page_size(run.common.size)))
    except BaseException:
        with suppress(click.exceptions.Exit):
            finish()
        raise
    finish()


def _end_dry_run(run: Run, facts: dict[str, Any], budget: float) -> None:
    """End a dry run with the forecast of one simulation, and the seconds of the budget."""
    read = facts["read_seconds"]
    run.end_dry_run({**facts, "seconds": read + budget, "seconds_range": [read, read + budget]})


def _cost_of_example(run: Run) -> dict[str, Any]:
    """Forecast for a mechanical example: that of the program alone, since the system is tiny."""
    from ddgcli.cli.forecast.check_cost import predict_run
    from ddgcli.cli.forecast.prediction import as_results

    size = InputSize("curve", 0)
    return as_results(predict_run(run, size), size)


def _problem(
    run: Run,
    compared: str,
    call: CommandCall,
    truth: str | None,
    conserved: str | None,
    maps: bool,
    error_part: str,
) -> Problem:
    """Problem of a command: of a conserved quantity, of maps, of a scene or of a mesh."""
    if conserved is not None:
        return _conservation_problem(run, compared, call, conserved)
    if maps:
        return _map_problem(run, compared, call, truth)
    if truth and compared in SIMULATORS:
        raise ParameterError(
            f"--truth does not apply to {compared}; its reference is a run with a small step"
        )
    if compared in ("shell-sim", "fluid-sim"):
        return _scene_problem(run, compared, call, error_part)
    return _mesh_problem(run, compared, call, truth, error_part)


def _mesh_problem(run: Run, compared: str, call: CommandCall, truth: str | None, error_part: str) -> Problem:
    """Problem of a command on a mesh."""
    from ddgcli.tradeoff.problems.table import mesh_problem
    from ddgcli.tradeoff.truths import parse_truth

    mesh = run.read(call.path).surface
    with renamed_parameters(text="truth"):
        known_truth = parse_truth(truth, mesh.points) if truth else None
    keywords: dict[str, Any] = {"error_part": error_part} if compared in SIMULATORS else {}
    if compared == "geodesic" and any(name in call.options for name in SOURCE_OPTIONS):
        from ddgcli.algorithms.geodesics.distance_query import query_sources
        from ddgcli.algorithms.geodesics.query import DistanceQuery

        named = {name: call.options[name] for name in SOURCE_OPTIONS if name in call.options}
        keywords["sources"] = query_sources(mesh, DistanceQuery(**named))
    return mesh_problem(compared, mesh, truth=known_truth, options=call.options, **keywords)


def _map_problem(run: Run, compared: str, call: CommandCall, truth: str | None) -> Problem:
    """Problem of the distortion of maps to the plane."""
    if compared != "laplacian":
        raise ParameterError("compares maps of laplacian; leave it out", parameter="maps")
    if truth is not None:
        raise ParameterError("maps are compared with conformal ones; leave it out", parameter="truth")
    other = next((name for name in call.options if name not in MAP_OPTIONS), None)
    if other is not None:
        raise ParameterError(
            f"--{other} changes nothing that --maps compares; it takes --operator, --subdivide"
        )
    from ddgcli.tradeoff.problems.table import mesh_problem

    return mesh_problem("maps", run.read(call.path).surface, options=call.options)


def _conservation_problem(run: Run, compared: str, call: CommandCall, quantity: str) -> Problem:
    """Problem of the drift of a conserved quantity."""
    if compared != "shell-sim":
        raise ParameterError("compares integrators of shell-sim; leave it out", parameter="conserved")
    from ddgcli.tradeoff.problems.conservation import example_problem, scene_problem

    if _is_example(call.path):
        run.set_input(call.path, "")
        with renamed_parameters(quantity="conserved"):
            return example_problem(call.path, quantity, options=call.options)
    document, read = _scene(run, "shell", call)
    with renamed_parameters(quantity="conserved"):
        return scene_problem(document, read, quantity, options=call.options)


def _is_example(path: str) -> bool:
    """Whether an input is a mechanical system that has no file."""
    return path in MECHANICAL_EXAMPLES and not Path(path).exists()


def _scene(run: Run, role: str, call: CommandCall) -> tuple[Any, Any]:
    """Document of a scene, and the reader of its meshes."""
    from ddgcli.cli.commands.fluid_sim import quick_lines as fluid_lines
    from ddgcli.cli.commands.shell_sim import quick_lines as shell_lines
    from ddgcli.cli.simulation.scene_input import mesh_reader, scene_document

    lines, extra = (shell_lines if role == "shell" else fluid_lines)(call.options)
    document, _ = scene_document(call.path, role, lines, extra, None, run.common.input_format)
    run.set_input(call.path, "")
    return document, mesh_reader(run, document)


def _scene_problem(run: Run, compared: str, call: CommandCall, error_part: str) -> Problem:
    from ddgcli.io.arrays import read_array
    from ddgcli.tradeoff.problems import simulate

    scene_options, role = call.options, compared.removesuffix("-sim")
    document, read = _scene(run, role, call)
    if role == "shell":
        return simulate.shell_problem(document, read, options=scene_options, error_part=error_part)
    folder = Path(document.folder)
    return simulate.fluid_problem(
        document,
        read,
        lambda name: read_array(str(folder / name)),
        options=scene_options,
        error_part=error_part,
    )


def row_command(compared: str, call: CommandCall, row: Row) -> str:
    """Command that runs a row, quoted for a shell."""
    arguments = [f"--{name.replace('_', '-')} {text}" for name, text in row.arguments.items()]
    words = ("ddgcli", row.program or compared, shlex.quote(call.path), call.problem_arguments, *arguments)
    return " ".join(word for word in words if word)


def write(run: Run, results: dict[str, Any]) -> None:
    """The rows as CSV, or all results as JSON, to every -o."""
    from ddgcli.cli.summary import plain
    from ddgcli.tradeoff.report import csv_of

    for path in run.common.outputs:
        as_json = (run.common.output_format or path).endswith("json")
        data = json.dumps(plain(results), indent=1).encode() + b"\n" if as_json else csv_of(results["rows"])
        run.write_bytes(path, data)


def draw(
    path: str, table: Table, results: dict[str, Any], within: float | None, size: dict[str, Any]
) -> None:
    """Draw error against seconds: a line per method, parameter values at the points, Pareto front ringed."""
    from ddgcli.plots.chart import draw_chart
    from ddgcli.tradeoff.report import chart_of

    any_on_front = any(row.on_front for row in table.rows)
    remark = "Rings: Pareto front." if any_on_front else f"No Pareto front: {results['undecided']}."
    names = ", ".join(dict.fromkeys(name for row in table.rows for name in row.parameters))
    remark = f"Labels of points: {names}. {remark}" if names else remark
    chart = chart_of(table.rows, results["norm"], within)
    if any(map(any, chart["bars"].values())):
        remark += " Vertical bars: errors more or less their uncertainty."
    draw_chart(
        path,
        **chart,
        **size,
        xlabel="seconds (set-up and one query)",
        ylabel=f"{'largest' if results['norm'] == 'max' else 'mean'} error, relative",
        log="xy",
        caption=f"Errors relative to {results['error_scale']}. Reference: {results['reference']}. "
        f"{remark}\n{results['machine']}",
    )
