"""Join the frames of several models into one surface."""

from __future__ import annotations

from typing import Any

import numpy as np

from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.fields import Frame
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.simulation.model import Observation
from ddgcli.simulation.time_loop import Snapshot


def joined_mesh(meshes: list[Any]) -> tuple[TriangleMesh | TetMesh | CurveSet, np.ndarray]:
    """One mesh of several of one kind, vertices in order, and the (m,) number of the object of each cell.

    A set of curves comes alone and stays as it is.
    """
    if isinstance(meshes[0], CurveSet):
        return meshes[0], np.zeros(len(meshes[0].lines), dtype=np.int64)
    sizes = np.cumsum([0, *(mesh.n_vertices for mesh in meshes)])
    if isinstance(meshes[0], TetMesh):
        cells = np.concatenate([mesh.tetrahedra + start for mesh, start in zip(meshes, sizes)])
        number = np.repeat(np.arange(len(meshes)), [len(mesh.tetrahedra) for mesh in meshes])
        return TetMesh(np.concatenate([mesh.points for mesh in meshes]), cells), number
    faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, sizes)])
    points = np.concatenate([mesh.points for mesh in meshes])
    number = np.repeat(np.arange(len(meshes)), [mesh.n_faces for mesh in meshes])
    return TriangleMesh(points, Topology(faces, len(points))), number


def joined_frame(snapshot: Snapshot) -> Frame:
    """Points and arrays one behind the other, scalars added; `step_size` is the smallest step so far.

    A vector of one number is a number, as it is in a file.
    """
    parts = sorted(snapshot.observations.values(), key=lambda part: part.place)
    points = (
        None if parts[0].points is None else np.concatenate([p.points for p in parts if p.points is not None])
    )
    names = dict.fromkeys(name for part in parts for name in part.vertex)
    vertex = {name: np.concatenate([_array(part, name, parts) for part in parts]) for name in names}
    scalar: dict[str, Any] = {}
    for part in parts:
        for name, value in part.scalar.items():
            scalar[name] = scalar[name] + value if name in scalar else value
    scalar["step_size"] = 0.0 if np.isinf(snapshot.smallest_step) else snapshot.smallest_step
    scalar = {name: np.asarray(v).item() if np.size(v) == 1 else v for name, v in scalar.items()}
    return Frame(snapshot.step, snapshot.time, points, vertex, scalar, parts[0].faces)


def mesh_of_frame(mesh: Any, frame: Frame) -> Any:
    """The mesh of a run as it is in a frame: moved, and with the frame's faces where these change."""
    if frame.points is None:
        return mesh
    if frame.faces is None:
        return mesh.moved(frame.points)
    return TriangleMesh(frame.points, Topology(frame.faces, len(frame.points)))


def _array(part: Observation, name: str, parts: list[Observation]) -> np.ndarray:
    """The part's array, or zeros of the same kind where it has none."""
    if name in part.vertex:
        return part.vertex[name]
    like = next(p.vertex[name] for p in parts if name in p.vertex)
    count = len(next(iter(part.vertex.values()))) if part.points is None else len(part.points)
    return np.zeros((count, *like.shape[1:]), dtype=like.dtype)
