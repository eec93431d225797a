"""Meshes of the library are immutable: their copies too, and whatever points they are moved to."""

import copy
import pickle
import re
from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import ddgcli as ddg
from ddgcli.errors import MeshError
from ddgcli.geometry.surface_points import face_centroids
from ddgcli.mesh.shapes import box_tetrahedra

BALL = ddg.icosphere(1)
MESHES: dict[str, Any] = {
    "surface": BALL,
    "topology": BALL.topology,
    "intrinsic": ddg.intrinsic_delaunay(BALL),
    "tetrahedra": box_tetrahedra(1, 1, 1),
    "curves": ddg.CurveSet.from_arrays(np.eye(3), [[0, 1], [1, 2]]),
    "isolines": ddg.isolines(BALL, BALL.points[:, 2]).mesh,
    "path": ddg.shortest_paths(BALL, 0, 9).mesh,
    "places": face_centroids(BALL),
}


def arrays_of(mesh: Any) -> list[np.ndarray]:
    """Arrays of a mesh, cached ones too; tuples of arrays are cached as such."""
    values = [value for name, value in vars(mesh).items() if name != "point_arrays"]
    arrays = []
    while values:
        value = values.pop()
        if isinstance(value, tuple):
            values += value
        elif isinstance(value, np.ndarray):
            arrays.append(value)
    return arrays


@pytest.mark.parametrize("kind", MESHES)
def test_arrays_of_meshes_are_read_only_in_copies_and_pickles_too(kind):
    mesh = MESHES[kind]
    if isinstance(mesh, ddg.TetMesh):
        assert len(mesh.edges) == 19 and mesh.boundary.n_faces == 12  # cached from here on
    if isinstance(mesh, ddg.CurveSet):
        assert mesh.paths
    for copied in (mesh, copy.copy(mesh), copy.deepcopy(mesh), pickle.loads(pickle.dumps(mesh))):
        arrays = arrays_of(copied)
        assert len(arrays) == len(arrays_of(mesh)) > 0
        assert not any(array.flags.writeable for array in arrays)
        for array, original in zip(arrays, arrays_of(mesh)):
            np.testing.assert_array_equal(array, original)


def test_the_surface_of_a_copied_measurement_is_read_only():
    surface = copy.deepcopy(ddg.curvature(BALL)).mesh
    with pytest.raises(ValueError, match="read-only"):
        surface.points[0] = 0.0
    with pytest.raises(ValueError, match="read-only"):
        surface.topology.faces[0] = 0


MOVABLE = ("surface", "tetrahedra", "curves")


@pytest.mark.parametrize("kind", MOVABLE)
@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.int64])
def test_points_to_which_a_mesh_is_moved_stay_those_of_the_caller(kind, dtype):
    mesh = MESHES[kind]
    points = (4 * mesh.points).astype(dtype)
    moved = mesh.moved(points)
    expected = points.astype(np.float64)
    points[:] = 7
    np.testing.assert_array_equal(moved.points, expected)
    assert moved.points.dtype == np.float64 and not moved.points.flags.writeable


@pytest.mark.parametrize("kind", MOVABLE)
def test_a_mesh_is_not_moved_to_what_is_no_point_for_each_vertex(kind):
    mesh = MESHES[kind]
    not_finite = np.where(np.arange(mesh.n_vertices) == 2, np.nan, 1.0)[:, None] * mesh.points
    ragged: list[Any] = [[0, 0, 0], [1, 0]]
    for points, words in (
        (mesh.points[1:], "one for each vertex"),
        (mesh.points.ravel(), "shape"),
        (mesh.points + 1j, "real numbers"),
        (not_finite, "vertex 2 is not finite"),
        (np.full(mesh.points.shape, np.inf), "vertex 0 is not finite"),
        (ragged, "rows of different lengths"),
        (np.array([["a", 1, 2]], dtype=object), "not real numbers"),
        ("abc", "real numbers"),
    ):
        with pytest.raises(ddg.errors.MeshError, match=words):
            mesh.moved(points)


def test_a_mesh_moved_to_points_of_the_plane_has_no_height():
    flat = BALL.moved(BALL.points[:, :2])
    np.testing.assert_array_equal(flat.points, BALL.points * [1, 1, 0])


@pytest.mark.parametrize("kind", MOVABLE)
def test_numbers_of_vertices_may_be_whole_floats_or_objects(kind):
    mesh = MESHES[kind]
    cells = {"surface": "faces", "tetrahedra": "tetrahedra", "curves": "lines"}[kind]
    corners = getattr(mesh, cells)
    for numbers in (corners.astype(np.float64), corners.astype(object), corners.astype(np.float32).tolist()):
        again = ddg.as_mesh((mesh.points.astype(object), numbers))
        np.testing.assert_array_equal(getattr(again, cells), corners)
        np.testing.assert_array_equal(again.points, mesh.points)
    for wrong in (corners + 0.5, np.where(corners == 0, np.nan, corners), np.where(corners == 0, 1e300, 0.0)):
        with pytest.raises(ddg.errors.MeshError, match="whole numbers"):
            ddg.as_mesh((mesh.points, wrong))


