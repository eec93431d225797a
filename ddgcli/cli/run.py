"""One run of a subcommand: reading, timing, warnings, provenance, outputs, summary, exit code."""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import click

from ddgcli import __version__
from ddgcli.cli.options import Common
from ddgcli.cli.report import print_summary
from ddgcli.errors import ParameterError
from ddgcli.mesh.fields import AnnotatedMesh


class _Collector(logging.Handler):
    """Warnings of the core go into the summary; with -v its other messages go to standard error."""

    def __init__(self, verbose: int, quiet: bool) -> None:
        super().__init__(logging.DEBUG if verbose > 1 else logging.INFO if verbose else logging.WARNING)
        self.warnings: list[str] = []
        self.quiet = quiet

    def emit(self, record: logging.LogRecord) -> None:
        message = record.getMessage()
        if record.levelno >= logging.WARNING:
            self.warnings.append(message)
            message = f"Warning: {message}"
        if not self.quiet:
            click.echo(message, err=True)


class Run:
    """State of one run; a subcommand reads, computes and finishes through it.

    Parameters
    ----------
    command : str
    common : Common
    options : dict
        The subcommand's own options, for the summary and the provenance.
    """

    def __init__(self, command: str, common: Common, **options: Any) -> None:
        if common.as_json and "-" in common.outputs:
            raise ParameterError("--json and -o - both want standard output; write the mesh to a file")
        self.command, self.common, self.options = command, common, options
        self.seconds = {"read": 0.0, "compute": 0.0, "write": 0.0}
        self.input: dict[str, Any] = {}
        self.outputs: list[str] = []
        self._began = time.perf_counter()
        self._collector = _Collector(common.verbose, common.quiet)
        logger = logging.getLogger("ddgcli")
        logger.handlers[:] = [self._collector]
        logger.setLevel(self._collector.level)
        logger.propagate = False

    @contextmanager
    def timed(self, stage: str) -> Iterator[None]:
        """Add the time inside to `seconds[stage]` (read, compute or write)."""
        began = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[stage] += time.perf_counter() - began

    def read(self, path: str):  # -> MeshInput
        """Read the input mesh and note it in the summary."""
        with self.timed("read"):
            from ddgcli.io.mesh_file import read_mesh

            source = read_mesh(path)
            self.input = {"path": path, **describe(source.mesh)}
            self._provenance_input = {"input": path, "input_sha256": source.sha256}
        for note in source.notes:
            logging.getLogger("ddgcli").warning(note)
        return source

    @property
    def metadata(self) -> dict[str, Any]:
        """Provenance for every output that can hold it."""
        return {
            "command_line": " ".join(["ddgcli", *sys.argv[1:]]),
            "version": __version__,
            "options": self.options,
            "seed": self.common.seed,
            **({"units_note": self.common.units_note} if self.common.units_note else {}),
            **getattr(self, "_provenance_input", {}),
        }

    def write(self, annotated: AnnotatedMesh) -> None:
        """Write the annotated mesh to every -o."""
        for path in self.common.outputs:
            self.write_file(path, annotated)

    def write_file(self, path: str, annotated: AnnotatedMesh) -> None:
        """Write an annotated mesh or curves to one file, with the provenance, and list it in `outputs`."""
        with self.timed("write"):
            from ddgcli.io.mesh_file import write_mesh

            write_mesh(path, replace(annotated, metadata=self.metadata))
            self.outputs.append(path)

    def finish(self, results: dict[str, Any], accuracy: dict[str, Any], *, converged: bool = True) -> None:
        """Print the summary; exit 1 when the run did not reach what was asked."""
        seconds = {**self.seconds, "total": time.perf_counter() - self._began}
        if not converged:
            results = {**results, "converged": False}
        print_summary(
            {
                "command": self.command,
                "version": __version__,
                "input": self.input,
                "options": self.options,
                "results": results,
                "accuracy": accuracy,
                "seconds": seconds,
                "warnings": self._collector.warnings,
                "outputs": self.outputs,
            },
            self.common.as_json,
        )
        if not converged:
            click.get_current_context().exit(1)


def describe(mesh: Any) -> dict[str, Any]:
    """The `input` block of the summary."""
    topology = mesh.topology
    return {
        "vertices": mesh.n_vertices,
        "faces": topology.n_faces,
        "components": topology.n_components,
        "boundary_loops": topology.boundary_loops,
        "euler_characteristic": topology.euler_characteristic,
        "genus": topology.genus,
        "manifold": topology.is_manifold,
        "oriented": topology.is_oriented,
        "closed": topology.is_closed,
    }
