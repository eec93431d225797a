"""Every remedy that a refusal of `willmore-flow` names is run, as its message words it."""

import re
import shlex

import numpy as np
import pytest

from ddgcli.choices import WILLMORE_BOUNDARIES, WILLMORE_ENERGIES, WILLMORE_FLOWS
from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from tests.physics.willmore_runs import bowl

MEAN = ("--flow", "mean-curvature")
VALUES = {
    "--dt": "1e-4",
    "--duration": "1e-4",
    "--energy": "cotan",
    "--remesh": "mean",
}  # where none is named
FLAGS = ("--fix-area", "--fix-volume", "--remesh-adaptive")
OPTION = re.compile(r"(--[a-z-]+)(?: (?!or\b|and\b|out\b)([a-z][a-z-]*))?")


def two_balls():
    ball = shapes.icosphere(1)
    return TriangleMesh.from_arrays(
        np.concatenate([ball.points, ball.points + 5.0]), np.concatenate([ball.faces, ball.faces + 42])
    )


def flat_box():
    """Closed, with no volume: the two sides of a square turned into each other."""
    one = shapes.grid(4, 4, pattern="alternating")
    rim = one.topology.boundary_vertex
    number = np.where(rim, np.arange(25), 0)
    number[~rim] = 25 + np.arange(np.count_nonzero(~rim))
    points = np.concatenate([one.points, one.points[~rim] + [0, 0, -0.1]])
    points[:25][~rim] += [0, 0, -0.1]
    points[25:] += [1e-3, 0, 0]
    return TriangleMesh.from_arrays(points, np.concatenate([one.faces, number[one.faces][:, ::-1]]))


MESHES = {
    "ball": lambda: shapes.icosphere(1),
    "finer ball": lambda: shapes.icosphere(2),
    "bowl": bowl,
    "tube": lambda: shapes.cylinder(8, 4),
    "two": two_balls,
    "flat": flat_box,
}


def with_option(words, name, value=""):
    """The words with an option, in place of its value there if there is one."""
    words = without(words, name)
    return words + ((name,) if name in FLAGS else (name, value or VALUES[name]))


def without(words, name):
    """The words without an option and its value."""
    if name not in words:
        return words
    at = words.index(name)
    return words[:at] + words[at + (1 if name in FLAGS else 2) :]


def remedies(message, words):
    """Commands that a refusal names, each as (command of repair or None, words of the flow)."""
    commands = []
    if repair := re.search(r"ddgcli (repair .*? -o \S+)", message):
        commands.append((shlex.split(repair[1]), words))
    if drops := re.search(r"leave (--.*?) out", message):
        fewer = words
        for name in re.findall(r"--[a-z-]+", drops[1]):
            fewer = without(fewer, name)
        commands.append((None, fewer))
    if "keep one of them" in message:
        commands += [(None, without(words, name)) for name in ("--fix-area", "--fix-volume")]
    if advice := re.search(r"\buse (--.*|.*--energy.*)", message):
        start = without(without(words, "--dt"), "--duration") if "leave --dt" in message else words
        commands += [(None, with_option(start, *option)) for option in OPTION.findall(advice[1])]
    if needs := re.search(r"(--[a-z-]+):? needs (--[^;:]*)", message):
        commands += [(None, with_option(words, *option)) for option in OPTION.findall(needs[2])]
    if choice := re.search(r"(\w+): '\w+' is not available.*choose (?:one of )?(.*)$", message):
        for value in re.split(r", | or ", choice[2]):
            commands.append((None, with_option(words, f"--{choice[1]}", value)))
    if span := re.search(r"(--[a-z-]+): must be from \S+ to (\S+) (?:on|here)", message):
        commands.append((None, with_option(words, *span.groups())))  # remesh, the least: five million faces
    if number := re.search(r"vertex (\d+) is\)", message):
        commands.append((None, with_option(words, "--fill", number[1])))
    if written := re.search(r"(--[a-z-]+).*(?:write|name) (.*)$", message):
        values = re.findall(r"\ball$|\bmean$", written[2])
        commands += [(None, with_option(words, written[1], value)) for value in values]
    return commands


