"""`ddgcli batch`."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

import click

from ddgcli.cli import options
from ddgcli.cli.forecast.batch_cost import (
    batch_cost,
    dry_runs,
    may_not_fit,
    refuse_batch,
    with_refused_runs,
)
from ddgcli.cli.options import CommonOptions
from ddgcli.cli.run import Run
from ddgcli.errors import ParameterError

if TYPE_CHECKING:
    from ddgcli.cli.batch.process import TaskRow
    from ddgcli.cli.batch.tasks import Task

log = logging.getLogger("ddgcli")

OUTPUT_METAVARS = ("PATH", "FOLDER")  # of options that name outputs
COMMANDS_OUTSIDE_BATCHES = ("batch", "check", "examples")


@click.command("batch", short_help="Run a command over many inputs and parameter values.")
@click.argument("words", metavar="INPUTS... -- COMMAND OPTIONS", nargs=-1, type=click.UNPROCESSED)
@click.option(
    "--sweep", multiple=True, metavar="NAME=V1,V2", help="Run with each value of an option. Repeatable."
)
@click.option(
    "--jobs",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    metavar="N",
    help="Processes in parallel.",
)
@click.option("--timeout", type=options.POSITIVE_NUMBER, metavar="S", help="Seconds that a run may take.")
@click.option(
    "--memory", type=options.POSITIVE_NUMBER, metavar="MIB", help="Resident memory that a run may take."
)
@click.option("--shard", metavar="I/N", help="Only every N-th run, from the I-th: for job arrays.")
@click.option("--cluster", metavar="ADDRESS", help="Run on the workers of this Dask scheduler.")
@click.option("--resume", is_flag=True, help="Skip the runs that the table lists as done.")
@click.option("--table", metavar="PATH", help="Write the results as a table (.jsonl or .csv).")
@click.option(
    "--collect",
    multiple=True,
    metavar="KEY",
    help="Put a value of the summaries into the table, such as results.area. Repeatable.",
)
@options.common_without_pictures
def command(
    words: tuple[str, ...], common: CommonOptions, table: str | None, resume: bool, shard: str | None,
    cluster: str | None, sweep: tuple[str, ...], collect: tuple[str, ...], jobs: int, timeout: float | None,
    memory: float | None,
) -> None:  # fmt: skip
    """Run COMMAND with OPTIONS on every input, and with every value of swept options.

    INPUTS are files or quoted patterns. -o is a template with {stem}, {name}, {suffix}, {index} and swept
    names; OPTIONS may have them too. Each run is a process of its own; one that fails, hangs or takes too
    much memory does not stop the rest. Exit code: 0 if all are done, else 1.

    The table has a row per run: input, command, parameters, output, status (done, failed, timeout, memory,
    killed), exit_code, seconds, peak_mib, sha256 of the input, message, collected values. --resume skips
    the runs that the table lists as done; until the table is written, TABLE.part lists the runs that ended.

    \b
    Examples:
      ddgcli batch 'meshes/*' -o 'out/{stem}.vtu' --table curvature.csv -- curvature
      ddgcli batch a.ply b.ply --sweep radius=0.5,1 -o '{stem}.{radius}.vtu' -- curvature --scheme corrected
      ddgcli batch 'scans/*.ply' --jobs 8 --timeout 60 --collect results.area --table t.jsonl -- curvature
    """
    from ddgcli.cli.batch.process import TaskLimits
    from ddgcli.cli.batch.run import run_batch
    from ddgcli.cli.batch.table import TABLE_FORMATS, journal_path, table_bytes
    from ddgcli.cli.batch.tasks import (
        expanded_inputs,
        make_tasks,
        parsed_sweeps,
        refuse_inputs_as_outputs,
        shard_of,
    )

    inputs, call = split_words(words)
    if len(common.outputs) > 1:
        raise ParameterError("takes one template; leave the others out", parameter="output")
    if resume and table is None:
        raise ParameterError("needs `table`, which holds the runs that are done", parameter="resume")
    template = common.outputs[0] if common.outputs else None
    run = Run("batch", replace(common, outputs=()), formats=(), call=call, sweep=sweep, shard=shard)
    run.plan_output(table, TABLE_FORMATS)
    sweeps = parsed_sweeps(sweep)
    output_options = check_call(call, sweeps)
    tasks = make_tasks(expanded_inputs(inputs), sweeps, template, call, output_options)
    refuse_inputs_as_outputs(tasks, table)
    tasks = shard_of(tasks, shard)
    run.input = {"path": ", ".join(inputs), "runs": len(tasks)}
    predict_batch(run, tasks, jobs, on_cluster=cluster is not None)
    rows = run_batch(
        tasks, TaskLimits(timeout, memory), jobs=jobs, collect=collect, table=table, resume=resume,
        cluster=cluster, progress=run.progress("batch"),
    )  # fmt: skip
    if table is not None:
        run.write_bytes(table, table_bytes(table, rows))
        run.commit_outputs()
        journal_path(table).unlink(missing_ok=True)
    warn_of_empty_columns(rows, collect)
    counts = Counter(row.status for row in rows)
    failed = [row for row in rows if row.status != "done"]
    results: dict[str, Any] = {
        "runs": len(rows),
        "status": dict(counts),
        "rows": [asdict(row) for row in rows],
    }
    text = [f"runs    {len(rows)}", *(f"{status:<8}{count}" for status, count in counts.items())]
    text += [f"{row.status}: {row.input} {row.message}".rstrip() for row in failed]
    run.finish(results, {}, converged=not failed, text=text)


def predict_batch(run: Run, tasks: Sequence[Task], jobs: int, *, on_cluster: bool) -> None:
    """Refuse a batch that does not fit into memory; end a dry run, with the runs that are refused."""
    dry_run = run.common.dry_run
    if not dry_run and (on_cluster or not may_not_fit(tasks, jobs)):
        return
    placed = [task.in_existing_folders() for task in tasks]
    checked = dry_runs(placed, jobs) if dry_run else {}
    cost = batch_cost(placed, jobs, checked)
    if not on_cluster:
        refuse_batch(cost, jobs)
    if dry_run:
        results, text = with_refused_runs(cost, placed, checked)
        run.end_dry_run(results, text, converged=not results["refused"])


def warn_of_empty_columns(rows: Sequence[TaskRow], collect: Sequence[str]) -> None:
    """Warn of names that no run has in its summary: a misspelt name makes an empty column."""
    completed_rows = [row for row in rows if row.status == "done"]
    empty = [
        name
        for name in collect
        if completed_rows and all(row.collected.get(name) is None for row in completed_rows)
    ]
    if empty:
        command = " ".join(completed_rows[0].command.split()[:2])
        log.warning(f"no run has {', '.join(empty)}: empty columns; `{command} ... --json` lists the names")


def split_words(words: tuple[str, ...]) -> tuple[list[str], list[str]]:
    """Inputs before `--` and the command with its options after it."""
    typed = click.get_current_context().find_root().meta.get("ddgcli.args", [])
    behind = typed[typed.index("--") + 1 :] if "--" in typed else []
    if not behind:
        raise ParameterError(
            "no command to run; put it after --, as in: ddgcli batch 'meshes/*' -- curvature"
        )
    inputs = list(words[: len(words) - len(behind)])
    if not inputs:
        raise ParameterError("no inputs; name files or patterns before --")
    return inputs, behind


def check_call(call: list[str], sweeps: dict[str, list[str]]) -> list[str]:
    """Options of a command that name outputs; refuses one that cannot run in a batch, and swept names that
    are none of its options."""
    context = click.get_current_context().find_root()
    group = context.command
    if not isinstance(group, click.Group):
        raise TypeError("batch runs below the command group")
    usable = [name for name in group.list_commands(context) if name not in COMMANDS_OUTSIDE_BATCHES]
    target = group.get_command(context, call[0]) if call[0] in usable else None
    if target is None:
        raise ParameterError(f"no command {call[0]!r} for a batch; there are: {', '.join(usable)}")
    names = {word.lstrip("-") for option in target.params for word in option.opts}
    unknown = [name for name in sweeps if name not in names]
    if unknown:
        raise ParameterError(f"{call[0]} has no option --{unknown[0]}", parameter="sweep")
    for option in target.params:
        _refuse_second_value(option, call[1:], sweeps)
    paths = [option for option in target.params if option.metavar in OUTPUT_METAVARS]
    return [word for option in paths for word in option.opts]


def _refuse_second_value(option: click.Parameter, words: list[str], sweeps: dict[str, list[str]]) -> None:
    """Refuse a swept option that the command has, or that is swept by two names: the last value would win."""
    swept = [name for name in sweeps if name in {word.lstrip("-") for word in option.opts}]
    typed = [name for name in (word.partition("=")[0] for word in words) if name in option.opts]
    if not swept or getattr(option, "multiple", False):
        return
    if typed:
        raise ParameterError(
            f"{swept[0]} is swept, and {typed[0]} is also an option after --; leave one out",
            parameter="sweep",
        )
    if len(swept) > 1:
        raise ParameterError(f"{swept[0]} and {swept[1]} are one option; sweep one", parameter="sweep")
