"""Command-line entry point: the command table, and the mapping from exceptions to exit codes."""

from __future__ import annotations

import errno
import importlib
import io
import os
import signal
import sys
import time
from typing import Any

import click

from ddgcli import __version__
from ddgcli.cli.clock import ImportClock
from ddgcli.cli.help_pages import with_help_pages
from ddgcli.cli.imports import with_deferred_imports
from ddgcli.cli.interrupts import PARTIAL_RUN, Terminated, received_signal, signals_as_exceptions
from ddgcli.cli.multi_value import repeat_options
from ddgcli.cli.parameters import option_names
from ddgcli.cli.streams import open_standard_streams
from ddgcli.cli.threads import set_thread_variables
from ddgcli.errors import DdgError, StandardOutputError, excerpt, with_short_words

# name -> (module of ddgcli.cli.commands, help line); a module is imported only when its command runs
COMMANDS = {
    "info": ("info", "Contents and quality of a mesh file, and which commands accept it."),
    "repair": ("repair", "Weld, split, orient, fill, cut: one flag for each step."),
    "curvature": ("curvature", "Gaussian, mean and principal curvature of surfaces and curves."),
    "delaunay": ("delaunay", "Intrinsic Delaunay triangulation, refinement, common subdivision."),
    "laplacian": ("laplacian", "Laplace matrices, spectra, Poisson, smoothing, parameterization."),
    "dec": ("dec", "Derivatives, Hodge stars, codifferentials and Laplacians as sparse matrices."),
    "hodge": ("hodge", "Split a vector field into exact, coexact and harmonic parts."),
    "geodesic": ("geodesic", "Distances, shortest paths, straightest lines, transport."),
    "shell-sim": ("shell_sim", "Simulate thin elastic shells: bending, contact, fracture."),
    "fluid-sim": ("fluid_sim", "Simulate incompressible flow on a surface or in a volume."),
    "willmore-flow": ("willmore_flow", "Gradient flow of the bending energy of a surface."),
    "curve-flow": ("curve_flow", "Gradient flows of the length or bending energy of curves."),
    "tradeoff": ("tradeoff", "Show what accuracy costs in time, on your own input."),
    "frames": ("frames", "Export frames of a trajectory: meshes, pictures, animations."),
    "view": ("view", "Write an HTML page: rotate the mesh, read values, play frames."),
    "batch": ("batch", "Run a command over many inputs and parameter values."),
    "examples": ("examples", "Copy the sample meshes and scenes into a folder."),
    "check": ("check", "Compare a run's summary with a stored one (regression runs)."),
}


# words of click for the kinds of numbers
NUMBER_WORDS = {"integer range": "a whole number", "float range": "a number"}
OUTPUT_ERRNOS = (errno.ENOSPC, errno.EFBIG, errno.EIO, errno.EROFS)  # disk full, read-only, ...
UNMAPPED = "failed to map segment"  # of a library, in the message of the system's loader: no memory
UNREACHABLE_ERRNOS = (errno.EACCES, errno.EPERM, errno.ENAMETOOLONG, errno.ELOOP)  # of a path in the call


class CommandError(click.ClickException):
    """Error with one line on standard error and an exit code."""

    def __init__(self, message: str, exit_code: int) -> None:
        super().__init__(" ".join(message.split()))
        self.exit_code = exit_code  # type: ignore[misc]

    def show(self, file: Any = None) -> None:
        click.echo(f"Error: {self.message}", err=True)


