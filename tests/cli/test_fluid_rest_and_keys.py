"""`ddgcli fluid-sim`: fluids at rest, keys without effect, and flows that need the harmonic part."""

import numpy as np
import pytest

from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh

BALL = "sphere = { subdivisions = 2 }"
TORUS = 'grid = { size = [2, 2], cells = [8, 8], periodic = "xy" }'
CHANNEL = 'grid = { size = [2, 1], cells = [8, 4], periodic = "x" }'
SQUARE = "grid = { size = [1, 1], cells = [6, 6] }"
INTEGRATORS = {
    "conservative": 'integrator = "conservative"',
    "midpoint": 'integrator = "conservative"\nscheme = "midpoint"',
    "circulation": 'integrator = "circulation"',
    "covector": 'integrator = "covector"',
}


def scene(path, shape, effects, time="", steps=1, step=0.02):
    text = f"[time]\nduration = {steps * step}\nstep = {step}\n{time}\n"
    path.write_text(f'{text}[[object]]\nname = "f"\nrole = "fluid"\n{shape}\n[effects]\n{effects}\n')
    return path


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize(
    "shape, effects",
    [
        (BALL, 'initial = { vorticity = "0" }'),
        (BALL, 'initial = { velocity = [0, 0, 0] }\nviscosity = { nu = 0 }\ndye = { amount = "0" }'),
        (TORUS, 'harmonic = {}\nviscosity = { nu = "0 m^2/s" }'),
        (SQUARE, 'viscosity = { nu = 0.1 }\nboundary = { kind = "no-slip" }\ndye = { amount = "x" }'),
        (BALL, 'initial = { flow = "rotation", strength = 0 }\nviscosity = { nu = 0.1 }'),
    ],
)
def test_a_fluid_at_rest_stays_at_rest(summary, tmp_path, shape, effects, integrator):
    out = summary("fluid-sim", scene(tmp_path / "s.toml", shape, effects, INTEGRATORS[integrator]))
    assert out["warnings"] == [] and out["results"]["kinetic_energy"] == 0
    assert set(out["accuracy"].values()) == {0.0}


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize(
    "shape, velocity", [(TORUS, "[1, 2, 0]"), (TORUS, "[1e-9, 0, 0]"), (CHANNEL, "[1, 0, 0]")]
)
def test_drifts_of_vorticity_that_is_rounding_are_rounding(summary, tmp_path, shape, velocity, integrator):
    """A translation has no vorticity: what the sums leave is no scale for its drift."""
    effects = f"initial = {{ velocity = {velocity} }}\nharmonic = {{}}"
    out = summary("fluid-sim", scene(tmp_path / "s.toml", shape, effects, INTEGRATORS[integrator], steps=3))
    assert out["warnings"] == [] and max(out["accuracy"].values()) < 1e-13


@pytest.mark.parametrize(
    "shape, flow, is_at_rest",
    [
        (SQUARE, 'flow = "rossby-haurwitz"', True),
        (SQUARE, 'flow = "vortex-pair", separation = 100', True),
        (SQUARE, 'flow = "vortex-pair"', False),
        (BALL, 'flow = "rossby-haurwitz"', False),
        (BALL, 'flow = "rotation", strength = 0', False),
    ],
)
def test_a_flow_by_name_that_moves_nothing_is_reported(summary, tmp_path, shape, flow, is_at_rest):
    out = summary("fluid-sim", scene(tmp_path / "s.toml", shape, f"initial = {{ {flow} }}"))
    assert any("leaves the fluid at rest" in text for text in out["warnings"]) is is_at_rest
    assert not is_at_rest or out["results"]["kinetic_energy"] < 1e-20


def test_vorticity_on_a_mesh_without_inner_vertices_is_reported_and_the_remedy_works(summary, tmp_path):
    coarse, fine = tmp_path / "coarse.ply", tmp_path / "fine.ply"
    write_mesh(str(coarse), AnnotatedMesh(shapes.grid(8, 1)))
    words = ("--vorticity", "1+x", "--duration", 0.1, "--dt", 0.05)
    out = summary("fluid-sim", coarse, *words)
    assert out["results"]["kinetic_energy"] == 0 and out["results"]["enstrophy"] > 1
    (warning,) = out["warnings"]
    assert "leaves the fluid at rest" in warning and "`subdivide=1`" in warning
    summary("laplacian", coarse, "--subdivide", 1, "-o", fine)
    out = summary("fluid-sim", fine, *words)
    assert out["results"]["kinetic_energy"] > 0.02
    assert not any("leaves the fluid at rest" in text for text in out["warnings"])


