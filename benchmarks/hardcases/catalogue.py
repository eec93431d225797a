"""Catalogue of hard cases: what each command is run on, and what is known of the answer.

A case is a mesh (or none) and the calls of the commands on it. `{input}`, `{output}` and `{folder}` in a call
stand for the mesh file, an output file and a folder of the run. Preparing calls come before the judged one.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.hardcases import meshes
from benchmarks.hardcases.meshes import Arrays
from ddgcli.cli.main import COMMANDS
from ddgcli.models.fluid.scene import KIND as FLUID
from ddgcli.models.shell.scene import KIND as SHELLS

ROOT = Path(__file__).parents[2]
SAMPLES = ROOT / "sample_meshes"
SHARED_MESHES = Path(os.environ.get("DDGCLI_SHARED_MESHES", ROOT.parent / "shared" / "meshes"))
MAX_REAL_BYTES = 400_000  # larger real meshes take minutes on a slow machine,
CHEAP_COMMANDS = ("info", "repair", "curvature", "delaunay", "view")  # but not with these commands

Build = Callable[[], Arrays]
Call = tuple[str, ...]
Calls = tuple[Call, ...]

SHELL = ("shell-sim", "{input}", "--effect", "stretching", "--effect", "bending")
INTERRUPTED = "interrupted"  # first word of a preparing call that is killed while it runs
SHORT_RUN = ("--steps", "2", "--dt", "1e-3")

# the default call of every command; the last one is judged
CALLS: dict[str, Calls] = {
    "info": (("info", "{input}"),),
    "repair": (("repair", "{input}", "--drop-degenerate", "--drop-unused", "-o", "{output}"),),
    "curvature": (("curvature", "{input}", "-o", "{output}"),),
    "delaunay": (("delaunay", "{input}"),),
    "laplacian": (("laplacian", "{input}", "--eigen", "3"),),
    "dec": (("dec", "{input}", "-o", "{output}"),),
    "hodge": (("hodge", "{input}"),),
    "geodesic": (("geodesic", "{input}", "--source", "0", "-o", "{output}"),),
    "shell-sim": ((*SHELL, *SHORT_RUN, "-o", "{output}"),),
    "fluid-sim": (("fluid-sim", "{input}", *SHORT_RUN),),
    "willmore-flow": (("willmore-flow", "{input}", "--steps", "2", "-o", "{output}"),),
    "tradeoff": (("tradeoff", "laplacian", "{input}", "--eigen", "3", "--budget", "60"),),
    "frames": (
        (*SHELL, *SHORT_RUN, "-o", "{folder}/run.vtkhdf"),
        ("frames", "{folder}/run.vtkhdf", "--at", "0", "-o", "{output}"),
    ),
    "curve-flow": (("curve-flow", "{input}", "--steps", "2"),),
    "view": (("view", "{input}", "-o", "{folder}/page.html"),),
    "batch": (("batch", "{input}", "--table", "{folder}/table.jsonl", "--", "info"),),
    "examples": (("examples", "{folder}/examples"),),
    "check": (
        ("check", "{folder}/expected.json", "--update", "--", "info", "{input}"),
        ("check", "{folder}/expected.json", "--", "info", "{input}"),
    ),
}
COMMANDS_WITHOUT_MESH = ("examples",)
WRAPPERS = ("curve-flow", "tradeoff", "frames", "batch", "examples", "check")
MESH_COMMANDS = tuple(name for name in COMMANDS if name not in WRAPPERS)


@dataclass(frozen=True)
class Case:
    """One row of the table.

    Parameters
    ----------
    name, family : str
        The row and its group.
    build : callable, optional
        Makes (points, faces); or `path` names a file.
    parameter : float, optional
        Of a family that is pushed until it breaks.
    calls : dict of str to calls
        The commands of the row.
    expected : dict
        Truths that only the catalogue states: `betti_numbers`, `known_distance`; of a file: `load`.
    checks : tuple of str
        Names of further checks (see `judge`).
    quick : tuple of str
        Commands of the short run.
    too_large : tuple of str
        Commands that the file is too large for, by MAX_REAL_BYTES; the page marks them.
    """

    name: str
    family: str
    build: Callable[[], Arrays] | None = None
    path: Path | None = None
    parameter: float | None = None
    calls: dict[str, Calls] = field(default_factory=dict)
    expected: dict = field(default_factory=dict)
    checks: tuple[str, ...] = ()
    quick: tuple[str, ...] = ()
    too_large: tuple[str, ...] = ()


def default_calls(commands: tuple[str, ...] = MESH_COMMANDS) -> dict[str, Calls]:
    """The default calls of these commands."""
    return {name: CALLS[name] for name in commands}


# family: (generator, parameters in the order in which it gets harder, truths, label)
PUSHED_CALLS: dict[str, tuple[Callable[[float], Arrays], tuple[float, ...], dict]] = {
    "needles, aspect": (meshes.needles, (1e2, 1e4, 1e6, 1e8, 1e10, 1e12), {"betti_numbers": (1, 0, 0)}),
    "caps, aspect": (meshes.caps, (1e2, 1e4, 1e6, 1e8, 1e10, 1e12), {"betti_numbers": (1, 0, 1)}),
    "cylinder, needles": (meshes.cylinder, (300, 3e4), {"betti_numbers": (1, 1, 0)}),
    "fan, valence": (
        meshes.fan,
        (1e2, 1e3, 1e4, 1e5),
        {"betti_numbers": (1, 0, 0), "known_distance": (1, 1.0)},
    ),
    "scale, small 10^": (meshes.scaled_sphere, (-50, -100, -150), {"betti_numbers": (1, 0, 1)}),
    "scale, large 10^": (meshes.scaled_sphere, (50, 100, 150), {"betti_numbers": (1, 0, 1)}),
    "offset, diameters": (meshes.far_sphere, (1e4, 1e8, 1e12), {"betti_numbers": (1, 0, 1)}),
    "hinge, radians": (
        meshes.hinge,
        (1e-12, 1e-8, 1.0, 3.14159, 3.14159265),
        {"betti_numbers": (1, 0, 0)},
    ),
    "noise, edges": (meshes.noisy_sphere, (0.05, 0.2, 0.5, 1.0, 3.0), {"betti_numbers": (1, 0, 1)}),
    "voxel gyroid, cells": (meshes.voxel_gyroid, (12, 40), {}),
    "tetrahedra": (meshes.tetrahedra, (30, 3e3, 1e5), {}),
    "triangles": (meshes.triangles, (30, 3e3, 1e5), {}),
    "soup, faces": (meshes.soup, (100, 2e4), {}),
    "crossing faces": (meshes.voxel_soup, (10, 50, 200), {}),
    "genus": (meshes.handles, (1, 30, 1000), {}),
    "pinched squares": (meshes.pinched, (2, 50, 5000), {}),
}
SHORT_CASES = {
    ("needles, aspect", 1e8): ("delaunay",),
    ("scale, large 10^", 150): ("curvature",),
    ("tetrahedra", 3e3): ("delaunay",),
    ("genus", 30): ("hodge",),
}


def pushed_cases() -> list[Case]:
    """The generated families, parameter by parameter."""
    cases = []
    for family, (make, parameters, expected) in PUSHED_CALLS.items():
        for value in parameters:
            truths = dict(expected)
            if family == "genus":
                truths["betti_numbers"] = (1, 2 * int(value), 1)
            if family in ("tetrahedra", "triangles"):
                truths["betti_numbers"] = (int(value), 0, int(value) if family == "tetrahedra" else 0)
            cases.append(
                Case(
                    f"{family} {value:.10g}",
                    family,
                    build=partial(make, value),
                    parameter=value,
                    calls=default_calls(),
                    expected=truths,
                    quick=SHORT_CASES.get((family, value), ()),
                )
            )
    return cases


def slow_cases() -> list[Case]:
    """Calls that once took minutes, and the degenerate complexes on which exact distances did not end."""
    smoothed = [
        Case(f"smoothing a voxel gyroid of {cells} cells", "slow once", partial(meshes.voxel_gyroid, cells),
             calls={"laplacian": (("laplacian", "{input}", "--smooth", "1", "-o", "{output}"),)},
             checks=("box_does_not_grow",))
        for cells in (12, 40)
    ]  # fmt: skip
    hangs = sorted((SHARED_MESHES.parent / "regressions" / "meshes").glob("*.npz"))
    return smoothed + [
        Case(path.name, "slow once", path=path, calls=default_calls(("geodesic", "hodge", "curvature")))
        for path in hangs
    ]


def ordinary_cases() -> list[Case]:
    """One element, rest, zero loads and fields, constant functions, empty selections; others' defects."""
    triangle, square = meshes.one_triangle, meshes.square
    shell = ("stretching", "bending")
    effects = tuple(word for name in shell for word in ("--effect", name))

    def one(name: str, build: Callable[[], Arrays], command: str, *words: str, **more) -> Case:
        return Case(name, "ordinary", build, calls={command: ((command, "{input}", *words),)}, **more)

    at_rest = [
        one(f"at rest, {scheme}", square, "shell-sim", *effects, "--integrator", scheme, *SHORT_RUN,
            "-o", "{output}")
        for scheme in SHELLS.integrators
    ]  # fmt: skip
    still = [
        one(f"still fluid, {scheme}", partial(meshes.sphere, 2), "fluid-sim", "--vorticity", "0*x",
            "--integrator", scheme, *SHORT_RUN)
        for scheme in FLUID.integrators
    ]  # fmt: skip
    return [
        Case("one triangle", "ordinary", triangle, calls=default_calls(),
             expected={"betti_numbers": (1, 0, 0), "known_distance": (1, 1.0)}, quick=("geodesic",)),
        Case("triangle from its side", "ordinary", meshes.turned_triangle,
             calls=default_calls(("geodesic",)), expected={"known_distance": (2, 2**0.5)}),
        Case("kite of two triangles", "ordinary", meshes.kite, calls=default_calls(("geodesic",)),
             expected={"known_distance": (2, 2.0)}),
        one("zero gravity", square, "shell-sim", *effects, "--effect", "gravity acceleration=[0,0,0]",
            *SHORT_RUN, "-o", "{output}", quick=("shell-sim",)),
        one("zero load", square, "shell-sim", *effects, "--effect", "load force=[0,0,0] vertices=[0]",
            *SHORT_RUN, "-o", "{output}"),
        one("empty selection of pins", square, "shell-sim", *effects, "--effect", "pin vertices=[]",
            *SHORT_RUN, "-o", "{output}"),
        one("equal values at all fixed vertices", square, "laplacian", "--harmonic", "--fix", "0=2",
            "--fix", "5=2", "-o", "{output}", checks=("constant_two",)),
        one("smoothing for a tiny time", partial(meshes.sphere, 2), "laplacian", "--smooth", "1e-12",
            "-o", "{output}", checks=("points_unchanged",)),
        one("opposite corner of a square", square, "geodesic", "--source", "0", "--method", "exact",
            "-o", "{output}", expected={"known_distance": (440, 2**0.5)}),
        one("one step of a still fluid", triangle, "fluid-sim", "--steps", "1", "--dt", "1"),
        *at_rest,
        *still,
    ]  # fmt: skip


