"""Legacy VTK files as VTK itself writes them: every version, cells in their order, arrays by their names."""

import numpy as np
import pytest

from ddgcli.errors import InputError
from ddgcli.io.mesh_file import read_mesh
from ddgcli.mesh import shapes

vtk = pytest.importorskip("vtk")
from vtk.util.numpy_support import numpy_to_vtk  # noqa: E402

VERSIONS = (42, 51)


def cells_of(rows):
    cells = vtk.vtkCellArray()
    for row in rows:
        cells.InsertNextCell(len(row), [int(i) for i in row])
    return cells


def polydata(points, **lists):
    data = vtk.vtkPolyData()
    coordinates = vtk.vtkPoints()
    coordinates.SetData(numpy_to_vtk(np.asarray(points, dtype=float), deep=True))
    data.SetPoints(coordinates)
    for name, rows in lists.items():
        getattr(data, f"Set{name}")(cells_of(rows))
    return data


def attach(data, **arrays):
    for name, value in arrays.items():
        array = numpy_to_vtk(np.asarray(value), deep=True)
        array.SetName(name.replace("__", " "))
        (data.GetPointData() if name.startswith("at") else data.GetCellData()).AddArray(array)
    return data


def written(path, data, version, binary, kind="PolyData"):
    if path.suffix == ".vtp":
        writer = vtk.vtkXMLPolyDataWriter()
    else:
        writer = getattr(vtk, f"vtk{kind}Writer")()
        writer.SetFileVersion(version)
        (writer.SetFileTypeToBinary if binary else writer.SetFileTypeToASCII)()
    writer.SetFileName(str(path))
    writer.SetInputData(data)
    assert writer.Write() == 1
    return read_mesh(str(path))


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("binary", [True, False])
def test_surfaces_that_vtk_writes_are_read_with_their_arrays(tmp_path, version, binary):
    mesh = shapes.torus(12, 8)
    n, m = mesh.n_vertices, mesh.n_faces
    data = attach(
        polydata(mesh.points, Polys=mesh.faces), at_height=mesh.points[:, 2], at__vector__field=mesh.points,
        at_count=np.arange(n, dtype=np.int32), number=np.arange(m), f4=np.arange(m, dtype="f4"),
    )  # fmt: skip
    normals = numpy_to_vtk(np.ascontiguousarray(mesh.points), deep=True)
    normals.SetName("Normals")
    data.GetPointData().SetNormals(normals)
    data.GetPointData().SetActiveScalars("at_height")
    data.GetPointData().SetActiveVectors("at vector field")
    annotated = written(tmp_path / "a.vtk", data, version, binary)
    np.testing.assert_allclose(annotated.mesh.points, mesh.points, rtol=0, atol=0 if binary else 1e-9)
    np.testing.assert_array_equal(annotated.mesh.faces, mesh.faces)
    assert set(annotated.vertex) == {"at_height", "at vector field", "at_count", "Normals"}
    np.testing.assert_allclose(annotated.vertex["at vector field"], mesh.points, atol=1e-9)
    np.testing.assert_allclose(annotated.vertex["at_height"], mesh.points[:, 2], atol=1e-9)
    np.testing.assert_array_equal(annotated.vertex["at_count"], np.arange(n))
    for name in ("number", "f4"):
        np.testing.assert_array_equal(annotated.face[name], np.arange(m))
    assert not annotated.notes