def test_drift_after_a_start_without_vorticity_is_relative_to_what_came(summary, tmp_path):
    effects = "initial = { velocity = [1, 0, 0] }\nharmonic = {}\nviscosity = { nu = 0.1 }\n"
    effects += 'boundary = { kind = "no-slip", velocity = [1, 0, 0], where = "y > 0.9" }'
    accuracy = summary("fluid-sim", scene(tmp_path / "s.toml", CHANNEL, effects, steps=5))["accuracy"]
    assert 0.1 < accuracy["total_vorticity_drift"] < 1.01 and 0.1 < accuracy["enstrophy_drift"] < 1.01


def test_adaptive_steps_from_rest_are_relative_too(summary, tmp_path):
    """A cavity with a lid a million times slower takes the same steps in its own time."""
    steps = {}
    for speed in (1.0, 1e-6):
        lid = f'boundary = {{ kind = "no-slip", velocity = [{speed}, 0, 0], where = "y > 0.99" }}'
        effects = f"viscosity = {{ nu = {0.1 * speed} }}\n{lid}"
        time = f"duration = {0.2 / speed}\ntolerance = 1e-4\nframe_every = {0.1 / speed}"
        text = f'[time]\n{time}\n[[object]]\nname = "f"\nrole = "fluid"\n{SQUARE}\n[effects]\n{effects}\n'
        (tmp_path / "s.toml").write_text(text)
        steps[speed] = summary("fluid-sim", tmp_path / "s.toml")["results"]["steps"]
    assert steps[1.0] == pytest.approx(steps[1e-6], rel=0.2) and steps[1.0] > 10


@pytest.mark.parametrize(
    "effects, key",
    [
        ('initial = { flow = "rotation", direction = [1, 0, 0] }', "direction"),
        ('initial = { flow = "rotation", core = 0.1 }', "core"),
        ('initial = { flow = "taylor-green", center = [0, 0, 0] }', "center"),
        ('initial = { vorticity = "z", core = 0.1 }', "core"),
        ('initial = { vorticity = "z", strength = 1 }', "strength"),
        ("initial = { velocity = [1, 0, 0], separation = 1 }", "separation"),
    ],
)
def test_a_key_without_effect_is_refused(run, tmp_path, effects, key):
    path = scene(tmp_path / "s.toml", BALL, effects)
    result = run("fluid-sim", path)
    assert result.exit_code == 2 and result.stdout == ""
    assert result.stderr.startswith(f"Error: {path}: line 10: ") and f"{key} has no effect" in result.stderr
    remedy = effects.split(f", {key}")[0] + " }"
    assert run("fluid-sim", scene(tmp_path / "s.toml", BALL, remedy)).exit_code == 0


def test_negative_strength_turns_a_flow_round(run, tmp_path):
    vorticity = {}
    for sign in ("", "-"):
        effects = f'initial = {{ flow = "vortex-pair", strength = {sign}0.5 }}'
        path = scene(tmp_path / "s.toml", BALL, effects)
        assert run("fluid-sim", path, "-o", tmp_path / "end.npz").exit_code == 0
        vorticity[sign] = np.load(tmp_path / "end.npz")["vorticity"]
    apart = np.abs(vorticity["-"] + vorticity[""]).max()
    assert np.abs(vorticity[""]).max() > 1 and apart < 0.2 * np.abs(vorticity[""]).max()


def annulus(inner, outer, around, across):
    """A flat ring of triangles."""
    angle = 2 * np.pi * np.arange(around) / around
    radius = np.linspace(inner, outer, across + 1)
    r, a = np.meshgrid(radius, angle, indexing="ij")
    points = np.stack([r * np.cos(a), r * np.sin(a), 0 * r], axis=2).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(across), np.arange(around), indexing="ij")
    a, b = (i * around + j).ravel(), (i * around + (j + 1) % around).ravel()
    c, d = a + around, b + around
    faces = np.concatenate([np.stack([a, c, d], axis=1), np.stack([a, d, b], axis=1)])
    return TriangleMesh(points, Topology(faces, len(points)))


