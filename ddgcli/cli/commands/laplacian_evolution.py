"""Options of `ddgcli laplacian` for the heat and the wave equation, and their output."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ddgcli.choices import EVOLUTIONS
from ddgcli.cli.options import POSITIVE_NUMBER, grouped_options
from ddgcli.errors import ParameterError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ddgcli.algorithms.laplacian.evolution import EvolutionResult
    from ddgcli.cli.run import Run
    from ddgcli.io.mesh_file import MeshInput
    from ddgcli.mesh.tet_mesh import TetMesh
    from ddgcli.mesh.triangle_mesh import TriangleMesh

TRAJECTORIES = (".vtkhdf", ".h5")


@dataclass(frozen=True)
class EvolutionOptions:
    """Values of the options."""

    heat: str | None = None
    wave: str | None = None
    duration: float | None = None
    time_step: float | None = None
    n_frames: int | None = None

    @property
    def equation(self) -> str | None:
        """Name of the equation, if there is one."""
        return next((name for name in EVOLUTIONS if getattr(self, name) is not None), None)

    def changed(self) -> dict[str, Any]:
        """Options that are set, for the summary."""
        return {name: value for name, value in asdict(self).items() if value is not None}

    def check(self, other_tasks: bool) -> None:
        """Raise ParameterError for options that exclude each other or lack what they refer to."""
        if self.equation is None:
            for name in ("duration", "time_step", "n_frames"):
                if getattr(self, name) is not None:
                    raise ParameterError("belongs to `heat` or `wave`; add one of them", parameter=name)
            return
        if self.heat is not None and self.wave is not None:
            raise ParameterError("and `wave` exclude each other; give one", parameter="heat")
        if self.duration is None:
            raise ParameterError("needs `duration`; give both", parameter=self.equation)
        if other_tasks:
            raise ParameterError("is a run of its own; leave the other tasks out", parameter=self.equation)


_OPTIONS = (
    click.option("--heat", metavar="ARRAY|FILE|ID",
                 help="Heat equation M u' = -L u from an array of MESH, of a file, or from one unit at "
                      "a vertex; "
                      "-o .vtkhdf holds all frames, other formats the last."),
    click.option("--wave", metavar="ARRAY|FILE|ID", help="Wave equation M u'' = -L u, likewise, from rest."),
    click.option("--duration", type=POSITIVE_NUMBER, metavar="T",
                 help="Time of --heat (length squared) or --wave (length, at unit speed)."),
    click.option("--dt", "time_step", type=POSITIVE_NUMBER, metavar="T",
                 help="Time step; heat is exact at any.  "
                      "[default: a hundredth of the duration, of short waves less]"),
    click.option("--frames", "n_frames", type=click.IntRange(min=1), metavar="N",
                 help="Number of frames after the first.  [default: 50]"),
)  # fmt: skip

evolution_options = grouped_options("evolution", EvolutionOptions, _OPTIONS)


def start_of(source: MeshInput, options: EvolutionOptions) -> NDArray | int:
    """The function at the start: a vertex array, or the index of a vertex."""
    from ddgcli.cli.subdivided_input import input_function

    equation = options.equation or ""
    name = str(getattr(options, equation))
    if name.isdigit() and name not in source.vertex:
        return int(name)
    array, place = input_function(source, name, equation)
    if place not in ("vertex", ""):
        raise ParameterError(f"needs values on vertices; {name!r} has values on {place}s", parameter=equation)
    return array


def write_evolution(run: Run, mesh: TriangleMesh | TetMesh, result: EvolutionResult) -> None:
    """All frames to a trajectory, the last one to the other outputs."""
    from ddgcli.algorithms.laplacian.evolution import frame_arrays
    from ddgcli.mesh.fields import AnnotatedMesh, TrajectoryFrame

    for path in run.common.outputs:
        if Path(path).suffix.lower() not in TRAJECTORIES:
            run.write_file(path, AnnotatedMesh(mesh, vertex=result.arrays))
            continue
        from ddgcli.io.trajectories.layout import Header
        from ddgcli.io.trajectories.writer import TrajectoryWriter

        with run.clock.timed("write"):
            attributes = {name: str(value) for name, value in run.metadata.items()}
            writer = TrajectoryWriter(
                path, Header(mesh, False, attributes=attributes), len(result.evolution_frames)
            )
            status = "failed"
            try:
                for evolution_frame in result.evolution_frames:
                    writer.append(
                        TrajectoryFrame(
                            evolution_frame.step,
                            evolution_frame.time,
                            None,
                            frame_arrays(evolution_frame),
                            evolution_frame.scalar,
                        )
                    )
                status = "complete"
            finally:
                writer.close(status, staged=run.staged, keep=False)
        run.outputs.append(path)
