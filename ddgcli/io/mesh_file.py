"""Mesh files in and out: the only room that knows meshio and trimesh exist."""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshFileError, OutputError
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh


@dataclass(frozen=True, eq=False)
class MeshInput:
    """A mesh as read, with the arrays and the story of its file.

    Parameters
    ----------
    mesh : TriangleMesh or TetMesh
    path, sha256 : str
    vertex, face, edge : dict of str to ndarray
        Arrays the file carried.
    input_vertex : (k,) ndarray of int64, or None
        Vertex of the mesh for each vertex of the file, where the format needed a merge.
    notes : tuple of str
        What was done to the input: merged, triangulated, ...
    """

    mesh: TriangleMesh | TetMesh
    path: str
    sha256: str
    vertex: dict[str, NDArray] = field(default_factory=dict)
    face: dict[str, NDArray] = field(default_factory=dict)
    edge: dict[str, NDArray] = field(default_factory=dict)
    input_vertex: NDArray | None = None
    notes: tuple[str, ...] = ()


def read_mesh(path: str) -> MeshInput:
    """Read a mesh file; MeshFileError with one line when it cannot be."""
    source = Path(path)
    if not source.is_file():
        raise MeshFileError(f"{path}: no such file; check the path")
    data = source.read_bytes()
    import trimesh

    try:
        loaded: Any = trimesh.load(path, process=False, maintain_order=True, force="mesh")
    except (Exception, SystemExit) as error:
        raise MeshFileError(f"{path}: cannot be read ({error}); check the format") from error
    mesh = TriangleMesh.from_arrays(np.asarray(loaded.vertices), np.asarray(loaded.faces))
    return MeshInput(mesh, path, hashlib.sha256(data).hexdigest())


def write_mesh(path: str, annotated: AnnotatedMesh) -> None:
    """Write a mesh with its arrays, whole or not at all; the extension chooses the format."""
    target = Path(path)
    if not target.parent.is_dir():
        raise OutputError(f"{path}: folder {target.parent} does not exist; create it")
    with tempfile.TemporaryDirectory(dir=target.parent, prefix=".ddgcli-") as folder:
        partial = os.path.join(folder, target.name)
        _write(partial, target.suffix.lower(), annotated)
        os.replace(partial, target)


def _write(path: str, suffix: str, annotated: AnnotatedMesh) -> None:
    import meshio

    mesh = annotated.mesh
    if not isinstance(mesh, TriangleMesh):
        raise OutputError(f"{path}: only triangle meshes can be written so far")
    if suffix == ".npz":
        arrays = {"points": mesh.points, "faces": mesh.faces}
        arrays |= annotated.vertex | annotated.face | annotated.edge
        arrays["metadata"] = np.array(json.dumps(annotated.metadata))
        np.savez(path, **arrays)  # type: ignore[arg-type]
        return
    cell_data = {name: [value] for name, value in annotated.face.items()}
    meshio.Mesh(
        mesh.points, [("triangle", mesh.faces)], point_data=annotated.vertex, cell_data=cell_data
    ).write(path)
