"""Every format gives back what was put in: points, cells, arrays, order; other programs read the same."""

import hashlib
import json

import numpy as np
import pytest

from ddgcli.errors import MeshFileError, OutputError
from ddgcli.io.mesh_file import WRITERS, read_mesh, write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.tet_mesh import TetMesh

METADATA = {
    "command_line": "ddgcli x --json 'a?>b' -- \"c\"",
    "version": "0",
    "input": "x.ply",
    "input_sha256": "ff" * 32,
    "options": {"a": 1},
    "converged": True,
}
WITHOUT_ARRAYS = {".obj", ".off", ".stl", ".glb"}
SINGLE_PRECISION = {".stl", ".glb"}
MESH_FORMATS = sorted(set(WRITERS) - {".csv"})  # a table of vertices is no mesh
WITH_EDGES = {".npz", ".vtkhdf"}


def annotated_surface():
    rng = np.random.default_rng(0)
    mesh = shapes.torus(12, 8)
    mesh = mesh.moved(mesh.points + 1e-3 * rng.normal(size=mesh.points.shape))
    n, m, e = mesh.n_vertices, mesh.n_faces, mesh.topology.n_edges
    vertex = {
        "scalar": rng.normal(size=n),
        "vector": rng.normal(size=(n, 3)),
        "uv": rng.normal(size=(n, 2)),
        "flag": rng.random(n) > 0.5,
        "count": np.arange(n) - 5,
    }
    face = {"face_scalar": rng.normal(size=m), "face_vector": rng.normal(size=(m, 3)), "number": np.arange(m)}
    edge = {"edges": mesh.topology.edges, "angle": rng.normal(size=e)}
    return AnnotatedMesh(mesh, vertex, face, edge, {"input_vertex": np.arange(7)}, METADATA)


def annotated_tetrahedra():
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1 / 3]])
    mesh = TetMesh.from_arrays(points, np.array([[0, 1, 2, 3], [1, 2, 3, 4]]))
    return AnnotatedMesh(mesh, {"a": points[:, 2]}, {"c": np.array([0.1, 0.2])}, metadata=METADATA)


def annotated_curves():
    rng = np.random.default_rng(1)
    curves = CurveSet.from_paths([rng.normal(size=(4, 3)), rng.normal(size=(3, 3))])
    return AnnotatedMesh(curves, metadata=METADATA)


def same(read, written):
    assert read.keys() >= written.keys()
    for name, value in written.items():
        np.testing.assert_array_equal(np.asarray(read[name], dtype=float), np.asarray(value, dtype=float))


@pytest.mark.parametrize("suffix", MESH_FORMATS)
def test_surfaces_come_back(tmp_path, suffix):
    annotated = annotated_surface()
    path = str(tmp_path / f"a{suffix}")
    write_mesh(path, annotated)
    result = read_mesh(path)
    if suffix in SINGLE_PRECISION:
        np.testing.assert_allclose(
            result.mesh.points[result.mesh.faces],
            annotated.mesh.points[annotated.mesh.faces],
            rtol=1e-6,
            atol=1e-6,
        )
        return
    np.testing.assert_array_equal(result.mesh.points, annotated.mesh.points)
    np.testing.assert_array_equal(result.mesh.faces, annotated.mesh.faces)
    if suffix not in WITHOUT_ARRAYS:
        same(result.vertex, annotated.vertex)
        same(result.face, annotated.face)
    if suffix in WITH_EDGES:
        same(result.edge, annotated.edge)
        same(result.whole, annotated.whole)


@pytest.mark.parametrize("suffix", WRITERS)
def test_bytes_are_the_same_each_time(tmp_path, suffix):
    for name in "ab":
        write_mesh(str(tmp_path / f"{name}{suffix}"), annotated_surface())
    assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


@pytest.mark.parametrize("suffix", [".vtu", ".vtk", ".vtkhdf", ".xdmf", ".npz"])
def test_tetrahedra_come_back(tmp_path, suffix):
    annotated = annotated_tetrahedra()
    path = str(tmp_path / f"a{suffix}")
    write_mesh(path, annotated)
    result = read_mesh(path)
    np.testing.assert_array_equal(result.mesh.points, annotated.mesh.points)
    np.testing.assert_array_equal(result.mesh.tetrahedra, annotated.mesh.tetrahedra)
    same(result.vertex, annotated.vertex)
    same(result.face, annotated.face)


