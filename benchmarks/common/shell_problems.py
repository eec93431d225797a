"""Nonlinear benchmark shells of Sze, Liu and Lo (2004) as scenes, on regular and irregular meshes.

K. Y. Sze, X. H. Liu, S. H. Lo, "Popular benchmark problems for geometric nonlinear analysis of shells",
Finite Elements in Analysis and Design 40, 2004. Where a problem is symmetric, a part is computed: vertices on
a plane of symmetry stay in it, and so do the directors of its edges.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from benchmarks.common.rectangle_meshes import Spacing, flat_mesh
from ddgcli.io.scene_file import parse_scene
from ddgcli.models.shell import model
from ddgcli.models.shell.scene import KIND
from ddgcli.scenes.scene import resolve
from ddgcli.simulation.account import Account
from ddgcli.simulation.time_loop import evolve

SCENE = """
[time]
integrator = "static"
load_steps = {steps}
duration = 1
[[object]]
name = "s"
role = "shell"
mesh = "m"
density = 1
thickness = {thickness}
young = {young}
poisson = {poisson}
[effects]
stretching = {{}}
bending = {{ model = "{bending}" }}
{effects}
"""


@dataclass(frozen=True)
class ShellProblem:
    """A shell over a rectangle of parameters, with its reference curve.

    Parameters
    ----------
    size : tuple of float
        Parameter rectangle (a, b), isotropic on the shell.
    onto : callable (n, 2) -> (n, 3)
    young, poisson, thickness : float
    effects : callable (points at rest, parameters) -> str
        Lines of pins and loads.
    measured : tuple of (parameters, direction)
        Points and unit directions of the displacements.
    fractions : tuple of float
    reference : tuple of tuples
        Displacements at these fractions of the load.
    spacing : callable (n,) -> (n,), optional
        Distance of neighbours in the parameters at the second parameter, up to a factor.
    """

    size: tuple[float, float]
    onto: Callable[[NDArray], NDArray]
    young: float
    poisson: float
    thickness: float
    effects: Callable[[NDArray, NDArray], str]
    measured: tuple[tuple[tuple[float, float], tuple[float, float, float]], ...]
    fractions: tuple[float, ...]
    reference: tuple[tuple[float, ...], ...]
    spacing: Spacing = np.ones_like


def numbers(mask: NDArray) -> str:
    """List of the vertices of a mask."""
    return str(np.flatnonzero(mask).tolist())


def at(q: NDArray, axis: int, value: float) -> NDArray:
    """Mask of the parameters with one value along an axis."""
    return np.abs(q[:, axis] - value) < 1e-9 * max(1.0, float(np.abs(q).max()))


def _plate(q: NDArray) -> NDArray:
    return np.column_stack([q, np.zeros(len(q))])


def _shear(x: NDArray, q: NDArray) -> str:
    return (
        f"pin = {{ vertices = {numbers(at(q, 0, 0))}, clamp = true }}\n"
        f"load = {{ line_force = [0, 0, 4], vertices = {numbers(at(q, 0, 10))} }}"
    )


def _moment(x: NDArray, q: NDArray) -> str:
    return (
        f"pin = {{ vertices = {numbers(at(q, 0, 0))}, clamp = true }}\n"
        f"load = {{ moment = {-50 * np.pi / 3}, vertices = {numbers(at(q, 0, 12))} }}"
    )


def full_circle(fractions: NDArray) -> NDArray[np.float64]:
    """(fractions, 2) exact displacements of the end of the cantilever that a moment bends to a circle."""
    turn = 2 * np.pi * fractions
    return np.column_stack([12 * (1 - np.sin(turn) / turn), 12 * (1 - np.cos(turn)) / turn])


def open_hemisphere(q: NDArray) -> NDArray:
    """Parameters: longitude from 0 to 90 degrees, latitude from 0 to 72, both times the radius."""
    longitude, latitude = q[:, 0] / 10, q[:, 1] / 10
    return 10 * np.column_stack(
        [np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)]
    )


MERCATOR_HEIGHT = 10 * np.arctanh(np.sin(np.radians(72)))


def mercator_hemisphere(q: NDArray) -> NDArray:
    """The same with a second parameter that makes the map conformal: triangles keep their shape."""
    return open_hemisphere(np.column_stack([q[:, 0], 10 * np.arcsin(np.tanh(q[:, 1] / 10))]))


def _hemisphere_spacing(y: NDArray) -> NDArray:
    """Twice as long at the hole as at the loaded edge."""
    latitude = np.arcsin(np.tanh(y / 10))
    return (1 + latitude / np.radians(72)) / np.cos(latitude)


def _hemisphere_effects(x: NDArray, q: NDArray) -> str:
    quarter = 5 * np.pi
    first, second = at(q, 0, 0), at(q, 0, quarter)
    corner = first & at(q, 1, 0)
    return f"""
[[effects.pin]]
vertices = {numbers(first)}
axes = "y"
clamp = true
[[effects.pin]]
vertices = {numbers(second)}
axes = "x"
clamp = true
[[effects.pin]]
vertices = {numbers(corner)}
axes = "z"
[[effects.load]]
vertices = {numbers(corner)}
force = [-200, 0, 0]
[[effects.load]]
vertices = {numbers(second & at(q, 1, 0))}
force = [0, 200, 0]
"""


def _annulus(q: NDArray) -> NDArray:
    """Parameters: arc at the mean radius 8 (a whole turn), and the radius less 6."""
    angle, radius = q[:, 0] / 8, q[:, 1] + 6
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(len(q))])


def _annulus_effects(x: NDArray, q: NDArray) -> str:
    return (
        f"pin = {{ vertices = {numbers(at(q, 0, 0))}, clamp = true }}\n"
        f"load = {{ line_force = [0, 0, 0.8], vertices = {numbers(at(q, 0, 16 * np.pi))} }}"
    )


def _cylinder(q: NDArray) -> NDArray:
    """Parameters: arc from the load (0) to the side (a quarter), and the distance from the clamped end."""
    angle = q[:, 0] / 101.6
    return np.column_stack([101.6 * np.sin(angle), q[:, 1], 101.6 * np.cos(angle)])


def _cylinder_spacing(y: NDArray) -> NDArray:
    """Twice as long at the clamped end as at the loaded one."""
    return 2 - y / 304.8


def _cylinder_effects(x: NDArray, q: NDArray) -> str:
    top, side = at(q, 0, 0), at(q, 0, 50.8 * np.pi)
    clamped, free = at(q, 1, 0), at(q, 1, 304.8)
    return f"""
