"""`ddgcli dec` on forms and fields of the input: identities, orders, places of the arrays, refusals."""

import numpy as np
import pytest

from ddgcli.io.mesh_file import read_mesh, write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.operators.dec import complex_of
from ddgcli.operators.form_products import form_products


def smooth(mesh):
    x, y = mesh.points[:, 0], mesh.points[:, 1]
    f, g = np.sin(2 * x + y), np.cos(x - 2 * y)
    centre = mesh.points[mesh.faces].mean(axis=1)
    field = np.column_stack([1 + centre[:, 1], np.sin(centre[:, 0]), np.zeros(mesh.n_faces)])
    return f, g, field


def test_the_lie_derivative_of_functions_is_the_slope_and_a_derivation_at_first_order():
    slope_error, leibniz_error = [], []
    for n in (8, 16, 32):
        mesh = shapes.grid(n, n)
        f, g, field = smooth(mesh)
        x, y = mesh.points[:, 0], mesh.points[:, 1]
        exact = (1 + y) * 2 * np.cos(2 * x + y) + np.sin(x) * np.cos(2 * x + y)
        lie = {
            name: form_products(mesh, {"lie_derivative": (field, form)}).vertex["lie_derivative"]
            for name, form in (("f", f), ("g", g), ("fg", f * g))
        }
        slope_error.append(np.abs(lie["f"] - exact).max())
        leibniz_error.append(np.abs(lie["fg"] - f * lie["g"] - g * lie["f"]).max())
    for errors in (slope_error, leibniz_error):
        assert np.log2(np.array(errors[:-1]) / errors[1:]).min() > 0.8
    assert leibniz_error[-1] < 0.1


def test_the_lie_derivative_of_a_2_form_is_the_divergence_of_the_moved_density():
    mesh = shapes.grid(24, 24)
    area = complex_of(mesh).metric.measure
    stretch = mesh.points * [1.0, 2.0, 0.0]  # on vertices: divergence 3
    moved = form_products(mesh, {"lie_derivative": (stretch, area)}).face["lie_derivative"]
    centre = mesh.points[mesh.faces].mean(axis=1)
    inside = (np.abs(centre[:, :2] - 0.5) < 0.4).all(axis=1)
    assert (moved / area)[inside] == pytest.approx(3.0, abs=1e-9)


def test_products_of_the_input_are_written_on_the_simplices_of_their_degree(summary, tmp_path):
    mesh = shapes.grid(6, 5)
    f, g, field = smooth(mesh)
    d0 = complex_of(mesh).derivatives[0]
    path, out = tmp_path / "in.npz", tmp_path / "out.npz"
    edge = {"df": d0 @ f, "dg": d0 @ g, "edges": mesh.topology.edges}
    edge["any"] = np.random.default_rng(0).normal(size=len(edge["df"]))  # a form that is not closed
    write_mesh(str(path), AnnotatedMesh(mesh, vertex={"f": f}, face={"wind": field}, edge=edge))
    result = summary(
        "dec", path, "--wedge", "df", "dg", "--interior-product", "wind", "df",
        "--lie-derivative", "wind", "df", "--forms", out,
    )  # fmt: skip
    assert result["results"]["forms"] == {"wedge": 2, "interior_product": 0, "lie_derivative": 1}
    assert result["accuracy"]["lie_commutation_residual"] < 1e-13
    written = read_mesh(str(out))
    # df ^ dg is exact, d (f dg), and i_X df = L_X f
    closed = complex_of(mesh).derivatives[1] @ (f[mesh.topology.edges].mean(axis=1) * (d0 @ g))
    assert written.face["wedge"] == pytest.approx(closed, abs=1e-14)
    slope = form_products(mesh, {"lie_derivative": (field, f)}).vertex["lie_derivative"]
    assert written.vertex["interior_product"] == pytest.approx(slope, abs=1e-13)
    assert written.edge["lie_derivative"] == pytest.approx(d0 @ slope, abs=1e-13)
    for pair in (("f", "f"), ("f", "dg"), ("any", "f")):
        assert summary("dec", path, "--wedge", *pair)["accuracy"]["leibniz_residual"] < 1e-13


@pytest.mark.parametrize(
    "words, message",
    [
        (("--forms", "x.npz"), "--forms: holds --wedge"),
        (("--wedge", "area", "df"), "--wedge: a 2-form and a 1-form have no wedge in dimension 2"),
        (("--wedge", "wind", "df"), "is not a form"),
        (("--interior-product", "wind", "f"), "--interior-product: a 0-form has no interior product"),
        (("--lie-derivative", "f", "df"), "is not a field"),
        (("--wedge", "f", "nothing"), "no array 'nothing'"),
    ],
)
def test_products_without_meaning_are_refused_in_one_line(run, tmp_path, words, message):
    mesh = shapes.grid(4, 3)
    f, _, field = smooth(mesh)
    complex_ = complex_of(mesh)
    face = {"wind": field, "area": complex_.metric.measure}
    edge = {"df": complex_.derivatives[0] @ f, "edges": mesh.topology.edges}
    write_mesh(str(tmp_path / "in.npz"), AnnotatedMesh(mesh, vertex={"f": f}, face=face, edge=edge))
    result = run("dec", tmp_path / "in.npz", *words)
    assert result.exit_code == 2 and message in result.stderr and result.stderr.count("\n") == 1


