"""Malformed files end in one line of ours, in bounded time and memory; no other file is read."""

import zipfile

import h5py
import numpy as np
import pytest

from ddgcli.errors import MAX_EXCERPT_LENGTH, InputError, MeshFileError
from ddgcli.io.mesh_file import read_mesh, write_mesh
from ddgcli.io.readers.raw_mesh import RawMesh, assembled
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh

pytestmark = pytest.mark.timeout(60)
TRIANGLE = "0 0 0\n1 0 0\n0 1 0\n"


def ply(faces: str, *, vertex: str = "", edge: str = "", points: str = TRIANGLE, count: int = 1) -> str:
    head = (
        "ply\nformat ascii 1.0\nelement vertex 3\n" + "".join(f"property float {c}\n" for c in "xyz") + vertex
    )
    if edge:
        return (
            f"{head}element edge 1\nproperty int vertex1\nproperty int vertex2\nend_header\n{points}{edge}\n"
        )
    declared, _, listed = faces.partition("|")
    return f"{head}element face {count}\n{declared}end_header\n{points}{listed}\n"


LIST = "property list uchar int vertex_indices\n"


def vtk(polygon: str) -> str:
    head = "# vtk DataFile Version 3.0\nt\nASCII\nDATASET POLYDATA\nPOINTS 3 float\n"
    return f"{head}0 0 0 1 0 0 0 1 0\nPOLYGONS 1 4\n{polygon}\n"


def vtu(
    *, header: str = "UInt32", kind: str = "Float64", connectivity: str = "0 1 2", types: str = "5"
) -> str:
    def array(kind: str, name: str, text: str, more: str = "") -> str:
        return f'<DataArray type="{kind}" Name="{name}" {more} format="ascii">{text}</DataArray>'

    cells = array("Int64", "connectivity", connectivity) + array("Int64", "offsets", "3")
    return (
        f'<VTKFile type="UnstructuredGrid" header_type="{header}"><UnstructuredGrid>'
        '<Piece NumberOfPoints="3" NumberOfCells="1"><Points>'
        + array(kind, "p", "0 0 0 1 0 0 0 1 0", 'NumberOfComponents="3"')
        + f"</Points><Cells>{cells}{array('UInt8', 'types', types)}</Cells></Piece>"
        + "</UnstructuredGrid></VTKFile>"
    )


