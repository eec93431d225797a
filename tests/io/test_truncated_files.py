"""A file cut anywhere is refused, or read as less; never a hang, a traceback or made-up numbers."""

import gzip
import io

import meshio
import numpy as np
import pytest
import trimesh

from ddgcli.errors import InputError
from ddgcli.io.mesh_file import READERS, WRITERS, read_mesh, write_mesh
from ddgcli.io.readers import foreign as read_foreign
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.tet_mesh import TetMesh

pytestmark = pytest.mark.timeout(20)  # a reader that hangs must not hang the suite
# formats in which a cut must always be seen: they count, or close what they open
COUNTED = {".ply", ".off", ".stl", ".vtu", ".vtp", ".npz", ".vtkhdf", ".xdmf"}
# what meshio writes, and can read again (of .cgns it cannot read what it writes itself)
MESHIO_SURFACES = {
    "abaqus": ".inp", "permas": ".dato", "tecplot": ".dat", "mdpa": ".mdpa", "avsucd": ".avs", "wkt": ".wkt",
    "med": ".med", "hmf": ".hmf",
}  # fmt: skip
MESHIO_SOLIDS = {
    "gmsh22": ".msh", "gmsh": ".msh", "medit": ".mesh", "nastran": ".bdf", "netgen": ".vol", "su2": ".su2",
    "h5m": ".h5m", "dolfin-xml": ".xml", "flac3d": ".f3grid", "ugrid": ".b8.ugrid", "tetgen": ".ele",
}  # fmt: skip


def cuts(size: int, count: int) -> list[int]:
    """Places to cut: dense at both ends, spread between."""
    inner = np.linspace(0, size, count, endpoint=False).astype(int)
    return sorted({*range(0, min(size, 4)), *inner.tolist(), *(size - k for k in (1, 2, 5, 17) if k < size)})


def annotated() -> AnnotatedMesh:
    mesh = shapes.icosphere(1)
    return AnnotatedMesh(mesh, {"height": mesh.points[:, 2]}, {"number": np.arange(mesh.n_faces)})


def assert_refused_or_less(path, whole, counted: bool, size: int, at: int) -> None:
    try:
        annotated = read_mesh(str(path))
    except InputError as error:
        assert str(error).startswith(str(path)) and "\n" not in str(error).strip()
        return
    assert not counted or at >= size - 2, f"cut at {at} of {size} was not seen"
    assert annotated.mesh.n_vertices <= whole.n_vertices
    assert np.isfinite(annotated.mesh.points).all()


@pytest.mark.parametrize("suffix", sorted(set(WRITERS) - {".csv"}))
def test_cut_files_of_our_writers_are_refused_or_hold_less(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    write_mesh(str(path), annotated())
    data, whole = path.read_bytes(), read_mesh(str(path)).mesh
    for at in cuts(len(data), 24):
        path.write_bytes(data[:at])
        assert_refused_or_less(path, whole, suffix in COUNTED, len(data.rstrip()), at)


@pytest.mark.parametrize("text", ["ascii ply", "ascii stl"])
def test_cut_text_files_are_refused_or_hold_less(tmp_path, text):
    mesh = shapes.icosphere(1)
    peer = trimesh.Trimesh(mesh.points, mesh.faces, process=False)
    kind = text.split()[1]
    exported = (
        peer.export(file_type="ply", encoding="ascii")
        if kind == "ply"
        else peer.export(file_type="stl_ascii")
    )
    data = exported if isinstance(exported, bytes) else exported.encode()
    path = tmp_path / f"a.{kind}"
    path.write_bytes(data)
    whole = read_mesh(str(path)).mesh
    np.testing.assert_allclose(whole.points[whole.faces], mesh.points[mesh.faces], atol=1e-6)
    for at in cuts(len(data), 60):
        path.write_bytes(data[:at])
        try:
            partial = read_mesh(str(path)).mesh
        except InputError:
            continue
        assert partial.n_faces == whole.n_faces or at >= len(data) - 10, at


@pytest.mark.parametrize("name, suffix", [*MESHIO_SURFACES.items(), *MESHIO_SOLIDS.items()])
def test_formats_of_meshio_are_read_in_order_and_cut_ones_hold_less(tmp_path, name, suffix):
    """What meshio writes is read with its order; cut anywhere it is refused or less, and nothing hangs."""
    solid = name in MESHIO_SOLIDS
    if solid:
        points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1.0]])
        corners = np.array([[0, 1, 2, 3], [1, 2, 3, 4]])
    else:
        points, corners = shapes.icosphere(1).points, shapes.icosphere(1).faces
    path = tmp_path / f"a{suffix}"
    cells = [("tetra" if solid else "triangle", corners)]
    meshio.Mesh(points, cells).write(str(path), file_format=name)
    result = read_mesh(str(path)).mesh
    assert isinstance(result, TetMesh) == solid
    indices = result.tetrahedra if solid else result.faces
    np.testing.assert_allclose(result.points[indices], points[corners], atol=1e-6)
    if name != "wkt":  # which has no vertex indices
        np.testing.assert_array_equal(indices, corners)
    data = path.read_bytes()
    for at in cuts(len(data), 4):
        path.write_bytes(data[:at])
        assert_refused_or_less(path, result, False, len(data), at)


@pytest.mark.parametrize("empty", [".node", ".ele"])
def test_either_file_of_tetgen_may_be_empty(tmp_path, empty):
    (tmp_path / "a.node").write_text("# points\n4 3 0 0\n0 0 0 0\n1 1 0 0\n2 0 1 0\n3 0 0 1\n")
    (tmp_path / "a.ele").write_text("1 4 0\n0 0 1 2 3\n")
    assert len(read_mesh(str(tmp_path / "a.node")).mesh.tetrahedra) == 1
    (tmp_path / f"a{empty}").write_text("# nothing\n\n")
    for suffix in (".node", ".ele"):
        with pytest.raises(InputError, match="the file ends early"):
            read_mesh(str(tmp_path / f"a{suffix}"))


