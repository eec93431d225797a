"""`ddgcli tradeoff`."""

from __future__ import annotations

import json
from typing import Any

import click

from ddgcli.cli import options
from ddgcli.cli.options import Common
from ddgcli.cli.run import Run
from ddgcli.errors import ParameterError

COMMANDS = ("curvature", "delaunay", "laplacian", "geodesic", "shell-sim", "fluid-sim", "willmore-flow")


@click.command("tradeoff")
@click.argument("compared", metavar="COMMAND", type=click.Choice(COMMANDS))
@click.argument("input_path", metavar="INPUT", type=click.Path())
@click.option("--within", type=options.POSITIVE, metavar="ERROR", help="Name the cheapest row within.")
@click.option(
    "--norm",
    type=click.Choice(["max", "mean"]),
    default="max",
    show_default=True,
    help="The error that --within and the front speak of.",
)
@click.option("--truth", metavar="SHAPE", help="Known truth: sphere:R, torus:R,r, ellipsoid:a,b,c ...")
@click.option(
    "--budget",
    type=options.POSITIVE,
    metavar="SECONDS",
    default=60.0,
    show_default=True,
    help="Time for everything; what would exceed it is left out.",
)
@click.option(
    "--repeat", type=click.IntRange(min=1), default=5, show_default=True, help="Timed queries a row."
)
@click.option("--source", type=int, multiple=True, metavar="ID", help="geodesic: source vertex.")
@click.option("--eigen", type=click.IntRange(min=1), metavar="K", help="laplacian: eigenvalues compared.")
@click.option(
    "--duration", type=options.POSITIVE, metavar="SECONDS", help="Simulators, willmore-flow: time simulated."
)
@options.common
def command(
    compared: str,
    input_path: str,
    within: float | None,
    norm: str,
    truth: str | None,
    budget: float | None,
    repeat: int,
    source: tuple[int, ...],
    eigen: int | None,
    duration: float | None,
    common: Common,
) -> None:
    """Show what accuracy costs in time: the methods of COMMAND on INPUT, error against seconds.

    Every method runs with several settings of its dials against the most accurate one that is affordable, or
    against a known truth. Rows marked * are beaten by no other in both time and error.

    \b
    Examples:
      ddgcli tradeoff geodesic bunny.ply --source 5 --within 1e-3
      ddgcli tradeoff curvature sphere.ply --truth sphere:1 --plot tradeoff.png

    See docs/tradeoff.md, and docs/accuracy/ for the same pictures on known truths.
    """
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
        source=list(source),
        eigen=eigen,
        duration=duration,
    )
    problem = _problem(run, compared, input_path, truth, source, eigen, duration)

    from ddgcli.tradeoff.front import give_verdicts
    from ddgcli.tradeoff.measure import run_problem
    from ddgcli.tradeoff.report import results_of, text_table

    table = run_problem(problem, repeat=repeat, budget=budget, progress=run.progress("tradeoff"))
    chosen = give_verdicts(table, within, norm)
    results = results_of(table, problem, compared, input_path, chosen=chosen, within=within, norm=norm)
    write(run, results)
    run.plot(lambda path: draw(path, table, results, within))
    run.finish(
        results,
        {"reference_uncertainty": results["reference_uncertainty"]},
        converged=within is None or chosen is not None,
        text=text_table(table, problem, results),
    )
    if table.interrupted:
        click.get_current_context().exit(130)


def _problem(
    run: Run,
    compared: str,
    path: str,
    truth: str | None,
    source: tuple[int, ...],
    eigen: int | None,
    duration: float | None,
) -> Any:
    """The question of a command, on a mesh or on a scene."""
    if compared in ("shell-sim", "fluid-sim"):
        if truth:
            raise ParameterError(f"--truth says nothing of {compared}; its reference is a small step")
        return _scene_problem(run, compared, path, duration)
    from ddgcli.tradeoff.problems.table import mesh_problem
    from ddgcli.tradeoff.truths import parse_truth

    mesh = run.read(path).mesh
    known = parse_truth(truth, mesh.points) if truth else None
    return mesh_problem(compared, mesh, source=source, eigen=eigen, truth=known, duration=duration)


def _scene_problem(run: Run, compared: str, path: str, duration: float | None) -> Any:
    from pathlib import Path

    from ddgcli.cli.scene_input import mesh_reader, scene_document
    from ddgcli.io.arrays import read_array
    from ddgcli.tradeoff.problems import simulate

    role = compared.removesuffix("-sim")
    document, _ = scene_document(path, role, (), {}, None)
    run.note_input(path, "")
    read = mesh_reader(run, document)
    if role == "shell":
        return simulate.shell_problem(document, read, duration=duration)
    folder = Path(document.folder)
    return simulate.fluid_problem(
        document, read, lambda name: read_array(str(folder / name)), duration=duration
    )


def write(run: Run, results: dict[str, Any]) -> None:
    """The rows as CSV, or all results as JSON, to every -o."""
    from ddgcli.cli.report import plain
    from ddgcli.tradeoff.report import csv_of

    for path in run.common.outputs:
        as_json = (run.common.output_format or path).endswith("json")
        data = json.dumps(plain(results), indent=1).encode() + b"\n" if as_json else csv_of(results["rows"])
        run.write_bytes(path, data)


def draw(path: str, table: Any, results: dict[str, Any], within: float | None) -> None:
    """Error against seconds, one line a method, dial values at the points, the front ringed."""
    from ddgcli.plots.chart import draw_chart
    from ddgcli.tradeoff.report import chart_of

    draw_chart(
        path,
        **chart_of(table.rows, results["norm"], within, results["reference_uncertainty"]),
        xlabel="seconds (set-up and one query)",
        ylabel=f"error, relative to {results['error_scale']}",
        log="xy",
        caption=f"Reference: {results['reference']}. Rings: no other row beats it.\n{results['machine']}",
    )