# name of the file -> (content, words of the message)
REFUSED = {
    "big_index.ply": (ply(f"{LIST}property int f\n|3 0 4294967297 2 0"), "4294967297 does not fit"),
    "frac_index.ply": (ply(f"{LIST}property int f\n|3 0 1.7 2 0"), "1.7 is not a usable whole number"),
    "inf_index.ply": (ply(f"{LIST}property int f\n|3 0 inf 2 0"), "inf is not a usable whole number"),
    "nan_index.ply": (ply(f"{LIST}property int f\n|3 0 nan 2 0"), "nan is not a usable whole number"),
    "fracsize.ply": (ply(f"{LIST}|3.9 0 1 2"), "its count is wrong"),
    "nan_first.ply": (ply(f"{LIST}|3 0 1 2\nnan 0 1 2", count=2), "its count is wrong"),
    "nan_list.ply": (ply(f"{LIST}property int f\n|nan 0 1 2 0"), "nan is not a count of a list"),
    "neg.ply": (ply("property list int int vertex_indices\n|3 0 1 -1"), "names vertex -1"),
    "edge_frac.ply": (ply("", edge="0 1.9"), "1.9 is not a usable whole number"),
    "edge_nan.ply": (ply("", edge="0 nan"), "nan is not a usable whole number"),
    "over_uchar.ply": (
        ply(f"{LIST}|3 0 1 2", vertex="property uchar red\n", points="0 0 0 300\n1 0 0 -5\n0 1 0 9\n"),
        "'red' 300 does not fit its type uint8",
    ),
    "float_count.ply": (ply("property list float int vertex_indices\n|3 0 1 2"), "not a line of a PLY"),
    "x_list.ply": (
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty list uchar float x\nproperty float y\n"
        "property float z\nend_header\n1 0 0 0\n",
        "no numbers x, y and z",
    ),
    "indices_no_list.ply": (ply("property int vertex_indices\n|0"), "is not a list"),
    "off_frac.off": ("OFF\n3 1 0\n" + TRIANGLE + "3 0 1 1.5\n", "1.5 is not a usable whole number"),
    "off_nan.off": ("OFF\n3 1 0\n" + TRIANGLE + "nan 0 1 2\n", "nan is not a usable whole number"),
    "vtk_frac.vtk": (vtk("3 0 1 2.9"), "2.9 is not a usable whole number"),
    "vtk_nan.vtk": (vtk("3 0 1 nan"), "nan is not a usable whole number"),
    "vtk_1e30.vtk": (vtk("3 0 1 1e30"), "1e+30 is not a usable whole number"),
    "vtk_1e39.vtk": (vtk("3 0 1 2").replace("0 1 0\n", "0 1e39 0\n"), "not finite"),
    "vtk_type.vtk": (vtk("3 0 1 2").replace("3 float", "3 UInt1.0.0"), "data type 'UInt1.0.0'"),
    "header_type.vtu": (vtu(header="UInt1.0.0"), "header_type 'UInt1.0.0'"),
    "data_type.vtu": (vtu(kind="Float1.0.0"), "data type 'Float1.0.0'"),
    "frac.vtu": (vtu(connectivity="0 1 1.5"), "1.5 is not a usable whole number"),
    "types.vtu": (vtu(types="261"), "261 does not fit its type uint8"),
    "neg_count.vtu": (vtu().replace('NumberOfPoints="3"', 'NumberOfPoints="-3"'), "NumberOfPoints='-3'"),
    "cells.vtu": (vtu().replace('NumberOfCells="1"', 'NumberOfCells="7"'), "announces 7 cells"),
    "no_array.vtu": (vtu().replace('"offsets"', '"offset5"'), "no array 'offsets'"),
    "big.csv": ("0,0\n1e400,0\n1,1\n", "not finite"),
}  # fmt: skip


def refused(path) -> str:
    with pytest.raises(InputError) as refusal:
        read_mesh(str(path))
    message = str(refusal.value)
    assert message.startswith(f"{path}: ") and "\n" not in message
    assert len(message) < len(str(path)) + 400
    return message


@pytest.mark.parametrize("name", REFUSED)
def test_counts_indices_and_types_that_are_none(tmp_path, name):
    content, words = REFUSED[name]
    (tmp_path / name).write_text(content)
    assert words in refused(tmp_path / name)


def test_the_same_files_without_the_fault_are_read(tmp_path):
    sound = {"a.ply": ply(f"{LIST}property int f\n|3 0 1 2 0"), "a.vtk": vtk("3 0 1 2"), "a.vtu": vtu(),
             "a.off": "OFF\n3 1 0\n" + TRIANGLE + "3 0 1 2\n"}  # fmt: skip
    for name, content in sound.items():
        (tmp_path / name).write_text(content)
        assert read_mesh(str(tmp_path / name)).mesh.n_faces == 1


def npz(path, **arrays):
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.0]])
    np.savez(path, **{"points": points, "faces": np.array([[0, 1, 2]]), **arrays})


@pytest.mark.parametrize(
    "edges", [np.array(3), np.array(["a", "b", "c"]), np.eye(3)[:, :2], np.array([[0, 1], [1, 9], [0, 2]])]
)
def test_edges_that_are_none_are_left_out_with_a_word(tmp_path, edges):
    npz(tmp_path / "a.npz", edges=edges, w=np.arange(7.0)[: max(edges.shape[:1] or (1,))])
    annotated = read_mesh(str(tmp_path / "a.npz"))
    assert annotated.edge == {}
    assert any("'edges' is not" in note for note in annotated.notes)


