"""The linear obstacle course of shells: Scordelis-Lo roof, pinched cylinder, pinched hemisphere, hyperboloid.

T. Belytschko, H. Stolarski, W. K. Liu, N. Carpenter, J. S.-J. Ong, "Stress projection for membrane and shear
locking in shell finite elements", 1985. An eighth of the cylinder, a quarter of the roof and the hemisphere
are computed; the hemisphere is the one with a hole of 18 degrees.

The hyperboloid x^2 + y^2 = 1 + z^2, |z| <= 1, with free ends bends without stretching, which elements that
lock in their membranes forbid: P.-S. Lee, K.-J. Bathe, "Development of MITC isotropic triangular shell finite
elements", 2004; references by M. Neunteufel and J. Schoeberl, "Avoiding membrane locking with Regge
interpolation", 2021. An eighth is computed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from benchmarks.common.rectangle_meshes import flat_mesh
from benchmarks.common.shell_problems import SCENE, at, numbers, open_hemisphere
from ddgcli.io.scene_file import parse_scene
from ddgcli.linalg.factor import Factor
from ddgcli.mechanics.increment import Increment
from ddgcli.mechanics.objective import Objective
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.shell import model
from ddgcli.models.shell.scene import KIND
from ddgcli.scenes.scene import resolve
from ddgcli.simulation.account import Account


@dataclass(frozen=True)
class LinearProblem:
    """A shell over a rectangle of parameters, and the deflection of one point in one direction.

    Parameters
    ----------
    size : tuple of float
    onto : callable (n, 2) -> (n, 3)
    young, poisson, thickness : float
    effects : callable parameters -> str
    place, direction : tuple of float
        Of the deflection.
    reference : float
    pressure : callable (faces, 3) -> (faces,), or None
        Force per area along the outward normal at the middles of the faces, beside the loads of `effects`.
    """

    size: tuple[float, float]
    onto: Callable[[NDArray], NDArray]
    young: float
    poisson: float
    thickness: float
    effects: Callable[[NDArray], str]
    place: tuple[float, float]
    direction: tuple[float, float, float]
    reference: float
    pressure: Callable[[NDArray], NDArray] | None = None


def pin(vertices: NDArray, axes: str, clamp: bool = False) -> str:
    """Lines of a pin."""
    text = f'[[effects.pin]]\nvertices = {numbers(vertices)}\naxes = "{axes}"\n'
    return text + ("clamp = true\n" if clamp else "")


def force(vertices: NDArray, vector: str) -> str:
    """Lines of a load."""
    return f"[[effects.load]]\nvertices = {numbers(vertices)}\nforce = {vector}\n"


def _roof(q: NDArray) -> NDArray:
    """Arc from the crown (0 to 40 degrees) and distance from the middle."""
    angle = q[:, 0] / 25
    return np.column_stack([25 * np.sin(angle), q[:, 1], 25 * np.cos(angle)])


def _roof_effects(q: NDArray) -> str:
    return (
        pin(at(q, 0, 0), "x", clamp=True) + pin(at(q, 1, 0), "y", clamp=True) + pin(at(q, 1, 25), "xz")
        + "[[effects.load]]\ntraction = [0, 0, -90]\n"
    )  # fmt: skip


def _cylinder(q: NDArray) -> NDArray:
    """Arc from the load (a quarter) and distance from the middle."""
    angle = q[:, 0] / 300
    return np.column_stack([300 * np.sin(angle), q[:, 1], 300 * np.cos(angle)])


def _cylinder_effects(q: NDArray) -> str:
    top, middle = at(q, 0, 0), at(q, 1, 0)
    return (
        pin(top, "x", clamp=True) + pin(at(q, 0, 150 * np.pi), "z", clamp=True)
        + pin(middle, "y", clamp=True) + pin(at(q, 1, 300), "xz") + force(top & middle, "[0, 0, -0.25]")
    )  # fmt: skip


def _hemisphere_effects(q: NDArray) -> str:
    first, second, equator = at(q, 0, 0), at(q, 0, 5 * np.pi), at(q, 1, 0)
    return (
        pin(first, "y", clamp=True) + pin(second, "x", clamp=True) + pin(first & equator, "z")
        + force(first & equator, "[1, 0, 0]") + force(second & equator, "[0, -1, 0]")
    )  # fmt: skip


def _hyperboloid(q: NDArray) -> NDArray:
    """Angle about the axis (a quarter) and height (a half)."""
    radius = np.sqrt(1 + q[:, 1] ** 2)
    return np.column_stack([radius * np.cos(q[:, 0]), radius * np.sin(q[:, 0]), q[:, 1]])


def _hyperboloid_effects(q: NDArray) -> str:
    first, second, waist = at(q, 0, 0), at(q, 0, np.pi / 2), at(q, 1, 0)
    return pin(first, "y", clamp=True) + pin(second, "x", clamp=True) + pin(waist, "z", clamp=True)


def hyperboloid(thickness: float, reference: float) -> LinearProblem:
    """The free hyperboloid under 1e4 t^3 cos(2 angle); reference: the waist's motion towards x."""
    return LinearProblem(
        (np.pi / 2, 1.0), _hyperboloid, 2.85e4, 0.3, thickness, _hyperboloid_effects, (0, 0), (1, 0, 0),
        reference, lambda middle: 1e4 * thickness**3 * np.cos(2 * np.arctan2(middle[:, 1], middle[:, 0])),
    )  # fmt: skip


