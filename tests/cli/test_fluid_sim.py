"""`ddgcli fluid-sim` end to end: scenes, the quick form, files, refusals."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh

HEAD = 'format = "ddgcli-scene/1"\n'


def scene(path, shape, effects, time="duration = 0.1\nstep = 0.02"):
    text = f'{HEAD}[time]\n{time}\n[[object]]\nname = "f"\nrole = "fluid"\n{shape}\n[effects]\n{effects}\n'
    path.write_text(text)
    return path


SQUARE = 'grid = { size = [6.283185307179586, 6.283185307179586], cells = [32, 32], periodic = "xy" }'
BALL = "sphere = { subdivisions = 3 }"


@pytest.fixture
def ball(tmp_path):
    path = tmp_path / "ball.ply"
    mesh = shapes.icosphere(3)
    write_mesh(str(path), AnnotatedMesh(mesh, vertex={"spin": 5 * mesh.points[:, 2]}))
    return path


def test_scene_and_quick_form_are_the_same(summary, ball, tmp_path):
    words = ("--duration", 0.2, "--dt", 0.02)
    by_array = summary("fluid-sim", ball, "--vorticity", "spin", *words)["results"]
    by_text = summary("fluid-sim", ball, "--vorticity", "5*z", *words)["results"]
    file = scene(tmp_path / "s.toml", 'mesh = "ball.ply"', 'initial = { vorticity = "spin" }')
    by_scene = summary("fluid-sim", file, *words)["results"]
    assert by_array["kinetic_energy"] == by_scene["kinetic_energy"]
    assert by_text["kinetic_energy"] == pytest.approx(
        by_array["kinetic_energy"], rel=1e-6
    )  # ply holds floats
    assert by_text["kinetic_energy"] == pytest.approx(0.5 * 2.5**2 * 8 * np.pi / 3, rel=0.01)


@pytest.mark.parametrize("velocity", ["[1, 2, 3]", '["y", "z", "x"]'])
@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_rounding_of_the_mean_causes_no_warning(summary, tmp_path, velocity, scale):
    """A velocity's vorticity has no mean; that of a gradient, as of a translation, is all rounding."""
    path, ball = tmp_path / "ball.npz", shapes.random_sphere(500)
    write_mesh(str(path), AnnotatedMesh(ball.moved(scale * (ball.points + 3.0))))
    out = summary("fluid-sim", path, "--effect", f"initial velocity={velocity}", "--steps", 1, "--dt", 1e-3)
    assert not any("mean" in warning for warning in out["warnings"])


def test_mean_is_subtracted_with_a_warning(summary, ball):
    out = summary("fluid-sim", ball, "--vorticity", "5*z + 3", "--steps", 2, "--dt", 0.01)
    assert any("mean (3" in w and "subtracted" in w for w in out["warnings"])
    assert abs(out["results"]["total_vorticity"]) < 1e-12


def test_accuracy_of_the_summary_shows_conservation(summary, tmp_path):
    file = scene(tmp_path / "s.toml", SQUARE, 'initial = { flow = "taylor-green" }\nharmonic = {}')
    accuracy = summary("fluid-sim", file)["accuracy"]
    assert accuracy["divergence_max"] < 1e-14 and accuracy["total_vorticity_drift"] < 1e-14
    assert accuracy["energy_drift"] < 1e-9 and accuracy["circulation_drift"] < 1e-14


@pytest.mark.parametrize("integrator", ["conservative", "circulation"])
def test_taylor_green_vortices_decay_at_their_rate(summary, tmp_path, integrator):
    time = f'duration = 0.5\nstep = 0.05\nintegrator = "{integrator}"'
    file = scene(
        tmp_path / "s.toml", SQUARE, 'initial = { flow = "taylor-green" }\nviscosity = { nu = 0.1 }', time
    )
    results = summary("fluid-sim", file)["results"]
    rate = -np.log(results["kinetic_energy"] / results["kinetic_energy_start"]) / 0.5
    assert rate == pytest.approx(4 * 0.1, rel=0.01 if integrator == "conservative" else 0.1)
    assert results["effects"]["viscosity"]["evaluations"] == 20


