"""Words of a format inside names and comments, and names outside ASCII."""

import logging

import numpy as np
import pytest

from ddgcli.errors import ParameterError
from ddgcli.io.mesh_file import read_mesh, write_mesh
from ddgcli.library.forms import flat, interior_product, lie_derivative
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh

TRIANGLE = "element vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
BODY = "property list uchar int vertex_indices\nend_header{}0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"


@pytest.mark.parametrize("end", ["\n", " \n", "\r\n"])
def test_a_comment_of_a_ply_file_may_have_the_word_end_header(tmp_path, end):
    """Once the header ended there: our own files from a folder of that name were read as empty."""
    path = tmp_path / "a.ply"
    path.write_bytes(
        f"ply\nformat ascii 1.0\ncomment /end_header_tests end_header\n{TRIANGLE}{BODY}".format(end).encode()
    )
    assert read_mesh(str(path)).mesh.n_faces == 1


def test_a_comment_of_an_obj_file_continues_no_line(tmp_path):
    path = tmp_path / "a.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n# C:\\meshes\\\nf 1 2 3\nv 1 1 0\nf 2 \\\n4 3\n")
    assert read_mesh(str(path)).mesh.faces.tolist() == [[0, 1, 2], [1, 3, 2]]


@pytest.mark.parametrize("name", ["my facet", "vertex 1 2 3", "", "endfacet"])
def test_the_name_of_an_ascii_stl_solid_may_have_words_of_the_format(tmp_path, name):
    facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
    path = tmp_path / "a.stl"
    for text in (f"solid {name}\n{facet}endsolid {name}\n", f"solid x {facet}endsolid".replace("\n", " ")):
        path.write_text(text)
        assert read_mesh(str(path)).mesh.n_faces == 1


@pytest.mark.parametrize("suffix", [".ply", ".vtu", ".vtk", ".vtkhdf", ".npz"])
def test_names_outside_ascii_are_kept(tmp_path, suffix):
    grid = shapes.grid(2, 2)
    path = str(tmp_path / f"a{suffix}")
    write_mesh(path, AnnotatedMesh(grid, vertex={"température": np.arange(9.0)}))
    assert np.array_equal(read_mesh(path).vertex["température"], np.arange(9.0))


def test_names_in_legacy_vtk_files_are_those_of_vtk(tmp_path):
    """VTK decodes `%XX`, so that the name `100%` was `100` there."""
    vtk = pytest.importorskip("vtk")
    names = ["100%", "strain 100%", "a%20b", "a b", 'the "x"', "température", "|v|/~[m]", "two\nlines"]
    path = str(tmp_path / "a.vtk")
    vertex = {name: np.arange(9.0) + k for k, name in enumerate(names)}
    write_mesh(path, AnnotatedMesh(shapes.grid(2, 2), vertex=vertex))
    reader = vtk.vtkUnstructuredGridReader()
    reader.SetFileName(path)
    reader.ReadAllScalarsOn()
    reader.Update()
    data = reader.GetOutput().GetPointData()
    assert [data.GetArrayName(k) for k in range(data.GetNumberOfArrays())] == names
    writer = vtk.vtkUnstructuredGridWriter()
    writer.SetFileName(str(tmp_path / "b.vtk"))
    writer.SetInputData(reader.GetOutput())
    writer.Write()
    for name in (path, str(tmp_path / "b.vtk")):
        assert {key: array[0] for key, array in read_mesh(name).vertex.items()} == {
            n: float(k) for k, n in enumerate(names)
        }


@pytest.mark.parametrize("suffix", [".ply", ".vtu", ".vtp", ".vtk", ".vtkhdf", ".npz", ".xdmf"])
def test_arrays_without_a_name_or_a_column_are_left_out(tmp_path, suffix, caplog):
    """Once a ValueError, or a file that our reader refuses."""
    path = str(tmp_path / f"a{suffix}")
    arrays = {"": np.arange(9.0), "none": np.zeros((9, 0)), "kept": np.arange(9.0)}
    with caplog.at_level(logging.WARNING):
        write_mesh(path, AnnotatedMesh(shapes.grid(2, 2), vertex=arrays))
    assert set(read_mesh(path).vertex) >= {"kept"} and "'', 'none'" in caplog.text


def test_fields_that_are_not_finite_are_refused():
    grid = shapes.grid(3, 3)
    field, form = np.ones((grid.n_vertices, 3)), np.ones(len(grid.topology.edges))
    field[5, 1] = np.nan
    with pytest.raises(ParameterError, match="not finite at row 5"):
        flat(grid, field)
    for product in (interior_product, lie_derivative):
        with pytest.raises(ParameterError, match="not finite at row 5"):
            product(grid, field, form)


@pytest.mark.parametrize("suffix, names", [(".vtk", ["a b", "a_b"]), (".ply", ["a_b", "a_b_2"]),
                                           (".vtkhdf", ["a b", "a_b"])])  # fmt: skip
def test_arrays_whose_names_a_format_does_not_tell_apart_are_all_written(tmp_path, suffix, names, caplog):
    mesh, path = shapes.icosphere(0), str(tmp_path / f"a{suffix}")
    arrays = {"a b": np.arange(12.0), "a_b": np.arange(12.0) + 1}
    with caplog.at_level(logging.WARNING):
        write_mesh(path, AnnotatedMesh(mesh, vertex=arrays))
    vertex = read_mesh(path).vertex
    assert sorted(vertex) == names and sorted(array[0] for array in vertex.values()) == [0.0, 1.0]
    assert ("written as" in caplog.text) == (suffix == ".ply")