def simulator_cases() -> list[Case]:
    """Stiffness ratios, long steps, extreme viscosity."""
    square = partial(meshes.square, 6, "alternating")
    gravity = ("--effect", "gravity", "--pin", "0", "--pin", "6")

    def shell(name: str, value: float, *words: str, family: str, build: Build = square) -> Case:
        calls = {"shell-sim": (("shell-sim", "{input}", *words),)}
        return Case(name, family, build, parameter=value, calls=calls, checks=("energy_falls",))

    stiff = [
        shell(f"stiffness ratio {ratio:g}", ratio, "--effect", f"stretching stiffness={ratio:g}",
              "--effect", "bending stiffness=1", *gravity, "--integrator", "implicit-euler",
              "--steps", "5", "--dt", "1e-3", family="stiffness ratio")
        for ratio in (1e3, 1e6, 1e9)
    ]  # fmt: skip
    long_steps = [
        shell(f"{scheme}, step {dt:g} s", dt, "--effect", "stretching", "--effect", "bending", *gravity,
              "--integrator", scheme, "--steps", "5", "--dt", f"{dt:g}", family=f"step, {scheme}")
        for scheme in ("implicit-euler", "newmark", "verlet")
        for dt in (1e-4, 1e-2, 1.0)
    ]  # fmt: skip
    fluids = [
        Case(f"viscosity {nu:g}, {scheme}", f"viscosity, {scheme}", partial(meshes.sphere, 2), parameter=nu,
             calls={"fluid-sim": (("fluid-sim", "{input}", "--vorticity", "5*z+x*y", "--viscosity", f"{nu:g}",
                                   "--integrator", scheme, "--steps", "5", "--dt", "0.01"),)},
             checks=("kinetic_energy_falls",),
             quick=("fluid-sim",) if (nu, scheme) == (1e9, "conservative") else ())
        for scheme in FLUID.integrators
        for nu in (1e-300, 1e-12, 1e3, 1e9, 1e300)
    ]  # fmt: skip
    cells = 70
    pins = [
        shell(f"pins {count}", count, *SHELL[2:], "--effect", f"pin vertices={list(range(count))}",
              "--effect", "gravity", *SHORT_RUN, family="pins", build=partial(meshes.square, cells))
        for count in (10, 1000, 4000)
    ]  # fmt: skip
    return [*stiff, *long_steps, *fluids, *pins]


