"""Malformed files end in one line of ours, in bounded time and memory; no other file is read."""

import io
import json
import os
import signal
import struct
import subprocess
import sys
import zipfile
import zlib

import h5py
import numpy as np
import pytest

from ddgcli.errors import MAX_EXCERPT_LENGTH, InputError
from ddgcli.io.mesh_file import read_mesh, write_mesh
from ddgcli.io.readers import guarded, inflate
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from tests.conftest import ROOT

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
    "nan_list.ply": (ply(f"{LIST}property int f\n|nan 0 1 2 0"), "nan is no count of a list"),
    "neg.ply": (ply("property list int int vertex_indices\n|3 0 1 -1"), "names vertex -1"),
    "edge_frac.ply": (ply("", edge="0 1.9"), "1.9 is not a usable whole number"),
    "edge_nan.ply": (ply("", edge="0 nan"), "nan is not a usable whole number"),
    "over_uchar.ply": (
        ply(f"{LIST}|3 0 1 2", vertex="property uchar red\n", points="0 0 0 300\n1 0 0 -5\n0 1 0 9\n"),
        "'red' 300 does not fit its type uint8",
    ),
    "float_count.ply": (ply("property list float int vertex_indices\n|3 0 1 2"), "no PLY header line"),
    "x_list.ply": (
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty list uchar float x\nproperty float y\n"
        "property float z\nend_header\n1 0 0 0\n",
        "no numbers x, y and z",
    ),
    "indices_no_list.ply": (ply("property int vertex_indices\n|0"), "no list"),
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
    with pytest.raises(InputError) as caught:
        read_mesh(str(path))
    message = str(caught.value)
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


@pytest.mark.parametrize(
    "value, description",
    [
        (np.array([1j, 0, 0]), "complex"),
        (np.array(["a", "b", "c"]), "text"),
        (np.array([b"a", b"b", b"c"]), "text"),
        (np.array(["2020-01-01"] * 3, dtype="datetime64[D]"), "dates"),
        (np.zeros(3, dtype=[("a", "f8")]), "records"),
    ],
)
@pytest.mark.parametrize("suffix", [".npz", ".vtkhdf"])
def test_arrays_that_are_no_real_numbers_are_left_out_with_a_word(tmp_path, value, description, suffix):
    path = tmp_path / f"a{suffix}"
    if suffix == ".npz":
        npz(path, f=value)
    else:
        if value.dtype.kind in "MU":
            pytest.skip("h5py cannot store these")
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
    assert f"'{group}' of the VTKHDF file is no group" in refused(path)


def test_a_group_that_holds_itself_is_read_once(tmp_path):
    path = tmp_path / "a.vtkhdf"
    write_mesh(str(path), AnnotatedMesh(shapes.icosphere(1), {"f": np.arange(42.0)}))
    with h5py.File(path, "a") as file:
        file["VTKHDF/PointData/again"] = file["VTKHDF"]
    assert list(read_mesh(str(path)).vertex) == ["f"]


@pytest.mark.parametrize("kind", ["storage", "link", "virtual"])
def test_nothing_outside_an_hdf5_file_is_read(tmp_path, kind):
    path, other = tmp_path / "a.vtkhdf", tmp_path / "secret.vtkhdf"
    write_mesh(str(other), AnnotatedMesh(shapes.icosphere(1)))
    write_mesh(str(path), AnnotatedMesh(shapes.icosphere(1)))
    with h5py.File(path, "a") as file:
        root = file["VTKHDF"]
        shape = root["Points"].shape
        del root["Points"]
        if kind == "storage":
            root.create_dataset("Points", shape, "f8", external=[(str(other), 0, 8 * 3 * shape[0])])
        elif kind == "link":
            root["Points"] = h5py.ExternalLink(str(other), "/VTKHDF/Points")
        else:
            layout = h5py.VirtualLayout(shape, "f8")
            layout[:] = h5py.VirtualSource(str(other), "/VTKHDF/Points", shape)
            root.create_virtual_dataset("Points", layout)
    assert "'VTKHDF/Points' of the HDF5 file" in refused(path)


def xdmf(item: str) -> str:
    return (
        '<Xdmf Version="3.0"><Domain><Grid><Geometry GeometryType="XYZ"><DataItem Dimensions="3 3" '
        f'NumberType="Float" Precision="8" {item}</DataItem></Geometry><Topology TopologyType="Triangle" '
        'NumberOfElements="1"><DataItem Dimensions="1 3" NumberType="Int" Format="XML">0 1 2</DataItem>'
        "</Topology></Grid></Domain></Xdmf>"
    )