# h5py stores neither texts of numpy's own type nor dates
NO_REAL_NUMBERS = {
    (".npz", ".vtkhdf"): {
        "complex": np.array([1j, 0, 0]),
        "text": np.array([b"a", b"b", b"c"]),
        "records": np.zeros(3, dtype=[("a", "f8")]),
    },
    (".npz",): {
        "text": np.array(["a", "b", "c"]),
        "dates": np.array(["2020-01-01"] * 3, dtype="datetime64[D]"),
    },
}


@pytest.mark.parametrize(
    "value, description, suffix",
    [
        (value, description, suffix)
        for suffixes, values in NO_REAL_NUMBERS.items()
        for description, value in values.items()
        for suffix in suffixes
    ],
)
def test_arrays_that_are_no_real_numbers_are_left_out_with_a_word(tmp_path, value, description, suffix):
    path = tmp_path / f"a{suffix}"
    if suffix == ".npz":
        npz(path, f=value)
    else:
        npz(tmp_path / "b.npz")
        write_mesh(str(path), AnnotatedMesh(read_mesh(str(tmp_path / "b.npz")).mesh))
        with h5py.File(path, "a") as file:
            file["VTKHDF"].require_group("PointData")["f"] = value
    annotated = read_mesh(str(path))
    assert "f" not in {**annotated.vertex, **annotated.whole}
    assert any(f"'f' holds {description}" in note for note in annotated.notes)


def test_arrays_are_in_the_machine_s_own_types(tmp_path):
    npz(tmp_path / "a.npz", points=np.eye(3).astype(">f2"), faces=np.array([[0, 1, 2]], dtype=">i2"),
        s=np.arange(3, dtype=">f4"), q=np.arange(3, dtype=np.longdouble),
        h=np.arange(3, dtype=np.float16))  # fmt: skip
    annotated = read_mesh(str(tmp_path / "a.npz"))
    assert {n: a.dtype.str[1:] for n, a in annotated.vertex.items()} == {"s": "f4", "q": "f8", "h": "f4"}
    assert all(a.dtype.isnative for a in annotated.vertex.values())


def test_indices_beyond_int64_are_refused(tmp_path):
    npz(tmp_path / "a.npz", faces=np.array([[0, 1, 2**64 - 1]], dtype=np.uint64))
    assert "1844674407370955161" in refused(tmp_path / "a.npz")


def test_a_member_that_is_no_array_is_left_out_with_a_word(tmp_path):
    npz(tmp_path / "a.npz")
    with zipfile.ZipFile(tmp_path / "a.npz", "a") as archive:
        archive.writestr("README.txt", "hello")
    assert any("README.txt" in note for note in read_mesh(str(tmp_path / "a.npz")).notes)


@pytest.mark.parametrize("group", ["PointData", "CellData", "FieldData"])
def test_a_data_set_in_the_place_of_a_group(tmp_path, group):
    path = tmp_path / "a.vtkhdf"
    write_mesh(str(path), AnnotatedMesh(shapes.icosphere(1)))
    with h5py.File(path, "a") as file:
        if group in file["VTKHDF"]:
            del file["VTKHDF"][group]
        file["VTKHDF"][group] = np.zeros(3)
    assert f"'{group}' of the VTKHDF file is not a group" in refused(path)


@pytest.mark.parametrize("name", ["NumberOfPoints", "Polygons/Connectivity", "Polygons/Offsets"])
@pytest.mark.parametrize("dtype", [float, complex])
def test_fractional_counts_and_indices_of_hdf5_are_refused(tmp_path, name, dtype):
    path = tmp_path / "a.vtkhdf"
    write_mesh(str(path), AnnotatedMesh(shapes.icosphere(1)))
    with h5py.File(path, "a") as file:
        numbers = file["VTKHDF"][name][...].astype(dtype)
        del file["VTKHDF"][name]
        file["VTKHDF"][name] = numbers
    assert f"'{name.split('/')[-1]}' holds" in refused(path)


