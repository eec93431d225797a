"""`tradeoff --conserved`: drift of energy and momenta of a pendulum, an oscillator and free shells."""

import numpy as np
import pytest

from benchmarks.common.scenes import FREE_SCENE
from ddgcli.errors import ParameterError
from ddgcli.io.scene_file import parse_scene
from ddgcli.mechanics.integrators import INTEGRATORS
from ddgcli.models.shell.scene import EFFECTS
from ddgcli.simulation.model import parts_of_step
from ddgcli.tradeoff.problems.conservation import Spring, Weight, example_problem, scene_problem

DYNAMIC = [name for name in INTEGRATORS if name != "static"]


def drifts(problem):
    """Drift of each candidate by its number of steps, longest step first."""
    return {c.parameters["dt"]: float(c.solve(c.setup())[0]) for c in problem.candidates}


def of(name, quantity, integrator, **options):
    problem = example_problem(name, quantity, options={"integrator": integrator, **options})
    return list(drifts(problem).values())


@pytest.mark.parametrize("integrator, order", [("symplectic-euler", 1), ("verlet", 2)])
def test_the_energy_of_a_symplectic_scheme_oscillates_with_its_order(integrator, order):
    error = of("pendulum", "energy", integrator)
    rates = np.log2(np.array(error[:-1]) / error[1:])[::-1]
    assert rates[0] == pytest.approx(order, abs=0.3)
    twice = of("pendulum", "energy", integrator, duration=160.0)
    assert twice[-1] < 1.2 * error[-1], "bounded: four times the time has no larger error"


def test_implicit_euler_loses_the_energy_that_the_midpoint_rule_keeps():
    euler, midpoint = (drifts_of_one(f"implicit-{rule}", "energy")[0] for rule in ("euler", "midpoint"))
    assert euler > 0.5 and midpoint < 0.02


def drifts_of_one(integrator, quantity, name="pendulum"):
    """Drift with the middle step only."""
    problem = example_problem(name, quantity, options={"integrator": integrator, "duration": 20.0})
    middle = [c for c in problem.candidates if c.parameters["dt"] == pytest.approx(0.1)]
    return [float(c.solve(c.setup())[0]) for c in middle]


@pytest.mark.parametrize("integrator", ["symplectic-euler", "verlet", "implicit-midpoint"])
@pytest.mark.parametrize("quantity", ["momentum", "angular-momentum"])
def test_variational_schemes_keep_both_momenta_of_an_oscillator(integrator, quantity):
    assert drifts_of_one(integrator, quantity, "oscillator")[0] < 1e-8


@pytest.mark.parametrize("term, x", [
    (Spring(3.0, 0.7), [[0.1, 0.2, 0.3], [1.0, -0.4, 0.2]]), (Weight(), [[0, 0, 0], [0.8, 0, 0]]),
])  # fmt: skip
def test_gradients_and_hessians_of_the_examples_equal_finite_differences(term, x):
    x, h = np.array(x, dtype=float), 1e-6
    direction = np.array([[0.3, -0.2, 0.5], [-0.1, 0.7, 0.4]])
    slope = (term.energy(x + h * direction) - term.energy(x - h * direction)) / (2 * h)
    assert (term.gradient(x) * direction).sum() == pytest.approx(slope, rel=1e-7)
    change = (term.gradient(x + h * direction) - term.gradient(x - h * direction)) / (2 * h)
    rows = term.stencil[0]
    hessian = term.blocks(x, "exact")[0] @ direction[rows].ravel()
    assert hessian == pytest.approx(change[rows].ravel(), rel=1e-6, abs=1e-9)


def free_shell(**options):
    document = parse_scene(FREE_SCENE.format(integrator="verlet", step=2e-3, duration=0.05), "free.toml")
    return document, options


def test_a_free_shell_keeps_its_momenta_with_every_scheme():
    document, _ = free_shell()
    for quantity in ("momentum", "angular-momentum"):
        problem = scene_problem(document, None, quantity, options={"integrator": "verlet"})
        assert max(drifts(problem).values()) < 1e-11
    problem = scene_problem(document, None, "energy", options={"integrator": "verlet"})
    error = list(drifts(problem).values())
    assert error[-1] < 0.3 * error[0] < 0.3


def test_conservation_that_a_system_does_not_have_is_refused():
    with pytest.raises(ParameterError, match="pivot of a pendulum"):
        example_problem("pendulum", "momentum")
    with pytest.raises(ParameterError, match="not one of"):
        example_problem("oscillator", "charge")
    with pytest.raises(ParameterError, match="changes nothing in this comparison"):
        example_problem("oscillator", "energy", options={"tolerance": 1e-3})
    text = FREE_SCENE.format(integrator="verlet", step=2e-3, duration=0.05)
    heavy = parse_scene(text.replace("[effects]", "[effects]\ngravity = {}"), "heavy.toml")
    with pytest.raises(ParameterError, match="effect gravity changes the momentum"):
        scene_problem(heavy, None, "momentum")


TABLE = '[[object]]\nname = "t"\nrole = "obstacle"\nplane = { point = [0, 0, -0.1], normal = [0, 0, 1] }'
SECOND = (
    '[[object]]\nname = "u"\nrole = "shell"\ngrid = { size = [1, 1], cells = [2, 2] }\nposition = [0, 0, 1]'
)