def test_a_ring_with_a_moving_wall_needs_the_harmonic_flow(summary, tmp_path):
    """Without it there is a warning, and the flow is wrong; its remedy gives Couette's flow A r + B / r.

    On a plane all kinds of viscosity are the same, though the boundary turns.
    """
    mesh = annulus(1.0, 2.0, 48, 12)
    write_mesh(str(tmp_path / "ring.npz"), AnnotatedMesh(mesh))
    wall = 'boundary = { kind = "no-slip", velocity = ["-y", "x", 0], where = "x^2 + y^2 < 1.5" }'
    radius = np.linalg.norm(mesh.points, axis=1)
    inner = (radius > 1.01) & (radius < 1.99)
    exact = (4 / radius - radius) / 3

    def error(more, kind="hodge"):
        path = scene(
            tmp_path / "s.toml", 'mesh = "ring.npz"',
            f'viscosity = {{ nu = 1, kind = "{kind}" }}\n{wall}{more}', "", 40, 0.05,
        )  # fmt: skip
        warnings = summary("fluid-sim", path, "-o", tmp_path / "end.npz")["warnings"]
        velocity = np.load(tmp_path / "end.npz")["velocity"]
        around = (mesh.points[:, 0] * velocity[:, 1] - mesh.points[:, 1] * velocity[:, 0]) / radius
        return np.abs(around - exact)[inner].max() / exact[inner].max(), warnings

    wrong, warnings = error("")
    assert wrong > 0.3 and len(warnings) == 1 and "add the effect harmonic = {}" in warnings[0]
    right, warnings = error("\nharmonic = {}")
    assert right < 0.02 and warnings == []
    other, warnings = error("\nharmonic = {}", "deformation")
    assert other == pytest.approx(right, rel=1e-6) and warnings == []


def test_an_initial_velocity_without_room_for_its_harmonic_part_is_reported(summary, tmp_path):
    report = summary("fluid-sim", scene(tmp_path / "s.toml", TORUS, "initial = { velocity = [1, 2, 0] }"))
    assert "100 % of the energy" in report["warnings"][0] and "harmonic = {}" in report["warnings"][0]
    swirl = 'initial = { velocity = ["sin(pi*y)", 0, 0] }'
    assert summary("fluid-sim", scene(tmp_path / "s.toml", TORUS, swirl))["warnings"] == []


def test_dye_that_is_lost_shows_in_its_drift(summary, tmp_path, monkeypatch):

    effects = 'initial = { vorticity = "z" }\ndye = { amount = "x" }'
    path = scene(tmp_path / "s.toml", BALL, effects, steps=3)
    assert summary("fluid-sim", path)["accuracy"]["dye_drift"] < 1e-14
    from ddgcli.models.fluid.tracer import SurfaceTracer

    advance = SurfaceTracer.advance
    monkeypatch.setattr(SurfaceTracer, "advance", lambda *a: advance(*a) + 0.01)
    assert 0.01 < summary("fluid-sim", path)["accuracy"]["dye_drift"] < 1


def test_losses_of_circulation_are_reported_and_its_remedy_has_none(summary, tmp_path):
    """Waves of two cells between walls, which 12 cells do not resolve."""
    square = "grid = { size = [6.283185307179586, 6.283185307179586], cells = [12, 12] }"
    effects = 'initial = { vorticity = "8*sin(6*x)*sin(5*y) + 6*sin(x+2*y)" }'
    path = scene(tmp_path / "s.toml", square, effects, INTEGRATORS["circulation"], steps=30, step=0.1)
    out = summary("fluid-sim", path)
    accuracy, results = out["accuracy"], out["results"]
    for name, total in (("energy", "kinetic_energy"), ("enstrophy", "enstrophy")):
        loss = 1 - results[total] / results[f"{total}_start"]
        assert accuracy[f"{name}_lost_by_scheme"] == pytest.approx(loss, rel=1e-9, abs=1e-12)
        warned = [w for w in out["warnings"] if f"of the {name}" in w and "conservative" in w]
        assert bool(warned) == (loss > 0.05)
    assert max(accuracy["energy_lost_by_scheme"], accuracy["enstrophy_lost_by_scheme"]) > 0.05
    cured = summary("fluid-sim", path, "--integrator", "conservative", "--dt", 0.02)
    assert max(cured["accuracy"]["energy_drift"], cured["accuracy"]["enstrophy_drift"]) < 0.01
    assert not any("lost" in w for w in cured["warnings"])


