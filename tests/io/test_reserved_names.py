"""Arrays with names that a format uses itself are kept under another name, with a warning."""

import logging

import numpy as np
import pytest

from ddgcli.io.mesh_file import read_mesh, write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh

NAMES = {
    ".ply": (("x", "y", "z"), ("vertex_indices", "count", "corners")),
    ".npz": (("points", "faces", "metadata", "tetrahedra", "lines"), ("edges",)),
    ".vtkhdf": (("a.b", "a_b", "NumberOfPoints", "Points"), ("a/b", "a_b")),
    ".vtu": (("Points",), ("connectivity", "offsets", "types")),
}
RENAMED = {".ply": {"x", "y", "z", "vertex_indices"}, ".npz": {*NAMES[".npz"][0], "edges"},
           ".vtkhdf": {"a_b"}, ".vtu": set()}  # fmt: skip


@pytest.mark.parametrize("suffix", NAMES)
def test_arrays_with_reserved_names_are_kept(tmp_path, caplog, suffix):
    mesh = shapes.grid(3, 3)
    at_vertices, at_faces = NAMES[suffix]
    vertex = {name: np.arange(mesh.n_vertices) + 0.5 + k for k, name in enumerate(at_vertices)}
    face = {name: np.arange(mesh.n_faces) + 0.25 + k for k, name in enumerate(at_faces)}
    path = str(tmp_path / f"names{suffix}")
    with caplog.at_level(logging.WARNING, "ddgcli"):
        write_mesh(path, AnnotatedMesh(mesh, vertex=vertex, face=face))
    result = read_mesh(path)
    assert np.array_equal(result.surface.points, mesh.points)
    assert np.array_equal(result.surface.faces, mesh.faces)
    for written, expected in ((result.vertex, vertex), (result.face, face)):
        assert len(written) == len(expected)
        for values in expected.values():
            assert any(np.array_equal(values, other) for other in written.values())
    assert {name for name in RENAMED[suffix] if f"{name!r}" in caplog.text} == RENAMED[suffix]