def restart_cases() -> list[Case]:
    """Simulators that are killed and resumed; part files that are missing, cut, foreign or of another run."""
    sphere, whole, run = partial(meshes.sphere, 3), "{folder}/whole.vtkhdf", "{folder}/run.vtkhdf"
    simulators: dict[str, tuple[Build, Call]] = {  # each runs for a second or more
        "shell-sim": (
            partial(meshes.square, 20),
            (*SHELL[1:], "--effect", "gravity", "--pin", "0", "--dt", "1e-3", "--steps", "40"),
        ),
        "fluid-sim": (sphere, ("{input}", "--vorticity", "5*z+x*y", "--dt", "0.02", "--steps", "40")),
        "willmore-flow": (sphere, ("{input}", "--steps", "20")),
    }

    def row(
        name: str, part_file: str, changed: tuple[str, ...] = (), unbroken: bool = False, **more: Any
    ) -> list[Case]:
        """A row for each simulator: killed, resumed from `part_file`, with `changed` words behind its own."""
        rows = []
        for command, (build, call) in simulators.items():
            before: Calls = ((command, *call, "-o", whole),) if unbroken else ()
            broken = (INTERRUPTED, command, *call, "-o", run)
            again = (command, *call, *changed, "--resume", part_file)
            rows.append(
                Case(
                    f"{name}, {command}", "restarts", build, calls={command: (*before, broken, again)}, **more
                )
            )
        return rows

    refused = {"refused": True}
    return [
        *row("killed and resumed", f"{run}.part", unbroken=True, checks=("resumed_as_whole",)),
        *row("resumed with another number of steps", f"{run}.part", ("--steps", "7"), expected=refused),
        *row("part file missing", "{folder}/missing.vtkhdf.part", expected=refused),
        *row("mesh in place of a part file", "{input}", expected=refused),
        *row("complete run in place of a part file", whole, unbroken=True, expected=refused),
    ]