def test_losses_in_a_volume_name_an_integrator_that_volumes_have(summary, tmp_path):
    box = "box = { size = [3.141592653589793, 3.141592653589793, 1], cells = [4, 4, 1] }"
    effects = 'initial = { velocity = ["sin(2*x)*cos(2*y)", "-cos(2*x)*sin(2*y)", 0] }'
    path = scene(tmp_path / "s.toml", box, effects, INTEGRATORS["covector"], steps=20, step=0.5)
    out = summary("fluid-sim", path)
    assert out["accuracy"]["energy_lost_by_scheme"] > 0.05
    (warning,) = [w for w in out["warnings"] if "of the energy" in w]
    assert "take integrator energy" in warning and "conservative" not in warning
    other = summary("fluid-sim", path, "--integrator", "energy")
    assert other["accuracy"]["energy_drift"] < 1e-12 and other["warnings"] == []


def test_friction_is_no_loss_of_the_scheme(summary, tmp_path):
    effects = 'initial = { vorticity = "z" }\nviscosity = { nu = 0.5 }'
    path = scene(tmp_path / "s.toml", BALL, effects, INTEGRATORS["circulation"], steps=10)
    out = summary("fluid-sim", path)
    assert out["accuracy"]["energy_drift"] > 0.1 and out["warnings"] == []
    assert abs(out["accuracy"]["energy_lost_by_scheme"]) < 1e-3


@pytest.mark.parametrize("integrator", ["circulation", "covector"])
def test_a_flow_that_a_wall_drives_causes_no_warning_of_losses(summary, tmp_path, integrator):
    """Shear between a wall at rest and one that moves: neither loses of it, nor corrects it."""
    grid = 'grid = { size = [2, 1], cells = [16, 12], periodic = "x" }'
    effects = 'viscosity = { nu = 0.1 }\nharmonic = {}\ninitial = { velocity = ["y", 0, 0] }\n'
    effects += '[[effects.boundary]]\nkind = "no-slip"\nvelocity = [1, 0, 0]\nwhere = "y > 0.99"\n'
    effects += '[[effects.boundary]]\nkind = "no-slip"'
    out = summary("fluid-sim", scene(tmp_path / "s.toml", grid, effects, INTEGRATORS[integrator], 100, 0.2))
    assert out["results"]["kinetic_energy"] == pytest.approx(1 / 3, rel=0.01)
    corrections = out["results"]["corrections"]
    assert corrections["scaled_energy"] < 1e-5
    assert not any("integrator" in warning for warning in out["warnings"])
    assert abs(out["accuracy"]["energy_lost_by_scheme"]) < 0.01


CAVITY = "grid = { size = [1, 1], cells = [8, 8] }"
BOX = "box = { size = [1, 1, 1], cells = [4, 4, 4] }"


@pytest.mark.parametrize(
    "integrator, shape, axis, velocity",
    [
        ("circulation", CAVITY, "y", "sin(3*t)"),
        ("covector", CAVITY, "y", "sin(3*t)"),
        ("conservative", CAVITY, "y", "20*sin(3*t)"),
        ("covector", BOX, "z", "sin(3*t)"),
    ],
)
def test_losses_of_the_scheme_do_not_depend_on_the_frames(
    summary, tmp_path, integrator, shape, axis, velocity
):
    """The wall almost rests at the end: the flow there is far below the largest of the run."""
    effects = f'viscosity = {{ nu = 0.2 }}\nboundary = {{ kind = "wall", velocity = ["{velocity}", 0, 0], '
    path = scene(
        tmp_path / "s.toml", shape, effects + f'where = "{axis} > 0.999" }}', INTEGRATORS[integrator], 10, 0.1
    )
    many, one = (summary("fluid-sim", path, "--frame-every", every) for every in (0.1, 1))
    assert (many["results"]["frames"], one["results"]["frames"]) == (11, 2)
    names = [name for name in many["accuracy"] if name.endswith("lost_by_scheme")]
    assert names and not any("lost" in warning for warning in [*many["warnings"], *one["warnings"]])
    for name in names:
        expected = pytest.approx(many["accuracy"][name], rel=1e-9, abs=1e-15)
        assert one["accuracy"][name] == expected, name


def test_adaptive_steps_of_a_uniform_flow_are_relative_to_its_speed(summary, tmp_path):
    """Its own vorticity is rounding; walls without slip then make some: both schemes end in a few steps."""
    for integrator in ("conservative", "energy"):
        path = tmp_path / "channel.toml"
        path.write_text(THROUGH_FLOW.format(integrator=integrator))
        results = summary("fluid-sim", path)["results"]
        assert results["steps"] < 200, integrator


