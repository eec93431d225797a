"""Fixtures of several tests of commands."""

import pytest

from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh


@pytest.fixture
def torus(tmp_path):
    """Path of a small torus."""
    path = tmp_path / "torus.ply"
    write_mesh(str(path), AnnotatedMesh(shapes.torus(12, 8)))
    return path