def sample_cases() -> list[Case]:
    """Every sample with every command, by default; the wrappers on one of them."""
    names = sorted(p for p in SAMPLES.iterdir() if p.suffix not in (".md", ".py"))
    cases = [Case(p.name, "samples", path=p, calls=default_calls()) for p in names]
    cube = SAMPLES / "cube.obj"
    wrappers = Case("cube.obj, wrappers", "samples", path=cube, calls=default_calls(WRAPPERS))
    return [*cases, wrappers]


def shared_cases() -> list[Case]:
    """Files of the shared folder: hard ones, voxel surfaces, small real meshes; none where it is missing."""
    if not SHARED_MESHES.is_dir():
        return []
    hard = SHARED_MESHES / "hard"
    expect = json.loads((hard / "EXPECT.json").read_text(encoding="utf-8"))
    for truths in expect.values():
        if "euler" in truths:
            truths["euler_characteristic"] = truths["euler"]
    cases = [
        Case(path.name, "hard files", path=path, calls=default_calls(), expected=expect.get(path.name, {}))
        for path in sorted(hard.iterdir())
        if path.suffix not in (".md", ".json")
    ]
    voxel = [p for p in sorted((SHARED_MESHES / "voxel").glob("*")) if p.suffix == ".vtp"]
    real = [p for p in sorted(SHARED_MESHES.iterdir()) if p.is_file() and p.suffix not in (".md", ".py")]
    return [
        *cases,
        *(Case(f"voxel/{path.name}", "voxel", path=path, calls=default_calls()) for path in voxel),
        *map(real_case, real),
    ]


def real_case(path: Path) -> Case:
    """A real mesh; a large one by the cheap commands alone."""
    large = path.stat().st_size >= MAX_REAL_BYTES
    return Case(
        f"real meshes/{path.name}", "real meshes", path=path,
        calls=default_calls(CHEAP_COMMANDS if large else MESH_COMMANDS),
        too_large=tuple(name for name in MESH_COMMANDS if large and name not in CHEAP_COMMANDS),
    )  # fmt: skip


def catalogue() -> list[Case]:
    """All cases."""
    return [
        *pushed_cases(),
        *slow_cases(),
        *ordinary_cases(),
        *simulator_cases(),
        *restart_cases(),
        *sample_cases(),
        *shared_cases(),
    ]