def scene_with(effect, objects=TABLE):
    text = FREE_SCENE.format(integrator="verlet", step=2e-3, duration=0.02)
    text = text.replace("[effects]", f"{objects}\n[effects]\n{effect}")
    return parse_scene(text, "scene.toml")


DISSIPATIVE = {
    "damping": ("{ mass = 1 }", "effect damping"),
    "wind": ("{}", "effect wind"),
    "plasticity": ("{ yield_strain = 0.1 }", "effect plasticity"),
    "fracture": ('[{ object = "s", strain = 0.1 }]', "effect fracture"),
    "handle": ("[{ vertices = [0], times = [0, 1], positions = [[0, 0, 0], [1, 0, 0]] }]", "the prescribed"),
    "load": (
        "[{ force = [0, 0, 1], vertices = [0], times = [0, 1], factors = [0, 1] }]",
        "effect load, which depends on time,",
    ),
    "contact": ('{ pairs = [["s", "t"]], friction = 0.5 }', "the friction of contact"),
}
CONSERVATIVE = {"stretching", "bending", "gravity", "pressure", "rigid", "pin", "attach"}


def test_every_effect_is_one_that_keeps_the_energy_or_one_that_is_refused():
    assert set(EFFECTS.entries) == CONSERVATIVE | set(DISSIPATIVE)


@pytest.mark.parametrize("effect", DISSIPATIVE)
def test_an_effect_that_changes_the_energy_is_refused(effect):
    """Contact with friction passed, and its work counted as the error of the integrators."""
    line, cause = DISSIPATIVE[effect]
    with pytest.raises(ParameterError, match=f"{cause}.* changes the energy; use a scene without it"):
        scene_problem(scene_with(f"{effect} = {line}"), None, "energy")


@pytest.mark.parametrize("contact, objects, cause", [
    ('pairs = [["s", "u"]], friction = 0.5', SECOND, "the friction of contact"),
    ("self_contact = true, friction = 0.5", "", "the friction of contact"),
    ('pairs = [["s", "t"]]', f"{TABLE}\nvelocity = [0, 0, 0.1]", "effect contact, which depends on time,"),
])  # fmt: skip
def test_contact_that_changes_the_energy_is_refused(contact, objects, cause):
    pytest.importorskip("ipctk")
    with pytest.raises(ParameterError, match=cause):
        scene_problem(scene_with(f"contact = {{ {contact} }}", objects), None, "energy")


def test_the_momenta_are_those_of_whole_groups_of_shells():
    """Contact between shells exchanges momentum, an obstacle takes it up."""
    pytest.importorskip("ipctk")
    pair = scene_with('contact = { pairs = [["s", "u"]], gap = "2 cm" }', SECOND.replace("1]", "0.015]"))
    problem = scene_problem(pair, None, "momentum", options={"integrator": "newmark", "steps": 4})
    longest = problem.candidates[0]
    assert longest.solve(longest.setup())[0] < 1e-11
    with pytest.raises(ParameterError, match="effect contact to obstacle 't' changes the momentum"):
        scene_problem(scene_with('contact = { pairs = [["s", "t"]] }'), None, "momentum")
    with pytest.raises(ParameterError, match="effect attach to obstacle 't' changes the angular momentum"):
        attach = 'attach = [{ object = "s", to = "t", vertices = [0] }]'
        scene_problem(scene_with(attach), None, "angular-momentum")
    with pytest.raises(ParameterError, match="the friction of contact changes the angular momentum"):
        scene_problem(
            scene_with("contact = { self_contact = true, friction = 0.1 }"), None, "angular-momentum"
        )


def test_rows_are_estimated_with_the_steps_that_they_take(caplog):
    """Explicit ones were with steps above their stability limit, came first and took the whole budget."""
    problem = scene_problem(scene_with(""), None, "energy", options={"step": 2e-3, "steps": 100})
    work = [candidate.work for candidate in problem.candidates]
    assert work == sorted(work)
    shortest = {}
    for candidate in problem.candidates:
        shortest.setdefault(candidate.method, []).append(candidate)
    verlet = [candidate.work for candidate in shortest["verlet"]]
    model = shortest["verlet"][0].setup()[0]["s"]
    taken = [
        c.parameters["dt"] / parts_of_step(c.parameters["dt"], model.largest_step) for c in shortest["verlet"]
    ]
    assert min(taken) < 0.2 * max(c.parameters["dt"] for c in shortest["verlet"])
    assert np.array(verlet) * taken == pytest.approx(verlet[0] * taken[0])
    assert caplog.messages == [], "the times between frames are whole numbers of steps"


def test_the_command_ranks_integrators_of_the_pendulum(summary, run, tmp_path):
    words = ("--conserved", "energy", "--duration", 4, "--integrator", "verlet")
    limits = ("--repeat", 1, "--budget", 600, "--plot", tmp_path / "p.png")
    report = summary("tradeoff", "shell-sim", "pendulum", *words, *limits)
    results = report["results"]
    rows = results["rows"]
    assert len(rows) == 4 and results["error_scale"] == "the largest kinetic energy of the run"
    assert "--conserved energy --integrator verlet --dt" in rows[0]["command"]
    assert results["reference"].startswith("known truth: the energy")
    result = run("tradeoff", "geodesic", "x.ply", "--conserved", "energy")
    assert result.exit_code == 2 and "--conserved: compares integrators of shell-sim" in result.stderr
