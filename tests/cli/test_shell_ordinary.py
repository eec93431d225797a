"""`shell-sim` on ordinary scenes: bodies at rest, zero strengths, everything held, equilibria that buckle."""

import json

import numpy as np
import pytest

from ddgcli.io.mesh_file import write_mesh
from ddgcli.io.trajectories.trajectory import Trajectory
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.shapes import random_sphere
from ddgcli.models.shell.report import DRIFTS

SCHEMES = [
    "newmark",
    "implicit-euler",
    "implicit-midpoint",
    "symplectic-euler",
    "verlet",
    "avi",
    "bdf2",
    "static",
]
STRIP = """
[time]
integrator = "{integrator}"
duration = {duration}
step = {step}
[[object]]
name = "strip"
role = "shell"
grid = {{ size = [1, 0.1], cells = [20, 2], pattern = "right" }}
density = 1
thickness = "5 mm"
young = 1e9
poisson = 0
[effects]
stretching = {{}}
bending = {{}}
{effects}
"""
CLAMPED = "pin = [{ box = [[0, 0, 0], [0, 1, 0]], clamp = true }]\n"


def strip_scene(folder, effects, integrator="newmark", duration=2e-3, step=1e-3):
    path = folder / "strip.toml"
    path.write_text(STRIP.format(effects=effects, integrator=integrator, duration=duration, step=step))
    return path


@pytest.mark.parametrize("integrator", SCHEMES)
@pytest.mark.parametrize("steps", [1, 4])
def test_a_body_at_rest_stays_at_rest(integrator, steps, summary, tmp_path):
    """Its energies are rounding, far from the origin too; they may not be compared with each other."""
    ball = random_sphere(60)
    write_mesh(str(tmp_path / "ball.ply"), AnnotatedMesh(ball.moved(ball.points + [3.0, -2.0, 5.0])))
    out = summary(
        "shell-sim", tmp_path / "ball.ply", "--effect", "stretching", "--effect", "bending",
        "--material", "felt",
        "--steps", steps, "--dt", 1e-4, "--integrator", integrator,
    )  # fmt: skip
    assert not any("grew" in warning for warning in out["warnings"])
    at_rest = None if integrator == "static" else 0.0
    assert {out["accuracy"][name] for name in DRIFTS} == {at_rest}


def test_a_drift_above_rounding_is_still_seen(summary, tmp_path):
    out = summary("shell-sim", strip_scene(tmp_path, "gravity = { acceleration = [0, 0, -1e-6] }"))
    assert out["accuracy"]["momentum_drift"] == pytest.approx(1.0, rel=1e-6)


def test_the_gain_of_energy_is_that_of_the_frames(summary, tmp_path):
    """While a strip slows down, the energy of symplectic Euler rises; that of implicit Euler only falls."""
    gains = {}
    for integrator in ("symplectic-euler", "implicit-euler"):
        path = strip_scene(tmp_path, CLAMPED, integrator, 5e-3)
        path.write_text(path.read_text().replace("poisson = 0", "poisson = 0\nvelocity = [0, 0, 0.3]"))
        out = summary("shell-sim", path, "-o", tmp_path / f"{integrator}.vtkhdf")
        with Trajectory(str(tmp_path / f"{integrator}.vtkhdf")) as trajectory:
            energy, kinetic = (trajectory.scalars[name] for name in ("energy", "energy_kinetic"))
        gains[integrator] = out["accuracy"]["energy_gain"]
        rise = (energy - np.minimum.accumulate(energy)).max()
        assert gains[integrator] in (0.0, pytest.approx(rise / kinetic.max(), rel=1e-6))
    assert gains["implicit-euler"] == 0.0 and gains["symplectic-euler"] > 1e-5


@pytest.mark.parametrize("integrator", SCHEMES)
@pytest.mark.parametrize(
    "effects, message",
    [
        (CLAMPED + "gravity = { acceleration = [0, 0, 0] }", "effect gravity on strip has no strength"),
        (CLAMPED + "load = { traction = [0, 0, 0] }", "effect load on strip has no strength"),
        (CLAMPED + "load = { moment = 0, vertices = [60, 61, 62] }", "effect load on strip has no strength"),
        ("gravity = {}\npin = { box = [[0, 0, 0], [1, 1, 0]] }", "every vertex of strip is held"),
        (CLAMPED + "load = { force = [0, 0, 1], vertices = [0, 1] }", "acts on held vertices alone"),
    ],
)
def test_what_cannot_act_is_reported(integrator, effects, message, summary, tmp_path):
    scene = strip_scene(tmp_path, effects, integrator, 1e-3)
    out = summary("shell-sim", scene, "-o", tmp_path / "end.npz")
    assert [message in w for w in out["warnings"] if "nothing" in w or "held" in w] == [True]
    assert out["accuracy"]["energy_drift"] == (None if integrator == "static" else 0.0)


