"""Join the frames of several models into one surface."""

from __future__ import annotations

from typing import Any

import numpy as np

from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.fields import TrajectoryFrame
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.simulation.model import Observation
from ddgcli.simulation.time_loop import Snapshot


def joined_mesh(meshes: list[Any]) -> tuple[TriangleMesh | TetMesh | CurveSet, np.ndarray]:
    """Join several meshes of one kind into one.

    A set of curves comes alone and stays as it is.

    Parameters
    ----------
    meshes : list of TriangleMesh, TetMesh or CurveSet

    Returns
    -------
    mesh : TriangleMesh, TetMesh or CurveSet
        Vertices and cells in order.
    number : (m,) ndarray of int64
        Index of the mesh of each cell.
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


def joined_frame(snapshot: Snapshot) -> TrajectoryFrame:
    """Trajectory frame of a snapshot: points and arrays of all models in order, scalars added.

    `step_size` is the smallest step so far. Arrays with a single entry become numbers, as in a file.

    Parameters
    ----------
    snapshot : Snapshot

    Returns
    -------
    TrajectoryFrame
    """
    observations = sorted(snapshot.observations.values(), key=lambda observation: observation.place)
    points = (
        None
        if observations[0].points is None
        else np.concatenate([p.points for p in observations if p.points is not None])
    )
    names = dict.fromkeys(name for observation in observations for name in observation.vertex)
    vertex = {
        name: np.concatenate([_array(observation, name, observations) for observation in observations])
        for name in names
    }
    scalar: dict[str, Any] = {}
    for observation in observations:
        for name, value in observation.scalar.items():
            scalar[name] = scalar[name] + value if name in scalar else value
    scalar["step_size"] = 0.0 if np.isinf(snapshot.smallest_step) else snapshot.smallest_step
    scalar = {name: np.asarray(v).item() if np.size(v) == 1 else v for name, v in scalar.items()}
    return TrajectoryFrame(
        snapshot.step, snapshot.time, points, vertex, scalar, _faces(observations), _on_faces(observations)
    )


def _on_faces(observations: list[Observation]) -> dict[str, np.ndarray]:
    """Face arrays over all objects; nan for objects without an array of that name."""
    shapes = {
        name: values.shape[1:] for observation in observations for name, values in observation.face.items()
    }
    return {
        name: np.concatenate(
            [
                observation.face.get(name, np.full((observation.n_faces, *shape), np.nan))
                for observation in observations
            ]
        )
        for name, shape in shapes.items()
    }


def _faces(observations: list[Observation]) -> np.ndarray | None:
    """Faces of all objects over their concatenated points; None if they do not change."""
    faces, first = [], 0
    for observation in observations:
        if observation.faces is None:
            return None
        faces.append(observation.faces + first)
        first += 0 if observation.points is None else len(observation.points)
    return np.concatenate(faces)


def mesh_of_frame(mesh: Any, trajectory_frame: TrajectoryFrame) -> Any:
    """Mesh of a run at a frame: with the points of the frame, and with its faces if these change.

    Parameters
    ----------
    mesh : TriangleMesh, TetMesh or CurveSet
        At the start of the run.
    trajectory_frame : TrajectoryFrame

    Returns
    -------
    TriangleMesh, TetMesh or CurveSet
    """
    if trajectory_frame.points is None:
        return mesh
    if trajectory_frame.faces is None:
        return mesh.moved_unchecked(trajectory_frame.points)
    return TriangleMesh(
        trajectory_frame.points, Topology(trajectory_frame.faces, len(trajectory_frame.points))
    )


def _array(observation: Observation, name: str, observations: list[Observation]) -> np.ndarray:
    """Array of an object, or zeros of the same shape and type if it does not have one."""
    if name in observation.vertex:
        return observation.vertex[name]
    like = next(p.vertex[name] for p in observations if name in p.vertex)
    count = (
        len(next(iter(observation.vertex.values())))
        if observation.points is None
        else len(observation.points)
    )
    return np.zeros((count, *like.shape[1:]), dtype=like.dtype)
