"""--plot of the simulators: chosen frames, and the chart of energies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from numpy.typing import NDArray

from ddgcli.cli.options import Common, chosen, page_size
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.simulation.outcome import Outcome


@dataclass(frozen=True, eq=False)
class Picture:
    """How the frames of a simulator are drawn.

    Parameters
    ----------
    array : str, optional
        Vertex array that colours them.
    label : str
        Beside the colour bar.
    limits : (float, float), optional
        Of the colours; default: robust ones over the frames.
    edges : bool
        Draw the edges too.
    shown : (m,) ndarray of bool, optional
        Faces to draw.
    energy, time_unit : str
        Labels of the chart.
    """

    array: str | None = None
    label: str = ""
    limits: tuple[float, float] | None = None
    edges: bool = False
    shown: NDArray | None = None
    energy: str = "energy [J]"
    time_unit: str = "s"


def draw_story(path: str, outcome: Outcome, picture: Picture, common: Common) -> None:
    """Chosen frames above, the chart of energies below."""
    from ddgcli.plots.motion import Shot, draw_motion, stage

    if common.show is not None:
        chosen(outcome.kept[0].vertex, common.show)
        picture = replace(picture, array=common.show, label=common.show, limits=None)
    shots = []
    for frame in outcome.kept:
        mesh = outcome.mesh if frame.points is None else outcome.mesh.moved(frame.points)
        values = None if picture.array is None else length_of(frame.vertex[picture.array])
        shots.append(Shot(frame.time, part_of(mesh, picture.shown), values))
    on = stage(
        shots,
        picture.label,
        common.view,
        limits=picture.limits,
        edges=picture.edges,
        time_unit=picture.time_unit,
    )
    draw_motion(path, shots, energies(outcome.times, outcome.series), on, picture.energy,
                **page_size(common.size, 9.0))  # fmt: skip


def length_of(values: NDArray) -> NDArray:
    """Numbers as they are, vectors by their length."""
    import numpy as np

    return values if values.ndim == 1 else np.linalg.norm(values, axis=1)


def part_of(mesh: Any, shown: NDArray | None) -> Any:
    """The faces to draw; of tetrahedra the boundary of those behind the middle, so that a cut is seen."""
    if isinstance(mesh, TetMesh):
        return cut_open(mesh)
    if shown is None or shown.all():
        return mesh
    from ddgcli.mesh.triangle_mesh import TriangleMesh

    return TriangleMesh.from_arrays(mesh.points, mesh.faces[shown])


def cut_open(mesh: TetMesh) -> TriangleMesh:
    """Boundary of the cells whose centroid has more than the middle y."""
    import numpy as np

    y = mesh.points[mesh.tetrahedra][..., 1].mean(axis=1)
    behind = y > 0.5 * (mesh.points[:, 1].min() + mesh.points[:, 1].max())
    return TetMesh(np.asarray(mesh.points), mesh.tetrahedra[behind]).boundary


def energies(times: NDArray, scalars: Mapping[str, NDArray]) -> dict[str, tuple[NDArray, NDArray]]:
    """Series of the scalars that are energies, or of all numbers where none is."""
    plain = {name: v for name, v in scalars.items() if v.ndim == 1}
    found = [name for name in plain if name in ("energy", "kinetic_energy") or name.startswith("energy_")]
    found = [name for name in found if name != "energy_increases"]
    return {name: (times, plain[name]) for name in found or plain}
