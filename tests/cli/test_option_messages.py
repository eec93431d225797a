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
        (("willmore-flow", "grid", "--fill", 5), "--fill: vertex 5 is on no boundary loop"),
    ],
)
def test_an_error_begins_with_the_option(run, paths, words, message):
    command, mesh, *options = words
    result = run(command, paths[mesh], *options)
    assert result.exit_code == 2
    line = result.stderr.partition("Error: ")[2].removeprefix(f"{paths[mesh]}: ")
    assert line.startswith(message), result.stderr
