"""One run of a subcommand: reading, timing, warnings, provenance, outputs, summary, exit code."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ddgcli import __version__
from ddgcli.cli.options import Common, chosen, page_size
from ddgcli.cli.parameters import error_text, option_names, with_option_names
from ddgcli.cli.progress import Progress
from ddgcli.cli.summary import plain, print_summary
from ddgcli.errors import DdgError, MeshError, MissingExtraError, OutputError, ParameterError

if TYPE_CHECKING:
    from ddgcli.io.mesh_file import MeshInput
    from ddgcli.mesh.fields import AnnotatedMesh, AnyMesh

MOST_FACES = 20_000_000  # that --subdivide makes


class _Collector(logging.Handler):
    """Warnings of the core go into the summary; with -v its other messages go to standard error at once."""

    def __init__(self, verbose: int, quiet: bool, options: dict[str, str]) -> None:
        super().__init__(logging.DEBUG if verbose > 1 else logging.INFO if verbose else logging.WARNING)
        self.warnings: list[str] = []
        self.options = options
        self.verbose, self.quiet = verbose, quiet

    def emit(self, record: logging.LogRecord) -> None:
        message = with_option_names(record.getMessage(), self.options)
        if record.levelno >= logging.WARNING and record.name != "py.warnings":
            if message not in self.warnings:
                self.warnings.append(message)
            message = f"Warning: {message}"
        if self.verbose and not self.quiet:
            click.echo(message, err=True)

    def tell(self) -> None:
        """Print the warnings kept back so far: a refused run says one line only."""
        if not self.verbose and not self.quiet:
            for message in self.warnings:
                click.echo(f"Warning: {message}", err=True)


class Run:
    """State of one run; a subcommand reads, computes, writes and finishes through it.

    Parameters
    ----------
    command : str
    common : Common
    formats : sequence of str, optional
        Extensions that `-o` may have; by default those of meshes.
    pictures : {'plot', 'output', 'chart'}
        Where --view, --show and --size belong: to --plot, to -o too (the command checks), or nowhere.
    options : dict
        The subcommand's own options, for the summary and the provenance.

    Raises
    ------
    InputError
        Outputs that cannot be written (unknown extension, missing folder, missing extra), before any work.
    """

    def __init__(
        self,
        command: str,
        common: Common,
        *,
        formats: Sequence[str] | None = None,
        pictures: str = "plot",
        **options: Any,
    ) -> None:
        self._context = click.get_current_context()
        self._began = self._context.meta.pop("ddgcli.began", time.perf_counter())
        self.command, self.common = command, common
        picture = {name: getattr(common, name) for name in ("view", "show", "size")}
        options |= {name: value for name, value in picture.items() if value is not None}
        self.options = {name: plain(value) for name, value in options.items()}
        self.seconds = {"read": 0.0, "write": 0.0}
        self.input: dict[str, Any] = {}
        self.outputs: list[str] = []
        self._inputs: dict[str, str] = {}  # path -> SHA-256
        self._read_beside: list[str] = []
        self._input_vertex: Any = None
        self._promised: list[str] = []
        self._progress = Progress(command, False, None)
        self._collector = _Collector(common.verbose, common.quiet, option_names(self._context.command))
        self._listen()
        self._check_outputs(formats)
        self._check_picture(pictures)
        self.progress(command)
        self._context.call_on_close(lambda: self._progress.clear())

    def _listen(self) -> None:
        for name in ("ddgcli", "py.warnings"):
            logger = logging.getLogger(name)
            logger.handlers[:] = [self._collector]
            logger.setLevel(self._collector.level if name == "ddgcli" else logging.ERROR)
            logger.propagate = False
        if self.common.verbose > 1:
            logging.getLogger("py.warnings").setLevel(logging.WARNING)
        logging.captureWarnings(True)

    def _check_outputs(self, formats: Sequence[str] | None) -> None:
        common = self.common
        if common.as_json and "-" in common.outputs:
            raise ParameterError("--json and -o - both want standard output; write the result to a file")
        if common.quiet and common.verbose:
            raise ParameterError("-q and -v exclude each other; give one")
        if common.outputs:
            from ddgcli.io.mesh_file import check_output

            for path in common.outputs:
                check_output(path, common.output_format, formats=formats)
                self._promise(path)
        if common.plot is not None:
            from ddgcli.plots.page import FORMATS, need_matplotlib

            self.will_write(common.plot, FORMATS)
            need_matplotlib()

    def _check_picture(self, pictures: str) -> None:
        """Refuse --view, --show and --size where no picture takes them."""
        for name in ("view", "show", "size"):
            if getattr(self.common, name) is None or pictures == "output":
                continue
            if pictures == "chart" and name != "size":
                raise ParameterError(
                    f"--{name} is for pictures of surfaces, and {self.command} draws a chart"
                )
            if self.common.plot is None:
                raise ParameterError(f"--{name} is for the picture of --plot; add that")

    @property
    def look(self) -> dict[str, Any]:
        """`view`, `up`, `width`, `height` and `dpi` of drawing functions, where given."""
        return {**(self.common.view or {}), **page_size(self.common.size)}

    def shown(self, arrays: Mapping[str, Any], default: str) -> tuple[str, Any]:
        """Name and values of the array that --show names, else of the default (None where there is none)."""
        name = self.common.show
        return (default, arrays.get(default)) if name is None else (name, chosen(dict(arrays), name))

    def will_write(self, path: str | None, formats: Sequence[str]) -> None:
        """Check a further output (a matrix, curves, a picture) before any work; None is passed over."""
        if path is None:
            return
        from ddgcli.io.mesh_file import check_place

        suffix = Path(path).suffix.lower()
        if suffix not in formats:
            raise OutputError(
                f"{path}: unknown format {suffix or '(no extension)'}; known here: {' '.join(formats)}"
            )
        check_place(path)
        self._promise(path)

    def _promise(self, path: str) -> None:
        if Path(path).resolve() in [Path(p).resolve() for p in self._promised]:
            raise OutputError(f"{path}: two results would go to this one place; give each its own")
        self._promised.append(path)

    def also_reads(self, path: str | None) -> None:
        """Name a further file that the run reads (an array, say), so that no output replaces it."""
        if path is not None and Path(path).is_file():
            self._read_beside.append(path)

    def _spare_inputs(self, path: str) -> None:
        """Refuse to write over an input: the last door of every output, promised beforehand or not."""
        if path != "-":
            from ddgcli.io.mesh_file import check_place

            check_place(path, inputs=(*self._inputs, *self._read_beside))

    @property
    def began(self) -> float:
        """When the run began, by `time.perf_counter`."""
        return self._began

    @contextmanager
    def timed(self, stage: str) -> Iterator[None]:
        """Add the time inside to `seconds[stage]` (read or write); all other time counts as compute."""
        began = time.perf_counter()
        try:
            yield
        finally:
            if stage != "compute":
                self.seconds[stage] += time.perf_counter() - began

    def progress(self, label: str) -> Callable[..., None]:
        """A callback for long work: `told(done, total)`; draws a bar on standard error if one is wanted."""
        self._progress.clear()
        terminal = False if self.common.quiet else None
        self._progress = Progress(label, terminal, self.common.progress, since=self._began)
        return self._progress

    def read(
        self,
        path: str,
        accept: Sequence[str] = ("surface",),
        *,
        subdivide: int = 0,
        flat_faces: bool = False,
    ) -> MeshInput:
        """Read the input mesh and note it in the summary.

        Parameters
        ----------
        subdivide : int
            Times that every face is split in four; the input's vertices keep their numbers, its arrays go.
        accept : sequence of {'surface', 'tetrahedra', 'curve'}
            Kinds that the command takes; others are refused with the mend.
        flat_faces : bool
            An intrinsic triangulation may stand for the surface of flat faces between its points.
        """
        with self.timed("read"):
            from ddgcli.io.mesh_file import check_place, read_mesh
            from ddgcli.mesh.require import wrong_kind

            for output in self._promised:
                if output != "-":
                    check_place(output, inputs=(path, *self._read_beside))
            source = read_mesh(path, self.common.input_format)
            if told := wrong_kind(source.mesh, accept, self.command, path):
                raise MeshError(f"{path}: {told}")
            self._inputs[path] = source.sha256
            self._input_vertex = source.input_vertex
            self._context.meta["ddgcli.input"] = path
        for note in source.notes:
            logging.getLogger("ddgcli").warning(note)
        if {"face_edge_lengths", "neighbors"} <= set(source.face) and not flat_faces:
            logging.getLogger("ddgcli").warning(
                "the input is an intrinsic triangulation, whose faces are taken as straight in space here: "
                "that is another surface; give the mesh that it was made from"
            )
        if subdivide:
            from ddgcli.mesh.shapes import midpoint_subdivided

            dropped = sorted({*source.vertex, *source.face, *source.edge})
            if dropped:
                logging.getLogger("ddgcli").warning(
                    f"--subdivide leaves behind the arrays {', '.join(dropped)}"
                )
            finer_faces = source.surface.n_faces * 4**subdivide
            if finer_faces > MOST_FACES:
                raise ParameterError(
                    f"--subdivide {subdivide} would make {finer_faces:,} faces; "
                    f"{MOST_FACES:,} are the most: ask for less"
                )
            finer = midpoint_subdivided(source.surface, subdivide)
            source = replace(source, mesh=finer, vertex={}, face={}, edge={}, input_face=None)
        self.input = {"path": path, **describe(source.mesh)}
        if self.input.get("faces") and self.input["genus"] is None:
            logging.getLogger("ddgcli").warning("genus is null: the surface is not an orientable manifold")
        return source

    def note_input(self, path: str, sha256: str, **facts: Any) -> None:
        """Note an input that `read` did not read (a scene, a trajectory)."""
        self.input = {"path": path, **facts}
        self._inputs[path] = sha256
        self._context.meta["ddgcli.input"] = path

    @property
    def command_line(self) -> str:
        """The command as typed."""
        import shlex

        return shlex.join(["ddgcli", *self._context.find_root().meta.get("ddgcli.args", [])])

    @property
    def metadata(self) -> dict[str, Any]:
        """Provenance for every output that can hold it."""
        path, sha256 = next(iter(self._inputs.items()), ("", ""))
        return {
            "command_line": self.command_line,
            "version": __version__,
            "input": path,
            "input_sha256": sha256,
            "options": self.options,
            "seed": self.common.seed,
            **({"units_note": self.common.units_note} if self.common.units_note else {}),
        }

    def write(self, annotated: AnnotatedMesh, *, converged: bool = True) -> None:
        """Write the annotated mesh to every -o."""
        for path in self.common.outputs:
            self.write_file(path, annotated, converged=converged)

    def write_file(self, path: str, annotated: AnnotatedMesh, *, converged: bool = True) -> None:
        """Write an annotated mesh, or curves, to one path with the provenance, and list it in `outputs`."""
        with self.timed("write"):
            from ddgcli.io.mesh_file import write_mesh

            self._spare_inputs(path)
            whole = annotated.whole
            if self._input_vertex is not None:
                whole = {"input_vertex": self._input_vertex, **whole}
            metadata = {**self.metadata, "converged": converged, **annotated.metadata}
            output_format = self.common.output_format if path == "-" else None
            write_mesh(path, replace(annotated, whole=whole, metadata=metadata), output_format=output_format)
            self.outputs.append(path)

    def write_bytes(self, path: str, data: bytes, *, in_place: bool = False) -> None:
        """Write a table, a matrix or whatever else is bytes, whole or not at all.

        `in_place`: the input itself is to be replaced, as the user asked.
        """
        with self.timed("write"):
            from ddgcli.io.mesh_file import write_whole

            if not in_place:
                self._spare_inputs(path)
            write_whole(path, data)
            self.outputs.append(path)

    def plot(self, draw: Callable[[str], Any]) -> None:
        """Draw the picture that --plot asks for; `draw` gets a path to draw to, and is not called without."""
        if self.common.plot is not None:
            with self.drawing(self.common.plot) as partial:
                draw(partial)

    @contextmanager
    def drawing(self, path: str) -> Iterator[str]:
        """A path to draw to; the picture takes its own place, and is listed, when the block ends well."""
        with self.timed("write"):
            from ddgcli.io.mesh_file import written_whole

            self._spare_inputs(path)
            self.progress("picture")
            with written_whole(path) as partial:
                yield partial
            self.outputs.append(path)

    def finish(
        self,
        results: dict[str, Any],
        accuracy: dict[str, Any],
        *,
        converged: bool = True,
        text: list[str] | None = None,
        exit_code: int = 1,
    ) -> None:
        """Print the summary; exit 1 (or `exit_code`) when the run did not reach what was asked.

        `text` takes the place of the results where people read them.
        """
        self._progress.clear()
        if not converged:
            results = {**results, "converged": False}
        if self.common.plot is not None and self.common.plot not in self.outputs:
            logging.getLogger("ddgcli").warning(
                f"{self.common.plot}: {self.command} has no picture to draw here"
            )
        missing: list[str] = []
        body = {
            "command": self.command,
            "version": __version__,
            "input": self.input,
            "options": self.options,
            "results": results,
            "accuracy": accuracy,
        }
        body = plain(body, missing)
        if missing:
            shown = ", ".join(missing[:5]) + (", ..." if len(missing) > 5 else "")
            logging.getLogger("ddgcli").warning(f"could not be computed, hence null: {shown}")
        self._collector.tell()
        total = time.perf_counter() - self._began
        read, write = self.seconds["read"], self.seconds["write"]
        body["seconds"] = {"read": read, "compute": total - read - write, "write": write, "total": total}
        body |= {"warnings": list(self._collector.warnings), "outputs": list(self.outputs)}
        print_summary(body, self.common.as_json, err="-" in self.outputs, text=text)
        if not converged:
            self._context.exit(exit_code)


def describe(mesh: AnyMesh) -> dict[str, Any]:
    """The `input` block of the summary; of tetrahedra, the topology is that of their boundary surface."""
    from ddgcli.mesh.curve import CurveSet
    from ddgcli.mesh.tet_mesh import TetMesh

    if isinstance(mesh, TetMesh):
        facts = describe(mesh.boundary)
        return {**facts, "vertices": mesh.n_vertices, "tetrahedra": len(mesh.tetrahedra)}
    if isinstance(mesh, CurveSet):
        return mesh.describe()
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


def refusal_of(error: DdgError, context: click.Context) -> str:
    """The message with option names, after the input's name where it has none of its own."""
    message = error_text(error, context.meta.get("ddgcli.options", {}))
    path = context.meta.get("ddgcli.input")
    if path and not isinstance(error, (OutputError, MissingExtraError)) and not message.startswith(path):
        return f"{path}: {message}"
    return message
