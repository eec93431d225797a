"""A face that names a vertex twice has a boundary of its own, which is not that of the surface."""

import shlex

import numpy as np
import pytest

from ddgcli.algorithms.tracing.trace import END_STATUS, trace
from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh

CALLS = [
    ("geodesic", "--source-boundary"),
    ("geodesic", "--trace", "5:.3,.3,.4:1,0,0:1"),
    ("geodesic", "--path-to", 17, "--source", 1),
    ("geodesic", "--log-map", "--source", 6),
    ("hodge", "--basis"),
    ("laplacian", "--form-eigen", 3),
]


@pytest.fixture
def path(tmp_path):
    square = shapes.grid(4, 4)
    faces = np.concatenate([square.faces, [[6, 6, 7]]])  # the edge 6-7 is inside
    write_mesh(str(tmp_path / "square.ply"), AnnotatedMesh(TriangleMesh.from_arrays(square.points, faces)))
    return tmp_path / "square.ply"


@pytest.mark.parametrize("dry", [False, True])
@pytest.mark.parametrize("words", CALLS, ids=lambda words: words[1])
def test_one_repair_is_named_and_remedies_it(run, path, monkeypatch, words, dry):
    monkeypatch.chdir(path.parent)
    name, *options = words
    dry_run = ["--dry-run"] if dry else []
    refused = run(name, path, *options, *dry_run)
    assert refused.exit_code == 2 and "face 32 names a vertex twice (1 such face)" in refused.stderr
    words = shlex.split(refused.stderr[refused.stderr.index("ddgcli repair") :])[1:]
    assert words[2:-2] == ["--drop-degenerate"] and run(*words).exit_code == 0
    assert run(name, words[-1], *options, *dry_run).exit_code == 0


def test_distances_from_a_vertex_do_without_it(summary, path):
    assert summary("geodesic", path, "--source", 0)["results"]["max_distance"] == pytest.approx(2**0.5)


def test_lines_cross_such_faces_of_a_delta_complex():
    """A square torus of two triangles and one vertex, along its diagonal."""
    gluing = np.array([[4, 5, 3], [2, 0, 1]])
    topology = Topology(np.zeros((2, 3), dtype=int), 1, gluing)
    torus = IntrinsicMesh(topology, np.array([[1, 1, 2**0.5], [2**0.5, 1, 1]]))
    line = trace(torus, [0], [[0.5, 0.3, 0.2]], [[1.0, 0.0]], [2.5])
    assert line.length[0] == pytest.approx(2.5) and line.status[0] == END_STATUS