@pytest.mark.parametrize("form", ["binary", "hdf", "link beside"])
def test_references_of_xdmf_stay_in_its_folder(tmp_path, form):
    (tmp_path / "own").mkdir()
    secret, path = np.eye(3), tmp_path / "own" / "a.xdmf"
    (tmp_path / "secret.bin").write_bytes(secret.tobytes())
    with h5py.File(tmp_path / "secret.h5", "w") as file:
        file["p"] = secret
    with h5py.File(tmp_path / "own" / "beside.h5", "w") as file:
        file["p"], file["q"] = secret, h5py.ExternalLink("../secret.h5", "/p")
    leaving = {"binary": 'Format="Binary">../secret.bin', "hdf": 'Format="HDF">../secret.h5:/p',
               "link beside": 'Format="HDF">beside.h5:/q'}[form]  # fmt: skip
    path.write_text(xdmf(leaving))
    assert "outside" in refused(path)
    path.write_text(xdmf('Format="HDF">beside.h5:/p'))
    assert "link to another file" in refused(path)  # of the file that is referred to, too
    with h5py.File(tmp_path / "own" / "beside.h5", "a") as file:
        del file["q"]
    np.testing.assert_array_equal(read_mesh(str(path)).mesh.points, secret)


def test_references_of_gltf_stay_in_its_folder(tmp_path):
    (tmp_path / "own").mkdir()
    buffer = np.array([0, 1, 2], dtype="<u4").tobytes() + np.eye(3, dtype="<f4").tobytes()
    document = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 1}, "indices": 0}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5125, "count": 3, "type": "SCALAR"},
            {"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC3"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 12},
            {"buffer": 0, "byteOffset": 12, "byteLength": 36},
        ],
    }  # fmt: skip
    for name, uri in (("secret.bin", "../secret.bin"), ("own/beside.bin", "beside.bin")):
        (tmp_path / name).write_bytes(buffer)
        (tmp_path / "own" / "a.gltf").write_text(
            json.dumps({**document, "buffers": [{"byteLength": 48, "uri": uri}]})
        )
        if uri.startswith(".."):
            assert "secret" in refused(tmp_path / "own" / "a.gltf").replace("../se...", "secret")
        else:
            assert read_mesh(str(tmp_path / "own" / "a.gltf")).mesh.n_faces == 1