@pytest.mark.parametrize("suffix", sorted(read_foreign.suffixes()))
@pytest.mark.parametrize(
    "content", [b"", b"\n", b"garbage\n" * 20, bytes(range(256)) * 8], ids=["empty", "line", "text", "bytes"]
)
def test_nonsense_under_every_name_is_refused(tmp_path, suffix, content):
    path = tmp_path / f"a{suffix}"
    path.write_bytes(content)
    try:
        assert read_mesh(str(path)).mesh.points.shape[1] == 3
    except InputError as error:
        assert str(error).startswith(str(path))


@pytest.mark.parametrize("suffix", [".glb", ".gltf", ".3mf", ".dae"])
def test_formats_of_trimesh_are_read_with_their_corners(tmp_path, suffix):
    mesh = shapes.icosphere(1)
    path = tmp_path / f"a{suffix}"
    trimesh.Trimesh(mesh.points, mesh.faces, process=False).export(str(path))
    annotated = read_mesh(str(path))
    corners = annotated.mesh.points[annotated.mesh.faces]
    np.testing.assert_allclose(corners, mesh.points[mesh.faces], atol=1e-6)
    renumbered = any("order" in note for note in annotated.notes)
    assert renumbered or (annotated.mesh.faces == mesh.faces).all()


def test_a_reader_that_is_not_installed_is_named(tmp_path, monkeypatch):
    def missing(*args, **kwargs):
        raise ImportError("missing `pip install pycollada`")

    monkeypatch.setattr(trimesh, "load_scene", missing)
    (tmp_path / "a.dae").write_text("<x/>")
    with pytest.raises(InputError, match="pip install lxml pycollada"):
        read_mesh(str(tmp_path / "a.dae"))


def test_output_of_readers_that_print_and_exit_is_suppressed(tmp_path, capfd):
    path = tmp_path / "a.vtk"
    path.write_bytes(b"# vtk DataFile Version 3.0\nx\nASCII\nDATASET NONSENSE\n")
    with pytest.raises(InputError):
        read_mesh(str(path))
    out, err = capfd.readouterr()
    assert (out, err) == ("", "")


def test_a_huge_count_allocates_nothing(tmp_path):
    import tracemalloc

    path = tmp_path / "a.ply"
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    head += "property float z\nelement face 4000000000\nproperty list uchar int vertex_indices\nend_header\n"
    path.write_bytes(head.encode() + bytes(100))
    tracemalloc.start()
    with pytest.raises(InputError, match="more than the file holds"):
        read_mesh(str(path))
    assert tracemalloc.get_traced_memory()[1] < 10e6
    tracemalloc.stop()


def test_text_numbers_stay_exact(tmp_path):
    values = np.array([[0.1, 1 / 3, 1e-300], [2**0.5, -7.25, 1e300], [0, -0.0, 3.0]])
    stream = io.StringIO()
    for row in values:
        stream.write("v " + " ".join(map(repr, row.tolist())) + "\n")
    path = tmp_path / "a.obj"
    path.write_text(stream.getvalue() + "f 1 2 3\n")
    np.testing.assert_array_equal(read_mesh(str(path)).mesh.points, values)


@pytest.mark.parametrize("suffix", [*READERS, ".vtk", ".msh", ".glb"])
def test_an_empty_file_is_called_so(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    path.write_bytes(b"")
    with pytest.raises(InputError, match="the file is empty"):
        read_mesh(str(path))


@pytest.mark.parametrize("named", [".obj", ".off", ".stl", ".vtk"])
@pytest.mark.parametrize("kind", [".ply", ".vtu", ".vtp", ".vtkhdf", ".vtk", ".off"])
def test_a_file_with_the_extension_of_another_format_is_recognised(tmp_path, kind, named):
    if kind == named:
        return
    path = tmp_path / f"a{named}"
    write_mesh(str(tmp_path / f"b{kind}"), AnnotatedMesh(shapes.icosphere(1)))
    path.write_bytes((tmp_path / f"b{kind}").read_bytes())
    with pytest.raises(InputError, match=f"like a {kind} file: use `input_format={kind[1:]}`"):
        read_mesh(str(path))
    assert read_mesh(str(path), kind[1:]).mesh.n_faces == 80


def test_a_compressed_file_is_called_so(tmp_path):
    path = tmp_path / "a.ply"
    path.write_bytes(gzip.compress(b"ply\n"))
    with pytest.raises(InputError, match="compressed"):
        read_mesh(str(path))


@pytest.mark.parametrize("suffix, program", [(".gz", "gunzip"), (".GZ", "gunzip"), (".xz", "unxz")])
def test_a_file_with_the_extension_of_a_compressed_one_is_called_so(tmp_path, suffix, program):
    with pytest.raises(InputError, match=rf"compressed: unpack it \({program}\)"):
        read_mesh(str(tmp_path / f"a.ply{suffix}"))


def test_the_message_of_meshio_before_it_exits_is_reported(tmp_path):
    path = tmp_path / "a.vtk"
    path.write_text("# vtk DataFile Version 7.9\na\nASCII\nDATASET FIELD\n")
    with pytest.raises(InputError) as refusal:
        read_mesh(str(path))
    assert "SystemExit" not in str(refusal.value) and "supported" in str(refusal.value)
