"""Random words of a call: options by introspection of the commands, values by the type of each option."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from functools import cache
from random import Random
from typing import Any

import click
import numpy as np

from benchmarks.fuzz.call_meshes import CURVE, SUFFIXES, SURFACE, TETRAHEDRA, mesh_arrays, random_mesh
from benchmarks.fuzz.scenes import FLUID_EFFECTS, SHELL_EFFECTS, SceneObjects, toml
from ddgcli.choices import UP_AXES, WILLMORE_BOUNDARIES, WILLMORE_ENERGIES, WILLMORE_FLOWS
from ddgcli.cli.commands.check import KeyTolerance
from ddgcli.cli.commands.curvature import Radius
from ddgcli.cli.commands.curvature_measures import Region
from ddgcli.cli.commands.geodesic_curves import TraceStart
from ddgcli.cli.commands.laplacian import FixedValue
from ddgcli.cli.main import main as command_line
from ddgcli.cli.options import FacePoint, Ids, Numbers, Real, Size, View
from ddgcli.mechanics.integrators import INTEGRATORS
from ddgcli.models.fluid.scene import TRANSPORTS
from ddgcli.scenes.materials import MATERIALS

LEFT_OUT = {"help_all", "as_json", "verbose", "quiet", "cluster"}  # not values of a result; a running cluster
RARE = {"plot", "threads", "jobs", "list_effects", "schema", "resume", "input_format", "output_format"}
SHARE_OF_RARE = 0.06
SHARE_OF_OUTPUTS = 0.7
SHARE_OF_RESUMED, SHARE_OF_STREAMS = 0.2, 0.04
MAX_STEPS = 50  # of a simulation
NUMBER = re.compile(r"[0-9.]+(e[-+]?[0-9]+)?")
MAX_SUBDIVISIONS = 3  # each makes four times as many faces
OPTION_COUNTS = (0, 1, 1, 2, 2, 3, 3, 4, 6)
KINDS = {  # cells that a command accepts, the most frequent first
    "info": (SURFACE, SURFACE, TETRAHEDRA, CURVE),
    "curvature": (SURFACE, SURFACE, SURFACE, CURVE, TETRAHEDRA),
    "laplacian": (SURFACE, SURFACE, TETRAHEDRA), "dec": (SURFACE, SURFACE, TETRAHEDRA),
    "hodge": (SURFACE, SURFACE, TETRAHEDRA), "curve-flow": (CURVE,), "view": (SURFACE, TETRAHEDRA, CURVE),
    "fluid-sim": (SURFACE, SURFACE, TETRAHEDRA), "repair": (SURFACE,),
}  # fmt: skip
OTHER_KIND = 0.04  # of the calls have cells of any kind
WEIGHTS = {
    "info": 3, "repair": 6, "curvature": 9, "delaunay": 7, "laplacian": 12, "dec": 5, "hodge": 6,
    "geodesic": 16, "shell-sim": 6, "fluid-sim": 6, "willmore-flow": 8, "curve-flow": 5, "tradeoff": 4,
    "frames": 3, "view": 2, "batch": 0.7, "check": 0.7,
}  # fmt: skip
MEASURES = ("info", "repair", "curvature", "delaunay", "laplacian", "dec", "hodge", "geodesic")
SIMULATIONS = ("shell-sim", "fluid-sim", "willmore-flow", "curve-flow")
ANY = (*MEASURES, *SIMULATIONS)
OUTPUTS = (".npz", ".npz", ".npz", ".vtu", ".ply", ".vtkhdf", ".obj", ".glb", ".stl", ".vtp", ".off", ".vtk")
# the most important formats of commands and options whose outputs are others
OUTPUTS_OF = {
    "dec": (".npz",), "frames": (".npz", ".vtu", ".ply", ".png"), "view": (".html",),
    "check": (".json", ".vtu"),
    "tradeoff": (".csv", ".json"), "plot": (".png", ".svg"), "matrix": (".npz", ".mtx"),
    "mass_matrix": (".npz", ".mtx"), "generators": (".npz", ".vtp", ".obj"), "table": (".csv", ".jsonl"),
    "paths_output": (".npz", ".vtp", ".obj"), "distance_matrix": (".npz",), "dual": (".npz", ".vtp", ".obj"),
    "batch": (".npz", ".vtu"),
}  # fmt: skip
SCHEMES = {"shell-sim": list(INTEGRATORS), "fluid-sim": list(TRANSPORTS)}
TRAJECTORIES = (".vtkhdf", ".vtkhdf", ".npz", ".ply", ".vtu")
ARRAYS = ("f", "f", "v", "k", "ff", "fv", "w")
EXPRESSIONS = ("z", "sin(3*x)*y", "x*y", "1", "where(x<0, 1, 2)", "f")


class Place:
    """The mesh of a call: what values refer to."""

    def __init__(self, rng: Random, command: str, mesh: dict[str, Any]) -> None:
        points, cells = mesh_arrays(mesh)
        self.rng, self.command, self.points, self.cells = rng, command, points, cells
        self.size = min(float(np.ptp(points, axis=0).max()), 1e70) or 1.0  # its fourth power is a number
        self.outputs = 0

    def vertex(self) -> int:
        """A vertex, in one call of twenty one that does not exist."""
        n = len(self.points)
        return self.rng.choice([-1, n]) if self.rng.random() < 0.05 else self.rng.randrange(n)

    def face_point(self) -> str:
        """A point of a face: inside, on an edge, or at a corner."""
        return (
            f"{self.rng.randrange(len(self.cells))}:{self.rng.choice(('0.2,0.3,0.5', '0.5,0.5,0', '1,0,0'))}"
        )

    def point(self) -> str:
        """A point near the mesh."""
        at = self.points[self.rng.randrange(len(self.points))] + self.size * self.rng.choice([0, 0.1, 3])
        return ",".join(repr(float(x)) for x in at)

    def edge_path(self, closed: bool = False) -> str:
        """Some vertices."""
        ids = [self.vertex() for _ in range(self.rng.choice([2, 3, 4]))]
        return ",".join(map(str, ids + ids[:1] * closed))

    def output(self, option: str) -> str:
        """The name of a new file."""
        default = TRAJECTORIES if self.command in SIMULATIONS else OUTPUTS
        table = OUTPUTS_OF.get(
            option, OUTPUTS_OF.get(self.command, default) if option == "outputs" else default
        )
        self.outputs += 1
        if self.command == "batch" and option == "outputs":
            return "{folder}/out-{stem}-{index}" + self.rng.choice(table)
        return f"{{folder}}/out{self.outputs}{self.rng.choice(table)}"

    def number(self, above: float | None, least: float | None) -> str:
        """A finite number in a range: a length, a time or an angle of this mesh, or an extreme one."""
        s, rng = self.size, self.rng
        value = rng.choice([0.1 * s, s, 0.01 * s**2, 1e-3 * s**4, 1.0, 0.5, 20.0, 1e-6])
        if rng.random() < 0.06:
            value = rng.choice([1e-300, 1e300, 1e-12, 1e12, 0.0])
        if above is None and least is None and rng.random() < 0.4:
            value = -value
        low = above if above is not None else least
        value = min(value, 1e300)
        if low is not None and value <= low:
            value = low + (1.0 if above is not None else 0.0)
        return repr(float(value))


def _integer(place: Place, low: int, high: int | None) -> str:
    value = low + place.rng.choice([0, 0, 1, 2, 4, 9])
    if place.rng.random() < 0.03:
        value = low + 1000
    return str(value if high is None else min(value, high))


def with_few_steps(words: list[str]) -> list[str]:
    """The words with a duration of at most MAX_STEPS steps or frames."""
    names = "--dt", "--duration", "--frame-every", "--steps"
    pairs = zip(words, words[1:], strict=False)
    value = {word: float(text) for word, text in pairs if word in names and NUMBER.fullmatch(text)}
    step, between = (value.get(name, 1e300) for name in ("--dt", "--frame-every"))
    new = {}
    if value.get("--duration", 0.0) > MAX_STEPS * min(step, between):
        new["--duration"] = repr(MAX_STEPS * min(step, between))
    if step < 1e300 and value.get("--steps", 0.0) * step > MAX_STEPS * between:
        new["--frame-every"] = repr(step)
    return [new.get(before, word) for before, word in zip(["", *words], words, strict=False)]


def _effect(place: Place) -> str:
    """An effect of the quick form with its parameters."""
    rng = place.rng
    table = SHELL_EFFECTS if place.command == "shell-sim" else FLUID_EFFECTS
    name = rng.choice(list(table))
    content = table[name][1](rng, SceneObjects(["shell"], [], "newmark", [])) or {}
    content = rng.choice(content) if isinstance(content, list) else content
    keys = {key: value for key, value in content.items() if key not in ("object", "to", "pairs")}
    return " ".join([name, *(f"{key}={toml(value)}" for key, value in keys.items())])


def _heat_source(place: Place) -> str:
    return str(place.vertex()) if place.rng.random() < 0.5 else place.rng.choice(ARRAYS)


def _flow(place: Place) -> str:
    if place.command == "willmore-flow":
        return place.rng.choice(WILLMORE_FLOWS)
    return place.rng.choice(["taylor-vortices", "vortex-pair", "rotation", "jet", "shear-layer"])


# values of texts, by their metavar, else by the name of the parameter
TEXTS: dict[str, Callable[[Place], str]] = {
    "ARRAY": lambda p: p.rng.choice(ARRAYS),
    "FILE": lambda p: p.rng.choice(["{folder}/f.npy", "{folder}/edges.npy"]),
    "ARRAY|FILE": lambda p: p.rng.choice([*ARRAYS, "{folder}/f.npy"]),
    "ARRAY|FILE|ID": _heat_source,
    "FILE_OR_ARRAY": lambda p: p.rng.choice(["w", "k", "{folder}/edges.npy"]),
    "CURVES": lambda p: p.rng.choice(["w", "k", "{folder}/edges.npy"]),
    "NAME": lambda p: p.rng.choice(ARRAYS),
    "FORM FORM": lambda p: p.rng.choice(("f", "w", "ff")),
    "FIELD FORM": lambda p: p.rng.choice(("v", "fv", "w", "f")),
    "FOLDER": lambda p: "{folder}/matrices",
    "EXT": lambda p: p.rng.choice(SUFFIXES),
    "TEXT": lambda p: "lengths in mm",
    "COMMAND": lambda p: p.rng.choice(["hodge", "willmore-flow", "fluid-sim", "curvature"]),
    "LOOP": lambda p: p.rng.choice(["all", str(p.vertex())]),
    "LENGTH": lambda p: p.rng.choice(["mean", repr(p.size * 0.3)]),
    "'NAME KEY=VALUE ...'": _effect,
    "EFFECT=NAME": lambda p: p.rng.choice(
        ["bending=midedge", "bending=cubic", "stretching=edges"]
        if p.command == "shell-sim" else ["viscosity=bochner", "viscosity=deformation"]),
    "KEY=VALUE": lambda p: p.rng.choice(["thickness=1e-3", 'young="1 MPa"', "velocity=[0,0,1]", "scale=0.1"]),
    "NU": lambda p: p.rng.choice(["0", "1e-3", "1", "0.01 m^2/s"]),
    "NAME=V1,V2": lambda p: "threads=1,2",
    "I/N": lambda p: p.rng.choice(["1/2", "2/2"]),
    "KEY": lambda p: p.rng.choice(["results.area", "results.*", "accuracy"]),
    "EXPECTED_MESH ACTUAL_MESH": lambda p: "{input}",
    "SHAPE": lambda p: p.rng.choice(["sphere:1", "torus:1,0.4"]),
    "material": lambda p: p.rng.choice(list(MATERIALS)),
    "vorticity": lambda p: p.rng.choice(EXPRESSIONS),
    "flow": _flow,
    "energy": lambda p: p.rng.choice(WILLMORE_ENERGIES),
    "boundary": lambda p: p.rng.choice(WILLMORE_BOUNDARIES),
    "report_energy": lambda p: "all",
    "region": lambda p: p.rng.choice(["k", "0,1,2", str(p.vertex())]),
    "show": lambda p: p.rng.choice([*ARRAYS, "geodesic_distance", "mean_curvature", "angle_defect"]),
    "integrator": lambda p: p.rng.choice(SCHEMES.get(p.command, ["explicit", "implicit"])),
    "up": lambda p: p.rng.choice(UP_AXES),
}  # fmt: skip
# values of the types of options
TYPES: dict[type[click.ParamType], Callable[[Place], str]] = {
    click.types.IntParamType: lambda p: str(p.vertex()),
    Ids: lambda p: p.edge_path() if p.rng.random() < 0.4 else str(p.vertex()),
    FacePoint: Place.face_point,
    Numbers: Place.point,
    View: lambda p: p.rng.choice(["x", "iso", "iso:y", "30,-60"]),
    Size: lambda p: "200x200",
    FixedValue: lambda p: f"{p.vertex()}={p.rng.choice(['0', '1', '360', '180', '-2.5'])}",
    Radius: lambda p: "auto" if p.rng.random() < 0.3 else p.number(0, None),
    Region: lambda p: p.rng.choice(["k", "ff", "{folder}/f.npy", f"{p.point()}:{0.4 * p.size!r}"]),
    TraceStart: lambda p: f"{p.face_point()}:{p.rng.choice(['1,0,0', '0.3,-1,0.2'])}:{p.number(0, None)}",
    KeyTolerance: lambda p: p.rng.choice(["results.area=1e-6", "results.*=1e-6,1e-9"]),
}


@cache
def command_of(name: str) -> click.Command:
    """A command as click has it."""
    command = command_line.get_command(click.Context(command_line), name)
    if command is None:
        raise KeyError(name)
    return command


@cache
def options_of(name: str) -> tuple[click.Option, ...]:
    """Options of a command that random calls have."""
    every = [p for p in command_of(name).params if isinstance(p, click.Option)]
    return tuple(option for option in every if option.name not in LEFT_OUT)


def option_words(option: click.Option, place: Place) -> list[str]:
    """Words of an option with random values."""
    word = max(option.opts, key=len)
    if option.is_flag:
        return [place.rng.choice([word, *option.secondary_opts])]
    if option.metavar and option.metavar.startswith("[") and place.rng.random() < 0.5:
        return [word]  # its value is optional
    value = value_generator(option)
    if value is None:
        raise KeyError(f"{word} has a type without random values")
    return [word, *(value(place) for _ in range(option.nargs))]


def value_generator(option: click.Option) -> Callable[[Place], str] | None:
    """Function of a place that returns a random value of an option; None for a type that has none here."""
    kind, name = option.type, option.name or ""
    if isinstance(kind, click.Choice):
        choices = list(kind.choices)
        return lambda place: str(place.rng.choice(choices))
    if isinstance(kind, click.IntRange):
        low, high = int(kind.min or 0), None if kind.max is None else int(kind.max)
        high = MAX_SUBDIVISIONS if name == "subdivide" else high
        return lambda place: _integer(place, low, high)
    if isinstance(kind, click.Path):
        return lambda place: "{folder}/run.vtkhdf.part"
    if isinstance(kind, Real):
        above, least = kind.above, kind.least
        return lambda place: place.number(above, least)
    if type(kind) in TYPES:
        return TYPES[type(kind)]
    if option.metavar == "PATH" and name not in TEXTS:
        return lambda place: place.output(name)
    return TEXTS.get(name) or TEXTS.get(str(option.metavar))


def random_words(name: str, place: Place, outputs: bool = True) -> list[str]:
    """Random options of a command."""
    rng, words = place.rng, []
    options = [o for o in options_of(name) if o.name not in RARE and o.name != "outputs"]
    rare = [o for o in options_of(name) if o.name in RARE]
    count = min(rng.choice(OPTION_COUNTS), len(options))
    sample = rng.sample(options, count) + [o for o in rare if rng.random() < SHARE_OF_RARE / 2]
    for option in sample:
        if option.name == "dry_run" and rng.random() < 0.8:
            continue
        for _ in range(rng.choice([1, 1, 2]) if option.multiple else 1):
            words += option_words(option, place)
    if outputs and rng.random() < SHARE_OF_OUTPUTS:
        words += ["-o", place.output("outputs")]
    return words


def default_words(name: str, place: Place, words: list[str]) -> list[str]:
    """Options without which most calls of a command are refused, or take long."""
    rng = place.rng
    if name in SIMULATIONS:
        bounded = {"--steps", "--duration", "--help"} & set(words)
        words = words if bounded else [*words, "--steps", rng.choice("123")]
        if "--dt" not in words and name != "willmore-flow":
            words = [*words, "--dt", rng.choice(["1e-3", "1e-2", repr(1e-3 * place.size**2)])]
    words = with_few_steps(words)
    if name == "willmore-flow" and "--tolerance" in words:  # its first steps are short
        words = [repr(1e-6 * place.size**4) if before == "--duration" else word
                 for before, word in zip(["", *words], words, strict=False)]  # fmt: skip
    if name == "shell-sim" and "--effect" not in words:
        words = [*words, "--effect", "stretching", "--effect", rng.choice(["bending", "gravity"])]
    if name == "fluid-sim" and not {"--vorticity", "--flow", "--effect"} & set(words):
        words = [*words, "--vorticity", rng.choice(EXPRESSIONS)]
    if name == "geodesic" and not any(word.startswith(("--source", "--curve", "--trace")) for word in words):
        words = [*words, "--source", str(place.vertex())]
    return words


def random_call(rng: Random) -> bytes:
    """A call as JSON: the mesh, preparing calls, and the words of the judged call."""
    name = rng.choices(list(WEIGHTS), list(WEIGHTS.values()))[0]
    inner = {"tradeoff": (*MEASURES[2:5], "geodesic", *SIMULATIONS[:3]), "check": ANY, "batch": ANY,
             "frames": SIMULATIONS, "view": ANY}.get(name)  # fmt: skip
    subject = rng.choice(inner) if inner else name
    kinds = (SURFACE, TETRAHEDRA, CURVE) if rng.random() < OTHER_KIND else KINDS.get(subject, (SURFACE,))
    mesh = random_mesh(rng, rng.choice(kinds))
    place = Place(rng, subject, mesh)
    own = default_words(subject, place, random_words(subject, place, outputs=inner is None))
    place.command = name
    prepare: list[list[str]] = []
    if name == "tradeoff":
        outer = [*random_words(name, place), "--budget", "1", "--repeat", "1"]
        words = [name, *outer, subject, "{input}", *own]
    elif name == "batch":
        second = rng.choice(
            ["{input}", *(f"{{folder}}/second{suffix}" for suffix in (".vtu", ".npz", ".ply"))]
        )
        missing = rng.random() < 0.1
        prepare = [["info", "{input}", "-o", second]] * (second != "{input}" and not missing)
        words = [name, "{input}", second, *random_words(name, place), "--", subject, *own]
    elif name == "check":
        stored = "{folder}/expected.json"
        prepare = [[name, stored, "--update", "--", subject, "{input}", *own]]
        words = [name, stored, *random_words(name, place), "--", subject, "{input}", *own]
    elif name in ("frames", "view"):
        result = "{folder}/run" + (".vtkhdf" if name == "frames" or subject in SIMULATIONS else ".npz")
        prepare = [[subject, "{input}", *own, "-o", result]]
        shown = rng.choices([result, "{input}"], k=rng.choice([1, 1, 2, 3])) if name == "view" else [result]
        words = [name, *shown, *random_words(name, place)]
    else:
        words = [name, "{input}", *own]
    call = {"mesh": mesh, "prepare": prepare, "words": words}
    if name in SIMULATIONS and rng.random() < SHARE_OF_RESUMED:
        call["words"] = [*words, "-o", "{folder}/run.vtkhdf"]
        call["interrupt"] = rng.choice([1, 1, 2, 3])
    elif name in MEASURES and "-o" not in words and rng.random() < SHARE_OF_STREAMS:
        formats = OUTPUTS_OF.get(name, (".npz", ".ply", ".vtu", ".vtp", ".obj"))
        call["words"] = [*words, "-o", "-", "--output-format", rng.choice(formats)]
    if inner is None and "--input-format" not in words and rng.random() < SHARE_OF_STREAMS:
        streamed = ["-", "--input-format", mesh["suffix"]]
        call["words"] = [w for word in call["words"] for w in (streamed if word == "{input}" else [word])]
        call["stdin"] = True
    return json.dumps(call).encode()