@pytest.mark.parametrize("integrator", ["newmark", "implicit-midpoint", "bdf2"])
def test_a_shell_that_handles_move_as_a_whole_turns_without_a_rejected_step(integrator, summary, tmp_path):
    """All that is left of its energy is rounding, which no balance judges."""
    handle = (
        "handle = { box = [[0, 0, 0], [1, 1, 0]], center = [0, 0, 0], times = [0, 1], "
        "positions = [[0, 0, 0], [0, 0, 0]], "
        "rotations = [{ degrees = 0 }, { axis = [0, 1, 0], degrees = 450 }] }"
    )
    scene = strip_scene(tmp_path, handle, integrator, 1, 0.05)
    out = summary("shell-sim", scene, "-o", tmp_path / "end.npz")
    assert out["warnings"] == ["every vertex of strip is held: it moves as its handles and obstacles do"]
    assert out["results"]["rejected_steps"] == 0
    points = np.load(tmp_path / "end.npz")["points"]
    assert np.abs(points[:, 0]).max() < 1e-12 and points[:, 2].min() == pytest.approx(-1)


def test_a_moment_of_an_edge_takes_no_vertices(run, tmp_path):
    load = "load = { moment = 1, edge = [3, 4], vertices = [0] }"
    refused = run("shell-sim", strip_scene(tmp_path, load))
    assert refused.exit_code == 2 and "here: edge and vertices" in refused.stderr
    cured = run("shell-sim", strip_scene(tmp_path, load.replace(", vertices = [0]", "")))
    assert cured.exit_code == 0


@pytest.mark.parametrize("share, negative", [(0.8, 0), (1.5, 1), (12.0, 2)])
def test_static_reports_that_a_straight_strip_buckles(share, negative, summary, tmp_path):
    """Cantilever column: Euler loads are (2k - 1)^2 pi^2 D w / 4 L^2, k = 1, 2, ..."""
    force = share * 1e9 * 5e-3**3 / 12 * 0.1 * np.pi**2 / 4
    load = CLAMPED + f"load = {{ force = [{-force!r}, 0, 0], box = [[1, 0, 0], [1, 1, 0]] }}"
    out = summary("shell-sim", strip_scene(tmp_path, load, "static"))
    assert out["accuracy"]["negative_eigenvalues"] == negative
    assert any("the equilibrium is unstable" in w for w in out["warnings"]) == bool(negative)
    assert {out["accuracy"][name] for name in DRIFTS} == {None}  # no motion, nothing is conserved


def test_the_advice_for_an_unstable_equilibrium_works(summary, tmp_path):
    force = 1.5 * 1e9 * 5e-3**3 / 12 * 0.1 * np.pi**2 / 4
    load = CLAMPED + f"load = {{ force = [{-force!r}, 0, {1e-3 * force!r}], box = [[1, 0, 0], [1, 1, 0]] }}"
    out = summary("shell-sim", strip_scene(tmp_path, load, "static"), "-o", tmp_path / "end.npz")
    assert out["accuracy"]["negative_eigenvalues"] == 0 and out["warnings"] == []
    assert np.load(tmp_path / "end.npz")["points"][:, 2].max() > 0.3


SLOPE = """
gravity = {}
contact = { pairs = [["strip", "slope"]] }
[[object]]
name = "slope"
role = "obstacle"
plane = { point = [0, 0, -0.01], normal = [0.1, 0, 1] }
"""


@pytest.mark.parametrize("load_steps, attempts", [(1, 1), (8, 4)])
def test_static_on_a_slope_ends_where_nothing_holds_the_shell(load_steps, attempts, run, tmp_path):
    """The energy has no bound, and halves of a load step have none either."""
    scene = strip_scene(tmp_path, SLOPE, "static", 1e-3)
    scene.write_text(scene.read_text().replace("[time]", f"[time]\nload_steps = {load_steps}"))
    failed = run("shell-sim", scene)
    assert failed.exit_code == 1 and "motion without bound at vertex" in failed.stderr
    assert failed.stderr.count("rejected") == (attempts > 1) * 2  # the first warns, the last is the error
    effects = SLOPE.replace("contact", CLAMPED + "contact")
    assert run("shell-sim", strip_scene(tmp_path, effects, "static", 1e-3)).exit_code == 0


def test_a_step_longer_than_the_run_is_refused(run, tmp_path):
    refused = run("shell-sim", strip_scene(tmp_path, "gravity = {}", duration=1, step=5))
    assert refused.exit_code == 2 and refused.stderr.count("\n") == 1
    assert "line 5: step = 5 s is longer than the duration of 1 s; write step = 1 or less" in refused.stderr
    assert run("shell-sim", strip_scene(tmp_path, "gravity = {}", duration=1, step=1)).exit_code == 0
    assert (
        run("shell-sim", strip_scene(tmp_path, "gravity = {}", duration=1, step=5), "--dt", 1).exit_code == 0
    )
    short = run("shell-sim", strip_scene(tmp_path, "gravity = {}", duration=1e-3, step=5), "--dt", 5)
    assert short.exit_code == 2
    assert "--dt: 5 is longer than the duration of 0.001; give 0.001 or less" in short.stderr
    assert "line" not in short.stderr  # the scene has another step


