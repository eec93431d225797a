"""A format of surfaces holds the boundary of tetrahedra, without the vertices inside."""

import numpy as np
import pytest

from ddgcli.io.mesh_file import read_mesh, write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh


@pytest.mark.parametrize("suffix", [".ply", ".off", ".obj", ".stl", ".vtp", ".glb"])
def test_the_vertices_inside_are_left_out(tmp_path, suffix):
    box = shapes.box_tetrahedra(3)
    path = tmp_path / f"skin{suffix}"
    write_mesh(str(path), AnnotatedMesh(box, vertex={"height": box.points[:, 2].copy()}))
    skin = read_mesh(str(path))
    assert skin.mesh.n_vertices < box.n_vertices and skin.mesh.topology.referenced_vertex.all()
    assert skin.mesh.topology.is_closed
    if "height" in skin.vertex:
        assert np.allclose(skin.vertex["height"], skin.mesh.points[:, 2], atol=1e-6)
