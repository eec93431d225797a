"""Errors of the core begin with the option whose value is wrong, whatever the core calls its parameter."""

import numpy as np
import pytest

from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh


@pytest.fixture(scope="module")
def paths(tmp_path_factory):
    """A sphere, and an open grid, with vertex arrays of too few kinds of numbers."""
    folder = tmp_path_factory.mktemp("meshes")
    for name, mesh in (("ball", shapes.icosphere(1)), ("grid", shapes.grid(3, 3))):
        half = np.full(mesh.n_vertices, 0.5)
        bad = np.where(np.arange(mesh.n_vertices) == 1, np.nan, half)
        arrays = {"half": half, "bad": bad, "fields": np.stack([bad, bad, bad], axis=1)}
        write_mesh(folder / f"{name}.vtu", AnnotatedMesh(mesh, vertex=arrays))
    return {"ball": folder / "ball.vtu", "grid": folder / "grid.vtu"}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("laplacian", "ball", "--eigen", 99), "--eigen: 99 eigenpairs"),
        (("laplacian", "ball", "--form-eigen", 999), "--form-eigen: 999 eigenforms"),
        (("laplacian", "ball", "--poisson", "bad"), "--poisson: not finite at vertex 1"),
        (("laplacian", "ball", "--heat", "bad", "--duration", 1), "--heat: not finite at vertex 1"),
        (("laplacian", "ball", "--wave", 99, "--duration", 1), "--wave: vertex 99 is outside"),
        (("laplacian", "ball", "--wave", 0, "--duration", 1, "--dt", 2), "--dt: 2 is longer"),
        (("laplacian", "ball", "--harmonic"), "--harmonic: needs fixed values; add --fix ID=VALUE"),
        (("laplacian", "ball", "--fix", "0=1"), "--fix: applies to --harmonic and --poisson"),
        (("laplacian", "ball", "--harmonic", "--fix", "99=1"), "--fix: vertex 99 does not exist"),
        (("laplacian", "ball", "--cone", "0=90"), "--cone: applies to --parameterize discrete-conformal"),
        (("laplacian", "ball", "--parameterize", "discrete-conformal"), "--cone: a closed surface"),
        (("curvature", "ball", "--offset", 1, "--offset-angle", 91), "--offset-angle: must be an angle"),
        (("curvature", "ball", "--offset", 1e200), "--offset: 1e+200 has a volume"),
        (("curvature", "ball", "--region", "half"), "--region: regions are whole numbers"),
        (("curvature", "ball", "--map", "half"), "--map: an array of shape"),
        (("delaunay", "ball", "--refine", 50), "--refine: refinement to 50 degrees"),
        (("delaunay", "ball", "--transfer", "bad"), "--transfer: the array 'bad' is not finite"),
        (("repair", "ball", "--for", "curve-flow"), "--for: 'curve-flow' takes no surface"),
        (("hodge", "ball", "--field", "fields"), "--field: not finite at vertex 1"),
        (("geodesic", "ball", "--source", 99), "--source: source vertex 99 is outside 0..41"),
        (("geodesic", "ball", "--source-face", "99:1,0,0"), "--source-face: face 99 is outside"),
        (("geodesic", "ball", "--source", 0, "--path-to", 99), "--path-to: vertex 99 does not exist"),
        (("geodesic", "ball", "--source", 0, 1, "--log-map"), "--source: a tangent frame has exactly one"),
        (
            ("geodesic", "ball", "--source", 0, 1, "--spread-vector", "1,0,0"),
            "--spread-vector: 1 vector for 2",
        ),
        (("geodesic", "ball", "--trace", "99:1,0,0:1,0,0:1"), "--trace: face 99 is outside"),
        (("geodesic", "ball", "--trace", "0:1,0,0:0,0,0:1"), "--trace: line 0 has no direction"),
        (("geodesic", "ball", "--field", "fields"), "--field: the field is not finite at vertex 1"),
        (
            ("geodesic", "ball", "--source", 0, 1, "--fan", 9, "--fan-length", 1),
            "--source: a fan has exactly",
        ),
        (
            ("geodesic", "ball", "--source", 0, "--method", "heat", "--heat-time", 1e308),
            "--heat-time: the heat after",
        ),
        (("dec", "ball", "--wedge", "fields", "half"), "--wedge: an array of shape (42, 3) is not a form"),
        (("dec", "ball", "--interior-product", "half", "half"), "--interior-product: "),
        (("dec", "ball", "--star", "circumcentric", "--wedge", "fields", "half"), "--wedge: an array"),
        (("willmore-flow", "ball", "--remesh", "short"), "--remesh: 'short' is not a length"),
        (("willmore-flow", "ball", "--region", "bad"), "--region: must have one finite number"),
        (("willmore-flow", "ball", "--region", "half"), "--region: is the whole surface"),
        (("tradeoff", "curvature", "ball", "--truth", "egg:1"), "--truth: 'egg:1': unknown shape"),
        (
            ("tradeoff", "shell-sim", "pendulum", "--conserved", "momentum"),
            "pendulum: --conserved: the pivot",
        ),
        (("willmore-flow", "grid", "--fill", 5), "--fill: vertex 5 is on no boundary loop"),
    ],
)
def test_an_error_begins_with_the_option(run, paths, words, message):
    result = run(*(paths.get(word, word) for word in words))
    assert result.exit_code == 2
    line = result.stderr.partition("Error: ")[2]
    for path in paths.values():
        line = line.removeprefix(f"{path}: ")
    assert line.startswith(message), result.stderr


@pytest.mark.parametrize(("command", "name"), [("curve-flow", "CURVE"), ("willmore-flow", "MESH")])
def test_a_flow_without_input_states_that_a_resumed_run_needs_it_again(run, command, name):
    missing = f"Missing argument '{name}'"
    assert f"{missing};" in run(command).stderr
    result = run(command, "--resume", "run.vtkhdf.part")
    assert result.exit_code == 2
    assert f"{missing}. --resume needs the input again, with the options of the run" in result.stderr