@pytest.mark.parametrize("suffix", [".ply", ".vtp", ".obj", ".off", ".stl"])
def test_tetrahedra_give_their_boundary_to_surface_formats(tmp_path, suffix):
    path = str(tmp_path / f"a{suffix}")
    write_mesh(path, annotated_tetrahedra())
    assert read_mesh(path).mesh.n_faces == 6


@pytest.mark.parametrize("suffix", sorted(set(WRITERS) - {".off", ".stl", ".glb", ".csv"}))
def test_curves_come_back(tmp_path, suffix):
    annotated = annotated_curves()
    path = str(tmp_path / f"a{suffix}")
    write_mesh(path, annotated)
    curves = read_mesh(path).mesh
    np.testing.assert_array_equal(curves.points, annotated.mesh.points)
    np.testing.assert_array_equal(curves.lines, annotated.mesh.lines)
    assert [len(path) for path, _ in curves.paths] == [4, 3]


@pytest.mark.parametrize("suffix", [".off", ".stl", ".glb"])
def test_curves_are_refused_where_they_cannot_be(tmp_path, suffix):
    with pytest.raises(OutputError, match="vtp"):
        write_mesh(str(tmp_path / f"a{suffix}"), annotated_curves())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("suffix", [".vtu", ".vtk", ".xdmf"])
def test_meshio_reads_what_we_write(tmp_path, suffix):
    import meshio

    annotated = annotated_surface()
    path = str(tmp_path / f"a{suffix}")
    write_mesh(path, annotated)
    peer = meshio.read(path)
    np.testing.assert_array_equal(peer.points, annotated.mesh.points)
    np.testing.assert_array_equal(peer.cells[0].data, annotated.mesh.faces)
    same(peer.point_data, annotated.vertex)
    same({name: value[0] for name, value in peer.cell_data.items()}, annotated.face)


def integers_of_every_type(n):
    """Arrays of n entries with the ends of the range of each type."""
    types = [np.dtype(f"{kind}{size}") for kind in "iu" for size in (1, 2, 4, 8)]
    return {t.str: np.resize(np.array([np.iinfo(t).min, np.iinfo(t).max], dtype=t), n) for t in types}


@pytest.mark.parametrize("suffix", [".npz", ".vtkhdf", ".vtu", ".vtp", ".xdmf"])
def test_integers_of_every_type_come_back_exactly(tmp_path, suffix):
    mesh = shapes.grid(2, 2)
    arrays = integers_of_every_type(mesh.n_vertices)
    path = str(tmp_path / f"a{suffix}")
    write_mesh(path, AnnotatedMesh(mesh, vertex=arrays))
    result = read_mesh(path).vertex
    assert {name: result[name].tolist() for name in arrays} == {n: v.tolist() for n, v in arrays.items()}


def test_an_array_of_one_column_keeps_its_name_in_formats_of_scalars(tmp_path):
    mesh = shapes.grid(2, 2)
    annotated = AnnotatedMesh(mesh, {"s": mesh.points[:, :1]}, {"t": np.arange(mesh.n_faces)[:, None]})
    ply, csv = tmp_path / "a.ply", tmp_path / "a.csv"
    for path in (ply, csv):
        write_mesh(str(path), annotated)
    result = read_mesh(str(ply))
    assert result.vertex["s"].tolist() == mesh.points[:, 0].tolist()
    assert result.face["t"].tolist() == list(range(mesh.n_faces))
    assert csv.read_text().splitlines()[0] == "vertex,x,y,z,s"


@pytest.mark.parametrize("suffix", [".vtk", ".ply"])
def test_integers_that_a_format_rounds_are_named_in_a_warning_and_others_are_exact(tmp_path, caplog, suffix):
    mesh = shapes.grid(2, 2)
    exact = {"even": 2**62 + 2**10, "least": -(2**63), "narrow": 2**40 + 1}
    vertex = {name: np.full(mesh.n_vertices, value) for name, value in exact.items()}
    vertex |= {
        "odd": np.arange(mesh.n_vertices) + 2**53 + 1,
        "top": np.full(mesh.n_vertices, 2**64 - 1, "u8"),
    }
    with caplog.at_level("WARNING", "ddgcli"):
        write_mesh(str(tmp_path / f"a{suffix}"), AnnotatedMesh(mesh, vertex=vertex))
    result = read_mesh(str(tmp_path / f"a{suffix}")).vertex
    assert {name: int(result[name][0]) for name in exact} == exact
    warnings = [record.getMessage() for record in caplog.records]
    assert len(warnings) == 2 and "'odd'" in warnings[0] and "'top'" in warnings[1]
    assert all(".npz" in warning for warning in warnings)


