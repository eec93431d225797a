"""Dry runs beside what whole commands take: slow."""

import numpy as np
import pytest

from benchmarks.common.process import measured_command
from ddgcli.mesh import shapes
from tests.cli.test_dry_run import SHELL, write_inputs

MEASURED = {
    "info": "info {mesh} -o {out}.vtu",
    "curvature": "curvature {mesh} -o {out}.vtu",
    "delaunay": "delaunay {mesh}",
    "laplacian": "laplacian {mesh} --eigen 12",
    "poisson": "laplacian {mesh} --poisson f",
    "hodge": "hodge {mesh}",
    "dec": "dec {mesh} -o {out}.npz",
    "exact": "geodesic {mesh} --source 0",
    "heat": "geodesic {mesh} --source 0 --method heat",
    "fast-marching": "geodesic {mesh} --source 0 --method fast-marching",
    "repair": "repair {mesh} --for curvature",
    "willmore-flow": "willmore-flow {mesh} --steps 4 --dt 1e-9",
    "curve-flow": "curve-flow {curve} --steps 10 --dt 1e-9",
    "shell-sim": f"shell-sim {{mesh}} {SHELL} --pin 0 --steps 5",  # a free fall needs no factors
    "avi": f"shell-sim {{mesh}} {SHELL.replace('--dt 1e-3', '--dt 1e-5')} --integrator avi --steps 4",
    "distance matrix": "geodesic {mesh} --source 0,1,2,3,4,5 --target 7,8 --distance-matrix {out}.npz",
    "fluid-sim": "fluid-sim {mesh} --vorticity f --dt 1e-2 --steps 5",
    "view": "view {mesh} -o {out}.html",
}
MESHES = {
    "noisy sphere": (lambda: shapes.random_sphere(12_000, 3), 24_000),
    "torus": (lambda: shapes.torus(220, 100), 9_000),
}


def warped(mesh, change):
    return mesh.moved(change(mesh.points))


def graded(points):
    return points ** [3.0, 2.0, 1.0]


def noisy(points):
    """Deviations of a twentieth of an edge, which turn faces too little to look rough."""
    return points + 1e-3 * np.random.default_rng(0).standard_normal(points.shape)


TARGETS = ",".join(map(str, range(1, 3000)))
# options and meshes that change the work, unlike those of the measured kernels
OTHER_WORK = {
    "strip": ("geodesic {mesh} --source 0", lambda: shapes.grid(1000, 8, 100.0, 0.8)),
    "tube": ("geodesic {mesh} --source 0", lambda: shapes.cylinder(12, 800, 0.5, 100.0)),
    "signatures": ("laplacian {mesh} --hks 0.05", lambda: shapes.random_sphere(9000, 2)),
    "heat": ("laplacian {mesh} --heat f --duration 1 --dt 0.004", lambda: shapes.random_sphere(6000, 2)),
    "basis": ("hodge {mesh} --basis", lambda: shapes.torus(250, 80)),
    "transfer": ("delaunay {mesh} --transfer f", lambda: shapes.torus(250, 80)),
    "graded balls": ("curvature {mesh} --radius 0.03", lambda: warped(shapes.grid(100, 100), graded)),
    "stretched balls": (
        "curvature {mesh} --scheme normal-cycle --radius 0.4",
        lambda: warped(shapes.icosphere(4), lambda p: p * [1.0, 1.0, 25.0]),
    ),
    "noise": ("curvature {mesh}", lambda: warped(shapes.torus(160, 60), noisy)),
    "long trace": ("geodesic {mesh} --trace 0:1,0,0:1,0.3,0:1500", lambda: shapes.random_sphere(6000, 2)),
    "boundary": ("geodesic {mesh} --source-boundary", lambda: shapes.grid(80, 80)),
    "paths": (
        f"geodesic {{mesh}} --source 0 --path-to {TARGETS} --paths-output {{out}}.vtp",
        lambda: shapes.random_sphere(6000, 2),
    ),
    "level lines": (
        "geodesic {mesh} --source 0 --isolines 1500 --paths-output {out}.vtp",
        lambda: shapes.random_sphere(6000, 2),
    ),
    "edge paths": (
        "geodesic {mesh} " + " ".join(f"--curve {k},{k + 3000}" for k in range(100)),
        lambda: shapes.random_sphere(6000, 2),
    ),
    "refined transfer": ("delaunay {mesh} --refine 25 --transfer f", lambda: shapes.random_sphere(6000, 2)),
    "wide balls": ("curvature {mesh} --scheme corrected --radius 0.2", lambda: shapes.random_sphere(6000, 2)),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", OTHER_WORK)
def test_other_work_is_within_half_of_the_prediction(name, tmp_path):
    call, make = OTHER_WORK[name]
    assert_predicted(call, make(), 100, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("name", MEASURED)
@pytest.mark.parametrize("shape", MESHES)
def test_peak_memory_and_seconds_are_within_half_of_the_prediction(name, shape, tmp_path):
    make, n_points = MESHES[shape]
    assert_predicted(MEASURED[name], make(), n_points, tmp_path)


def assert_predicted(call, mesh, n_points, folder):
    words = call.format(**write_inputs(folder, mesh, n_points), out=folder / "out").split()
    dry, real = (measured_command([*words, "--json", *more], folder) for more in (["--dry-run"], []))
    facts = dry.summary["results"]
    assert 0.5 <= facts["peak_mib"] / real.mib <= 1.5
    assert 0.5 <= facts["seconds"] / (real.seconds + real.system_seconds) <= 1.5