def test_meshes_of_meshio_are_accepted_where_they_have_cells_of_one_kind():
    def of_meshio(points, **cells):  # the attributes that are used
        return SimpleNamespace(points=points, cells_dict=cells)

    ball = ddg.as_mesh(of_meshio(BALL.points, triangle=BALL.faces, line=BALL.faces[:1, :2]))
    assert np.array_equal(ball.faces, BALL.faces)
    solid = box_tetrahedra(1, 1, 1)
    tetra = ddg.as_mesh(of_meshio(solid.points, tetra=solid.tetrahedra, vertex=np.zeros((1, 1), int)))
    assert np.array_equal(tetra.tetrahedra, solid.tetrahedra)
    for cells in ({"tetra": solid.tetrahedra, "triangle": [[0, 1, 2]]}, {"quad": [[0, 1, 2, 3]]}, {}):
        with pytest.raises(MeshError, match=re.escape('(mesh.points, mesh.cells_dict["triangle"])')):
            ddg.as_mesh(of_meshio(solid.points, **cells))


def test_the_surface_of_a_measurement():
    assert ddg.curvature(BALL).surface is BALL
    solid = box_tetrahedra(1, 1, 1)
    assert ddg.Measurement(solid).surface is solid.boundary
    with pytest.raises(MeshError, match="surface in space, not curves"):
        ddg.Measurement(MESHES["curves"]).surface  # noqa: B018


def test_faces_of_vtk_are_no_tetrahedra():
    """The remedy was one for tetrahedra with a repeated vertex."""
    faces = np.column_stack([np.full(BALL.n_faces, 3), BALL.faces])
    with pytest.raises(MeshError, match=re.escape("pass the corners alone, cells[:, 1:]")):
        ddg.as_mesh((BALL.points, faces))
    fan = [[3, 0, 1, 2], [3, 0, 2, 4]]  # tetrahedra about vertex 3
    points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, -1], [-1, 0, 0]]
    assert len(ddg.as_mesh((points, fan)).tetrahedra) == 2


@pytest.mark.parametrize(
    ("thing", "remedy"),
    [
        (lambda path: ddg.DistanceSolver(BALL), "make one from its mesh"),
        (lambda path: ddg.HeatSolver(BALL), "make one from its mesh"),
        (lambda path: ddg.willmore_flow(BALL), "pass its scene or its end"),
        (ddg.read_trajectory, "open its path"),
    ],
)
def test_what_holds_functions_or_files_is_not_pickled_and_the_message_says_what_to_pass(
    thing, remedy, tmp_path
):
    path = str(tmp_path / "run.vtkhdf")
    ddg.write_trajectory(path, ddg.willmore_flow(BALL, steps=1))
    with pytest.raises(TypeError, match=remedy):
        pickle.dumps(thing(path))


def test_quadrilaterals_are_no_tetrahedra():
    """The spectrum of a sphere of quadrilaterals was 1.41, 1.41, 1.41 without a word."""
    x, y = np.meshgrid(np.arange(5.0), np.arange(5.0))
    points = np.column_stack([x.ravel(), y.ravel(), (x * y).ravel()])
    corner = (np.arange(4) + 5 * np.arange(4)[:, None]).ravel()
    quads = np.column_stack([corner, corner + 1, corner + 6, corner + 5])
    with pytest.raises(
        MeshError, match="16 cells .* divide quadrilaterals Q into triangles: (np.*)$"
    ) as caught:
        ddg.eigenpairs((points, quads), 2)
    triangles = eval(str(caught.value).rsplit("triangles: ", 1)[1], {"np": np, "Q": quads})
    assert ddg.as_mesh((points, triangles)).n_faces == 32
    # tetrahedra that share faces, touch along an edge, or are apart
    assert len(ddg.as_mesh((np.eye(5, 3), [[0, 1, 2, 3], [1, 2, 3, 4]])).tetrahedra) == 2
    apart = np.random.default_rng(0).random((16, 3))
    assert len(ddg.as_mesh((apart, np.arange(16).reshape(4, 4))).tetrahedra) == 4
    assert len(ddg.as_mesh((apart, [[0, 1, 2, 3], [0, 1, 4, 5]])).tetrahedra) == 2


def test_objects_with_vertices_and_faces_are_meshes():
    class Other:
        vertices, faces = np.array(BALL.points), np.array(BALL.faces)

    np.testing.assert_allclose(ddg.lumped_mass(Other()).diagonal(), ddg.lumped_mass(BALL).diagonal())


def test_arrays_of_objects_that_are_real_numbers_are_written(tmp_path):
    path = str(tmp_path / "a.vtu")
    values = np.array([Fraction(i, 2) for i in range(BALL.n_vertices)], dtype=object)
    ddg.write_mesh(path, BALL, vertex={"a": values, "b": np.arange(BALL.n_vertices).astype(object)})
    back = ddg.read_mesh(path).vertex
    np.testing.assert_array_equal(back["a"], values.astype(float))
    assert back["b"].dtype.kind == "i" and back["b"].tolist() == list(range(BALL.n_vertices))
    with pytest.raises(ddg.errors.MeshError, match="vertex array 'a'"):
        ddg.write_mesh(path, BALL, vertex={"a": [None] * BALL.n_vertices})