def test_vtk_reads_the_integers_of_our_xdmf_files(tmp_path):
    vtk = pytest.importorskip("vtk")
    mesh = shapes.grid(2, 2)
    arrays = {name: v for name, v in integers_of_every_type(mesh.n_vertices).items() if v.itemsize < 8}
    arrays |= {kind: np.full(mesh.n_vertices, 2**40, dtype=kind) for kind in ("i8", "u8")}
    write_mesh(str(tmp_path / "a.xdmf"), AnnotatedMesh(mesh, vertex=arrays))
    reader = vtk.vtkXdmfReader()
    reader.SetFileName(str(tmp_path / "a.xdmf"))
    reader.Update()
    data = reader.GetOutputDataObject(0).GetPointData()
    for name, value in arrays.items():
        assert [data.GetArray(name).GetTuple1(k) for k in range(len(value))] == value.astype(float).tolist()


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".off"])
def test_trimesh_reads_what_we_write(tmp_path, suffix):
    import trimesh

    annotated = annotated_surface()
    path = str(tmp_path / f"a{suffix}")
    write_mesh(path, annotated)
    peer = trimesh.load(path, process=False, maintain_order=True)
    np.testing.assert_array_equal(peer.vertices, annotated.mesh.points)
    np.testing.assert_array_equal(peer.faces, annotated.mesh.faces)


@pytest.mark.parametrize("suffix", [".vtu", ".vtp", ".vtk", ".vtkhdf"])
@pytest.mark.parametrize("make", [annotated_surface, annotated_tetrahedra, annotated_curves])
def test_vtk_reads_what_we_write(tmp_path, suffix, make):
    pytest.importorskip("vtk")
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOHDF import vtkHDFReader
    from vtkmodules.vtkIOLegacy import vtkUnstructuredGridReader
    from vtkmodules.vtkIOXML import vtkXMLPolyDataReader, vtkXMLUnstructuredGridReader

    readers = {".vtu": vtkXMLUnstructuredGridReader, ".vtp": vtkXMLPolyDataReader,
               ".vtk": vtkUnstructuredGridReader, ".vtkhdf": vtkHDFReader}  # fmt: skip
    annotated = make()
    path = str(tmp_path / f"a{suffix}")
    write_mesh(path, annotated)
    reader = readers[suffix]()
    reader.SetFileName(path)
    reader.Update()
    data = reader.GetOutput()
    np.testing.assert_array_equal(vtk_to_numpy(data.GetPoints().GetData()), annotated.mesh.points)
    for name, value in annotated.vertex.items():
        array = vtk_to_numpy(data.GetPointData().GetArray(name))
        np.testing.assert_array_equal(array, np.asarray(value, dtype=array.dtype))
    expected = {"TriangleMesh": "faces", "TetMesh": "tetrahedra", "CurveSet": "lines"}
    cells = getattr(annotated.mesh, expected[type(annotated.mesh).__name__])
    if suffix == ".vtp" and hasattr(annotated.mesh, "tetrahedra"):
        cells = annotated.mesh.boundary.faces
    n_cells = data.GetNumberOfCells()
    ids = [
        [data.GetCell(i).GetPointId(k) for k in range(data.GetCell(i).GetNumberOfPoints())]
        for i in range(n_cells)
    ]
    if suffix == ".vtp" and make is annotated_curves:  # one cell a path
        assert n_cells == 2
        ids = [pair for path in ids for pair in zip(path, path[1:], strict=False)]
    np.testing.assert_array_equal(ids, cells)