@pytest.mark.parametrize("kind", ["frozen", "evolved"])
def test_harmonic_flow_on_a_torus_is_unchanged(summary, tmp_path, kind):
    path = tmp_path / "torus.ply"
    write_mesh(str(path), AnnotatedMesh(shapes.torus(36, 18)))
    effect = f'harmonic = {{ kind = "{kind}", coefficients = [1.0, -2.0] }}'
    results = summary("fluid-sim", scene(tmp_path / "s.toml", 'mesh = "torus.ply"', effect))["results"]
    assert results["harmonic_coefficients"] == [1.0, -2.0]
    assert results["kinetic_energy"] == results["kinetic_energy_start"] == pytest.approx(2.5)
    assert len(results["circulation"]["generators"]) == 2


def test_generators_have_their_circulation_without_harmonic_flows_too(summary, tmp_path):
    path = tmp_path / "torus.ply"
    write_mesh(str(path), AnnotatedMesh(shapes.torus(24, 12)))
    initial = 'initial = { vorticity = "x + z*y + z" }'
    alone, beside = (
        summary("fluid-sim", scene(tmp_path / "s.toml", 'mesh = "torus.ply"', initial + more))["results"]
        for more in ("", '\nharmonic = { kind = "frozen" }')
    )
    circulation = alone["circulation"]["generators"]
    assert len(circulation) == 2 and np.abs(circulation).max() > 0.1
    assert circulation == pytest.approx(beside["circulation"]["generators"], rel=1e-9)


def test_divided_steps_cause_a_warning(summary, tmp_path):
    out = summary("fluid-sim", scene(tmp_path / "s.toml", BALL, 'initial = { vorticity = "99*z" }'))
    assert len(out["warnings"]) == 1 and "stability" in out["warnings"][0]
    assert out["results"]["rejected_steps"] > 0 and out["results"]["smallest_step"] < 0.02


@pytest.mark.parametrize("integrator", ["circulation", "covector"])
def test_transport_is_bounded_far_beyond_the_courant_limit(summary, tmp_path, integrator):
    """Steps of 50 edge lengths: they are divided where loops would fold, and the energy never rises."""
    edge = shapes.icosphere(3).side_length.mean()
    effects = 'initial = { vorticity = "6*(5*z^3-3*z) + 12*x*y*z + 5*x" }'
    time = f'duration = {60 * edge}\nstep = {50 * edge / 3.3}\nintegrator = "{integrator}"'
    out = summary("fluid-sim", scene(tmp_path / "s.toml", BALL, effects, time))
    results = out["results"]
    assert results["kinetic_energy"] < 1.001 * results["kinetic_energy_start"]
    assert out["accuracy"]["total_vorticity_drift"] < 1e-13


@pytest.mark.parametrize("integrator", ["energy", "covector", "circulation"])
def test_steps_far_too_long_end_early_with_a_step_that_works(run, tmp_path, integrator):
    """They took minutes, of thousands of parts."""
    effects = 'initial = { vorticity = "5*z + x*y" }'
    time = f'duration = 400\nstep = 200\nintegrator = "{integrator}"'
    path = scene(tmp_path / "s.toml", BALL, effects, time)
    refused = run("fluid-sim", path, "--json")
    because = json.loads(refused.stdout)["results"]["stopped_because"]
    assert refused.exit_code == 1 and "shorter ones" in because
    step = float(re.search(r"make the step (\S+) s", because)[1])
    remedy = ("--dt", step, "--duration", 20 * step, "--frame-every", 10 * step)
    cured = json.loads(run("fluid-sim", path, "--json", *remedy).stdout)
    assert cured["results"]["rejected_steps"] == 0 and not cured["warnings"]


@pytest.mark.parametrize("speed", ["1e4", "1e12"])
def test_a_flow_beyond_every_halving_names_a_step_that_works(run, tmp_path, speed):
    effects = f'initial = {{ vorticity = "{speed}*z" }}'
    time = 'duration = 300\nstep = 100\nintegrator = "conservative"'
    path = scene(tmp_path / "s.toml", BALL, effects, time)
    refused = run("fluid-sim", path, "--json")
    because = json.loads(refused.stdout)["results"]["stopped_because"]
    step = float(re.search(r"make the step (\S+) s", because)[1])
    cured = run("fluid-sim", path, "--json", "--dt", step, "--duration", 3 * step)
    assert cured.exit_code == 0 and json.loads(cured.stdout)["results"]["rejected_steps"] == 0