def test_the_default_step_is_no_longer_than_the_run(run, tmp_path):
    path = strip_scene(tmp_path, "gravity = {}", duration=1e-3)
    path.write_text(path.read_text().replace("step = 0.001\n", ""))
    done = run("shell-sim", path, "--json")
    assert done.exit_code == 0 and json.loads(done.stdout)["results"]["time"] == 1e-3


@pytest.mark.parametrize("options", [
    "--dt 1e-300 --steps 1", "--duration 1e-300 --dt 1e-300", "--duration 1e300", "--frame-every 1e-300",
])  # fmt: skip
def test_a_time_beyond_the_range_of_numbers_is_refused_at_its_option(options, run, tmp_path):
    refused = run("shell-sim", strip_scene(tmp_path, CLAMPED, "newmark", 1e-3), *options.split())
    named = "--dt" if "--dt" in options else options.split()[0]
    assert refused.exit_code == 2 and f".toml: {named}: 1e" in refused.stderr


LIGHT = """format = "ddgcli-scene/1"
[time]
integrator = "static"
[[object]]
name = "ball"
role = "shell"
sphere = {{ subdivisions = 1 }}
material = "steel"
[effects]
stretching = {{}}
bending = {{ model = "midedge" }}
gravity = {{ acceleration = [0, 0, {gravity}] }}
pin = {{ vertices = {pins} }}
"""


def reactions(summary, path, gravity, pins):
    """Reaction force at an equilibrium, and the warnings about loads below rounding."""
    path.write_text(LIGHT.format(gravity=gravity, pins=pins))
    out = summary("shell-sim", path)
    force = np.array(out["results"]["reaction_forces"]["pin"]["force"])
    return force, [w for w in out["warnings"] if "below the rounding" in w]


HANGING = """[time]
integrator = "static"
[[object]]
name = "cloth"
role = "shell"
material = "cotton"
grid = {{ size = [1, 1], cells = [6, 6] }}
[effects]
stretching = {{}}
bending = {{}}
gravity = {{ acceleration = [0, 0, {gravity}] }}
pin = {{ vertices = [0, 1, 2, 3, 4, 5, 6], clamp = {clamp} }}
"""


@pytest.mark.parametrize("gravity", [-1e-12, -1e-16])
def test_a_cloth_on_hinges_under_loads_below_rounding_asks_for_larger_ones(run, tmp_path, gravity):
    """Once the remedy was to lessen them. Both remedies of the message let it come to rest."""
    path = tmp_path / "cloth.toml"
    path.write_text(HANGING.format(gravity=gravity, clamp="false"))
    result = run("shell-sim", path)
    assert result.exit_code == 1 and "hold the shell by pins or apply loads" in result.stderr
    times = float(result.stderr.split("apply loads ")[1].split()[0])
    for remedy in ({"gravity": times * gravity, "clamp": "false"}, {"gravity": gravity, "clamp": "true"}):
        path.write_text(HANGING.format(**remedy))
        assert run("shell-sim", path).exit_code == 0


def test_an_equilibrium_under_loads_below_rounding_warns_with_loads_that_are_not(summary, tmp_path):
    """The pins bear the weight to the tenth that the warning allows, vertices below rounding do not."""
    path, gravity, pins = tmp_path / "ball.toml", -1e-9, [0, 1, 2]
    _, (warning,) = reactions(summary, path, gravity, pins)
    gravity *= float(warning.split("apply loads ")[1].split()[0])
    force, warnings = reactions(summary, path, gravity, pins)
    assert not warnings
    full, warnings = reactions(summary, path, -9.81, pins)
    assert not warnings
    weight = full[2] / 9.81 * -gravity
    assert force == pytest.approx([0, 0, weight], abs=0.1 * weight)


def test_needles_of_another_shell_are_no_fault_of_a_load_below_rounding(summary, tmp_path):
    """The run failed for the needles of a plate that is held."""
    mesh = shapes.grid(3, 3)
    points = mesh.points.copy()
    points[4:8, 0] = points[0, 0] + 1e-6
    write_mesh(str(tmp_path / "needles.npz"), AnnotatedMesh(mesh.moved(points)))
    plate = '[[object]]\nname = "plate"\nrole = "shell"\nmesh = "needles.npz"\nmaterial = "steel"\n'
    pins = '[[effects.pin]]\nobject = "ball"\nvertices = [0, 1, 2]\n'
    pins += '[[effects.pin]]\nobject = "plate"\nbox = [[-9, -9, -9], [9, 9, 9]]\n'
    text = LIGHT.format(gravity=-1e-9, pins=[]).replace("[effects]", plate + "[effects]")
    (tmp_path / "two.toml").write_text(text.replace("pin = { vertices = [] }\n", pins))
    (warning,) = [w for w in summary("shell-sim", tmp_path / "two.toml")["warnings"] if "object ball" in w]
    assert "apply loads" in warning and "sides below" not in warning


def test_a_shell_that_turns_freely_under_a_load_below_rounding_is_to_be_held(summary, tmp_path):
    _, (warning,) = reactions(summary, tmp_path / "ball.toml", -1e-30, [0])
    assert "3 of 6 rigid motions free, hold it by pins" in warning
    _, warnings = reactions(summary, tmp_path / "ball.toml", 0, [0])
    assert not warnings