@pytest.mark.parametrize("suffix", [".ply", ".vtu", ".vtp", ".vtkhdf", ".obj", ".off", ".xdmf", ".npz"])
def test_provenance_is_in_the_file(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    write_mesh(str(path), annotated_surface())
    if suffix == ".npz":
        with np.load(path) as archive:
            text = str(archive["metadata"])
    elif suffix == ".vtkhdf":
        import h5py

        with h5py.File(path) as file:
            text = file["ddgcli"].attrs["metadata"]
            assert file["ddgcli"].attrs["input_sha256"] == METADATA["input_sha256"]
    else:
        line = next(row for row in path.read_bytes().split(b"\n") if b"command_line" in row).decode()
        text = line[line.index("{") : line.rindex("}") + 1]
    assert json.loads(text) == METADATA


def test_references_of_boundary_triangles_do_not_spoil_tetrahedra(tmp_path):
    path = tmp_path / "cell.mesh"
    path.write_text(
        "MeshVersionFormatted 1\nDimension\n3\nVertices\n4\n0 0 0 0\n1 0 0 0\n0 1 0 0\n0 0 1 0\n"
        "Triangles\n4\n1 3 2 7\n1 2 4 7\n2 3 4 7\n1 4 3 7\nTetrahedra\n1\n1 2 3 4 5\nEnd\n"
    )
    annotated = read_mesh(str(path))
    assert isinstance(annotated.mesh, TetMesh)
    assert annotated.face["medit:ref"].tolist() == [5]  # of the cell, not of its sides


def test_a_binary_ply_whose_header_ends_its_lines_with_cr_lf_keeps_every_byte_of_its_body(tmp_path):
    mesh = shapes.icosphere(1)
    plain, windows = tmp_path / "plain.ply", tmp_path / "windows.ply"
    write_mesh(str(plain), AnnotatedMesh(mesh))
    header, mark, body = plain.read_bytes().partition(b"end_header\n")
    windows.write_bytes((header + mark).replace(b"\n", b"\r\n") + body)
    assert np.array_equal(read_mesh(str(windows)).mesh.points, mesh.points)
    assert np.array_equal(read_mesh(str(windows)).mesh.faces, mesh.faces)


@pytest.mark.parametrize("line", ["property float y", "element vertex 12\nproperty float x"])
@pytest.mark.parametrize("binary", [False, True])
def test_a_ply_with_two_properties_or_elements_of_one_name_is_refused(tmp_path, line, binary):
    path = tmp_path / "twice.ply"
    write_mesh(str(path), AnnotatedMesh(shapes.icosphere(0)))
    header, _, body = path.read_bytes().partition(b"end_header\n")
    if not binary:
        header = header.replace(b"binary_little_endian", b"ascii")
    first = header.index(b"element face")
    path.write_bytes(header[:first] + line.encode() + b"\n" + header[first:] + b"end_header\n" + body)
    with pytest.raises(MeshFileError, match="twice; rename or remove one"):
        read_mesh(str(path))


def test_the_digest_of_an_input_is_that_of_the_bytes_that_were_read(tmp_path):
    path = tmp_path / "ball.ply"
    write_mesh(str(path), AnnotatedMesh(shapes.icosphere(1)))
    expected = hashlib.sha256(path.read_bytes()).hexdigest()
    source = read_mesh(str(path))
    path.write_bytes(b"another file")
    assert source.sha256 == expected == source.sha256


@pytest.mark.parametrize(
    "mesh, places, text",
    [
        (shapes.torus(8, 6), ["edge"], "on edges (e)"),
        (shapes.torus(8, 6), ["whole"], "of the whole mesh (w)"),
        (shapes.box_tetrahedra(1, 1, 1), ["whole"], "on faces of tetrahedra (w)"),
        (shapes.box_tetrahedra(1, 1, 1), ["edge", "whole"], "on edges and on faces of tetrahedra (e, w)"),
    ],
)
def test_the_warning_of_lost_arrays_names_their_elements_alone(tmp_path, caplog, mesh, places, text):
    edges = mesh.edges if isinstance(mesh, TetMesh) else mesh.topology.edges
    arrays = {"edge": {"edges": edges, "e": np.ones(len(edges))}, "whole": {"w": np.ones(3)}}
    write_mesh(str(tmp_path / "m.vtu"), AnnotatedMesh(mesh, **{place: arrays[place] for place in places}))
    assert [r.getMessage() for r in caplog.records] == [
        f".vtu holds no arrays {text}; write .npz or .vtkhdf to keep them"
    ]