REFUSALS = [
    ("two", ("--flow", "conformal"), 1),
    ("two", ("--fix-area", "--fix-volume", "--remesh", "0.5"), 2),
    ("two", (*MEAN, "--fix-volume"), 1),
    ("tube", ("--flow", "conformal"), 1),
    ("ball", ("--flow", "conformal", "--fix-volume"), 1),
    ("ball", ("--flow", "conformal", "--spontaneous-curvature", "1", "--fix-area"), 1),
    ("ball", ("--flow", "conformal", "--dt", "1e-3"), 1),
    ("tube", ("--fix-volume",), 1),
    ("bowl", ("--fix-volume",), 1),
    ("bowl", ("--flow", "conformal"), 1),
    ("bowl", (*MEAN, "--fix-area"), 1),
    ("tube", (*MEAN, "--fix-area"), 1),
    ("bowl", (*MEAN, "--boundary", "free"), 1),
    ("bowl", ("--energy", "gauss-map", "--boundary", "free"), 2),
    ("ball", (*MEAN, "--fix-area", "--fix-volume"), 3),
    ("ball", (*MEAN, "--energy", "cotan", "--fix-volume"), 1),
    ("flat", ("--fix-volume",), 1),
    ("flat", (*MEAN, "--fix-area"), 1),
    ("ball", ("--fill", "all"), 1),
    ("tube", ("--fill", "x"), 1),
    ("tube", ("--fill", "999"), 1),
    ("tube", ("--fill", "all", "--region", "0.txt"), 1),
    ("ball", ("--region", "all.npy"), 1),
    ("ball", ("--spontaneous-curvature", "1"), 2),
    ("ball", ("--spontaneous-curvature", "1", "--fix-area", *MEAN), 1),
    ("ball", ("--spontaneous-curvature", "1e300", "--fix-area"), 1),
    ("ball", ("--energy", "quadratic"), 3),
    ("ball", ("--energy", "hinge", "--flow", "circle-angle"), 1),
    ("ball", ("--flow", "newton", "--dt", "1e-3"), 2),
    ("finer ball", ("--remesh-adaptive",), 1),
    ("finer ball", ("--remesh", "100"), 1),
    ("finer ball", ("--remesh", "x"), 1),
    ("finer ball", ("--remesh", "mean", "--dt", "1e-3"), 3),
    ("finer ball", ("--remesh", "mean", "--energy", "hinge"), 1),
    ("ball", ("--frame-every", "1"), 2),
    ("ball", ("--tolerance", "10"), 1),
    ("ball", ("--integrator", "semi-implicit"), 2),
    ("ball", ("--integrator", "verlet", "--dt", "1e-3"), 2),
    ("ball", ("--integrator", "rosenbrock", "--dt", "1e-3", *MEAN), 1),
    ("ball", ("--report-energy", "x"), 1),
    ("bowl", ("--boundary", "loose"), len(WILLMORE_BOUNDARIES)),
    ("tube", ("--energy", "helfrich"), len(WILLMORE_ENERGIES)),
    ("ball", ("--flow", "ricci"), len(WILLMORE_FLOWS)),
]


@pytest.mark.parametrize(
    "mesh, words, count", REFUSALS, ids=lambda value: " ".join(map(str, np.ravel(value)))
)
def test_every_remedy_that_a_refusal_names_is_accepted(run, tmp_path, monkeypatch, mesh, words, count):
    monkeypatch.chdir(tmp_path)
    np.save("all.npy", np.ones(42))
    np.savetxt("0.txt", [20], fmt="%d")
    write_mesh("mesh.ply", AnnotatedMesh(MESHES[mesh]()))
    refused = run("willmore-flow", "mesh.ply", *words)
    assert refused.exit_code == 2 and len(refused.stderr.splitlines()) == 1 and "`" not in refused.stderr
    commands = remedies(refused.stderr.strip(), words)
    assert len(commands) == count, refused.stderr
    for repair, cured in commands:
        if repair is not None:
            assert repair[1] == "mesh.ply" and run(*repair).exit_code == 0
        steps = () if {"--duration", "--dt"} & set(cured) else ("--steps", 1)
        if "--dt" in cured and "--duration" not in cured:
            steps = ("--steps", 1)
        accepted = run("willmore-flow", repair[-1] if repair else "mesh.ply", *cured, *steps)
        assert accepted.exit_code == 0, f"{refused.stderr}{cured}: {accepted.stderr}"