def test_boundary_circulation_is_kept(summary, tmp_path):
    shape = 'grid = { size = [2, 1], cells = [24, 12], periodic = "x", pattern = "right" }'
    effects = (
        'initial = { velocity = ["1+y^2+0.1*sin(3.14159265*x)", "0", "0"] }\nharmonic = { kind = "evolved" }'
    )
    out = summary("fluid-sim", scene(tmp_path / "s.toml", shape, effects))
    assert len(out["results"]["circulation"]["boundary"]) == 2
    assert out["accuracy"]["circulation_drift"] < 1e-12
    assert out["accuracy"]["energy_drift"] < 1e-7


START = 'initial = { vorticity = "x*y + z^3" }\ndye = { amount = "x > 0" }\n'
TUBE = 'grid = { size = [2, 1], cells = [12, 6], periodic = "x" }'
FLOWS = {
    "conservative": ('mesh = "ball.ply"', "viscosity = { nu = 0.01 }", ""),
    "midpoint": ('mesh = "ball.ply"', 'viscosity = { nu = 0.01, kind = "bochner" }', 'scheme = "midpoint"'),
    "circulation": ('mesh = "ball.ply"', "", 'integrator = "circulation"'),
    "covector": ('mesh = "ball.ply"', "", 'integrator = "covector"'),
    "adaptive": ('mesh = "ball.ply"', "viscosity = { nu = 0.01 }", "tolerance = 1e-5"),
    "walls": (
        TUBE,
        'viscosity = { nu = 0.01 }\nharmonic = {}\nboundary = { kind = "no-slip", velocity = [1, 0, 0] }',
        'integrator = "circulation"',
    ),
    "divided": (TUBE, "harmonic = { coefficients = [40] }", ""),
    "frozen": (TUBE, 'harmonic = { kind = "frozen", coefficients = [1] }', ""),
}


@pytest.fixture(params=FLOWS)
def flow(request, ball, tmp_path):
    shape, effects, time = FLOWS[request.param]
    time = f"duration = 0.08\nstep = 0.02\nframe_every = 0.02\n{time}"
    return scene(tmp_path / "s.toml", shape, START + effects, time)


def test_trajectory_is_read_by_vtk(run, flow, tmp_path):
    """VTK's own reader finds times, positions, triangles, arrays and scalars equal to the last bit."""
    vtk = pytest.importorskip("vtk")
    from vtk.util.numpy_support import vtk_to_numpy

    from ddgcli.io.trajectories.trajectory import Trajectory

    assert run("fluid-sim", flow, "-o", tmp_path / "run.vtkhdf").exit_code == 0
    reader = vtk.vtkHDFReader()
    reader.SetFileName(str(tmp_path / "run.vtkhdf"))
    reader.UpdateInformation()
    with Trajectory(str(tmp_path / "run.vtkhdf")) as ours:
        assert reader.GetNumberOfSteps() == ours.n_frames == 5
        for k in range(ours.n_frames):
            reader.SetStep(k)
            reader.Update()
            shown = reader.GetOutput()
            assert reader.GetTimeValue() == ours.times[k] == pytest.approx(0.02 * k)
            assert np.array_equal(vtk_to_numpy(shown.GetPoints().GetData()), ours.points(k))
            triangles = vtk_to_numpy(shown.GetPolys().GetConnectivityArray()).reshape(-1, 3)
            assert np.array_equal(triangles, ours.mesh.faces)
            arrays = {name: vtk_to_numpy(shown.GetPointData().GetArray(name)) for name in ours.vertex(k)}
            assert set(arrays) == {"vorticity", "stream_function", "velocity", "speed", "dye"}
            assert np.allclose(arrays["speed"], np.linalg.norm(arrays["velocity"], axis=1))
            assert all(np.array_equal(arrays[name], values) for name, values in ours.vertex(k).items())
            assert {"kinetic_energy", "enstrophy", "total_vorticity", "step_size"} <= set(ours.scalars)
            for name, values in ours.scalars.items():
                field = vtk_to_numpy(shown.GetFieldData().GetArray(name))
                assert np.array_equal(np.ravel(field), np.ravel(values[k])), name
            wraps = shown.GetCellData().GetArray("wraps")
            assert (wraps is not None) == ("periodic" in flow.read_text())


