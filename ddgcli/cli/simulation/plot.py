"""Picture of a simulation: a few frames, and the chart of energies."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from ddgcli.choices import PARTICLES, VELOCITY_GLYPHS
from ddgcli.cli.options import CommonOptions, page_size
from ddgcli.errors import named_array
from ddgcli.mesh.periodic import Periods, crosses_side, unrolled
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.simulation.frames import mesh_of_frame
from ddgcli.simulation.outcome import Outcome

if TYPE_CHECKING:
    from ddgcli.plots.glyphs import Glyphs
    from ddgcli.plots.motion import PlotFrame

SHAPE_AMPLITUDE = 0.1  # of the longest side of the bounding box, of the eigenmode in a picture
# of the arrays of fluids, per density
FLOW_UNITS = {
    "vorticity": "1/s", "velocity": "m/s", "speed": "m/s", "pressure": "m²/s²", "stream_function": "m²/s",
    "temperature": "K",
}  # fmt: skip
ENERGIES = ("energy", "kinetic_energy", "elastic_energy")  # and those that begin with energy_


@dataclass(frozen=True, eq=False)
class Picture:
    """Options of the picture of a simulation.

    Parameters
    ----------
    array : str, optional
        Vertex array that colours them.
    label : str
        Beside the colour bar.
    limits : (float, float), optional
        Limits of the colours; default: robust limits over the frames.
    edges : bool
        Draw the edges too.
    periods : Periods, optional
        Periods of the periodic grids.
    arrows : str, optional
        Vertex array of vectors, drawn over the colours.
    glyphs : str
        How, of `VELOCITY_GLYPHS`.
    energy, time_name, time_unit : str
        Labels of the chart.
    shape : (str, (n, 3) ndarray), optional
        Title and displacement of an eigenmode, drawn in place of the frames.
    """

    array: str | None = None
    label: str = ""
    limits: tuple[float, float] | None = None
    edges: bool = False
    periods: Periods | None = None
    arrows: str | None = None
    glyphs: str = VELOCITY_GLYPHS[0]
    energy: str = "energy"
    time_name: str = "t"
    time_unit: str = "s"
    shape: tuple[str, NDArray] | None = None


def draw_run(
    path: str,
    outcome: Outcome,
    picture: Picture,
    common: CommonOptions,
    obstacles: Callable[[float], Sequence[TriangleMesh]] = lambda time: (),
) -> None:
    """Draw a few frames, with the obstacles, above the chart of energies; or the shape of an eigenmode."""
    if picture.shape is not None and common.show is None:
        draw_shape(path, outcome, *picture.shape, common, obstacles)
        return
    from ddgcli.plots.colour import is_signed, value_scale
    from ddgcli.plots.motion import draw_motion, sequence_style

    if common.show is not None:
        named_array(outcome.picture_frames[0].vertex, common.show, parameter="show")
        label = array_label(common.show, outcome.picture_frames[0].vertex)
        picture = replace(picture, array=common.show, label=label, limits=None)
    plot_frames = []
    for trajectory_frame in outcome.picture_frames:
        mesh, time = mesh_of_frame(outcome.mesh, trajectory_frame), trajectory_frame.time
        values = None if picture.array is None else magnitude(trajectory_frame.vertex[picture.array])
        vectors = trajectory_frame.vertex.get(picture.arrows or "")
        glyphs = glyphs_of_velocity(mesh, vectors, picture.glyphs)
        paths = particle_lines(outcome.times, outcome.series, time, mesh, picture.periods)
        plot_frames.append(plot_frame(time, mesh, values, glyphs, obstacles(time), paths, picture.periods))
    name = picture.array
    signed = None if name is None else is_signed(name, outcome.picture_frames[0].vertex[name].ndim)
    style = sequence_style(
        plot_frames,
        picture.label,
        common.view,
        limits=picture.limits,
        signed=signed,
        value_size=value_scale(name or ""),
        edges=picture.edges,
        time_name=picture.time_name,
        time_unit=picture.time_unit,
    )
    draw_motion(path, plot_frames, energy_series(outcome.times, outcome.series), style, picture.energy,
                **page_size(common.size, 9.0))  # fmt: skip


def draw_shape(
    path: str,
    outcome: Outcome,
    title: str,
    displacement: NDArray,
    common: CommonOptions,
    obstacles: Callable[[float], Sequence[TriangleMesh]],
) -> None:
    """Draw the last frame with a displacement, of which the longest is SHAPE_AMPLITUDE of the size."""
    from ddgcli.mesh.vectors import vector_length
    from ddgcli.plots.surface import draw_surface

    mesh, length = mesh_of_frame(outcome.mesh, outcome.end), vector_length(displacement)
    size = float((mesh.points.max(axis=0) - mesh.points.min(axis=0)).max())
    scale = SHAPE_AMPLITUDE * size / (length.max() or 1.0)
    draw_surface(
        path, mesh.moved_unchecked(mesh.points + scale * displacement), length, title=title,
        label="displacement", limits=(0.0, float(length.max()) or 1.0),
        caption=f"displacements up to {SHAPE_AMPLITUDE:g} of the size",
        context=obstacles(outcome.end.time), **(common.view or {}), **page_size(common.size),
    )  # fmt: skip


def plot_frame(
    time: float,
    mesh: Any,
    values: NDArray | None,
    glyphs: Glyphs | None,
    obstacles: Sequence[TriangleMesh],
    paths: Sequence[NDArray],
    periods: Periods | None,
) -> PlotFrame:
    """What a picture shows of a frame; of a periodic grid also the faces that close it, at its sides."""
    from ddgcli.plots.motion import PlotFrame

    drawn = visible_part(mesh)
    if periods is not None:
        drawn, vertex = unrolled(mesh, periods.of_faces)
        values = None if values is None else values[vertex]
        if glyphs is not None:
            glyphs = replace(glyphs, places=drawn.points, vectors=glyphs.vectors[vertex], faces=drawn.faces)
    return PlotFrame(time, drawn, values, obstacles, glyphs, paths)


def glyphs_of_velocity(mesh: Any, vectors: NDArray | None, style: str) -> Glyphs | None:
    """Arrows at equal distances on the visible faces, or streamlines; None without vectors."""
    import numpy as np

    from ddgcli.plots.glyphs import Glyphs

    if vectors is None or style == "none":
        return None
    at_vertices = np.asarray(vectors, dtype=np.float64)
    return Glyphs(mesh.points, at_vertices, faces=visible_part(mesh).faces, lines=style == "streamlines")


def particle_lines(
    times: NDArray, series: Mapping[str, NDArray], end: float, mesh: Any, periods: Periods | None = None
) -> list[NDArray]:
    """Paths of particles up to a time; on periodic grids since they last crossed a side."""
    import numpy as np

    count = int((times <= end * (1 + 1e-12)).sum())
    lines = []
    for name in (name for name in series if name.startswith(PARTICLES)):
        places = series[name].reshape(len(times), -1, 3)[:count]
        period = np.zeros(3)
        if periods is not None:
            fluid = name.removeprefix(PARTICLES)
            places, period = periods.within(fluid, places, mesh), periods.of_object[fluid]
        for path in places.transpose(1, 0, 2):
            jump = np.flatnonzero(crosses_side(np.diff(path, axis=0), period).any(axis=1))
            lines.append(path[jump[-1] + 1 if len(jump) else 0 :])
    return lines


def array_label(name: str, arrays: Collection[str]) -> str:
    """Name beside a colour bar, with the unit where the arrays of a frame are those of a fluid."""
    is_known = "vorticity" in arrays and name in FLOW_UNITS
    return f"{name} [{FLOW_UNITS[name]}]" if is_known else name


def magnitude(values: NDArray) -> NDArray:
    """Lengths of vectors; scalars unchanged."""
    import numpy as np

    return values if values.ndim == 1 else np.linalg.norm(values, axis=1)


def visible_part(mesh: Any) -> Any:
    """The faces to draw: of tetrahedra the boundary of the rear half, so that a cut is visible."""
    return cut_open(mesh) if isinstance(mesh, TetMesh) else mesh


def cut_open(mesh: TetMesh) -> TriangleMesh:
    """Boundary of the cells whose centroids lie in the upper half of the y range."""
    import numpy as np

    y = mesh.points[mesh.tetrahedra][..., 1].mean(axis=1)
    behind = y > 0.5 * (mesh.points[:, 1].min() + mesh.points[:, 1].max())
    return TetMesh(np.asarray(mesh.points), mesh.tetrahedra[behind]).boundary


def energy_series(times: NDArray, scalars: Mapping[str, NDArray]) -> dict[str, tuple[NDArray, NDArray]]:
    """Time series of the energies, or of all scalars if none is an energy."""
    plain = {name: v for name, v in scalars.items() if v.ndim == 1}
    energies = [n for n in plain if n in ENERGIES or n.startswith("energy_")]
    energies = [n for n in energies if n != "energy_increases"]
    return {name: (times, plain[name]) for name in energies or plain}
