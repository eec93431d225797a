"""`ddgcli view`."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ddgcli.choices import UP_AXES
from ddgcli.cli import options
from ddgcli.cli.forecast.use import InputSize
from ddgcli.cli.options import CommonOptions
from ddgcli.cli.run import Run
from ddgcli.errors import MeshFileError, ParameterError, named_array

if TYPE_CHECKING:
    from ddgcli.io.trajectories.trajectory import Trajectory
    from ddgcli.plots.web_page import ViewedObject

log = logging.getLogger("ddgcli")

TRAJECTORY_SUFFIXES = (".vtkhdf", ".h5", ".part")
COUNTS = ("vertices", "faces", "tetrahedra", "lines", "frames")  # of several inputs the summary has the sums
MAX_PAGE_MIB = 400  # a browser reads the page as one string


@click.command("view", short_help="Write an HTML page: rotate the mesh, read values, play frames.")
@click.argument("paths", metavar="RESULT...", nargs=-1, required=True, type=click.Path(readable=False))
@click.option(
    "--every",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    metavar="N",
    help="Show every N-th frame of a trajectory.",
)
@click.option("--array", metavar="NAME", help="Array to show first.")
@click.option("--up", type=click.Choice(UP_AXES), help="Axis that points up (default: from the shape).")
@options.common_without_pictures
def command(
    paths: tuple[str, ...], common: CommonOptions, every: int, array: str | None, up: str | None
) -> None:
    """Write one self-contained page that shows RESULTs: surfaces, curves, the trajectory of a simulation.

    The page needs a browser with WebGL2 and no network. Drag to rotate, shift-drag to move, wheel to zoom;
    click for the index and the value of a vertex or face; choose array, colour map, range and isolines; jump
    to the smallest or largest value; play frames; switch inputs on and off to compare.

    \b
    Examples:
      ddgcli view ellipsoid.vtu -o page.html
      ddgcli view surface.ply paths.vtp -o page.html
      ddgcli view hat.vtkhdf --every 2 -o hat.html
    """
    run = Run("view", common, formats=(".html",), every=every, array=array, up=up)
    if not common.outputs:
        raise ParameterError("the page needs an output file; add -o page.html")
    from ddgcli.plots.web_page import page_bytes

    objects: list[ViewedObject] = []
    times: list[float] = []
    totals: dict[str, int] = {}
    for path in paths:
        trajectory_frames = _trajectory(run, path, every)
        if trajectory_frames is not None and times:
            raise ParameterError("a page can show only one trajectory; view them one at a time")
        viewed, seconds = trajectory_frames or ([_static(run, path)], [])
        objects += viewed
        times = seconds or times
        totals |= {name: totals.get(name, 0) + run.input[name] for name in COUNTS if name in run.input}
    if len(paths) > 1:
        run.input = {"path": " ".join(paths), **totals}
    if every > 1 and not times:
        raise ParameterError("applies to trajectories, and no input is one; leave it out", parameter="every")
    names = sorted({name for viewed in objects for name in (*viewed.vertex, *viewed.face)})
    if array is not None:
        named_array(dict.fromkeys(names), array, parameter="array")
    cells = sum(len(viewed.cells[0]) for viewed in objects)
    run.predict(InputSize("surface", cells, frame_count=max(1, len(times))))
    run.begin()
    content = page_bytes(", ".join(Path(path).name for path in paths), objects, times, show=array, up=up)
    if len(content) > MAX_PAGE_MIB << 20:
        raise ParameterError(
            f"the page would have {len(content) >> 20} MiB, above {MAX_PAGE_MIB}; show fewer frames",
            parameter="every",
        )
    for output in common.outputs:
        run.write_bytes(output, content)
    run.finish({"objects": [viewed.name for viewed in objects], "arrays": names, "frames": len(times)}, {})


def _static(run: Run, path: str) -> ViewedObject:
    """A mesh or curve file with its arrays."""
    source = run.read(path, accept=("surface", "tetrahedra", "curve"))
    from ddgcli.mesh.curve import CurveSet
    from ddgcli.mesh.fields import surface_arrays
    from ddgcli.plots.web_page import ViewedObject

    name = Path(path).name
    if on_edges := sorted(set(source.edge) - {"edges"}):  # `edges` holds the end vertices, not a result
        log.warning(f"{name}: the page does not show arrays on edges ({', '.join(on_edges)})")
    if isinstance(source.mesh, CurveSet):
        arrays = [{k: [v] for k, v in own.items() if _drawable(v)} for own in (source.vertex, source.face)]
        return ViewedObject(name, [source.mesh.points], [source.mesh.lines], *arrays)
    faces = surface_arrays(source.mesh, source.face)
    vertex = {key: [values] for key, values in source.vertex.items() if _drawable(values)}
    face = {key: [values] for key, values in faces.items() if _drawable(values)}
    return ViewedObject(name, [source.surface.points], [source.surface.faces], vertex, face)


def _drawable(values: Any) -> bool:
    return values.dtype.kind in "fiub" and values.ndim <= 2


def _trajectory(run: Run, path: str, every: int) -> tuple[list[ViewedObject], list[float]] | None:
    """Frames and obstacles of a ddgcli trajectory; None for any other file."""
    if Path(path).suffix.lower() not in TRAJECTORY_SUFFIXES:
        return None
    from ddgcli.io.trajectories.trajectory import Trajectory
    from ddgcli.mesh.curve import CurveSet
    from ddgcli.mesh.tet_mesh import TetMesh
    from ddgcli.plots.web_page import ViewedObject

    try:
        trajectory = Trajectory(path)
    except MeshFileError:
        return None
    with run.clock.timed("read"), trajectory:
        run.set_input(path, str(trajectory.attributes.get("input_sha256", "")), frames=trajectory.n_frames)
        numbers = range(0, trajectory.n_frames, every)
        trajectory_frames = [trajectory.read_frame(k) for k in numbers]
        first = trajectory.mesh.points
        points = [
            first if trajectory_frame.points is None else trajectory_frame.points
            for trajectory_frame in trajectory_frames
        ]
        points = points if trajectory.moving else points[:1]
        vertex = {
            name: [trajectory_frame.vertex[name] for trajectory_frame in trajectory_frames]
            for name, values in trajectory_frames[0].vertex.items()
            if _drawable(values)
        }
        mesh = trajectory.mesh
        if isinstance(mesh, CurveSet):
            cells = [mesh.lines]
        elif trajectory.changing_faces:
            cells = [f.faces for f in trajectory_frames if f.faces is not None]
        else:
            cells = [mesh.boundary.faces if isinstance(mesh, TetMesh) else mesh.faces]
        viewed = ViewedObject(Path(path).name, points, cells, vertex)
        obstacles = [
            ViewedObject(name, _obstacle_points(trajectory, name, numbers), [body.faces])
            for name, body in trajectory.obstacles().items()
        ]
        return [viewed, *obstacles], [trajectory_frame.time for trajectory_frame in trajectory_frames]


def _obstacle_points(trajectory: Trajectory, name: str, numbers: range) -> list[Any]:
    """Positions of an obstacle in each frame; one entry if it does not move."""
    places = [trajectory.obstacles(k)[name].points for k in numbers]
    still = all((place == places[0]).all() for place in places[1:])
    return places[:1] if still else places
