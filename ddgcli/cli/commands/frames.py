"""`ddgcli frames`: export frames of a trajectory."""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from string import Formatter
from typing import TYPE_CHECKING, Any

import click

from ddgcli.choices import VELOCITY_GLYPHS
from ddgcli.cli import options
from ddgcli.cli.forecast.check_cost import size_of
from ddgcli.cli.input_facts import input_facts
from ddgcli.cli.options import CommonOptions
from ddgcli.cli.output_checks import check_holdable
from ddgcli.cli.run import Run
from ddgcli.errors import OutputError, ParameterError, named_array, renamed_parameters

if TYPE_CHECKING:
    from ddgcli.io.trajectories.trajectory import Trajectory
    from ddgcli.mesh.fields import AnnotatedMesh
    from ddgcli.plots.motion import PlotFrame, SequenceStyle


ANIMATIONS = (".gif", ".mp4")
NUMBER_FORMAT = re.compile(r"0?\d*d?")  # of the number of a frame in the name of an output
TIME_LABELS = {"time_name": "t", "time_unit": "s"}  # attributes of trajectories and their defaults


@click.command("frames")
@click.argument("path", metavar="RUN.vtkhdf", type=click.Path(readable=False))
@options.common
@click.option(
    "--at",
    "time",
    type=options.REAL_NUMBER,
    help="Time of the frame to export, in the run's unit; the nearest is taken.",
)
@click.option("--from", "start", type=options.REAL_NUMBER, help="First time of a sequence.")
@click.option("--to", "end", type=options.REAL_NUMBER, help="Last time of a sequence.")
@click.option(
    "--every",
    type=click.IntRange(min=1),
    metavar="N",
    default=1,
    show_default=True,
    help="Take every N-th frame.",
)
@click.option("--array", metavar="NAME", help="The same as --show; 'none' for no array.")
@click.option("--paths", is_flag=True, help="Write the paths of particles as polylines instead of the mesh.")
@click.option(
    "--glyphs", type=click.Choice(VELOCITY_GLYPHS), help="Velocity of a fluid in pictures.  [default: arrows]"
)
@click.option(
    "--jobs",
    type=click.IntRange(min=1),
    metavar="N",
    help="Processes that draw pictures and animations; the files are the same.  [default: 1]",
)
@click.option("--fps", type=options.POSITIVE_NUMBER, help="Frames per second of an animation.  [default: 25]")
def command(path: str, common: CommonOptions, **settings: Any) -> None:
    """Export frames of a trajectory (complete, or a .part that still grows).

    The extension of -o decides: a mesh format takes the frame of --at, or all frames under a numbered name
    such as f_{:04d}.ply; .png, .svg and .pdf one picture with --at, else a numbered sequence; .gif and
    .mp4 an animation; .pvd a series for ParaView.

    \b
    Examples:
      ddgcli frames run.vtkhdf --at 1.5 -o f.ply
      ddgcli frames run.vtkhdf --every 10 -o f_{:04d}.ply
      ddgcli frames run.vtkhdf -o movie.mp4 --view 15,40 --size 1920x1080
      ddgcli frames run.vtkhdf --plot run.png
      ddgcli frames run.vtkhdf --paths -o paths.vtp
    """
    from ddgcli.io.mesh_file import WRITERS
    from ddgcli.io.trajectories.paths import check_particles
    from ddgcli.io.trajectories.trajectory import Trajectory
    from ddgcli.plots.page import FORMATS

    run = Run("frames", common, formats=(*WRITERS, *FORMATS, *ANIMATIONS, ".pvd"), pictures="output",
              **_without_defaults(settings))  # fmt: skip
    if common.show is not None and settings["array"] is not None:
        raise ParameterError("--show and --array are the same option; give one")
    settings |= {"view": common.view, "size": common.size, "array": settings["array"] or common.show}
    _check_selection(settings)
    _check_picture_options(common, settings)
    with run.clock.timed("read"):
        run_file = Trajectory(path)
    with run_file as source:
        run.set_input(path, str(source.attributes.get("input_sha256", "")), **input_facts(source.mesh))
        frame_numbers = _frame_numbers(source, settings)
        for output in common.outputs:
            _check_numbering(output, 1 if settings["paths"] else len(frame_numbers))
        exported = frame_numbers if common.outputs else []
        drawn = {".png", ".svg", ".pdf", *ANIMATIONS} & {
            Path(output).suffix.lower() for output in common.outputs
        }
        size = replace(size_of(source.mesh, {"plot": bool(drawn)}), frame_count=max(1, len(exported)))
        run.predict(size, {"pictures": bool(drawn)})
        if drawn or common.plot is not None:
            _array_name(source, settings)
        if settings["paths"] and common.outputs:
            with renamed_parameters(source="paths"):
                check_particles(source)
        for output in common.outputs:
            if Path(output).suffix.lower() == ".pvd":
                run.plan_folder(str(Path(output).with_suffix("")))
        check_holdable(common, source.mesh)
        run.begin(written=(*source.vertex(0), *source.face(0)))
        for output in common.outputs:
            if settings["paths"]:
                run.write_file(output, _paths(source, frame_numbers))
            else:
                _export(run, source, output, frame_numbers, settings)
        run.plot(lambda target: _draw_plot(target, source, frame_numbers, settings))
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
    run.finish(results, {"time_mismatch": _time_mismatch(source, frame_numbers, settings)})