@pytest.mark.parametrize("suffix, name", [(".ply", "a b"), (".vtkhdf", "a/b"), (".vtkhdf", "a.b")])
def test_a_name_that_a_format_does_not_take_is_changed_with_a_warning(tmp_path, suffix, name, caplog):
    with caplog.at_level(logging.WARNING):
        write_mesh(
            str(tmp_path / f"a{suffix}"), AnnotatedMesh(shapes.icosphere(0), vertex={name: np.arange(12.0)})
        )
    assert f"{suffix} does not take the name {name!r}: written as 'a_b'" in caplog.text


FORMATS = (".npz", ".vtu", ".vtp", ".vtk", ".vtkhdf", ".ply", ".xdmf")


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize("character", ["\x1b", "\0", "\x7f", "\ufffe", "\ud800"])
def test_characters_that_damage_files_are_replaced_in_names_of_every_format(
    tmp_path, suffix, character, caplog
):
    path, values = str(tmp_path / f"a{suffix}"), np.arange(12.0)
    name = f"a{character}b"
    arrays = {"a_b": values, name: values + 1}
    with caplog.at_level(logging.WARNING):
        write_mesh(path, AnnotatedMesh(shapes.icosphere(0), vertex=arrays, face={name: np.arange(20.0)}))
    back = read_mesh(path)
    np.testing.assert_array_equal(back.vertex["a_b"], values)
    np.testing.assert_array_equal(back.vertex["a_b_2"], values + 1)
    if suffix != ".npz":  # which has one space of names
        np.testing.assert_array_equal(back.face["a_b"], np.arange(20.0))
    assert "written as" in caplog.text


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize("dtype", [np.longdouble, np.float16])
def test_floats_that_a_format_lacks_are_written_in_one_that_it_has(tmp_path, suffix, dtype):
    path, values = str(tmp_path / f"a{suffix}"), np.arange(12).astype(dtype) / 8
    write_mesh(path, AnnotatedMesh(shapes.icosphere(0), vertex={"a": values}))
    back = read_mesh(path).vertex["a"]
    assert back.dtype == (np.float64 if dtype is np.longdouble else np.float32)
    np.testing.assert_array_equal(back, values.astype(np.float64))


@pytest.mark.parametrize("name", ["metadata", "METADATA", "Metadata"])
def test_an_array_of_a_legacy_file_may_have_the_name_of_a_section(tmp_path, name):
    path, arrays = (
        str(tmp_path / "a.vtk"),
        {"first": np.arange(12.0), name: np.ones((12, 3)), "c": np.zeros(12)},
    )
    write_mesh(path, AnnotatedMesh(shapes.icosphere(0), vertex=arrays))
    back = read_mesh(path).vertex
    assert list(back) == list(arrays)
    for key, values in arrays.items():
        np.testing.assert_array_equal(back[key], values)


@pytest.mark.parametrize(
    ("suffix", "text", "notes"),
    [
        (".off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", []),
        (
            ".off",
            "COFF\n3 1 0\n0 0 0 9 9 9 9\n1 0 0 9 9 9 9\n0 1 0 9 9 9 9\n3 0 1 2\n",
            ["after the coordinates"],
        ),
        (".off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2 255 0 0\n", ["after the corners"]),
        (".ply", f"ply\nformat ascii 1.0\n{TRIANGLE}{BODY.format(chr(10))}", []),
        (
            ".ply",
            f"ply\nformat ascii 1.0\n{TRIANGLE}property list uchar int vertex_indices\n"
            "property list uchar int marks\nelement camera 1\nproperty float focus\nelement none 0\n"
            "property float y\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2 2 5 6\n50\n",
            ["elements of the PLY file omitted: camera", "lists of the PLY file omitted: marks of face"],
        ),
    ],
)
def test_what_no_array_holds_is_omitted_with_one_note_for_each_kind(tmp_path, suffix, text, notes):
    path = tmp_path / f"a{suffix}"
    path.write_text(text)
    read = read_mesh(str(path))
    assert read.mesh.n_faces == 1 and len(read.notes) == len(notes)
    assert all(words in note for words, note in zip(notes, read.notes, strict=True))


@pytest.mark.parametrize("suffix", FORMATS)
def test_further_dimensions_of_arrays_become_columns_as_the_page_says(tmp_path, suffix):
    path, tensor = str(tmp_path / f"a{suffix}"), np.arange(108.0).reshape(12, 3, 3)
    write_mesh(path, AnnotatedMesh(shapes.icosphere(0), vertex={"t": tensor, "one": tensor[:, 0, :1]}))
    back = read_mesh(path).vertex
    np.testing.assert_array_equal(back["t"], tensor if suffix == ".npz" else tensor.reshape(12, 9))
    is_flat = suffix in (".vtu", ".vtp", ".vtk", ".ply")
    np.testing.assert_array_equal(back["one"], tensor[:, 0, 0] if is_flat else tensor[:, 0, :1])