@pytest.mark.parametrize("suffix, version", [(".vtp", 0), (".vtk", 42), (".vtk", 51)])
def test_arrays_on_mixed_cells_stay_with_their_cells(tmp_path, suffix, version):
    points = np.random.default_rng(0).normal(size=(9, 3))
    data = polydata(
        points, Verts=[[0], [1]], Lines=[[2, 3]], Polys=[[0, 1, 2], [2, 3, 4, 5]], Strips=[[5, 6, 7, 8]]
    )
    # VTK numbers cells: vertices, lines, polygons, strips
    data = attach(
        data, first=np.array([data.GetCell(k).GetPointId(0) for k in range(data.GetNumberOfCells())])
    )
    annotated = written(tmp_path / f"a{suffix}", data, version, True)
    faces = annotated.mesh.faces.tolist()
    assert annotated.mesh.n_faces == 5
    corners = {0: set(), 2: set(), 5: set()}
    for face, first in zip(faces, annotated.face["first"]):
        assert len(set(face)) == 3
        corners[int(first)] |= set(face)
    assert corners == {0: {0, 1, 2}, 2: {2, 3, 4, 5}, 5: {5, 6, 7, 8}}


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("binary", [True, False])
def test_curves_and_solids_of_vtk(tmp_path, version, binary):
    points = np.random.default_rng(1).normal(size=(5, 3))
    curve = written(tmp_path / "a.vtk", polydata(points, Lines=[[0, 1, 2, 3, 4]]), version, binary)
    assert curve.kind == "curve" and curve.mesh.lines.tolist() == [[0, 1], [1, 2], [2, 3], [3, 4]]
    grid = vtk.vtkUnstructuredGrid()
    coordinates = vtk.vtkPoints()
    coordinates.SetData(numpy_to_vtk(points, deep=True))
    grid.SetPoints(coordinates)
    grid.SetCells(vtk.VTK_TETRA, cells_of([[0, 1, 2, 3], [1, 2, 3, 4]]))
    solid = written(tmp_path / "b.vtk", attach(grid, c=[0.5, 0.25]), version, binary, "UnstructuredGrid")
    assert solid.kind == "tetrahedra" and solid.face["c"].tolist() == [0.5, 0.25]


def test_a_file_by_hand_with_all_that_old_files_hold(tmp_path):
    path = tmp_path / "a.vtk"
    path.write_text(
        "# vtk DataFile Version 2.0\ntitle\nASCII\nDATASET POLYDATA\nFIELD FieldData 1\nTIME 1 1 double\n0\n"
        "POINTS 4 float\n0 0 0 1 0 0\n1 1 0\n0 1 0\nPOLYGONS 1 5\n4 0 1 2 3\n"
        "POINT_DATA 4\nSCALARS t float 1\nLOOKUP_TABLE own\n1 2 3 4\nLOOKUP_TABLE own 1\n0 0 0 1\n"
        "TEXTURE_COORDINATES uv 2 float\n0 0 1 0 1 1 0 1\nCOLOR_SCALARS rgb 3\n1 0 0 0 1 0 0 0 1 1 1 1\n"
        "CELL_DATA 1\nSCALARS q int\nLOOKUP_TABLE default\n7\n"
    )
    annotated = read_mesh(str(path))
    assert annotated.mesh.n_faces == 2 and annotated.vertex["t"].tolist() == [1, 2, 3, 4]
    assert annotated.vertex["uv"].shape == (4, 2) and annotated.vertex["rgb"].shape == (4, 3)
    assert annotated.face["q"].tolist() == [7, 7]


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("binary", [True, False])
def test_cut_anywhere_a_polydata_file_is_refused_or_read_as_less(tmp_path, version, binary):
    mesh = shapes.icosphere(0)
    data = attach(polydata(mesh.points, Polys=mesh.faces), at_x=mesh.points[:, 0], c=np.arange(20.0))
    written(tmp_path / "a.vtk", data, version, binary)
    whole = (tmp_path / "a.vtk").read_bytes()
    for length in range(0, len(whole), 7):
        (tmp_path / "b.vtk").write_bytes(whole[:length])
        try:
            annotated = read_mesh(str(tmp_path / "b.vtk"))
        except InputError as error:
            assert str(error).startswith(str(tmp_path)) and "\n" not in str(error)
        else:
            assert set(annotated.mesh.faces.ravel().tolist()) <= set(range(12))