def _check_selection(settings: dict[str, Any]) -> None:
    """Raise ParameterError for options that select several frames beside the one of --at."""
    several = {"from": settings["start"], "to": settings["end"], "every": settings["every"]}
    for name, value in several.items():
        if settings["time"] is not None and value not in (None, 1):
            raise ParameterError(
                f"--{name} selects from several frames, and --at names one; leave one of them out"
            )


def _check_picture_options(common: CommonOptions, settings: dict[str, Any]) -> None:
    """Raise ParameterError for options of pictures if no picture is drawn."""
    from ddgcli.plots.animation import check_animation
    from ddgcli.plots.page import FORMATS

    outputs = {Path(output).suffix.lower() for output in (*common.outputs, common.plot or "")}
    for name, suffixes in (
        ("fps", {*ANIMATIONS}),
        ("jobs", {*ANIMATIONS, *FORMATS}),
        ("view", {*ANIMATIONS, *FORMATS}),
        ("size", {*ANIMATIONS, *FORMATS}),
        ("array", {*ANIMATIONS, *FORMATS}),
        ("glyphs", {*ANIMATIONS, *FORMATS}),
    ):
        if settings[name] is not None and not outputs & suffixes:
            raise ParameterError(f"--{name} is for {' '.join(sorted(suffixes))}; write one with -o")
    for output in common.outputs:
        if Path(output).suffix.lower() in ANIMATIONS:
            with renamed_parameters(frames_per_second="fps"):
                check_animation(output, common.size, settings["fps"])


def _without_defaults(settings: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in settings.items() if value is not None}


def _frame_numbers(source: Trajectory, settings: dict[str, Any]) -> list[int]:
    """Indices of the selected frames."""
    times = source.times
    lasts = (
        f"the run lasts from {times.min():g} to {times.max():g} {_time_labels(source)['time_unit']}".rstrip()
    )
    slack = 1e-9 * max(abs(float(times[-1])), 1e-300)
    if settings["time"] is not None:
        if not times.min() - slack <= settings["time"] <= times.max() + slack:  # of load factors that fall
            raise ParameterError(f"--at {settings['time']:g}: {lasts}")
        return [source.frame_at(settings["time"])]
    low = times.min() if settings["start"] is None else settings["start"]
    high = times.max() if settings["end"] is None else settings["end"]
    inside = [k for k in range(source.n_frames) if low - slack <= times[k] <= high + slack]
    if not inside:
        span = f"{low:g} on" if settings["end"] is None else f"{low:g} to {high:g}"
        raise ParameterError(f"no frame from {span}; {lasts}")
    return inside[:: settings["every"]]


def _time_labels(source: Trajectory) -> dict[str, Any]:
    """`time_name` and `time_unit` of a run."""
    return {key: str(source.attributes.get(key, TIME_LABELS[key])) for key in TIME_LABELS}


def _time_mismatch(source: Trajectory, frame_numbers: list[int], settings: dict[str, Any]) -> float:
    """Difference between the time of the exported frame and --at, in the run's unit."""
    return 0.0 if settings["time"] is None else abs(float(source.times[frame_numbers[0]]) - settings["time"])


