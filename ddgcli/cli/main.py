"""The roof: the table of subcommands and the one place where refusals become exit codes."""

from __future__ import annotations

import contextlib
import difflib
import errno
import importlib
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from typing import Any

import click

from ddgcli import __version__
from ddgcli.cli.multi_value import spread
from ddgcli.cli.parameters import option_names
from ddgcli.cli.threads import set_thread_variables
from ddgcli.errors import DdgError, excerpt

# name -> (module of ddgcli.cli.commands, help line); a module is imported only when its command runs
COMMANDS = {
    "info": ("info", "What a file holds, how good it is, and which commands take it."),
    "repair": ("repair", "Weld, split, orient, fill, cut: each by its own flag."),
    "curvature": ("curvature", "Gaussian, mean and principal curvature of surfaces and curves."),
    "delaunay": ("delaunay", "Intrinsic Delaunay triangulation, refinement, common subdivision."),
    "laplacian": ("laplacian", "Laplace matrices, spectra, Poisson, smoothing, parameterization."),
    "dec": ("dec", "Derivatives, Hodge stars, codifferentials and Laplacians as sparse matrices."),
    "hodge": ("hodge", "Split a vector field into exact, coexact and harmonic parts."),
    "geodesic": ("geodesic", "Distances, shortest paths, straightest lines, transport."),
    "shell-sim": ("shell_sim", "Move thin elastic shells: a scene in, a trajectory out."),
    "fluid-sim": ("fluid_sim", "Move an incompressible fluid on a surface."),
    "willmore-flow": ("willmore_flow", "Flow a surface down its bending energy."),
    "tradeoff": ("tradeoff", "What accuracy costs in time, on your own input."),
    "frames": ("frames", "Export frames of a trajectory: meshes, pictures, animations."),
    "view": ("view", "A page for the browser: rotate, read values, play."),
    "batch": ("batch", "Run a command over many inputs and parameter values."),
    "examples": ("examples", "Copy the sample meshes and scenes into a folder."),
    "check": ("check", "Compare a run's summary with a stored one (regression runs)."),
}


NO_ROOM = (errno.ENOSPC, errno.EFBIG, errno.EIO, errno.EROFS)  # of standard output, too


class Refusal(click.ClickException):
    """One line on standard error and an exit code."""

    def __init__(self, message: str, exit_code: int) -> None:
        super().__init__(" ".join(message.split()))
        self.exit_code = exit_code  # type: ignore[misc]

    def show(self, file: Any = None) -> None:
        click.echo(f"Error: {self.message}", err=True)


class Door(click.Group):
    """Subcommands imported on demand; errors turned into one line and an exit code."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        if name not in COMMANDS:
            return None
        module, _ = COMMANDS[name]
        return importlib.import_module(f"ddgcli.cli.commands.{module}").command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, line) for name, (_, line) in COMMANDS.items()])

    def make_context(self, info_name: str | None, args: list[str], *rest: Any, **extra: Any) -> click.Context:
        words = list(args)
        set_thread_variables(words)
        try:
            context = super().make_context(info_name, args, *rest, **extra)
        except click.exceptions.NoArgsIsHelpError:
            raise
        except click.UsageError as error:
            raise Refusal(_usage(error), 2) from error
        context.meta["ddgcli.args"] = words
        context.meta["ddgcli.began"] = _start()
        return context

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        if args and args[0] not in COMMANDS and not args[0].startswith("-"):
            near = difflib.get_close_matches(args[0], COMMANDS, n=1)
            hint = f"did you mean {near[0]}?" if near else f"known: {', '.join(COMMANDS)}"
            raise click.UsageError(f"no such command {args[0]!r}; {hint}", ctx)
        name, command, words = super().resolve_command(ctx, args)
        if command is not None:
            ctx.meta["ddgcli.options"] = option_names(command)
        return name, command, spread(command, words) if command is not None else words

    def invoke(self, ctx: click.Context) -> Any:
        try:
            with _ended_by_signals():
                return super().invoke(ctx)
        except DdgError as error:
            raise Refusal(_refusal(error, ctx), error.exit_code) from error
        except click.UsageError as error:
            raise Refusal(_usage(error), 2) from error
        except BrokenPipeError:
            _quiet_end()
            ctx.exit(0)
        except KeyboardInterrupt:
            click.echo("Interrupted", err=True)
            ctx.exit(130)
        except _Ended as error:
            click.echo(f"Ended by {error.args[0].name}", err=True)
            ctx.exit(128 + error.args[0])
        except MemoryError as error:
            raise Refusal(f"out of memory ({error}); take a smaller mesh or fewer outputs", 1) from error
        except (click.ClickException, click.exceptions.Exit, click.Abort):
            raise
        except OSError as error:
            if error.errno not in NO_ROOM or ctx.params.get("debug"):
                raise _internal(error, ctx) from error
            _quiet_end()
            raise Refusal(
                f"the output cannot be written ({os.strerror(error.errno)}); free some room", 1
            ) from error
        except Exception as error:
            raise _internal(error, ctx) from error


class _Ended(BaseException):
    """A signal asks this process to end; files that are half written are taken away on the way out."""


@contextlib.contextmanager
def _ended_by_signals() -> Iterator[None]:
    """SIGTERM and SIGHUP end the run like an interrupt."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def end(number: int, frame: Any) -> None:
        raise _Ended(signal.Signals(number))

    kinds = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
    # a signal that is ignored (nohup) stays so
    before = {k: signal.signal(k, end) for k in kinds if signal.getsignal(k) == signal.SIG_DFL}
    try:
        yield
    finally:
        for kind, handler in before.items():
            signal.signal(kind, handler)


_imported = time.perf_counter()


def _start() -> float:
    """When this run began: the import of this module for the first run of a process, now for later ones."""
    global _imported
    began, _imported = _imported, 0.0
    return began or time.perf_counter()


def _refusal(error: DdgError, ctx: click.Context) -> str:
    from ddgcli.cli.run import refusal_of

    return refusal_of(error, ctx)


def _internal(error: Exception, ctx: click.Context) -> Exception:
    """What an error of ours in the code is told as; itself with --debug."""
    if ctx.params.get("debug"):
        return error
    return Refusal(
        f"internal error: {type(error).__name__}: {excerpt(error, 300)}; run ddgcli --debug to see", 1
    )


def _usage(error: click.UsageError) -> str:
    """The message of a wrong call, and where to look."""
    where = f"; see {error.ctx.command_path} --help" if error.ctx is not None else ""
    return error.format_message().rstrip(".") + where


def _quiet_end() -> None:
    """Let the interpreter's last flush go nowhere."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@click.group(cls=Door, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="ddgcli")
@click.option("--debug", is_flag=True, help="Show the traceback of an internal error.")
def main(debug: bool) -> None:
    """Discrete differential geometry on meshes: measure, triangulate, solve, simulate."""
