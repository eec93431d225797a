"""The roof: the table of subcommands and the one place where refusals become exit codes."""

from __future__ import annotations

import importlib
from typing import Any

import click

from ddgcli import __version__
from ddgcli.errors import DdgError

# name -> (module below ddgcli.cli, one line for --help); a module is imported only when its command runs
COMMANDS = {
    "info": ("info", "What a file holds, how good it is, and which commands take it."),
    "curvature": ("curvature", "Gaussian, mean and principal curvature of surfaces and curves."),
    "delaunay": ("delaunay", "Intrinsic Delaunay triangulation, refinement, common subdivision."),
    "laplacian": ("laplacian", "Laplace matrices, spectra, Poisson, smoothing, parameterization."),
    "hodge": ("hodge", "Split a vector field into exact, coexact and harmonic parts."),
    "geodesic": ("geodesic", "Distances, shortest paths, straightest lines, transport."),
    "shell-sim": ("shell_sim", "Move thin elastic shells: a scene in, a trajectory out."),
    "fluid-sim": ("fluid_sim", "Move an incompressible fluid on a surface."),
    "willmore-flow": ("willmore_flow", "Flow a surface down its bending energy."),
    "tradeoff": ("tradeoff", "What accuracy costs in time, on your own input."),
    "frames": ("frames", "Export frames of a trajectory: meshes, pictures, animations."),
    "check": ("check", "Compare a run's summary with a stored one (regression runs)."),
}


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
        return importlib.import_module(f"ddgcli.cli.{module}").command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, line) for name, (_, line) in COMMANDS.items()])

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except DdgError as error:
            raise Refusal(str(error), error.exit_code) from error
        except click.UsageError as error:
            raise Refusal(error.format_message(), 2) from error


@click.group(cls=Door, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="ddgcli")
def main() -> None:
    """Discrete differential geometry on meshes: measure, triangulate, solve, simulate."""
