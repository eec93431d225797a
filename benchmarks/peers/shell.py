"""Seconds a step of shell-sim, by effect and integrator, beside prototypes, and MuJoCo if it is installed.

Run: `python -m benchmarks.peers.shell [SIZE ...]`, sizes 3k, 12k and 50k; default all. The feasibility
figures are those of prototypes in numpy at 20 000 triangles on another machine; each is scaled by one sparse
factorisation measured in the same run (the figure's own was 691 ms with SuperLU), so the ratio is meant to
hold on any machine. A full Newton iteration there: Hessians, scatter, factorisation, solve. Steps are those
of a cloth that has hung for 0.2 s and swings; "newton" counts moves, with or without a new Hessian.
"""

from __future__ import annotations

import importlib.util
import statistics
import sys
from functools import cache

import numpy as np

from benchmarks.common.measure import cpu_seconds, machine, print_commands, print_table
from benchmarks.common.mujoco_shells import STABLE_STEP, mujoco_step, print_strips
from ddgcli.io.scene_file import parse_scene
from ddgcli.mechanics.integrators import INTEGRATORS
from ddgcli.mechanics.system import Motion
from ddgcli.models.shell import model
from ddgcli.models.shell.scene import KIND
from ddgcli.scenes.scene import resolve
from ddgcli.simulation.account import Account

# milliseconds at 20 000 triangles (29 800 hinges), of the prototypes
FIGURES = {
    "bending force": 9.1, "bending blocks": 17.0, "stretching force": 9.5, "stretching blocks": 55.0,
    "edges force": 2.2, "quadratic force": 0.23, "scatter": 7.0,
    "copy of element values": float("nan"), "factor": 691.0, "solve": 12.0,
    "newton iteration": 17 + 55 + 7 + 691 + 12,
}  # fmt: skip
SCENE = """
[time]
step = 0.01
integrator = "{integrator}"
[[object]]
name = "s"
role = "shell"
grid = {{ size = [1, 1], cells = [{n}, {n}] }}
density = 0.2
thickness = "1 mm"
young = 1e5
poisson = 0.3
[effects]
stretching = {{ model = "{membrane}" }}
bending = {{ model = "{bending}" }}
gravity = {{}}
pin = {{ vertices = [0, {n}] }}
"""


def system(
    n: int, integrator: str = "newmark", membrane: str = "stvk", bending: str = "hinge", more: str = ""
):
    text = SCENE.format(n=n, integrator=integrator, membrane=membrane, bending=bending) + more
    scene = resolve(parse_scene(text), KIND, {})
    context, _ = model.contexts(scene, None)["s"]
    account = Account()
    return model.make_system(scene, context, account), np.array(context.mesh.points), scene.time, account


def constant_matrix_steps(n: int) -> float:
    """Steps a second of a sheet with quadratic bending alone: the matrix is factorised once."""
    text = SCENE.format(n=n, integrator="newmark", membrane="stvk", bending="quadratic")
    scene = resolve(parse_scene(text.replace('stretching = { model = "stvk" }\n', "")), KIND, {})
    context, _ = model.contexts(scene, None)["s"]
    s, x = model.make_system(scene, context, Account()), np.array(context.mesh.points)
    motions = [Motion(x, np.zeros_like(x), s.acceleration(x, 0 * x, 0.01))]

    def advance() -> None:
        motions[0] = INTEGRATORS["newmark"].step(s, motions[0], 0.01, scene.time)

    return 1e3 / best(advance, 50)


@cache
def swinging(n: int) -> Motion:
    """The cloth after 0.2 s, computed with long damping steps."""
    s, x, parameters, _ = system(n, "implicit-euler")
    motion = Motion(x, np.zeros_like(x), s.acceleration(x, 0 * x, 0.04))
    for _ in range(5):
        motion = INTEGRATORS["implicit-euler"].step(s, motion, 0.04, parameters)
    return motion


def best(call, repeat: int = 3) -> float:
    """Least milliseconds of some calls: the figures are least times too."""
    call()
    least = np.inf
    for _ in range(repeat):
        began = cpu_seconds()
        call()
        least = min(least, cpu_seconds() - began)
    return 1e3 * least


def kernels(n: int) -> dict[str, float]:
    """Milliseconds of the parts of one Newton iteration."""
    from ddgcli.linalg.factor import Factor
    from ddgcli.mechanics.assembly import Assembly

    s, x, _, _ = system(n)
    x = x + 1e-3 * np.random.default_rng(0).normal(size=x.shape)
    stretching, bending = s.potentials[0], s.potentials[1]
    edges = system(n, membrane="edges", bending="quadratic")[0].potentials
    assembly = Assembly(s.free, [stretching.stencil, bending.stencil], [True, True])
    blocks = [stretching.pair_blocks(x, "projected"), bending.pair_blocks(x, "projected")]
    diagonal = 4e4 * s.mass
    matrix = assembly.matrix(blocks, diagonal)
    factor = Factor(matrix, solver="superlu")
    rhs = np.ones(matrix.shape[0])
    milliseconds = {
        "bending force": best(lambda: bending.gradient(x)),
        "bending blocks": best(lambda: bending.pair_blocks(x, "projected")),
        "stretching force": best(lambda: stretching.gradient(x)),
        "stretching blocks": best(lambda: stretching.pair_blocks(x, "projected")),
        "edges force": best(lambda: edges[0].gradient(x)),
        "quadratic force": best(lambda: edges[1].gradient(x)),
        "scatter": best(lambda: assembly.matrix(blocks, diagonal)),
        "copy of element values": best(lambda: [block.copy() for block in blocks]),
        "factor": best(lambda: factor.refactor(matrix), 2),
        "solve": best(lambda: factor.solve(rhs, refine=False)),
    }
    names = ("bending blocks", "stretching blocks", "scatter", "factor", "solve")
    milliseconds["newton iteration"] = sum(milliseconds[name] for name in names)
    own = Factor(matrix)
    rest = sum(milliseconds[name] for name in names[:3])
    factorisation = best(lambda: own.refactor(matrix), 5)
    ratio = (rest + factorisation + best(lambda: own.solve(rhs, refine=False))) / factorisation
    print(f"a Newton iteration takes {ratio:.2f} factorisations by {own.solver}, 20 000 triangles")
    return milliseconds