def test_a_resumed_run_has_the_same_frames(run, flow, tmp_path, monkeypatch):
    from ddgcli.io.trajectories.trajectory import Trajectory
    from ddgcli.models.fluid.model import FluidModel

    file = flow
    whole, cut = tmp_path / "whole.vtkhdf", tmp_path / "cut.vtkhdf"
    assert run("fluid-sim", file, "-o", whole).exit_code == 0
    advance = FluidModel.advance

    def interrupted(self, state, time, dt):
        if time > 0.03:  # two frames after the start, of however many steps
            raise KeyboardInterrupt
        return advance(self, state, time, dt)

    monkeypatch.setattr(FluidModel, "advance", interrupted)
    assert run("fluid-sim", file, "-o", cut).exit_code == 130
    monkeypatch.setattr(FluidModel, "advance", advance)
    resumed = run("fluid-sim", "--resume", f"{cut}.part")
    assert resumed.exit_code == 0, resumed.output + resumed.stderr
    with Trajectory(str(whole)) as a, Trajectory(str(cut)) as b:
        assert a.n_frames == b.n_frames == 5
        assert (a.log_rows > 1) == ("[40]" in file.read_text())
        assert a.log[: a.log_rows].tobytes() == b.log[: b.log_rows].tobytes()
        for k in range(5):
            first, second = a.read_frame(k), b.read_frame(k)
            assert {"vorticity", "stream_function", "velocity", "speed", "dye"} <= set(first.vertex)
            assert first.time == second.time
            for name in first.vertex:
                assert np.array_equal(first.vertex[name], second.vertex[name]), name
            for name in first.scalar:
                assert np.array_equal(first.scalar[name], second.scalar[name]), name
        dye = a.read_frame(4).vertex["dye"]
        assert dye.min() >= 0 and dye.max() <= 1


def test_a_scene_imports_only_the_modules_of_its_effects(summary, ball):
    import subprocess
    import sys

    code = (
        "import sys; from click.testing import CliRunner; from ddgcli.cli.main import main; "
        f"words = ['fluid-sim', {str(ball)!r}, '--vorticity', 'z', '--steps', '1', '--dt', '0.01']; "
        "r = CliRunner().invoke(main, words); "
        "assert r.exit_code == 0, r.output; "
        "print([m for m in sys.modules if m.startswith('ddgcli.models.fluid.') or m.endswith('.harmonic')])"
    )
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    for module in (
        "boundary", "buoyancy", "circulation", "covector", "diffusion", "dye", "force", "harmonic",
        "obstacles", "particles", "pressure", "rotation", "tracer", "transport", "viscosity", "volume_space",
    ):  # fmt: skip
        assert f"fluid.{module}'" not in loaded and f"hodge.{module}'" not in loaded


@pytest.mark.parametrize(
    "effects, message",
    [
        ('initial = { vorticty = "z" }', "vorticity"),
        ('initial = { vorticity = "q + 1" }', "q"),
        ('initial = { vorticity = "1/(z-z)" }', "not finite"),
        ('initial = { flow = "storm" }', "vortex-pair"),
        ('initial = { vorticity = "z", flow = "rotation" }', "one of"),
        ('initial = { velocity = ["1", "2"] }', "three"),
        ('initial = { flow = "vortex-pair", direction = [0, 0, 0] }', "direction"),
        ('initial = { flow = "vortex-pair", center = [9, 0, 0] }', "both vortices"),
        ("viscosity = { nu = -1 }", "at least 0"),
        ('viscosity = { nu = "1 kg" }', "unit"),
        ('viscosity = { nu = 1, kind = "stokes" }', "deformation"),
        ('boundary = { kind = "free-slip" }', "no boundary"),
        ('boundary = { kind = "inflow" }', "needs velocity"),
        ("harmonic = { coefficients = [1.0] }", "0 harmonic flows"),
        ('dye = { amount = "missing.npy" }', "no such file"),
        ("gravity = {}", "shell-sim"),
    ],
)
def test_refusals_are_one_line(run, tmp_path, effects, message):
    result = run("fluid-sim", scene(tmp_path / "s.toml", BALL, effects), "--json")
    assert result.exit_code == 2 and result.stdout == ""
    assert message in result.stderr, result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert result.stderr.startswith(f"Error: {tmp_path / 's.toml'}: line 10: ")


def test_an_unknown_integrator_is_refused_with_the_list_of_those_of_fluids(run, tmp_path):
    file = scene(tmp_path / "s.toml", BALL, 'initial = { vorticity = "z" }', 'integrator = "newmark"')
    assert "circulation, conservative" in run("fluid-sim", file).stderr