def _export(
    run: Run, source: Trajectory, output: str, frame_numbers: list[int], settings: dict[str, Any]
) -> None:
    from ddgcli.plots.page import FORMATS

    suffix = Path(output).suffix.lower()
    if suffix == ".pvd":
        _series(run, source, output, frame_numbers)
    elif suffix in ANIMATIONS:
        from ddgcli.plots.animation import draw_animation

        progress = run.progress("frames")
        with run.drawing(output, progress=False) as partial:
            draw_animation(
                partial,
                _plot_frames(source, frame_numbers, settings),
                _style(source, frame_numbers, settings),
                settings["fps"] or 25.0,
                settings["size"],
                lambda n_drawn: progress(n_drawn, len(frame_numbers)),
                settings["jobs"] or 1,
            )
    elif suffix in FORMATS:
        _pictures(run, source, output, frame_numbers, settings)
    else:
        span, progress = _colour_range(run, source, frame_numbers), run.progress("frames")
        for number, k in enumerate(frame_numbers):
            run.write_file(_numbered(output, number), _annotated(source, k), colour_range=span)
            progress(number + 1, len(frame_numbers))


def _colour_range(run: Run, source: Trajectory, frame_numbers: list[int]) -> tuple[float, float, bool] | None:
    """Range of the array of --colors over all exported frames."""
    name = run.common.colors
    if name is None or name not in source.vertex(frame_numbers[0]):
        return None
    import numpy as np

    from ddgcli.cli.simulation.plot import magnitude
    from ddgcli.plots.colour import is_signed, robust_limits, value_scale

    values = np.concatenate([magnitude(source.vertex(k)[name]) for k in frame_numbers])
    return robust_limits(
        values, is_signed(name, source.vertex(frame_numbers[0])[name].ndim), value_scale(name)
    )


def _check_numbering(output: str, count: int) -> None:
    """Raise OutputError for several frames in one mesh file, or a wrong number in the name."""
    from ddgcli.io.mesh_file import WRITERS
    from ddgcli.plots.page import FORMATS

    path = Path(output)
    braces = "{" in path.name or "}" in path.name
    if braces and (_number_count(output) is None or path.suffix.lower() not in (*WRITERS, *FORMATS)):
        raise OutputError(
            f"{output}: a numbered name needs one number and a format of one frame, such as f_{{:04d}}.ply; "
            "{{ and }} stand for braces"
        )
    if count > 1 and not _number_count(output) and path.suffix.lower() not in (*FORMATS, *ANIMATIONS, ".pvd"):
        name = f"{path.stem}_{{:04d}}{path.suffix}" if output != "-" else "f_{:04d}.ply"
        raise OutputError(
            f"{output}: the file holds one frame, and {count} are selected; number the files with -o {name}, "
            "or choose one with --at TIME"
        )


def _number_count(output: str) -> int | None:
    """How many numbers the name of a file has, 0 or 1; None where its braces are no pattern of these."""
    try:
        fields = [parsed[1:] for parsed in Formatter().parse(Path(output).name) if parsed[1] is not None]
    except ValueError:  # a brace alone
        return None
    plain = all(
        name == "" and not conversion and NUMBER_FORMAT.fullmatch(form or "")
        for name, form, conversion in fields
    )
    return len(fields) if plain and len(fields) < 2 else None


def _numbered(output: str, number: int) -> str:
    """File name of a frame; braces of its folders are their own."""
    path = Path(output)
    if not {"{", "}"} & set(path.name):
        return output
    return str(path.with_name(path.name.format(number)))


def _annotated(source: Trajectory, k: int) -> AnnotatedMesh:
    from ddgcli.mesh.fields import AnnotatedMesh

    metadata = {"trajectory": source.path, "frame": k, "time": float(source.times[k])}
    return AnnotatedMesh(source.mesh_at(k), vertex=source.vertex(k), face=source.face(k), metadata=metadata)


def _paths(source: Trajectory, frame_numbers: list[int]) -> AnnotatedMesh:
    from ddgcli.io.trajectories.paths import particle_paths
    from ddgcli.mesh.fields import AnnotatedMesh

    paths = particle_paths(source, frame_numbers)
    return AnnotatedMesh(paths, vertex=paths.point_arrays, metadata={"trajectory": source.path})


def _pictures(
    run: Run, source: Trajectory, output: str, frame_numbers: list[int], settings: dict[str, Any]
) -> None:
    """Draw the frame of --at, or every frame as name_0000.png, name_0001.png, ..."""
    from ddgcli.plots.motion import draw_frames

    with run.clock.timed("write"):
        style = _style(source, frame_numbers, settings)
    target, progress = Path(output), run.progress("frames")
    jobs = min(settings["jobs"] or 1, len(frame_numbers))
    with tempfile.TemporaryDirectory() as folder:
        pictures = draw_frames(
            _plot_frames(source, frame_numbers, settings), style, folder, target.suffix.lower(),
            options.page_size(settings["size"]), jobs,
        )  # fmt: skip
        for k in range(len(frame_numbers)):
            name = _numbered(output, k)
            if not _number_count(output) and settings["time"] is None:
                plain = Path(name)
                name = str(plain.with_name(f"{plain.stem}_{k:04d}{plain.suffix}"))
            with run.drawing(name, progress=False) as partial:
                shutil.move(next(pictures), partial)
            progress(k + 1, len(frame_numbers))


