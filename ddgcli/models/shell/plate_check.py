"""Error of hinge bending relative to the Kirchhoff plate of the material, estimated by one linear solve.

The bending stiffness of hinges depends on the mesh. A twin system has mid-edge bending in place of the
hinges; comparing deflections, forces, frequencies and buckling loads of the two gives warnings.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import SolveError
from ddgcli.mechanics.embedding import EmbeddedTerm, embedded
from ddgcli.mechanics.increment import Increment
from ddgcli.mechanics.system import System
from ddgcli.models.shell.context import ShellContext
from ddgcli.simulation.account import Account

if TYPE_CHECKING:
    from ddgcli.models.shell.midedge import MidedgeBending

WARNING_FACTOR = 1.1  # ratio of the results of hinges and plate, or its inverse, that is a warning
BENT_START = 1e-6  # ratio of bending energies at the start and at the end above which the start is not flat
LEAST_BENDING = 1e-6  # stiffness of a shape over D / size^2 below which it is a rigid motion
# shift over the mean ratio of stiffness and mass, for motions that pins leave free; on fine strips the lowest
# eigenvalue is 1e-9 of that ratio
LEAST_SHIFT = 1e-13


@dataclass(frozen=True, eq=False)
class PlateTwin:
    """Two systems of the same shells: with hinges, and with the plate of the material instead.

    Parameters
    ----------
    hinges, plate : System
        Both systems, at the same time.
    contexts : sequence of (ShellContext, slice)
        The shells and their vertices.
    rigidity : float
        Least bending stiffness D of the shells in N m.
    """

    hinges: System
    plate: System
    contexts: Sequence[tuple[ShellContext, slice]]
    rigidity: float

    def bent_at_start(self, points: NDArray) -> bool:
        """Whether the bending energy at the start is significant, relative to that at (n, 3) points."""
        bendings = [(_bending(context), context, rows) for context, rows in self.contexts]
        start = sum(term.energy(np.asarray(context.mesh.points)) for term, context, _ in bendings)
        end = sum(term.energy(points[rows]) for term, _, rows in bendings)
        return start > BENT_START * end

    def displacements(self, x: NDArray, forces: Sequence[NDArray], shift: float = 0.0) -> list[NDArray]:
        """Displacements (n, 3) of the plate from x under each of some forces (n, 3), by linear theory.

        `shift` (1/s^2) times the masses is added to the stiffness.

        Raises
        ------
        SolveError
            If the plate is unstable at x.
        """
        from ddgcli.mechanics.objective import Objective

        increment, objective = Increment(0.0, x), Objective(self.plate)
        stiffness = float(objective.hessian(increment, x, "exact").diagonal().sum())
        shift = max(shift, LEAST_SHIFT * stiffness / (3 * float(self.plate.mass.sum())))
        matrix = objective.hessian(increment, x, "exact", shift)
        solver = objective.solver(increment)
        solver.factorise(self.plate, matrix, x, objective.columns(x))
        return [objective.scatter(solver.solve(objective.gather(force))) for force in forces]


def plate_twin(system: System, contexts: Mapping[str, ShellContext]) -> PlateTwin | None:
    """The shells of a system with plates in place of hinges.

    Parameters
    ----------
    system : System
    contexts : mapping of str to ShellContext
        Shells of the system, in the order of their vertices.

    Returns
    -------
    PlateTwin or None
        None without hinges, if needles prevent mid-edge bending, and if factors do not fit into memory.
    """
    ends = np.cumsum([0, *(context.mesh.n_vertices for context in contexts.values())]).tolist()
    plates: dict[int, MidedgeBending] = {}
    shells = []
    for context, *pair in zip(contexts.values(), ends, ends[1:]):
        shells.append((context, slice(*pair)))
        if (plate := _plate(context)) is not None:
            plates[id(_bending(context))] = plate

    def with_plate(term: Any) -> Any:
        plate = plates.get(id(term.own_term))
        if plate is None:
            return term
        return embedded(plate, term.rows) if isinstance(term, EmbeddedTerm) else plate

    if not plates:
        return None
    from ddgcli.mechanics.objective import HESSIAN_SOLVER, Objective  # few runs need it

    system.cache.pop(HESSIAN_SOLVER, None)  # frees the factors of the hinges before those of the plate
    terms = [with_plate(term) for term in system.terms]
    twin = System(system.mass, terms, Account(), system.start, system.size).at(system.time)
    if Objective(twin).solver(Increment(0.0, system.start)).by_blocks:
        return None
    return PlateTwin(system, twin, shells, min(plate.rigidity for plate in plates.values()))


def deflection_factor(twin: PlateTwin, points: NDArray) -> float:
    """Ratio of the deflections of the plate and of the hinges, in equilibrium, weighted by the forces.

    The displacement of the plate from the equilibrium of the hinges to its own follows from linear theory.

    Parameters
    ----------
    twin : PlateTwin
    points : (n, 3) ndarray of float64
        Positions in m at the equilibrium of the hinges.

    Returns
    -------
    float
        1 if a shell was bent at the start, or if the plate is unstable.
    """
    if twin.bent_at_start(points):
        return 1.0
    force = np.zeros_like(points)
    for context, rows in twin.contexts:
        force[rows] = np.sum([term.gradient(points[rows]) for term in context.elastic], axis=0)
    force = twin.hinges.only_free(force)
    # couples rotate: after large rotations their forces do no work along the chord from the start
    work = max(abs(float(np.vdot(force, points - twin.hinges.start))), 2.0 * _elastic_energy(twin, points))
    move = _to_equilibrium(twin, points)
    if move is None or work <= twin.hinges.rounding.energy():
        return 1.0
    return max(1.0 + float(np.vdot(force, move)) / work, 0.0)


def force_factor(twin: PlateTwin, points: NDArray) -> float:
    """Ratio of the handle forces with hinges and with the plate, computed as that of elastic energies.

    Parameters
    ----------
    twin : PlateTwin
    points : (n, 3) ndarray of float64
        Positions in m at the equilibrium of the hinges.

    Returns
    -------
    float
        1 without handles, if a shell was bent at the start, or if the plate is unstable.
    """
    if not twin.hinges.prescribed or twin.bent_at_start(points):
        return 1.0
    elastic = _elastic_energy(twin, points)
    move = _to_equilibrium(twin, points)
    if move is None or elastic <= twin.hinges.rounding.energy():
        return 1.0
    more = sum(twin.plate.energies(points).values()) - sum(twin.hinges.energies(points).values())
    of_plate = elastic + more + 0.5 * float(np.vdot(twin.plate.gradient(points), move))
    return elastic / of_plate if of_plate > 0.0 else 1.0


def _elastic_energy(twin: PlateTwin, points: NDArray) -> float:
    """Energy of the shells with hinges in J."""
    return sum(term.energy(points[rows]) for context, rows in twin.contexts for term in context.elastic)


def _to_equilibrium(twin: PlateTwin, points: NDArray) -> NDArray[np.float64] | None:
    """Displacement of the plate to its equilibrium, by linear theory; None if it is unstable."""
    try:
        return twin.displacements(points, [-twin.plate.gradient(points)])[0]
    except SolveError:
        return None


def frequency_factor(twin: PlateTwin, points: NDArray, shapes: Sequence[NDArray], values: NDArray) -> float:
    """Ratio of the frequencies with hinges and with the plate, by one step of inverse iteration.

    Parameters
    ----------
    twin : PlateTwin
    points : (n, 3) ndarray of float64
        Positions in m.
    shapes : sequence of (n, 3) ndarray
        Vibration modes with hinges.
    values : (k,) ndarray
        Their frequencies in Hz.

    Returns
    -------
    float
        The ratio that is farthest from 1; 1 if no shape bends, or if the plate is unstable.
    """
    mass = twin.hinges.mass[:, None]
    forces = [(2 * np.pi * value) ** 2 * mass * shape for value, shape in zip(values, shapes)]
    stable = [(shape, force) for value, shape, force in zip(values, shapes, forces) if value > 0.0]
    return float(np.sqrt(_stiffness_factor(twin, points, stable)))


def load_factor(twin: PlateTwin, shapes: Sequence[NDArray]) -> float:
    """Ratio of the buckling loads with hinges and with the plate, by one step of inverse iteration.

    Parameters
    ----------
    twin : PlateTwin
    shapes : sequence of (n, 3) ndarray
        Buckling modes with hinges.

    Returns
    -------
    float
        The ratio that is farthest from 1; 1 if no shape bends.
    """
    start = twin.hinges.start
    forces = [np.zeros_like(start) for _ in shapes]
    for context, rows in twin.contexts:
        for term in context.elastic:
            operator = term.material_operator(start[rows])
            for force, shape in zip(forces, shapes):
                force[rows] += operator(shape[rows])
    return _stiffness_factor(twin, start, list(zip(shapes, map(twin.hinges.only_free, forces))))


def _stiffness_factor(twin: PlateTwin, x: NDArray, shapes: Sequence[tuple[NDArray, NDArray]]) -> float:
    """Ratio of the stiffnesses of hinges and plate that is farthest from 1, over (shape, elastic force)."""
    size = float(np.ptp(x, axis=0).max())
    least = LEAST_BENDING * twin.rigidity / size**2
    bent = [(shape, force) for shape, force in shapes if np.vdot(shape, force) > least]
    if not bent:
        return 1.0
    slowest = min(np.vdot(u, f) / np.vdot(twin.hinges.mass[:, None] * u, u) for u, f in bent)
    try:
        moves = twin.displacements(x, [force for _, force in bent], 1e-4 * float(slowest))
    except SolveError:
        return 1.0
    factors = [float(np.vdot(f, move) / np.vdot(f, u)) for (u, f), move in zip(bent, moves)]
    return farthest_from_one(factors)


def farthest_from_one(factors: Sequence[float]) -> float:
    """The positive factor f with the largest max(f, 1/f).

    Parameters
    ----------
    factors : sequence of float

    Returns
    -------
    float
        1 without factors.
    """
    return max((f for f in factors if f > 0.0), key=lambda f: max(f, 1 / f), default=1.0)


def warn_of_hinges(factor: float, what: str, more: str = "high", less: str = "low") -> None:
    """Warn if hinges bend differently from the plate of the material.

    Parameters
    ----------
    factor : float
        Ratio of the results of hinges and plate, or its inverse.
    what : str
        Name of the results in the message.
    more, less : str
        Adjective for the results of the hinges if the factor is above or below 1.
    """
    if max(factor, 1 / factor if factor > 0.0 else 0.0) > WARNING_FACTOR:
        logging.getLogger("ddgcli").warning(
            "hinges do not bend as the plate of the material on this mesh: %s are about %.2f times too %s; "
            'write bending = { model = "midedge" }',
            what, max(factor, 1 / factor), more if factor > 1.0 else less,
        )  # fmt: skip


def _bending(context: ShellContext) -> Any:
    return context.terms["bending"][0]


def _plate(context: ShellContext) -> MidedgeBending | None:
    """Mid-edge bending in place of the hinges; None without hinges, and if it is not possible."""
    from ddgcli.models.shell.bending import plate_bending
    from ddgcli.models.shell.midedge import MidedgeBending

    terms = context.terms.get("bending", [])
    if not terms or isinstance(terms[0], MidedgeBending):
        return None
    parameters = next(p for effect, p, _ in context.scene.effects if effect.name == "bending")
    try:
        return plate_bending(parameters, context)
    except (ValueError, SolveError):  # needles, and edges that cannot be clamped
        return None