def steps(
    n: int, integrator: str, membrane: str, bending: str, dt: float = 0.01, count: int = 3, more: str = ""
) -> list[float]:
    """Milliseconds a step, by part, after one step that builds the patterns; `more` effects."""
    s, _, parameters, account = system(n, integrator, membrane, bending, more)
    scheme = INTEGRATORS[integrator]
    dt = 1e-5 if np.isfinite(scheme.reach(parameters)) else dt
    begin = swinging(n)
    motion = Motion(begin.x, begin.v, s.acceleration(begin.x, begin.v, dt))
    motion = scheme.step(s, motion, dt, parameters)
    account.restore({})
    before = motion.newton
    began = cpu_seconds()
    for _ in range(count):
        with account.within("integrator"):
            s.begin_step()
            motion = scheme.step(s, motion, dt, parameters)
    total = 1e3 * (cpu_seconds() - began) / count
    booked = sum(account.seconds.values())  # by the clock on the wall; only the shares hold on a busy machine
    columns = [
        total * account.seconds.get(k, 0.0) / booked
        for k in ("stretching", "bending", "solver", "integrator")
    ]
    newton = (motion.newton - before) / count
    return [total, newton, total / newton if newton else total, *columns]


def main() -> None:
    sizes = {"3k": 39, "12k": 78, "50k": 158}
    sizes = {name: n for name, n in sizes.items() if name in sys.argv[1:] or len(sys.argv) == 1}
    print(machine())
    milliseconds = kernels(100)
    scale = milliseconds["factor"] / FIGURES["factor"]
    print_table(
        f"parts of a Newton iteration, 20 000 triangles [ms]; figures scaled by {scale:.2f}",
        ["part", "ours", "figure", "scaled", "ours / scaled"],
        [[k, f"{v:.2f}", FIGURES[k], f"{FIGURES[k] * scale:.2f}", f"{v / FIGURES[k] / scale:.2f}"]
         for k, v in milliseconds.items()],
    )  # fmt: skip
    print(f"quadratic bending alone, 20 000 triangles: {constant_matrix_steps(100):.0f} steps a second")
    if importlib.util.find_spec("mujoco") is not None:
        beside_mujoco({name: n for name, n in sizes.items() if name != "50k"})
        print_strips()
    if 78 in sizes.values():
        print_self_contact(78)
    for name, n in sizes.items():
        rows = []
        for integrator, membrane, bending in (
            ("verlet", "edges", "quadratic"), ("verlet", "stvk", "quadratic"), ("verlet", "stvk", "hinge"),
            ("newmark", "stvk", "quadratic"), ("newmark", "stvk", "hinge"),
            ("implicit-midpoint", "stvk", "hinge"), ("implicit-euler", "stvk", "hinge"),
        ):  # fmt: skip
            row = steps(n, integrator, membrane, bending, count=3 if n < 100 else 2)
            rows.append([integrator, membrane, bending, *(f"{v:.2f}" for v in row)])
        print_table(
            f"milliseconds a step of the hanging cloth, {name} triangles",
            ["integrator", "membrane", "hinges", "step", "newton", "a newton"]
            + ["stretching", "bending", "solver", "rest"],
            rows,
        )


def print_self_contact(n: int) -> None:
    """Ratio of the steps with and without self-contact of a cloth that does not touch itself, in pairs."""
    if importlib.util.find_spec("ipctk") is None:
        return
    more = "contact = { self_contact = true }\n"
    pairs = [[steps(n, "newmark", "stvk", "hinge", more=text)[0] for text in ("", more)] for _ in range(3)]
    ratio = statistics.median(after / before for before, after in pairs)
    print(f"a step with self_contact takes {ratio:.2f} of one without, {2 * n * n} triangles")


def beside_mujoco(sizes: dict[str, int]) -> None:
    """Table of our steps beside MuJoCo's, a step for a step and for the same motion."""
    rows = []
    for name, n in sizes.items():
        theirs = mujoco_step(n)
        for dt in (STABLE_STEP, 0.01):
            ours = steps(n, "newmark", "stvk", "hinge", dt)[0]
            motion = ours / dt / (theirs / STABLE_STEP)
            row = [
                f"{theirs:.1f}",
                f"{1e3 * dt:g} ms",
                f"{ours:.1f}",
                f"{ours / theirs:.1f}",
                f"{motion:.1f}",
            ]
            rows.append([name, *row])
    print_table(
        "MuJoCo, integrator discrete (CG), step 2 ms, beside our newmark with hinges; milliseconds a step",
        [
            "triangles",
            "MuJoCo",
            "our step",
            "ours",
            "a step: ours / MuJoCo",
            "a second of motion: ours / MuJoCo",
        ],
        rows,
    )


# whole commands, timed as a user starts them
COMMANDS = (
    "shell-sim hat.ply --effect bending --effect stretching --effect gravity --pin 0 --steps 10 --dt 1e-3",
)


if __name__ == "__main__":
    main()
    print_commands(*COMMANDS)