[[effects.pin]]
vertices = {numbers(clamped)}
clamp = true
[[effects.pin]]
vertices = {numbers(top)}
axes = "x"
clamp = true
[[effects.pin]]
vertices = {numbers(side)}
axes = "z"
clamp = true
[[effects.load]]
vertices = {numbers(top & free)}
force = [0, 0, -1000]
"""


TENTHS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
PROBLEMS = {
    "cantilever, shear": ShellProblem(
        (10, 1), _plate, 1.2e6, 0.0, 0.1, _shear,
        (((10, 0.5), (-1, 0, 0)), ((10, 0.5), (0, 0, 1))), (0.05, *TENTHS),
        (
            (0.026, 0.103, 0.381, 0.763, 1.184, 1.604, 2.002, 2.370, 2.705, 3.010, 3.286),
            (0.663, 1.309, 2.493, 3.488, 4.292, 4.933, 5.444, 5.855, 6.190, 6.467, 6.698),
        ),
    ),
    "cantilever, moment": ShellProblem(
        (12, 1), _plate, 1.2e6, 0.0, 0.1, _moment,
        (((12, 0.5), (-1, 0, 0)), ((12, 0.5), (0, 0, 1))), (0.05, *TENTHS),
        (
            (0.196, 0.774, 2.918, 5.945, 9.194, 12.000, 13.871, 14.595, 14.270, 13.247, 12.000),
            (1.870, 3.648, 6.598, 8.333, 8.637, 7.639, 5.758, 3.571, 1.650, 0.405, 0.0),
        ),
    ),
    "open hemisphere": ShellProblem(
        (5 * np.pi, MERCATOR_HEIGHT), mercator_hemisphere, 6.825e7, 0.3, 0.04, _hemisphere_effects,
        (((0, 0), (-1, 0, 0)), ((5 * np.pi, 0), (0, 1, 0))), (0.05, *TENTHS),
        (
            (0.955, 1.840, 3.261, 4.339, 5.196, 5.902, 6.497, 7.006, 7.448, 7.835, 8.178),
            (0.855, 1.499, 2.321, 2.819, 3.158, 3.406, 3.598, 3.750, 3.875, 3.979, 4.067),
        ),
        _hemisphere_spacing,
    ),
    "slit annular plate": ShellProblem(
        (16 * np.pi, 4), _annulus, 2.1e7, 0.0, 0.03, _annulus_effects,
        (((16 * np.pi, 4), (0, 0, 1)), ((16 * np.pi, 0), (0, 0, 1))), (0.025, 0.05, *TENTHS),
        (
            (1.789, 3.370, 5.876, 9.160, 11.213, 12.661, 13.768, 14.674, 15.469, 16.202, 16.886, 17.528),
            (1.305, 2.455, 4.277, 6.725, 8.340, 9.529, 10.468, 11.257, 11.970, 12.642, 13.282, 13.891),
        ),
    ),
    "pinched cylinder": ShellProblem(
        (50.8 * np.pi, 304.8), _cylinder, 2068.5, 0.3, 3.0, _cylinder_effects,
        (((0, 304.8), (0, 0, -1)),), (0.05, *TENTHS),
        ((5.421, 16.100, 37.582, 66.410, 113.704, 132.653, 144.185, 152.863, 160.015, 166.200, 171.505),),
        _cylinder_spacing,
    ),
}  # fmt: skip


def displacements(
    problem: ShellProblem, faces: int, pattern: str, bending: str = "midedge", steps: int = 20
) -> tuple[int, NDArray[np.float64]]:
    """Number of triangles, and displacements (fractions, measured points) at the fractions of the load."""
    flat = flat_mesh(problem.size, faces, pattern, problem.spacing)
    q = np.asarray(flat.points)[:, :2]
    mesh = flat.moved(problem.onto(q))
    text = SCENE.format(
        steps=steps, thickness=problem.thickness, young=problem.young, poisson=problem.poisson,
        bending=bending, effects=problem.effects(np.asarray(mesh.points), q),
    )  # fmt: skip
    scene = resolve(parse_scene(text), KIND, {})
    source = SimpleNamespace(mesh=mesh, vertex={}, face={}, sha256="", notes=[])
    contexts = {name: c for name, (c, _) in model.contexts(scene, lambda path: source).items()}
    account = Account()
    snapshots = list(evolve(model.build(scene, contexts, account), scene.schedule(), account))
    moves = np.zeros((len(problem.fractions), len(problem.measured)))
    for k, (place, direction) in enumerate(problem.measured):
        vertex = int(np.argmin(np.sum((q - np.array(place)) ** 2, axis=1)))
        path = [snapshot.observations["s"].points[vertex] for snapshot in snapshots]
        for row, fraction in enumerate(problem.fractions):
            number = round(fraction * steps)
            move = path[number] - path[0] if number < len(path) else np.full(3, np.nan)
            moves[row, k] = float(move @ np.array(direction))
    return mesh.n_faces, moves
