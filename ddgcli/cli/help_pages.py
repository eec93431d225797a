"""Help pages: a short one by `--help`, with groups of options, and all options by `--help-all`."""

from __future__ import annotations

import functools
from typing import Any

import click

# title -> options of every command and of simulators that belong there
GROUPS = {
    "Time": ("--steps", "--duration", "--dt", "--frame-every", "--tolerance", "--integrator", "--resume"),
    "Curves": (
        "--path-to", "--trace", "--at-boundary", "--straighten", "--loop", "--curve", "--field",
        "--field-seeds", "--field-time", "--field-order", "--field-step", "--field-tolerance", "--transport",
        "--paths-output", "--log-map", "--spread-vector", "--isolines",
    ),
    "Output": (
        "--output", "--json", "--full", "--colors", "--output-format", "--input-format", "--units-note",
    ),
    "Pictures": ("--plot", "--view", "--show", "--size", "--glyphs"),
    "Run": ("--progress", "--verbose", "--quiet", "--seed", "--threads", "--help", "--help-all"),
}  # fmt: skip
SIMULATORS = ("shell-sim", "fluid-sim", "willmore-flow", "curve-flow")
SHARED_GROUPS = ("Output", "Pictures", "Run")  # groups of every command
MAX_LINES = 58  # of the short page; the last options of a command move to --help-all beyond
GROUP_COMMANDS = {"Time": SIMULATORS, "Curves": ("geodesic",)}
# options that only --help-all shows: the shared ones, and these of long commands
SHORT_PAGE = ("--output", "--json", "--full", "--plot", "--quiet", "--help", "--help-all")
LONG_PAGE = {
    "geodesic": (
        "--target-point", "--target-face", "--operator", "--heat-time", "--heat-refine", "--each-source",
        "--certify", "--straighten", "--loop", "--curve", "--field-seeds", "--field-time", "--field-order",
        "--field-step", "--field-tolerance", "--at-boundary", "--spread-vector", "--tolerance", "--gradient",
        "--source-face", "--subdivide",
    ),
    "laplacian": ("--smooth-flow", "--smooth-steps", "--subdivide", "--mass-matrix"),
    "willmore-flow": ("--stop-gradient", "--stop-energy", "--report-energy", "--resume"),
}  # fmt: skip


def with_help_pages(command: click.Command) -> click.Command:
    """The command with grouped help and the option `--help-all`."""
    if not any("--help-all" in parameter.opts for parameter in command.params):
        command.params.append(
            click.Option(
                ["--help-all"], is_flag=True, is_eager=True, expose_value=False, callback=_print_all,
                help="Show all options and exit.",
            )
        )  # fmt: skip
        command.format_options = functools.partial(_format_options, command)  # type: ignore[method-assign]
    return command


def _print_all(context: click.Context, parameter: click.Parameter, value: bool) -> None:
    if value and not context.resilient_parsing:
        context.meta["ddgcli.help_all"] = True
        click.echo(context.get_help(), color=context.color)
        context.exit()


def _format_options(command: click.Command, context: click.Context, formatter: click.HelpFormatter) -> None:
    whole = context.meta.get("ddgcli.help_all", False)
    name = command.name or ""
    options = [p for p in command.get_params(context) if isinstance(p, click.Option) and not p.hidden]
    shown = options if whole else [option for option in options if not _is_rare(name, option)]
    around = click.HelpFormatter(width=formatter.width)
    command.format_epilog(context, around)
    rest = MAX_LINES - _n_lines(formatter) - _n_lines(around) - 3  # the last paragraph about --help-all
    while not whole:
        trial = click.HelpFormatter(width=formatter.width)
        _write_sections(name, context, trial, shown, whole)
        own = [option for option in shown if _group(name, option) not in SHARED_GROUPS]
        if _n_lines(trial) <= rest or not own:
            break
        shown.remove(own[-1])
    _write_sections(name, context, formatter, shown, whole)
    if len(shown) < len(options):
        formatter.write_paragraph()
        formatter.write_text(
            f"{context.command_path} --help-all shows {len(options) - len(shown)} more options."
        )


def _is_rare(command: str, option: click.Option) -> bool:
    """Whether only --help-all shows an option."""
    name = max(option.opts, key=len)
    return name in LONG_PAGE.get(command, ()) or (
        _group(command, option) in SHARED_GROUPS and name not in SHORT_PAGE
    )


def _write_sections(
    command: str, context: click.Context, formatter: click.HelpFormatter, options: list[Any], whole: bool
) -> None:
    sections: dict[str, list[tuple[str, str]]] = {"Options": [], **{title: [] for title in GROUPS}}
    for option in options:
        title = _group(command, option)
        record = option.get_help_record(context)
        if record is not None:
            sections["Output" if title in SHARED_GROUPS and not whole else title].append(record)
    for title, records in sections.items():
        if records:
            with formatter.section(title):
                formatter.write_dl(records)


def _n_lines(formatter: click.HelpFormatter) -> int:
    return formatter.getvalue().count("\n")


def _group(command: str, parameter: click.Parameter) -> str:
    for title, names in GROUPS.items():
        if command in GROUP_COMMANDS.get(title, (command,)) and any(name in names for name in parameter.opts):
            return title
    return "Options"


def describe(command: click.Command, context: click.Context) -> dict[str, Any]:
    """Name and whole help of a command, for manual pages."""
    context.meta["ddgcli.help_all"] = True
    return {
        "name": context.command_path.replace(" ", "-"),
        "help": command.get_help(context),
    }