class CommandGroup(click.Group):
    """Group of subcommands that are imported on demand; errors become one line and an exit code."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        if name not in COMMANDS:
            return None
        module, _ = COMMANDS[name]
        command = importlib.import_module(f"ddgcli.cli.commands.{module}").command
        return with_help_pages(with_deferred_imports(command))

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, line) for name, (_, line) in COMMANDS.items()])

    def main(self, *args: Any, **extra: Any) -> Any:
        open_standard_streams()
        return super().main(*args, **extra)

    def make_context(self, info_name: str | None, args: list[str], *rest: Any, **extra: Any) -> click.Context:
        words = list(args)
        set_thread_variables(words)
        try:
            # messages name the script, also where `python -m ddgcli` runs it, as batches do
            context = super().make_context("ddgcli", args, *rest, **extra)
        except click.exceptions.NoArgsIsHelpError:
            raise
        except click.UsageError as error:
            raise CommandError(_usage(error), 2) from error
        except OSError as error:  # of the text of --help or --version
            if error.errno not in OUTPUT_ERRNOS:
                raise
            raise _unwritten(error) from error
        context.meta["ddgcli.args"] = words
        context.meta["ddgcli.began"] = start_time()
        return context

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        if args and args[0] not in COMMANDS and not args[0].startswith("-"):
            import difflib

            similar = difflib.get_close_matches(args[0], COMMANDS, n=1)
            hint = f"did you mean {similar[0]}?" if similar else f"known: {', '.join(COMMANDS)}"
            raise click.UsageError(f"no such command {args[0]!r}; {hint}", ctx)
        name, command, words = super().resolve_command(ctx, args)
        if command is not None:
            ctx.meta["ddgcli.options"] = option_names(command)
        return name, command, repeat_options(command, words) if command is not None else words

    def invoke(self, ctx: click.Context) -> Any:
        _escape_undecodable_names()
        try:
            with signals_as_exceptions(), ImportClock() as clock:
                ctx.meta["ddgcli.imports"] = clock
                return super().invoke(ctx)
        except DdgError as error:
            if error.exit_code != 2:
                _commit_outputs(ctx)
            if isinstance(error, StandardOutputError):
                _discard_output()
            raise CommandError(_error_line(error, ctx), error.exit_code) from error
        except click.UsageError as error:
            raise CommandError(_usage(error), 2) from error
        except BrokenPipeError:
            _commit_outputs(ctx)
            _discard_output()
            ctx.exit(0)
        except (KeyboardInterrupt, Terminated):
            _end_by_signal(ctx)
        except MemoryError as error:
            raise _out_of_memory(error, ctx) from error
        except (click.ClickException, click.exceptions.Exit, click.Abort):
            raise
        except OSError as error:
            if error.errno == errno.ENOENT and _is_folder_deleted():
                raise CommandError("the current folder was deleted; change to another one", 2) from error
            if error.errno in UNREACHABLE_ERRNOS and error.filename is not None:
                raise CommandError(_unreachable(error), 2) from error
            if error.errno not in OUTPUT_ERRNOS or ctx.params.get("debug"):
                raise _internal(error, ctx) from error
            _commit_outputs(ctx)
            raise _unwritten(error) from error
        except Exception as error:
            if received_signal() is not None:  # a library made another error of its exception
                _end_by_signal(ctx)
            if isinstance(error.__context__, MemoryError):  # cleaning up failed, too
                raise _out_of_memory(error.__context__, ctx) from error
            if isinstance(error, ImportError) and UNMAPPED in str(error):
                raise _out_of_memory(MemoryError("a library does not fit"), ctx) from error
            raise _internal(error, ctx) from error


def _is_folder_deleted() -> bool:
    """Whether the current folder is no longer there."""
    try:
        os.getcwd()
    except FileNotFoundError:
        return True
    return False


def _unreachable(error: OSError) -> str:
    """Message for a path that the system does not let us look at."""
    return f"{with_short_words(str(error.filename))}: {os.strerror(error.errno or 0).lower()}; check the path"


def _unwritten(error: OSError) -> CommandError:
    """Error of a standard output that is full, which is left alone from now on."""
    _discard_output()
    reason = os.strerror(error.errno or 0)
    return CommandError(f"the output cannot be written ({reason}); free some disk space", 1)


def _out_of_memory(error: MemoryError, ctx: click.Context) -> CommandError:
    _commit_outputs(ctx)
    reason = f" ({error})" if str(error) else ""
    return CommandError(f"out of memory{reason}; use a smaller mesh or fewer outputs", 1)


def _commit_outputs(ctx: click.Context) -> None:
    """Move complete outputs to their paths: neither the call nor the input was wrong."""
    if "ddgcli.outputs" in ctx.meta:
        ctx.meta["ddgcli.outputs"].commit()


def _end_by_signal(ctx: click.Context) -> None:
    _commit_outputs(ctx)
    number = received_signal() or signal.SIGINT
    remedy = f"; continue with --resume {ctx.meta[PARTIAL_RUN]}" if PARTIAL_RUN in ctx.meta else ""
    click.echo(("Interrupted" if number == signal.SIGINT else f"Ended by {number.name}") + remedy, err=True)
    ctx.exit(128 + number)


_import_time = time.perf_counter()


def start_time() -> float:
    """Start of this run: the import of this module for the first run of a process, else now."""
    global _import_time
    began, _import_time = _import_time, 0.0
    return began or time.perf_counter()


def _error_line(error: DdgError, ctx: click.Context) -> str:
    from ddgcli.cli.messages import error_line

    return error_line(error, ctx)


def _internal(error: Exception, ctx: click.Context) -> Exception:
    """Error to raise for an exception that no code handles: itself with --debug, else one line."""
    if ctx.params.get("debug"):
        return error
    return CommandError(
        f"internal error: {type(error).__name__}: {excerpt(error, 300)}; ddgcli --debug shows the traceback",
        1,
    )


def _usage(error: click.UsageError) -> str:
    """Message of a wrong call, with the command for help."""
    where = f"; see {error.ctx.command_path} --help" if error.ctx is not None else ""
    message = error.format_message().rstrip(".")
    for name, number in NUMBER_WORDS.items():
        message = message.replace(f"is not a valid {name}", f"is not {number}")
    return with_short_words(message) + where


def _escape_undecodable_names() -> None:
    """Print bytes of file names that are not UTF-8 as escapes, which JSON readers turn back into the name."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")


def _discard_output() -> None:
    """Send standard output to nowhere, so that the interpreter's last flush cannot fail."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@click.group(
    cls=CommandGroup, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100}
)
@click.version_option(__version__, prog_name="ddgcli")
@click.option("--debug", is_flag=True, help="Show the traceback of an internal error.")
def main(debug: bool) -> None:
    """Discrete differential geometry on meshes: measure, triangulate, solve, simulate."""
