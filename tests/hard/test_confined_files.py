"""Files stay in their folder, and readers within their time and memory."""

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

from ddgcli.errors import InputError
from ddgcli.io.mesh_file import read_mesh, write_mesh
from ddgcli.io.readers import guarded, inflate
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from tests.conftest import ROOT
from tests.hard.test_malformed_files import refused

pytestmark = pytest.mark.timeout(60)


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


def test_a_device_is_no_mesh_file():
    with pytest.raises(InputError, match="is a device"):
        read_mesh("/dev/zero", "ply")


def test_the_guard_without_fork_gives_the_same(tmp_path, monkeypatch):
    """As on Windows and macOS: a new interpreter reads, refuses and is confined."""
    path = tmp_path / "a.vtkhdf"
    write_mesh(str(path), AnnotatedMesh(shapes.icosphere(1), {"f": np.arange(42.0)}))
    forked = read_mesh(str(path))
    monkeypatch.setattr(guarded.sys, "platform", "darwin")
    spawned = read_mesh(str(path))
    np.testing.assert_array_equal(spawned.mesh.points, forked.mesh.points)
    np.testing.assert_array_equal(spawned.vertex["f"], forked.vertex["f"])


def test_a_reader_that_crashes_is_a_refusal(tmp_path, monkeypatch):
    import meshio

    def crash(*args):
        os.kill(os.getpid(), signal.SIGKILL)  # SIGSEGV would make pytest print every thread

    monkeypatch.setattr(meshio, "read", crash)
    (tmp_path / "a.su2").write_text("NDIME= 3\n")
    assert "its reader crashed" in refused(tmp_path / "a.su2")


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