def test_a_group_that_holds_itself_is_read_once(tmp_path):
    path = tmp_path / "a.vtkhdf"
    write_mesh(str(path), AnnotatedMesh(shapes.icosphere(1), {"f": np.arange(42.0)}))
    with h5py.File(path, "a") as file:
        file["VTKHDF/PointData/again"] = file["VTKHDF"]
    assert list(read_mesh(str(path)).vertex) == ["f"]


@pytest.mark.parametrize("suffix", [".ply", ".off", ".obj", ".vtk", ".vtu", ".csv", ".wkt", ".stl", ".npz"])
def test_messages_do_not_repeat_the_file(tmp_path, suffix):
    word = "Ü\x1b[31m" + "long" * 2000
    texts = {
        ".ply": f"ply\nformat ascii 1.0\nelement {word} 3\nproperty {word} x\nend_header\n",
        ".off": f"OFF\n3 1 0\n{word} 0 0\n0 0 0\n0 0 0\n3 0 1 2\n",
        ".obj": f"v {word} 0 0\n",
        ".vtk": f"# vtk DataFile Version 3.0\nt\nASCII\nDATASET POLYDATA\nPOINTS 3 {word}\n0 0 0\n",
        ".vtu": f'<VTKFile type="{word[6:]}"/>',
        ".csv": f"0,0\n{word},1\n",
        ".wkt": f"TIN ((({word} 0 0, 1 0 0, 0 1 0, 0 0 0)))",
        ".stl": f"solid a\nfacet\nvertex {word} 0 0\nvertex 0 0 0\nvertex 0 0 0\nendfacet\nendsolid",
        ".npz": "PK" + word,
    }
    (tmp_path / f"a{suffix}").write_text(texts[suffix], encoding="utf-8")
    message = refused(tmp_path / f"a{suffix}")
    assert "\x1b" not in message and message.count("long") <= MAX_EXCERPT_LENGTH / 4 + 1


@pytest.mark.parametrize(
    "suffix, text", [(".off", "OFF\n3 {} 0\n"), (".ply", ply("|").replace("3\n", "{}\n", 1))]
)
def test_numbers_of_many_digits_are_cut_in_messages(tmp_path, suffix, text):
    path = tmp_path / f"a{suffix}"
    path.write_text(text.format("7" * 300))
    message = refused(path)
    assert "777" in message and "7" * (MAX_EXCERPT_LENGTH + 1) not in message


def test_many_rows_of_a_scene_cost_one_pass(monkeypatch):
    """4,000 pins, one a row: the scene's text was parsed again for each row."""
    from ddgcli.io import scene_file

    rows, lengths = 4000, []
    loads = scene_file.tomllib.loads
    monkeypatch.setattr(scene_file.tomllib, "loads", lambda text: (lengths.append(len(text)), loads(text))[1])
    text = "[effects]\npin = { vertices = [" + "0,\n" * rows + '], a = "]" } # [\nlater = 1\n'
    lines = scene_file.key_lines(text)
    assert lines["effects", "pin"] == 2 and lines["effects", "later"] == rows + 3
    assert sum(lengths) < 2 * len(text)


def replaced(group, name, array):
    group.pop(name, None)
    group[name] = array


