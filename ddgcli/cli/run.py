"""Run of a subcommand: reading, timing, provenance, outputs, summary, exit code."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ddgcli import __version__
from ddgcli.cli.clock import RunClock
from ddgcli.cli.input_facts import input_facts, reason_of_no_genus
from ddgcli.cli.messages import MessageHandler, path_from_here, with_repair_of_input
from ddgcli.cli.options import CommonOptions, page_size
from ddgcli.cli.output_checks import check_mesh, check_outputs, check_picture
from ddgcli.cli.progress import Progress
from ddgcli.cli.summary import plain, print_summary
from ddgcli.errors import MeshError, OutputError, named_array
from ddgcli.io.output_file import FileContent, atomic_output, check_place, write_atomically
from ddgcli.io.temporary import StagedOutputs

if TYPE_CHECKING:
    from ddgcli.cli.forecast.prediction import Prediction
    from ddgcli.cli.forecast.use import InputSize
    from ddgcli.io.mesh_file import MeshInput
    from ddgcli.mesh.fields import AnnotatedMesh

log = logging.getLogger("ddgcli")


class Run:
    """One run of a subcommand: reads the input, writes the outputs and prints the summary.

    Parameters
    ----------
    command : str
    common : CommonOptions
    formats : sequence of str, optional
        Extensions that `-o` may have; by default those of meshes.
    pictures : {'plot', 'output', 'chart'}
        Pictures that --view, --show and --size apply to: that of --plot; those of -o too (checked later); or
        charts, which take --size only.
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
        common: CommonOptions,
        *,
        formats: Sequence[str] | None = None,
        pictures: str = "plot",
        **options: Any,
    ) -> None:
        self._context = click.get_current_context()
        meta = self._context.meta
        self.clock = RunClock(meta.pop("ddgcli.began", time.perf_counter()), meta["ddgcli.imports"])
        self.command, self.common = command, common
        form = common.input_format
        if form and form.strip(".").lower() != "toml":  # of a mesh, not of a scene that names meshes
            meta["ddgcli.read_options"] = ("--input-format", form)
        picture = {name: getattr(common, name) for name in ("colors", "view", "show", "size")}
        options |= {name: value for name, value in picture.items() if value is not None}
        self.options = {name: plain(value) for name, value in options.items()}
        self.input: dict[str, Any] = {}
        self.outputs: list[str] = []
        self._inputs: dict[str, Callable[[], str]] = {}  # path -> its SHA-256, computed when called
        self._further_inputs: list[str] = []
        self._input_vertex: Any = None
        self._source: MeshInput | None = None
        self._predicted: tuple[Prediction, InputSize] | None = None
        self._planned_outputs: list[str] = []
        self.staged = meta["ddgcli.outputs"] = StagedOutputs()
        self._progress = Progress(command, False, None)
        self._messages = MessageHandler(common.verbose, common.quiet, meta["ddgcli.options"])
        self._messages.install()
        check_outputs(common, formats, self.plan_output)
        check_picture(common, pictures)
        self.progress(command)
        self._context.call_on_close(lambda: self._progress.clear())
        self._context.call_on_close(self.staged.discard)

    @property
    def picture_options(self) -> dict[str, Any]:
        """`view`, `up`, `width`, `height` and `dpi` of drawing functions, as far as the call sets them."""
        return {**(self.common.view or {}), **page_size(self.common.size)}

    def picture_array(self, arrays: Mapping[str, Any], default: str) -> tuple[str, Any]:
        """Name and values of the array of --show, else of the default (None if it is missing)."""
        name = self.common.show or default
        if self.common.show is not None and name not in arrays:  # an array that the run could not compute
            log.warning(f"these results have no array {name!r}: the picture shows another")
            name = default
        return name, arrays.get(name)

    def plan_output(
        self, path: str | None, formats: Sequence[str] | None, output_format: str | None = None
    ) -> None:
        """Check an output (a mesh, a matrix, curves, a picture) before any work; ignore None.

        `formats` None: those of meshes; `output_format`: that of standard output.
        """
        if path is None:
            return
        from ddgcli.io.mesh_file import check_output

        check_output(path, output_format, formats=formats)
        if Path(path).resolve() in [Path(p).resolve() for p in self._planned_outputs]:
            raise OutputError(f"{path}: two outputs have this name; use different names")
        self._planned_outputs.append(path)

    def plan_folder(self, path: str | None) -> None:
        """Check a folder for outputs before any work; ignore None."""
        existing = next((p for p in (Path(path), *Path(path).parents) if p.exists()), None) if path else None
        if existing is not None and not (existing.is_dir() and os.access(existing, os.W_OK)):
            reason = "cannot be written to" if existing.is_dir() else "is not a folder"
            raise OutputError(f"{path}: {existing} {reason}; name another folder")

    def add_input(self, path: str | None) -> None:
        """Register a further file that the run reads, such as an array, so that no output replaces it."""
        if path is not None and Path(path).is_file():
            self._further_inputs.append(path)

    def _protect_inputs(self, path: str) -> None:
        """Raise OutputError if an output would overwrite an input."""
        if path != "-":
            check_place(path, inputs=(*self._inputs, *self._further_inputs))

    def progress(self, label: str) -> Callable[..., None]:
        """Callback `progress(completed, total)` of long work, drawn as a progress bar on standard error."""
        self._progress.clear()
        terminal = False if self.common.quiet else None
        self._progress = Progress(label, terminal, self.common.progress, since=self.clock.began)
        return self._progress

    def read(
        self,
        path: str,
        accept: Sequence[str] = ("surface",),
        *,
        subdivide: int = 0,
        flat_faces: bool = False,
    ) -> MeshInput:
        """Read the input mesh and report it; refuse another kind, and a run that cannot fit into memory.

        The command then checks what its options require of the mesh, before it calls `begin`.

        Parameters
        ----------
        subdivide : int
            How often every face is split in four; vertices of the input keep their indices, and its arrays
            are those of `subdivided_input`.
        accept : sequence of {'surface', 'tetrahedra', 'curve'}
            Kinds that the command takes; for others the error names a repair.
        flat_faces : bool
            Whether the command may treat an intrinsic triangulation as flat faces between its points.
        """
        with self.clock.timed("read"):
            from ddgcli.io.mesh_file import read_mesh
            from ddgcli.mesh.requirements import kind_error

            for output in self._planned_outputs:
                if output != "-":
                    check_place(output, inputs=(path, *self._further_inputs))
            self._context.meta.pop("ddgcli.input", None)  # of several, errors name the one that is read
            source = read_mesh(path, self.common.input_format)
            if message := kind_error(source.mesh, accept, self.command, path):
                raise MeshError(f"{path}: {message}")
            self._context.meta["ddgcli.input"] = path
            self._context.meta["ddgcli.mesh"] = path
            self._context.meta["ddgcli.tetrahedra"] = source.kind == "tetrahedra"
            self._inputs[path] = source.digest.sha256
            if self._planned_outputs:  # they contain it; computing it here releases the bytes of the file
                source.digest.sha256()
            self._input_vertex = source.input_vertex
        for note in source.notes:
            log.warning(note)
        if not flat_faces:
            from ddgcli.cli.input_warnings import warn_of_flat_faces

            warn_of_flat_faces(source.face)
        if subdivide:
            from ddgcli.cli.subdivided_input import subdivided_input

            source = subdivided_input(source, subdivide)
        self._source = source
        self.input = {"path": path, **input_facts(source.mesh)}
        if self.command == "info" and self.input.get("faces") and self.input["genus"] is None:
            log.warning(f"genus is null: the surface {reason_of_no_genus(self.input)}")
        from ddgcli.cli.forecast.check_cost import size_of

        self.predict(size_of(source.mesh, self.options | {"plot": self.common.plot}))
        return source

    def predict(self, size: InputSize, options: Mapping[str, Any] | None = None) -> Prediction | None:
        """Refuse a run that cannot fit into memory; its cost, in a dry run and for large inputs.

        `options` replace those of the summary.
        """
        from ddgcli.cli.forecast.check_cost import check_cost

        prediction = check_cost(self, size, options)
        self._predicted = None if prediction is None else (prediction, size)
        return prediction

    def predict_with(self, change: Callable[[InputSize], InputSize]) -> None:
        """Predict again, where there is a prediction, with the facts that `change` adds to its size."""
        if self._predicted is not None:
            self.predict(change(self._predicted[1]))

    def refine_prediction(self, refine: Callable[[Prediction, InputSize], Prediction]) -> None:
        """Replace the prediction of a dry run by `refine(prediction, size)`."""
        if self.common.dry_run and self._predicted is not None:
            prediction, size = self._predicted
            self._predicted = refine(prediction, size), size

    def begin(self, shown: Collection[str] | None = None, written: Collection[str] | None = None) -> None:
        """End the checks of the call: a dry run prints its prediction and ends here, a run computes next.

        Every command calls it after it has checked its options and its input.

        Parameters
        ----------
        shown, written : collection of str, optional
            Names of the arrays that the results will have: those of --show and of --colors.
        """
        common = self.common
        for option, name, arrays in (("show", common.show, shown), ("colors", common.colors, written)):
            if name is not None and arrays is not None:
                named_array(dict.fromkeys(arrays), name, parameter=option)
        if self._source is not None:
            check_mesh(self.command, self.common, self._source.mesh)
        if self.common.dry_run and self._predicted is not None:
            from ddgcli.cli.forecast.check_cost import refined_prediction
            from ddgcli.cli.forecast.prediction import as_results

            prediction, size = self._predicted
            if self._source is not None:
                prediction, size = refined_prediction(self, size, self._source.mesh, prediction)
            self.end_dry_run(as_results(prediction, size))

    def print_warnings(self) -> list[str]:
        """Print the warnings of the run so far, and return them."""
        self._messages.print_warnings()
        return self._messages.warnings()

    def end_dry_run(
        self, results: dict[str, Any], text: Sequence[str] = (), *, converged: bool = True
    ) -> None:
        """Print `text` and the prediction of a dry run as the summary, and end the run."""
        self.common = replace(self.common, plot=None)
        from ddgcli.cli.forecast.prediction import as_text

        self.finish(results, {}, converged=converged, text=[*text, *as_text(results, self.common.full)])
        self._context.exit(0)

    def set_input(self, path: str, sha256: str, **facts: Any) -> None:
        """Report an input other than a mesh, such as a scene or a trajectory."""
        self.input = {"path": path, **facts}
        self._inputs[path] = lambda: sha256
        self._context.meta["ddgcli.input"] = path

    def name_mesh(self, path: str | None) -> None:
        """Name the mesh file that messages are about, where the input is another file; ignore None."""
        if path is not None:
            self._context.meta["ddgcli.mesh"] = path_from_here(path)

    @property
    def command_line(self) -> str:
        """The command as typed."""
        import shlex

        return shlex.join(["ddgcli", *self._context.find_root().meta.get("ddgcli.args", [])])

    def with_commands(self, messages: Mapping[str, str]) -> dict[str, str]:
        """Messages about the input mesh with the repair that each names as a command."""
        return {name: with_repair_of_input(message, self._context.meta) for name, message in messages.items()}

    @property
    def metadata(self) -> dict[str, Any]:
        """Provenance, for every output whose format can hold it."""
        path, sha256 = next(iter(self._inputs.items()), ("", str))
        return {
            "command_line": self.command_line,
            "version": __version__,
            "input": path,
            "input_sha256": sha256(),
            "options": self.options,
            "seed": self.common.seed,
            **({"units_note": self.common.units_note} if self.common.units_note else {}),
        }

    def write(self, annotated: AnnotatedMesh, *, converged: bool = True) -> None:
        """Write the annotated mesh to every -o."""
        for path in self.common.outputs:
            self.write_file(path, annotated, converged=converged)

    def write_file(
        self,
        path: str,
        annotated: AnnotatedMesh,
        *,
        converged: bool = True,
        colour_range: tuple[float, float, bool] | None = None,
    ) -> None:
        """Write an annotated mesh, or curves, to one path with the provenance, and list it in `outputs`.

        Texture coordinates and colours of the input are added where the faces are the input's; the array of
        --colors is drawn in colours, over `colour_range` = (low, high, signed) or its own range.
        """
        with self.clock.timed("write"):
            from ddgcli.cli.appearance import with_baked_colours, with_input_appearance
            from ddgcli.io.mesh_file import write_mesh

            self._protect_inputs(path)
            if self.common.colors is not None and (path in self.common.outputs or colour_range is not None):
                annotated = with_baked_colours(annotated, self.common.colors, colour_range)
            if self._source is not None:
                annotated = with_input_appearance(annotated, self._source)
            whole = annotated.whole
            if self._input_vertex is not None:
                whole = {"input_vertex": self._input_vertex, **whole}
            metadata = {**self.metadata, "converged": converged, **annotated.metadata}
            output_format = self.common.output_format if path == "-" else None
            annotated = replace(annotated, whole=whole, metadata=metadata)
            write_mesh(path, annotated, output_format=output_format, staged=self.staged)
            self.outputs.append(path)

    def write_bytes(self, path: str, content: FileContent, *, in_place: bool = False) -> None:
        """Write bytes to a file, all or nothing, and list it in `outputs`.

        `content`: the bytes, or a function that writes them to an open file; `in_place`: the file may be the
        input itself.
        """
        with self.clock.timed("write"):
            if not in_place:
                self._protect_inputs(path)
            write_atomically(path, content, staged=self.staged)
            self.outputs.append(path)

    def make_folder(self, folder: Path) -> None:
        """Make a folder for outputs; a run with an error removes it."""
        try:
            self.staged.make_folder(folder)
        except OSError as error:
            raise OutputError(f"{folder}: {error.strerror}; name another folder") from error

    def commit_outputs(self) -> None:
        """Move the complete outputs to their paths, all or none."""
        self.staged.commit()

    def plot(self, draw: Callable[[str], Any]) -> None:
        """Draw the picture of --plot, if there is one, with `draw(path)`."""
        if self.common.plot is not None:
            with self.drawing(self.common.plot) as partial:
                draw(partial)

    @contextmanager
    def drawing(self, path: str, *, progress: bool = True) -> Iterator[str]:
        """Temporary path to draw to; without an error the picture then replaces `path` and is listed.

        `progress` False: the caller draws the progress bar.
        """
        with self.clock.timed("write"):
            self._protect_inputs(path)
            if progress:
                self.progress("picture")
            with atomic_output(path, self.staged) as partial:
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
        """Print the summary; exit with `exit_code` if the run did not converge.

        `text` replaces the results in the summary for people.
        """
        self._progress.clear()
        if not converged:
            results = {**results, "converged": False}
        if self.common.plot is not None and self.common.plot not in self.outputs:
            log.warning(f"{self.common.plot}: {self.command} draws no picture of these results")
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
            log.warning(f"could not be computed and is null: {shown}")
        self.commit_outputs()
        warnings = self.print_warnings()
        body["seconds"] = self.clock.seconds()
        body |= {"warnings": warnings, "outputs": list(self.outputs)}
        if self.common.as_json or not self.common.quiet:
            to_error = "-" in self.outputs
            print_summary(body, self.common.as_json, to_error, text, full=self.common.full)
        if not converged:
            self._context.exit(exit_code)