THROUGH_FLOW = """format = "ddgcli-scene/1"
[time]
duration = 0.05
tolerance = 1e-3
integrator = "{integrator}"
[[object]]
name = "f"
role = "fluid"
grid = {{ size = [1, 1], cells = [4, 4] }}
[effects]
initial = {{ velocity = [1, 0, 0] }}
viscosity = {{ nu = 1.0 }}
[[effects.boundary]]
kind = "inflow"
velocity = [1, 0, 0]
where = "x < 1e-6"
[[effects.boundary]]
kind = "outflow"
where = "x > 1 - 1e-6"
[[effects.boundary]]
kind = "no-slip"
"""


def adaptive(path, force, integrator='integrator = "circulation"'):
    text = f"[time]\nduration = 1.0\ntolerance = 1e-4\nframe_every = 0.25\n{integrator}\n"
    effects = f"force = {{ acceleration = [{force}] }}\nviscosity = {{ nu = 0.01 }}"
    path.write_text(f'{text}[[object]]\nname = "f"\nrole = "fluid"\n{SQUARE}\n[effects]\n{effects}\n')
    return path


@pytest.mark.parametrize("integrator", [*INTEGRATORS.values(), 'integrator = "energy"'])
@pytest.mark.parametrize("force", ['"sin(x)*cos(y)", "cos(x)*sin(y)", 0', "0, -9.81, 0"])
def test_a_flow_that_is_the_rounding_of_a_balanced_force_is_none(summary, tmp_path, integrator, force):
    """Pressure balances a gradient: steps, drifts and warnings do not follow what rounding leaves."""
    out = summary("fluid-sim", adaptive(tmp_path / "s.toml", force, integrator))
    assert out["warnings"] == [] and max(out["accuracy"].values()) < 1e-7
    assert out["results"]["steps"] <= 20 and out["results"]["rejected_steps"] == 0


def test_a_flow_that_a_small_force_drives_is_no_rounding(summary, tmp_path):
    """A rotational part of a millionth of the gravity has the steps and the energy that it has alone."""
    runs = []
    for gravity in (0, 9.81):
        out = summary("fluid-sim", adaptive(tmp_path / "s.toml", f'"1e-5*y", -{gravity}, 0'))
        runs.append((out["results"]["steps"], out["results"]["kinetic_energy"]))
        assert out["accuracy"]["enstrophy_drift"] > 0.5
    (steps, energy), (steps_in_gravity, energy_in_gravity) = runs
    assert steps_in_gravity == steps and energy_in_gravity == pytest.approx(energy, rel=1e-6)


def test_flows_of_huge_strength_are_refused_or_flow(run, tmp_path):
    """The square of a strength of 1e308 was an internal error."""
    effects = 'initial = {{ flow = "taylor-vortices", strength = 1e308, core = {core}, separation = 0.8 }}'
    for core in (2**64, 0.3):
        result = run("fluid-sim", scene(tmp_path / "s.toml", TORUS, effects.format(core=core)))
        assert "internal" not in result.stderr and result.exit_code in (0, 2)


def test_steps_of_covector_from_rest_end_the_run(summary, tmp_path):
    """Interpolation loses the same share of the first speeds however short the step: steps of 1e-12 s."""
    path = tmp_path / "s.toml"
    path.write_text(
        '[time]\nduration = 0.05\ntolerance = 1e-3\nframe_every = 0.05\nintegrator = "covector"\n'
        f'[[object]]\nname = "f"\nrole = "fluid"\n{SQUARE.replace("[6, 6]", "[4, 4]")}\n'
        '[effects]\nforce = { acceleration = ["sin(3*x)*cos(3*y)", 0, 0] }\n'
    )
    assert summary("fluid-sim", path)["results"]["steps"] < 1500  # 1,076; once 7,594


@pytest.mark.parametrize("force", ["0, 0, -9.81", "0, 1e-200, 0"])
def test_a_force_without_a_tangential_part_moves_nothing(summary, tmp_path, force):
    effects = f"force = {{ acceleration = [{force}] }}\nviscosity = {{ nu = 1.0 }}"
    out = summary("fluid-sim", scene(tmp_path / "s.toml", TORUS, effects))
    assert out["warnings"] == [] and out["results"]["kinetic_energy"] == 0
