"""Reading and writing of meshes and trajectories."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from typing import Any

from numpy.typing import ArrayLike, NDArray

from ddgcli.errors import MeshError, OutputError
from ddgcli.io import mesh_file
from ddgcli.io.trajectories.layout import Header
from ddgcli.io.trajectories.trajectory import Trajectory
from ddgcli.io.trajectories.writer import TrajectoryWriter
from ddgcli.library.arguments import checked_arguments
from ddgcli.library.mesh_arguments import MeshLike, as_mesh, mesh_of_kind
from ddgcli.library.result import Measurement
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.fields import AnnotatedMesh, AnyMesh, TrajectoryFrame
from ddgcli.mesh.masked import unmasked
from ddgcli.mesh.tet_mesh import TetMesh

__all__ = ["read_mesh", "read_trajectory", "write_mesh", "write_trajectory"]

Path = str | os.PathLike[str]


@checked_arguments
def read_mesh(path: Path, input_format: str | None = None) -> mesh_file.MeshInput:
    """Read a mesh file with the arrays that it carries.

    Parameters
    ----------
    path : str or path
        `.ply .obj .off .stl .vtu .vtp .vtk .vtkhdf .csv .npz`, and what meshio and trimesh read.
    input_format : str, optional
        Extension that replaces the path's own, such as "ply".

    Returns
    -------
    MeshInput
        `mesh` (TriangleMesh, TetMesh or CurveSet), `surface` (the surface, or the boundary of tetrahedra),
        `vertex`, `face`, `edge` (arrays of the file by name), `notes` (what was merged or triangulated).

    Raises
    ------
    MeshFileError, MeshError
        One line that begins with the path.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> ddg.write_mesh("ball.ply", ddg.icosphere(1))
    >>> ddg.read_mesh("ball.ply").surface.n_faces
    80
    """
    return mesh_file.read_mesh(os.fspath(path), input_format)


@checked_arguments
def write_mesh(
    path: Path,
    mesh: MeshLike,
    *,
    vertex: Mapping[str, ArrayLike] | None = None,
    face: Mapping[str, ArrayLike] | None = None,
    edge: Mapping[str, ArrayLike] | None = None,
) -> None:
    """Write a mesh with arrays, completely or not at all.

    Parameters
    ----------
    path : str or path
        The extension chooses the format: `.ply .vtu .vtk .vtp .vtkhdf .obj .off .stl .xdmf .npz`.
    mesh : mesh, (points, cells) pair, or Measurement
        A Measurement is written with its own arrays.
    vertex : mapping of str to (n, ...) array_like, optional
        Arrays on vertices.
    face : mapping of str to (m, ...) array_like, optional
        Arrays on faces (tetrahedra, segments).
    edge : mapping of str to (e, ...) array_like, optional
        Arrays on edges, in the order of `mesh.topology.edges`; kept by `.npz` and `.vtkhdf`.

    Raises
    ------
    MeshError
        When an array does not have one entry per vertex, face or edge.
    OutputError
        On an unknown format, a missing folder, or a mesh that the format cannot hold.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> mesh = ddg.torus(16, 8)
    >>> ddg.write_mesh("torus.vtu", mesh, vertex={"height": mesh.points[:, 2]})
    >>> sorted(ddg.read_mesh("torus.vtu").vertex)
    ['height']
    """
    converted = as_mesh(mesh)
    own = mesh if isinstance(mesh, Measurement) else Measurement(converted)
    edges = _checked(edge, _edge_count(converted) if edge else 0, "edge")
    mesh_file.write_mesh(
        os.fspath(path),
        AnnotatedMesh(
            converted,
            vertex=own.vertex | _checked(vertex, converted.n_vertices, "vertex"),
            face=own.face | _checked(face, _cell_count(converted), "face"),
            edge=own.edge | edges,
        ),
    )


def _checked(arrays: Mapping[str, ArrayLike] | None, count: int, place: str) -> dict[str, NDArray]:
    """Arrays with one entry for each of `count` places."""
    checked = {
        name: unmasked(values, f"the {place} array {name!r}") for name, values in (arrays or {}).items()
    }
    for name, values in checked.items():
        if values.dtype.kind not in "biuf":
            raise MeshError(f"the {place} array {name!r} holds {values.dtype}; write real numbers")
        if values.ndim == 0 or len(values) != count:
            raise MeshError(f"the {place} array {name!r} has shape {values.shape}; it needs {count} entries")
    return checked


def _cell_count(mesh: AnyMesh) -> int:
    if isinstance(mesh, TetMesh):
        return len(mesh.tetrahedra)
    return len(mesh.lines) if isinstance(mesh, CurveSet) else mesh.n_faces


def _edge_count(mesh: AnyMesh) -> int:
    if isinstance(mesh, (TetMesh, CurveSet)):
        raise MeshError("edge arrays belong to surfaces; write arrays on vertices or cells")
    return mesh.topology.n_edges


@checked_arguments
def read_trajectory(path: Path) -> Trajectory:
    """Open the trajectory of a simulation.

    Parameters
    ----------
    path : str or path
        `.vtkhdf` or `.h5` that a simulator wrote; also a `.part` that is still growing.

    Returns
    -------
    Trajectory
        `n_frames`, `times` in seconds, `mesh` at the start, `points(k)`, `vertex(k)`, `read_frame(k)`,
        `scalars`; iteration gives the frames. Use it in a `with` statement: it keeps the file open.

    Raises
    ------
    MeshFileError
        When the file is missing or no trajectory.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> shell = {"role": "shell", "grid": {"size": [1, 1], "cells": [2, 2]}, "material": "paper"}
    >>> run = ddg.simulate({"object": [shell], "effects": {"gravity": {}}}, duration=0.1)
    >>> _ = ddg.write_trajectory("fall.vtkhdf", run)
    >>> with ddg.read_trajectory("fall.vtkhdf") as trajectory:
    ...     print(trajectory.n_frames, [frame.points.shape for frame in trajectory][-1])
    11 (9, 3)
    """
    return Trajectory(os.fspath(path))


@checked_arguments
def write_trajectory(
    path: Path, trajectory_frames: Iterable[TrajectoryFrame], mesh: MeshLike | None = None
) -> int:
    """Write frames as a trajectory that ParaView opens and `read_trajectory` reads.

    Parameters
    ----------
    path : str or path
        `.vtkhdf` or `.h5`. While frames come the file is called PATH.part.
    trajectory_frames : iterable of TrajectoryFrame
        Such as `simulate(...)`. All frames have the arrays of the first.
    mesh : mesh or (points, cells) pair, optional
        Mesh of the frames; by default `frames.mesh`, which simulations have.

    Returns
    -------
    int
        Number of frames written.

    Raises
    ------
    OutputError
        On another extension, or no frame.
    MeshError
        When no mesh is known.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> shell = {"role": "shell", "grid": {"size": [1, 1], "cells": [2, 2]}, "material": "paper"}
    >>> run = ddg.simulate({"object": [shell], "effects": {"gravity": {}}}, duration=0.1)
    >>> ddg.write_trajectory("run.vtkhdf", run)
    11
    """
    target = os.fspath(path)
    mesh_file.check_output(target, formats=(".vtkhdf", ".h5"))
    any_mesh: Any = getattr(trajectory_frames, "mesh", None) if mesh is None else mesh
    if any_mesh is None:
        raise MeshError("the frames carry no mesh; pass it as mesh=...")
    start = mesh_of_kind(any_mesh, ("surface", "tetrahedra", "curve"), "a trajectory")
    changing_vertices = bool(getattr(trajectory_frames, "changing_vertices", False))
    writer, count, status = None, 0, "failed"
    try:
        for trajectory_frame in trajectory_frames:
            if writer is None:
                writer = TrajectoryWriter(
                    target,
                    Header(
                        start,
                        trajectory_frame.points is not None,
                        changing_faces=trajectory_frame.faces is not None,
                        changing_vertices=changing_vertices,
                    ),
                    64,
                )
            writer.append(trajectory_frame)
            count += 1
        status = "complete"
    finally:
        if writer is not None:
            writer.close(status)
    if not count:
        raise OutputError(f"{target}: there is no frame to write")
    return count