def test_a_material_library_of_obj_is_not_opened(tmp_path):
    (tmp_path / "a.obj").write_text("mtllib ../../../../etc/passwd\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert read_mesh(str(tmp_path / "a.obj")).mesh.n_faces == 1


def test_a_reader_that_does_not_end_is_ended(tmp_path, monkeypatch):
    monkeypatch.setattr(guarded, "MIN_CPU_SECONDS", 0.0)
    monkeypatch.setattr(guarded, "CPU_SECONDS_PER_MIB", 0.0)
    monkeypatch.setattr(guarded, "MIN_WALL_SECONDS", 2.0)
    (tmp_path / "a.msh").write_bytes(b"(39 (\n")
    assert "did not end within" in refused(tmp_path / "a.msh")


def test_a_reader_that_asks_for_too_much_memory_is_ended(tmp_path, monkeypatch):
    monkeypatch.setattr(guarded, "MIN_MEMORY", 1 << 20)
    monkeypatch.setattr(inflate, "MIN_CONTENT_LIMIT", 1 << 20)
    path = tmp_path / "a.vtkhdf"
    write_mesh(str(path), AnnotatedMesh(shapes.icosphere(1)))
    with h5py.File(path, "a") as file:
        file["VTKHDF/PointData/f"] = 0.0
        del file["VTKHDF/PointData/f"]
        file["VTKHDF/PointData"].create_dataset("f", (42, 10**6), "f8")
    assert "the file is damaged" in refused(path)


def packed_vtu(n_bytes: int, blocks: int = 1) -> bytes:
    block = zlib.compress(bytes(n_bytes), 9)
    table = struct.pack(f"<{3 + blocks}I", blocks, n_bytes, n_bytes, *[len(block)] * blocks)
    head = (
        '<VTKFile type="UnstructuredGrid" byte_order="LittleEndian" compressor="vtkZLibDataCompressor">'
        '<UnstructuredGrid><Piece NumberOfPoints="3" NumberOfCells="0"><Points>'
        '<DataArray type="Float64" NumberOfComponents="3" format="appended" offset="0"/></Points></Piece>'
        '</UnstructuredGrid><AppendedData encoding="raw">_'
    )
    return head.encode() + table + block * blocks + b"</AppendedData></VTKFile>"


def test_bombs_of_zlib_and_zip(tmp_path, monkeypatch):
    monkeypatch.setattr(inflate, "MIN_CONTENT_LIMIT", 1 << 16)
    (tmp_path / "a.vtu").write_bytes(packed_vtu(1 << 20, 4))
    assert "unpacks to more than" in refused(tmp_path / "a.vtu")
    for suffix in (".npz", ".zip", ".3mf"):
        stream = io.BytesIO()
        with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("points.npy", bytes(1 << 22))
        (tmp_path / f"a{suffix}").write_bytes(stream.getvalue())
        assert "unpacks to more than" in refused(tmp_path / f"a{suffix}")


def test_arrays_that_name_one_block_again_and_again_are_bounded(tmp_path, monkeypatch):
    monkeypatch.setattr(inflate, "MIN_CONTENT_LIMIT", 1 << 16)
    monkeypatch.setattr(inflate, "MAX_COMPRESSION_RATIO", 2)
    # 30,000 bytes are 1,250 points of three doubles, and 1,250 rows of 24 bytes
    again = '<DataArray type="UInt8" Name="a" NumberOfComponents="24" format="appended" offset="0"/>' * 100
    data = packed_vtu(1).replace(b' compressor="vtkZLibDataCompressor"', b"")
    at = data.index(b'encoding="raw">_') + len(b'encoding="raw">_')
    data = data[:at] + struct.pack("<I", 30000) + bytes(30000) + b"</AppendedData></VTKFile>"
    data = data.replace(b'Points="3"', b'Points="1250"')
    (tmp_path / "once.vtu").write_bytes(data)
    assert "no array 'types'" in refused(tmp_path / "once.vtu")  # past its points
    (tmp_path / "a.vtu").write_bytes(
        data.replace(b"<Points>", f"<PointData>{again}</PointData><Points>".encode())
    )
    assert "unpacks" in refused(tmp_path / "a.vtu")


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


def test_a_device_is_no_mesh_file():
    with pytest.raises(InputError, match="is a device"):
        read_mesh("/dev/zero", "ply")


def test_the_guard_without_fork_gives_the_same(tmp_path, monkeypatch):
    """As on Windows and macOS: a new interpreter reads, refuses and is confined."""
    path = tmp_path / "a.vtkhdf"
    write_mesh(str(path), AnnotatedMesh(shapes.icosphere(1), {"f": np.arange(42.0)}))
    here = read_mesh(str(path))
    monkeypatch.setattr(guarded.sys, "platform", "darwin")
    there = read_mesh(str(path))
    np.testing.assert_array_equal(there.mesh.points, here.mesh.points)
    np.testing.assert_array_equal(there.vertex["f"], here.vertex["f"])


def test_a_reader_that_crashes_is_a_refusal(tmp_path, monkeypatch):
    import meshio

    def crash(*args):
        os.kill(os.getpid(), signal.SIGKILL)  # SIGSEGV would make pytest print every thread

    monkeypatch.setattr(meshio, "read", crash)
    (tmp_path / "a.su2").write_text("NDIME= 3\n")
    assert "its reader crashed" in refused(tmp_path / "a.su2")


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
    ],
)
def test_a_damaged_trajectory_is_refused(tmp_path, damage):
    from ddgcli.io.trajectories.layout import Header
    from ddgcli.io.trajectories.trajectory import Trajectory
    from ddgcli.io.trajectories.writer import TrajectoryWriter
    from ddgcli.mesh.fields import TrajectoryFrame

    mesh, path = shapes.icosphere(0), str(tmp_path / "o.vtkhdf")
    writer = TrajectoryWriter(path, Header(mesh, True), 2)
    for k in range(2):
        writer.append(TrajectoryFrame(k, float(k), mesh.points, {"f": mesh.points[:, 0]}, {"e": 1.0}))
    writer.close("complete")
    with Trajectory(path) as whole:
        assert whole.n_frames == 2
    with h5py.File(path, "a") as file:
        damage(file)
    with pytest.raises(InputError, match="not a ddgcli trajectory") as caught:
        Trajectory(path)
    assert "\n" not in str(caught.value)


def test_the_confined_reader_may_import_this_package(tmp_path):
    """An installation by a finder has no entry of `sys.path` for the package."""
    code = (
        "import sys\n"
        "import ddgcli.io.readers.guarded as guarded\n"
        "sys.path = [p for p in sys.path if p and p != str(guarded.SOURCE_FOLDER)]\n"
        "guarded._confine(None, hdf5=False)\n"
        "import ddgcli.io.readers.triangulate\n"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