def _series(run: Run, source: Trajectory, output: str, frame_numbers: list[int]) -> None:
    """Write a .pvd and, in a folder of its name, one file for each frame and one for each obstacle."""
    from ddgcli.mesh.fields import AnnotatedMesh
    from ddgcli.mesh.tet_mesh import TetMesh

    folder = Path(output).with_suffix("")
    run.make_folder(folder)
    written = []
    for k in frame_numbers:
        frame_meshes = {f"frame_{k:05d}": _annotated(source, k)}
        obstacles = source.obstacles(k).items()
        frame_meshes |= {f"obstacle_{n:02d}_{k:05d}": AnnotatedMesh(m) for n, (_, m) in enumerate(obstacles)}
        for part_number, (stem, annotated) in enumerate(frame_meshes.items()):
            suffix = ".vtu" if isinstance(annotated.mesh, TetMesh) else ".vtp"  # which holds surfaces
            name = folder / f"{stem}{suffix}"
            run.write_file(str(name), annotated)
            written.append((float(source.times[k]), part_number, f"{folder.name}/{name.name}"))
    from ddgcli.io.trajectories.trajectory import pvd_text

    run.write_bytes(output, pvd_text(written).encode(errors="backslashreplace"))


def _plot_frames(
    source: Trajectory, frame_numbers: list[int], settings: dict[str, Any]
) -> Iterator[PlotFrame]:
    from ddgcli.cli.simulation.plot import glyphs_of_velocity, magnitude, particle_lines, plot_frame

    name = _array_name(source, settings)
    style, periods = settings["glyphs"] or VELOCITY_GLYPHS[0], source.periods
    for k in frame_numbers:
        values = magnitude(source.vertex(k)[name]) if name else None
        whole, time = source.mesh_at(k), float(source.times[k])
        # of fluids; the velocity of a shell is seen in its motion
        vectors = source.vertex(k).get("velocity") if "vorticity" in source.vertex(k) else None
        glyphs = glyphs_of_velocity(whole, vectors, style)
        paths = particle_lines(source.times, source.scalars, time, whole, periods)
        yield plot_frame(time, whole, values, glyphs, list(source.obstacles(k).values()), paths, periods)


def _array_name(source: Trajectory, settings: dict[str, Any]) -> str | None:
    """Array that colours the pictures; by default vorticity or the first scalar that is not a map."""
    arrays = source.vertex(0)
    if settings["array"] in (None, "none"):
        from ddgcli.plots.colour import first_quantity

        scalars = [name for name, values in arrays.items() if values.ndim == 1]
        return first_quantity(scalars) if settings["array"] is None else None
    named_array(arrays, settings["array"], parameter="array")
    return str(settings["array"])


def _style(source: Trajectory, frame_numbers: list[int], settings: dict[str, Any]) -> SequenceStyle:
    from ddgcli.cli.simulation.plot import array_label
    from ddgcli.plots.colour import is_signed, value_scale
    from ddgcli.plots.motion import sequence_style

    name = _array_name(source, settings)
    signed = None if name is None else is_signed(name, source.vertex(frame_numbers[0])[name].ndim)
    return sequence_style(
        _plot_frames(source, frame_numbers, settings),
        "" if name is None else array_label(name, source.vertex(frame_numbers[0])),
        settings["view"],
        signed=signed,
        value_size=value_scale(name or ""),
        **_time_labels(source),
    )


def _draw_plot(target: str, source: Trajectory, frame_numbers: list[int], settings: dict[str, Any]) -> None:
    from ddgcli.cli.simulation.plot import energy_series
    from ddgcli.plots.motion import draw_motion

    series = energy_series(source.times, source.scalars)
    label = str(source.attributes.get("energy_label", "energy"))
    objective = str(source.attributes.get("objective"))
    if objective in source.scalars:
        series = {objective: (source.times, source.scalars[objective])}
        label = f"{objective.replace('_', ' ')}, which the flow lowers"
    draw_motion(
        target,
        list(_plot_frames(source, frame_numbers, settings)),
        series,
        _style(source, frame_numbers, settings),
        label,
        **options.page_size(settings["size"], 9.0),
    )
