"""`ddgcli frames`."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ddgcli.cli import options
from ddgcli.cli.options import Common
from ddgcli.cli.run import Run, describe
from ddgcli.errors import OutputError, ParameterError

if TYPE_CHECKING:
    from ddgcli.io.trajectories.trajectory import Trajectory
    from ddgcli.mesh.fields import AnnotatedMesh
    from ddgcli.plots.motion import Shot, Stage


NUMBER = re.compile(r"\{(?::0?\d*d?)?\}")  # the place of a frame's number in an output's name


@click.command("frames")
@click.argument("path", metavar="RUN.vtkhdf", type=click.Path())
@options.common
@click.option(
    "--at", "time", type=options.REAL, help="Time of the frame to export [s]; the nearest is taken."
)
@click.option("--from", "start", type=options.REAL, help="First time of a sequence [s].")
@click.option("--to", "end", type=options.REAL, help="Last time of a sequence [s].")
@click.option(
    "--every",
    type=click.IntRange(min=1),
    metavar="N",
    default=1,
    show_default=True,
    help="Take one frame in N.",
)
@click.option("--array", metavar="NAME", help="The same as --show; 'none' for none.")
@click.option("--fps", type=options.POSITIVE, help="Frames a second of a .gif.  [default: 25]")
def command(path: str, common: Common, **wishes: Any) -> None:
    """Export frames of a trajectory (complete, or a .part that still grows).

    The extension of -o decides: a mesh format takes the frame of --at, or all frames under a numbered name
    such as f_{:04d}.ply; .png, .svg and .pdf one picture with --at, else a numbered sequence; .gif an
    animation; .pvd a series for ParaView.

    \b
    Examples:
      ddgcli frames run.vtkhdf --at 1.5 -o f.ply
      ddgcli frames run.vtkhdf --every 10 -o f_{:04d}.ply
      ddgcli frames run.vtkhdf -o movie.gif --view 15,40
      ddgcli frames run.vtkhdf --plot story.png
    """
    from ddgcli.io.mesh_file import WRITERS
    from ddgcli.io.trajectories.trajectory import Trajectory
    from ddgcli.plots.page import FORMATS

    run = Run("frames", common, formats=(*WRITERS, *FORMATS, ".gif", ".pvd"), pictures="output",
              **_given(wishes))  # fmt: skip
    if common.show is not None and wishes["array"] is not None:
        raise ParameterError("--show and --array name the same; give one")
    wishes |= {"view": common.view, "size": common.size, "array": wishes["array"] or common.show}
    _refuse_idle(common, wishes)
    with run.timed("read"):
        run_file = Trajectory(path)
    with run_file as source:
        run.note_input(path, str(source.attributes.get("input_sha256", "")), **describe(source.mesh))
        chosen = _chosen(source, wishes)
        for output in common.outputs:
            _check_numbering(output, len(chosen))
        exported = chosen if common.outputs else []
        for output in common.outputs:
            _export(run, source, output, chosen, wishes)
        run.plot(lambda target: _story(target, source, chosen, wishes))
        results = {
            "frames": source.n_frames,
            "status": source.attributes.get("status"),
            "start": float(source.times[0]),
            "end": float(source.times[-1]),
            "exported_frames": len(exported),
            "exported_times": [float(source.times[k]) for k in exported],
            "arrays": sorted(source.vertex(0)),
            "scalars": sorted(source.scalars),
        }
    run.finish(results, {"time_mismatch": _mismatch(source, chosen, wishes)})


def _refuse_idle(common: Common, wishes: dict[str, Any]) -> None:
    """ParameterError for wishes about pictures where none is drawn."""
    from ddgcli.plots.page import FORMATS

    kinds = {Path(output).suffix.lower() for output in (*common.outputs, common.plot or "")}
    for name, of in (
        ("fps", {".gif"}),
        ("view", {".gif", *FORMATS}),
        ("size", {".gif", *FORMATS}),
        ("array", {".gif", *FORMATS}),
    ):
        if wishes[name] is not None and not kinds & of:
            raise ParameterError(f"--{name} is for {' '.join(sorted(of))}; write one with -o")


def _given(wishes: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in wishes.items() if value is not None}


def _chosen(source: Trajectory, wishes: dict[str, Any]) -> list[int]:
    """Numbers of the frames asked for."""
    times = source.times
    if wishes["time"] is not None:
        slack = 1e-9 * max(abs(float(times[-1])), 1e-300)
        if not times[0] - slack <= wishes["time"] <= times[-1] + slack:
            raise ParameterError(
                f"--at {wishes['time']:g}: the run lasts from {times[0]:g} to {times[-1]:g} s"
            )
        return [source.frame_at(wishes["time"])]
    low = times[0] if wishes["start"] is None else wishes["start"]
    high = times[-1] if wishes["end"] is None else wishes["end"]
    inside = [k for k in range(source.n_frames) if low - 1e-12 <= times[k] <= high + 1e-12]
    if not inside:
        raise ParameterError(f"no frame from {low:g} to {high:g} s; the run lasts to {times[-1]:g} s")
    return inside[:: wishes["every"]]


def _mismatch(source: Trajectory, chosen: list[int], wishes: dict[str, Any]) -> float:
    """Distance of the exported frame from the time asked for."""
    return 0.0 if wishes["time"] is None else abs(float(source.times[chosen[0]]) - wishes["time"])


def _export(run: Run, source: Trajectory, output: str, chosen: list[int], wishes: dict[str, Any]) -> None:
    from ddgcli.plots.page import FORMATS

    suffix = Path(output).suffix.lower()
    if suffix == ".pvd":
        _series(run, source, output, chosen)
    elif suffix == ".gif":
        from ddgcli.plots.motion import draw_animation

        with run.drawing(output) as partial:
            on = _stage(source, chosen, wishes)
            draw_animation(partial, _shots(source, chosen, wishes), on, wishes["fps"] or 25.0, wishes["size"])
    elif suffix in FORMATS:
        _pictures(run, source, output, chosen, wishes)
    else:
        for number, k in enumerate(chosen):
            run.write_file(_numbered(output, number), _annotated(source, k))


def _check_numbering(output: str, count: int) -> None:
    """OutputError where several frames would go to one mesh, or a number has no right place in the name."""
    from ddgcli.io.mesh_file import WRITERS
    from ddgcli.plots.page import FORMATS

    path = Path(output)
    numbered = NUMBER.findall(output)
    if "{" in output and (len(numbered) != 1 or path.suffix.lower() not in (*WRITERS, *FORMATS)):
        raise OutputError(
            f"{output}: a numbered name has one number, and a format of a frame a file; write f_{{:04d}}.ply"
        )
    if count > 1 and not numbered and path.suffix.lower() not in (*FORMATS, ".gif", ".pvd"):
        name = f"{path.stem}_{{:04d}}{path.suffix}" if output != "-" else "f_{:04d}.ply"
        raise OutputError(
            f"{output}: the file holds one frame, and {count} are chosen; number them with -o {name}, "
            "or choose one with --at TIME"
        )


def _numbered(output: str, number: int) -> str:
    """The name with the number in its place, where it has one."""
    return output.format(number) if NUMBER.search(output) else output


def _annotated(source: Trajectory, k: int) -> AnnotatedMesh:
    from ddgcli.mesh.fields import AnnotatedMesh

    metadata = {"trajectory": source.path, "frame": k, "time": float(source.times[k])}
    return AnnotatedMesh(
        source.mesh.moved(source.points(k)), vertex=source.vertex(k), face=source.face, metadata=metadata
    )


def _pictures(run: Run, source: Trajectory, output: str, chosen: list[int], wishes: dict[str, Any]) -> None:
    """The frame of --at, or a numbered picture of each frame: name_0000.png, name_0001.png, ..."""
    from ddgcli.plots.motion import draw_shot

    with run.timed("write"):
        on = _stage(source, chosen, wishes)
    target = Path(output)
    for k, shot in enumerate(_shots(source, chosen, wishes)):
        name = _numbered(output, k)
        if name == output and wishes["time"] is None:
            name = str(target.with_name(f"{target.stem}_{k:04d}{target.suffix}"))
        with run.drawing(name) as partial:
            draw_shot(partial, shot, on, **options.page_size(wishes["size"]))


def _series(run: Run, source: Trajectory, output: str, chosen: list[int]) -> None:
    """A .pvd and, in a folder of its name, one .vtp for each frame."""
    folder = Path(output).with_suffix("")
    folder.mkdir(exist_ok=True)
    written = []
    for k in chosen:
        name = folder / f"frame_{k:05d}.vtp"
        run.write_file(str(name), _annotated(source, k))
        written.append((float(source.times[k]), f"{folder.name}/{name.name}"))
    from ddgcli.io.trajectories.trajectory import pvd_text

    run.write_bytes(output, pvd_text(written).encode())


def _shots(source: Trajectory, chosen: list[int], wishes: dict[str, Any]) -> Iterator[Shot]:
    from ddgcli.cli.simulation.plot import length_of, part_of
    from ddgcli.plots.motion import Shot

    name = _array_name(source, wishes)
    hidden = source.face.get("wraps")  # faces of a periodic grid that would span the picture
    shown = None if hidden is None else hidden == 0
    for k in chosen:
        values = length_of(source.vertex(k)[name]) if name else None
        yield Shot(float(source.times[k]), part_of(source.mesh.moved(source.points(k)), shown), values)


def _array_name(source: Trajectory, wishes: dict[str, Any]) -> str | None:
    """The array that colours pictures: the one asked for, else vorticity or the first that is a number."""
    arrays = source.vertex(0)
    if wishes["array"] in (None, "none"):
        plain = [name for name, values in arrays.items() if values.ndim == 1]
        plain.sort(key=lambda name: name != "vorticity")
        return plain[0] if plain and wishes["array"] is None else None
    return wishes["array"] if wishes["array"] in arrays else options.chosen(arrays, wishes["array"])


def _stage(source: Trajectory, chosen: list[int], wishes: dict[str, Any]) -> Stage:
    from ddgcli.plots.motion import stage

    name = _array_name(source, wishes)
    unit = str(source.attributes.get("time_unit", "s"))
    return stage(_shots(source, chosen, wishes), name or "", wishes["view"], time_unit=unit)


def _story(target: str, source: Trajectory, chosen: list[int], wishes: dict[str, Any]) -> None:
    from ddgcli.cli.simulation.plot import energies
    from ddgcli.plots.motion import draw_motion

    series = energies(source.times, source.scalars)
    draw_motion(
        target,
        list(_shots(source, chosen, wishes)),
        series,
        _stage(source, chosen, wishes),
        "energy",
        **options.page_size(wishes["size"], 9.0),
    )