LINEAR_PROBLEMS = {
    "Scordelis-Lo roof": LinearProblem(
        (25 * np.radians(40), 25), _roof, 4.32e8, 0.0, 0.25, _roof_effects,
        (25 * np.radians(40), 0), (0, 0, -1), 0.3024,
    ),
    "pinched cylinder with diaphragms": LinearProblem(
        (150 * np.pi, 300), _cylinder, 3e6, 0.3, 3.0, _cylinder_effects, (0, 0), (0, 0, -1), 1.8248e-5,
    ),
    "pinched hemisphere": LinearProblem(
        (5 * np.pi, 4 * np.pi), open_hemisphere, 6.825e7, 0.3, 0.04, _hemisphere_effects,
        (0, 0), (1, 0, 0), 0.093,
    ),
    "free hyperboloid, thickness 0.1": hyperboloid(0.1, 0.1856305),
    "free hyperboloid, thickness 0.01": hyperboloid(0.01, 0.1502913),
    "free hyperboloid, thickness 0.001": hyperboloid(0.001, 0.1498749),
}  # fmt: skip


def deflection(
    problem: LinearProblem, faces: int, pattern: str, bending: str = "midedge"
) -> tuple[int, float]:
    """Number of triangles, and deflection over the reference, by one solve with the Hessian at rest."""
    flat = flat_mesh(problem.size, faces, pattern)
    q = np.asarray(flat.points)[:, :2]
    mesh = flat.moved(problem.onto(q))
    text = SCENE.format(
        steps=1, thickness=problem.thickness, young=problem.young, poisson=problem.poisson,
        bending=bending, effects=problem.effects(q),
    )  # fmt: skip
    scene = resolve(parse_scene(text), KIND, {})
    source = SimpleNamespace(mesh=mesh, vertex={}, face={}, sha256="", notes=[])
    context, _ = model.contexts(scene, lambda path: source)["s"]
    system = model.make_system(scene, context, Account())
    x, objective = np.asarray(mesh.points), Objective(system)
    matrix = objective.hessian(Increment(0.0, x), x, "exact")
    forces = -system.gradient(x)
    if problem.pressure is not None:
        forces += _pressed(mesh, problem.pressure)
    move = objective.scatter(Factor(matrix).solve(objective.gather(forces)))
    vertex = int(np.argmin(np.sum((q - np.array(problem.place)) ** 2, axis=1)))
    return mesh.n_faces, float(move[vertex] @ np.array(problem.direction)) / problem.reference


def _pressed(mesh: TriangleMesh, pressure: Callable[[NDArray], NDArray]) -> NDArray:
    """(n, 3) forces of a pressure, a third of each face's at its vertices; faces turn outward."""
    corners = np.asarray(mesh.points)[mesh.faces]
    area_vector = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    share = pressure(corners.mean(axis=1))[:, None] * area_vector / 3
    return sum_by_index(mesh.faces, np.repeat(share[:, None], 3, axis=1), mesh.n_vertices)