@pytest.mark.parametrize(
    "damage",
    [
        lambda f: f.__delitem__("VTKHDF/Steps"),
        lambda f: f["VTKHDF/Steps"].attrs.__setitem__("NSteps", 99),
        lambda f: f["VTKHDF/Steps"].attrs.__setitem__("NSteps", 0),
        lambda f: f["VTKHDF"].__setitem__("PointData/x", h5py.SoftLink("/VTKHDF")),
        lambda f: f["VTKHDF"].__setitem__("PointData/x", h5py.ExternalLink("b.h5", "/a")),
        lambda f: f["ddgcli"].attrs.__setitem__("overrides", "[]"),
        lambda f: f["VTKHDF/NumberOfPoints"].__setitem__(0, -1),
        lambda f: f["VTKHDF/Steps/CellDataOffsets/g"].__setitem__(1, 21),
        lambda f: f["VTKHDF/Steps/CellDataOffsets/g"].__setitem__(0, -1),
        lambda f: f["VTKHDF/CellData"].__delitem__("g"),
        lambda f: f["ddgcli"].attrs.__setitem__("face_arrays", '["h"]'),
        lambda f: replaced(f["VTKHDF/FieldData"], "e", np.zeros(2)),
        lambda f: replaced(f["VTKHDF/FieldData"], "obstacle_pose_b", np.zeros((2, 3))),
        lambda f: f["ddgcli/obstacles/000"].attrs.__delitem__("name"),
        lambda f: f["VTKHDF/FieldData"].move("e", b"\xff"),
        lambda f: f["ddgcli"].create_dataset(b"\xfe", data=0.0),
        lambda f: f["VTKHDF/CellData"].create_dataset("x", data=np.zeros(21)),
        lambda f: f["ddgcli"].attrs.__setitem__("periods", "{}"),
        lambda f: f["ddgcli"].attrs.__setitem__("periods", '["a"]'),
        lambda f: f["ddgcli"].attrs.__setitem__("periods", '{"a": [1, 0]}'),
        lambda f: f["ddgcli"].attrs.__setitem__("periods", '{"a": [1, NaN, 0]}'),
        lambda f: (
            f["ddgcli"].attrs.__setitem__("periods", '{"a": [1, 0, 0]}'),
            f["VTKHDF/CellData"].__setitem__("object_id", np.ones(20, dtype=int)),
        ),
        lambda f: (
            f["ddgcli"].attrs.__setitem__("periods", '{"a": [1, 0, 0]}'),
            f["VTKHDF/FieldData"].move("e", "particles_b"),
        ),
    ],
)
def test_a_damaged_trajectory_is_refused(tmp_path, damage):
    from ddgcli.io.trajectories.layout import Header
    from ddgcli.io.trajectories.trajectory import Trajectory
    from ddgcli.io.trajectories.writer import TrajectoryWriter
    from ddgcli.mesh.fields import TrajectoryFrame

    mesh, path = shapes.icosphere(0), str(tmp_path / "o.vtkhdf")
    writer = TrajectoryWriter(path, Header(mesh, True, obstacles={"b": mesh}), 2)
    for k in range(2):
        vertex, face = {"f": mesh.points[:, 0]}, {"g": np.full(mesh.n_faces, float(k))}
        writer.append(TrajectoryFrame(k, float(k), mesh.points, vertex, {"e": 1.0}, face=face))
    writer.close("complete")
    with Trajectory(path) as whole:
        assert whole.n_frames == 2 and list(whole.face(1)["g"]) == [1.0] * mesh.n_faces
    with h5py.File(path, "a") as file:
        damage(file)
    with pytest.raises(InputError, match="not a ddgcli trajectory") as refusal:
        Trajectory(path)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("text", ["vt 0 0\nf 1/1\n", "vt 0 0\nvt 1 0\nf 1/1 2/1\nf\n"])
def test_faces_without_any_vertex_are_refused(run, tmp_path, text):
    path = tmp_path / "a.obj"
    path.write_text(text)
    result = run("info", path)
    message = f"Error: {path}: not an OBJ file: no vertices; check the extension\n"
    assert (result.exit_code, result.stderr) == (2, message)


def test_a_polygon_of_arrays_that_names_no_point_is_refused():
    raw = RawMesh(np.zeros((3, 3)), np.array([0, 1, 2, 0, 3]), np.array([3, 2]))
    with pytest.raises(MeshFileError, match="face 1 names vertex 3, outside 0..2; correct the face list"):
        assembled(raw)