@pytest.mark.parametrize(
    "effects, message",
    [
        ('boundary = { kind = "no-slip" }', "viscosity"),
        ('viscosity = { nu = 1, kind = "deformation" }', "no-slip"),
    ],
)
def test_walls_that_do_not_go_together(run, tmp_path, effects, message):
    shape = "grid = { size = [1, 1], cells = [6, 6] }"
    result = run("fluid-sim", scene(tmp_path / "s.toml", shape, effects))
    assert result.exit_code == 2 and message in result.stderr and "s.toml: line 10: " in result.stderr


def test_every_effect_is_listed(run):
    listing = json.loads(run("fluid-sim", "--effects", "--json").stdout)
    assert set(listing) == {
        "initial", "viscosity", "harmonic", "boundary", "force", "rotation", "buoyancy", "pressure", "dye",
        "particles",
    }  # fmt: skip
    assert json.loads(run("fluid-sim", "--schema").stdout)
    assert listing["rotation"]["parameters"]["angular_velocity"]["numbers"] == 3
    assert listing["dye"]["parameters"]["amount"]["numbers"] is None
    assert "angular_velocity [rad/s, 3 numbers]: " in run("fluid-sim", "--effects").stdout


SAMPLES = Path(__file__).parents[2] / "sample_scenes"


@pytest.mark.parametrize(
    "name",
    ["taylor_vortices", "taylor_vortices_merge", "vortex_pair_torus", "flow_through_holes", "flow_on_spot"],
)
def test_sample_scenes_are_sound_and_start(run, tmp_path, name):
    result = run("fluid-sim", SAMPLES / f"{name}.toml", "--steps", 2, "-o", tmp_path / "run.vtkhdf", "--json")
    assert result.exit_code == 0, result.stderr
    accuracy = json.loads(result.stdout)["accuracy"]
    assert accuracy["divergence_max"] < 1e-14 and accuracy["total_vorticity_drift"] < 1e-14


@pytest.mark.parametrize(
    "name", ["karman_street", "smoke_box", "jet_sphere", "lid_driven_cavity", "vortex_ring"]
)
def test_sample_scenes_that_are_driven_start(run, tmp_path, name):
    result = run("fluid-sim", SAMPLES / f"{name}.toml", "--steps", 1, "-o", tmp_path / "run.vtkhdf", "--json")
    assert result.exit_code == 0, result.stderr
    assert json.loads(result.stdout)["accuracy"]["divergence_max"] < 1e-11


@pytest.mark.parametrize(
    "integrator, step",
    [("conservative", 0.025), pytest.param("circulation", 0.1, marks=pytest.mark.slow)],
)
def test_the_distance_decides_whether_vortices_separate_or_merge(run, tmp_path, integrator, step):
    """The sample scenes on half as many cells: 0.8 apart they separate, 0.7 apart they do not."""
    distance = {}
    for name in ("taylor_vortices", "taylor_vortices_merge"):
        text = (SAMPLES / f"{name}.toml").read_text().replace("[128, 128]", "[64, 64]")
        path = tmp_path / f"{name}.toml"
        path.write_text(text)
        last = tmp_path / f"{name}.npz"
        result = run(
            "fluid-sim", path, "--integrator", integrator, "--dt", step, "--frame-every", 1, "-o", last
        )
        assert result.exit_code == 0, result.stderr
        with np.load(last) as last_frame:
            x, y = (last_frame["points"][:, :2] - np.pi * (last_frame["points"].min() > -1)).T
            weight = np.maximum(last_frame["vorticity"], 0) ** 2
        distance[name] = 2 * np.sqrt(np.sum(weight * (x**2 + y**2)) / weight.sum())
    assert distance["taylor_vortices"] > 1.2 and distance["taylor_vortices_merge"] < 0.9


def test_a_run_that_fails_ends_with_an_error_that_quiet_runs_print(run, tmp_path):
    fast = 'initial = { vorticity = "1e6*sin(pi*x)*sin(pi*y)" }'
    path = scene(tmp_path / "s.toml", "grid = { size = [1, 1], cells = [6, 6] }", fast)
    whole, quiet = run("fluid-sim", path), run("fluid-sim", path, "-q")
    assert whole.exit_code == quiet.exit_code == 1 and quiet.stdout == ""
    (line,) = quiet.stderr.splitlines()
    assert line.startswith("Error: t = 0 s") and "make the step" in line
    assert whole.stderr.splitlines()[-1] == line