@pytest.fixture
def solid_input(tmp_path):
    """A box of tetrahedra whose 2-form is on triangles in another order and orientation."""
    mesh = shapes.box_tetrahedra(2, 2, 1)
    c = complex_of(mesh)
    x, y, z = mesh.points.T
    flux = c.derivatives[1] @ (c.derivatives[0] @ (x * y) * mesh.points[c.edges].mean(axis=1)[:, 2])
    order = np.random.default_rng(0).permutation(len(flux))
    triangles = mesh.triangles[order].copy()
    triangles[::2] = triangles[::2, [1, 0, 2]]
    whole = {"triangles": triangles, "flux": flux[order] * np.where(np.arange(len(flux)) % 2, 1, -1)}
    edge = {"dz": c.derivatives[0] @ z, "edges": mesh.edges}
    cell = {"wind": np.tile([1.0, 2.0, 0.0], (len(mesh.tetrahedra), 1)), "density": c.metric.measure}
    path = tmp_path / "solid.npz"
    write_mesh(str(path), AnnotatedMesh(mesh, vertex={"x": x}, face=cell, edge=edge, whole=whole))
    return path, mesh, flux


def test_products_on_tetrahedra_have_a_place_in_every_degree(summary, solid_input, tmp_path):
    path, mesh, flux = solid_input
    out = tmp_path / "out.npz"
    result = summary(
        "dec", path, "--wedge", "dz", "flux", "--interior-product", "wind", "density",
        "--lie-derivative", "wind", "flux", "--forms", out,
    )  # fmt: skip
    assert result["results"]["forms"] == {"wedge": 3, "interior_product": 2, "lie_derivative": 2}
    assert result["accuracy"]["lie_commutation_residual"] < 1e-12
    direct = form_products(
        mesh,
        {
            "wedge": (complex_of(mesh).derivatives[0] @ mesh.points[:, 2], flux),
            "lie_derivative": (np.tile([1.0, 2.0, 0.0], (len(mesh.tetrahedra), 1)), flux),
        },
    )
    with np.load(out) as file:
        assert np.array_equal(file["triangles"], mesh.triangles)
        assert file["wedge"] == pytest.approx(direct.face["wedge"], abs=1e-14)
        assert file["lie_derivative"] == pytest.approx(direct.triangle["lie_derivative"], abs=1e-13)
        a, b, c = np.moveaxis(mesh.points[mesh.triangles], 1, 0)
        assert file["interior_product"] == pytest.approx(np.cross(b - a, c - a) @ [0.5, 1.0, 0.0], abs=1e-14)
    # what is written is read again
    np.save(tmp_path / "ones.npy", np.ones(mesh.n_vertices))
    again = summary(
        "dec", out, "--wedge", tmp_path / "ones.npy", "lie_derivative", "--forms", tmp_path / "2.npz"
    )
    assert again["accuracy"]["leibniz_residual"] < 1e-13
    with np.load(tmp_path / "2.npz") as file:
        assert file["wedge"] == pytest.approx(direct.triangle["lie_derivative"], abs=1e-13)


def test_forms_on_triangles_that_a_format_cannot_hold_are_reported(summary, solid_input, tmp_path):
    path, _, _ = solid_input
    result = summary("dec", path, "--interior-product", "wind", "density", "--forms", tmp_path / "out.vtu")
    assert any("faces of tetrahedra (interior_product); write .npz" in w for w in result["warnings"])
    result = summary("dec", path, "--lie-derivative", "wind", "x", "--forms", tmp_path / "f.vtu")
    assert not any("holds no arrays" in w for w in result["warnings"])
    assert read_mesh(str(tmp_path / "f.vtu")).vertex["lie_derivative"] == pytest.approx(1.0)


def test_triangles_that_are_not_those_of_the_tetrahedra_are_refused(run, solid_input, tmp_path):
    _, mesh, flux = solid_input
    path = tmp_path / "wrong.npz"
    whole = {"triangles": mesh.triangles[:, [0, 1, 1]], "flux": flux}
    write_mesh(str(path), AnnotatedMesh(mesh, vertex={"x": mesh.points[:, 0]}, whole=whole))
    result = run("dec", path, "--wedge", "x", "flux")
    assert result.exit_code == 2 and "`triangles`" in result.stderr and result.stderr.count("\n") == 1
