"""Every command on random degenerate complexes: a sound answer, a warning or a refusal, never NaN."""

import json

import numpy as np
import pytest

from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh.fields import AnnotatedMesh
from tests.degenerate_meshes import degenerate_mesh

# seeds that escaped (NaN, infinite, internal error), and some that did not
SEEDS = (5, 25, 49, 78, 99, 144, 206, 1011)
EXCESS, RESIDUAL = 0.05, 1e-6  # beyond which the summary must have a warning


def calls(mesh):
    """The options of each command, with lengths and times that fit the size of the mesh."""
    source, target = int(mesh.faces[0, 0]), int(mesh.faces[-1, 2])
    length = float(mesh.side_length.max()) or 1.0
    yield from (
        f"geodesic --source {source} --method {method} --gradient"
        for method in ("exact", "heat", "fast-marching", "dijkstra")
    )
    yield f"geodesic --source {source} --path-to {target} --log-map"
    yield f"geodesic --source {source} --method fast-marching --trace 0:0.3,0.3,0.4:1,2,3:{length:.17g}"
    yield "delaunay --condition --transfer values"
    yield f"laplacian --eigen 1 --hks {length * length:.17g}"
    yield f"laplacian --smooth {0.01 * length * length:.17g}"
    yield "laplacian --poisson values"
    yield "laplacian --parameterize harmonic"
    yield "laplacian --parameterize conformal"
    yield "hodge --field vectors"
    yield f"curvature --radius {100 * length:.17g}"
    yield f"curvature --scheme cotan --region values --region 0,0,0:{length:.17g} --vertex-vectors"
    yield f"curvature --scheme cotan --region part --offset {length:.17g}"
    yield f"geodesic --source {source} --voronoi --vertex-types"
    yield f"geodesic --source-boundary --path-to {target} --darboux"
    yield "geodesic --source-edges part --signed-distance part"
    yield f"geodesic --source {source} --fan 3 --fan-length {length:.17g}"
    yield f"laplacian --heat values --duration {length * length:.17g} --frames 2"
    yield f"laplacian --wave {source} --duration {length:.17g} --dt {0.2 * length:.17g}"
    yield "laplacian --parameterize discrete-conformal --boundary angles"
    yield "delaunay --dual dual.npz"
    yield "info"


def check_summary(summary, case):
    """Strict JSON; residuals above the bound are reported."""
    document = json.loads(summary, parse_constant=lambda name: pytest.fail(f"{case}: {name} in the summary"))
    accuracy, warnings = document["accuracy"], " ".join(document["warnings"])
    judged = {"certificate_excess": EXCESS, "poisson_residual": RESIDUAL, "harmonic_residual": RESIDUAL}
    for name, bound in judged.items():
        if (accuracy.get(name) or 0.0) > bound:
            assert name in warnings, (case, name, accuracy[name])


def check_arrays(path, case):
    with np.load(path) as data:
        reached = np.isfinite(data["geodesic_distance"]) if "geodesic_distance" in data else slice(None)
        for name in data.files:
            values = data[name]
            if values.dtype.kind != "f":
                continue
            assert not np.isnan(values).any(), (case, name)
            if name == "signed_distance":
                continue  # inf on components without curves
            if name not in ("geodesic_distance", "log_map"):
                assert np.isfinite(values).all(), (case, name)
            elif name == "log_map":
                assert np.isfinite(values[reached]).all(), case


@pytest.mark.filterwarnings("error::RuntimeWarning")  # numpy's, which notebooks would show
@pytest.mark.parametrize("seed", SEEDS)
def test_degenerate_complexes_have_results_or_one_error_line(run, tmp_path, monkeypatch, seed):
    monkeypatch.chdir(tmp_path)
    mesh, rng = degenerate_mesh(seed), np.random.default_rng(seed)
    path, output = tmp_path / "mesh.npz", tmp_path / "output.npz"
    fields = {"values": rng.normal(size=mesh.n_vertices)}
    on_faces = {"vectors": rng.normal(size=(mesh.n_faces, 3)), "part": np.arange(mesh.n_faces) % 3}
    write_mesh(str(path), AnnotatedMesh(mesh, vertex=fields, face=on_faces))
    answers = 0
    for call in calls(mesh):
        command, *options = call.split()
        output.unlink(missing_ok=True)
        result = run(command, path, *options, "-o", output, "--json")
        case = (seed, call)
        assert result.exit_code in (0, 1, 2), (case, result.stderr)
        assert "internal error" not in result.stderr, (case, result.stderr)
        if result.stdout:
            check_summary(result.stdout, case)
            check_arrays(output, case)
            answers += 1
        else:
            assert result.stderr.startswith("Error: ") and result.stderr.count("\n") == 1, case
    assert answers >= 3


def test_vertices_without_area_on_the_boundary_are_named(run, tmp_path):
    path = tmp_path / "mesh.npz"
    write_mesh(str(path), AnnotatedMesh(degenerate_mesh(144)))
    result = run("laplacian", path, "--parameterize", "harmonic")
    assert result.exit_code == 2 and "first: vertex 12" in result.stderr, result.stderr


def test_poisson_does_not_depend_on_the_scale(summary, tmp_path):
    """Means of values of 1e200 were infinite, those of 1e-200 zero."""
    from ddgcli.mesh import shapes

    mesh, values = shapes.random_sphere(60, seed=1), np.random.default_rng(0).normal(size=60)
    solutions = []
    for scale in (1.0, 1e-120, 1e120):
        path, output = tmp_path / f"{scale}.npz", tmp_path / f"out{scale}.npz"
        write_mesh(str(path), AnnotatedMesh(mesh.moved(mesh.points * scale), vertex={"f": values}))
        summary("laplacian", path, "--poisson", "f", "-o", output)
        solutions.append(np.load(output)["poisson"] / scale / scale)
    np.testing.assert_allclose(solutions[1], solutions[0], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(solutions[2], solutions[0], rtol=1e-9, atol=1e-12)
