"""Small vibrations and buckling loads: eigenvalue problems of the exact Hessian."""

from __future__ import annotations

import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, diags_array

from ddgcli.errors import SolveError
from ddgcli.linalg import low_rank
from ddgcli.linalg.factor import Factor
from ddgcli.linalg.modes import largest_ratios, lowest_eigenpairs
from ddgcli.mechanics.increment import Increment
from ddgcli.mechanics.objective import Objective
from ddgcli.mechanics.rigid_motions import ROUNDING_MARGIN, unheld_motions
from ddgcli.mechanics.system import System

DIFFERENCE_STEP = 1e-4  # of the size of the object: largest move of the difference of Hessians
MAX_ROUNDING = 0.1  # of the energy of a buckling mode, by the rounding of the stiffness
MECHANISM = (
    "parts of the shell move without resistance, so no load factor is defined: "
    "buckling loads need stretching, bending and pins"
)
PINS = "pin more vertices: three that are not on one line hold all motions"
REST_STEP = 1e-3  # of the size of the object: largest move of the differences on the way to the equilibrium
FREE_FORCE = 1e-6  # of the largest force: a rigid motion that it drives
# of the largest eigenvalue of normal columns' products, and of a column: they depend on others
DEPENDENT = 1e-10
REST_SHIFT = 1e-3  # of the lowest elastic eigenvalue: bounds rigid motions on the way to the equilibrium
ZERO_EIGENVALUE = 1e-8  # of the largest eigenvalue: a rigid motion
ZERO_FREQUENCY = 1e-4  # of the largest frequency: a rigid motion at the equilibrium nearby
RIGID_MOTIONS = 6  # of one body, at most
DRIVEN_MOVE = 0.1  # of the size of the object: test move along the rigid motions that loads drive
SMALLEST_RATIO = 1e-9  # of the largest: below, a load stiffens or does nothing


@dataclass(frozen=True, eq=False)
class Modes:
    """Modes of a system, ascending.

    Parameters
    ----------
    values : (k,) ndarray
        Frequencies in Hz, negative (minus the growth rate by 2 pi) where unstable; or load factors.
    shapes : (k, n, 3) ndarray
        Displacements, the largest of length 1.
    at_equilibrium : (k,) ndarray or None
        What the values would be at the equilibrium nearby, to second order in the way there.
    way : float
        Largest displacement to that equilibrium by linear theory, over the size of the object.
    accelerates : bool
        The forces at the start drive motions that nothing resists.
    swings : bool
        Those motions are no translations: what they lead to has other forces.
    """

    values: NDArray[np.float64]
    shapes: NDArray[np.float64]
    at_equilibrium: NDArray[np.float64] | None = None
    way: float = 0.0
    accelerates: bool = False
    swings: bool = False


def natural_modes(system: System, x: NDArray, k: int, *, equilibrium: bool = False) -> Modes:
    """Frequencies and shapes of the slowest small vibrations about a rest shape, undamped.

    Parameters
    ----------
    system : System
    x : (n, 3) ndarray of float64
        Positions at rest, in m.
    k : int
        Number of modes.
    equilibrium : bool
        Whether to estimate the frequencies at the equilibrium nearby, too, if `x` is none.

    Returns
    -------
    Modes
        Frequencies in Hz; negative for the square root of a negative eigenvalue (an unstable direction).
    """
    matrix, objective = _hessian(system, x), Objective(system)
    mass = objective.entries(np.repeat(system.mass[:, None], 3, axis=1))
    count = int(np.count_nonzero(mass))
    k = min(k, count)
    if k == 0:
        return Modes(np.zeros(0), np.zeros((0, *x.shape)))
    columns = objective.columns(x)
    values, vectors = lowest_eigenpairs(matrix, mass, k, columns=columns)
    frequencies = _frequency(values)
    shapes = np.stack([_shape(objective.spread(column)) for column in vectors.T])
    force = -objective.entries(system.gradient(x))
    if not (equilibrium and force.any()):
        return Modes(frequencies, shapes)
    if _is_zero(values)[-1]:  # rigid motions may be missing, and the estimate needs an elastic mode
        values, vectors = lowest_eigenpairs(matrix, mass, min(k + RIGID_MOTIONS, count), columns=columns)
    rigid = vectors[:, _is_zero(values)]
    drive = rigid @ (rigid.T @ force)
    balanced, way = values, 0.0
    if not _is_zero(values).all():
        balanced, way = _at_equilibrium(system, x, matrix, mass, force - mass * drive, values, vectors)
    accelerates = bool(np.abs(mass * drive).max() > FREE_FORCE * np.abs(force).max())
    swings = accelerates and _changes_forces(system, x, objective.spread(drive))
    at_rest = _frequency(balanced)
    at_rest[np.abs(at_rest) <= ZERO_FREQUENCY * np.abs(at_rest).max()] = 0.0
    return Modes(frequencies, shapes, at_rest[:k], way, accelerates, swings)


def _is_zero(values: NDArray) -> NDArray[np.bool_]:
    """Which eigenvalues, some of them, are those of rigid motions."""
    return np.abs(values) <= ZERO_EIGENVALUE * np.abs(values).max()


def _changes_forces(system: System, x: NDArray, motion: NDArray) -> bool:
    """Whether elastic forces resist a motion in its second order: a rotation, not a translation."""
    move = DRIVEN_MOVE * system.size / np.abs(motion).max() * motion
    elastic = [potential for potential in system.potentials if len(potential.stencil)]
    change = sum(np.abs(p.gradient(x + move) - p.gradient(x)).sum() for p in elastic)
    return bool(change > ROUNDING_MARGIN * system.rounding.stiffness * system.rounding.length)


def _frequency(eigenvalue: NDArray) -> NDArray[np.float64]:
    return np.sign(eigenvalue) * np.sqrt(np.abs(eigenvalue)) / (2 * np.pi)


def _at_equilibrium(
    system: System, x: NDArray, stiffness: csc_array, mass: NDArray, force: NDArray, values: NDArray,
    vectors: NDArray,
) -> tuple[NDArray[np.float64], float]:  # fmt: skip
    """Eigenvalues about the equilibrium under a force, and the way there over the size of the object.

    To second order in the way: a flat plate that sags is stiffened by its second order alone. The modes and
    the static response of other modes to them span the space (a mode of a plate that has sagged stretches it,
    less where the plate moves in its plane). Without balance the Hessian has terms of the force: a free shell
    under a pressure that its stress does not bear resists, or drives, rotations. What accelerates the shell
    as a whole has no equilibrium: `force` is without it. The values stay as they are where rounding or a
    barrier leaves no way.
    """
    objective, columns = Objective(system), Objective(system).columns(x)
    elastic = np.abs(values[np.abs(values) > ZERO_EIGENVALUE * np.abs(values).max()])
    shift = REST_SHIFT * elastic.min() + 2.0 * max(0.0, -float(values[0]))
    try:
        factor = Factor(csc_array(stiffness + diags_array(shift * mass)))
        solve = low_rank.solver(factor.solve, columns)
        move = objective.spread(solve(force))
    except SolveError:
        return values, 0.0
    way = float(np.abs(move).max()) / system.size
    step = min(1.0, REST_STEP / way) if way else 1.0
    further = _second_order(system, x, solve, move, step)
    ahead, behind = (_hessian(system, x + s * move + s * s * further) for s in (step, -step))
    first, second = (ahead - behind) / (2 * step), (ahead + behind - 2 * stiffness) / (2 * step**2)
    if not (np.isfinite(first.data).all() and np.isfinite(second.data).all()):  # a barrier on the way
        return values, way
    load = first @ vectors
    load -= mass[:, None] * (vectors @ (vectors.T @ load))
    responses = np.stack([solve(column) for column in load.T], axis=1)
    basis = np.concatenate([vectors, _orthonormal(responses, vectors, mass)], axis=1)
    small = basis.T @ ((stiffness + first + second) @ basis)
    if columns is not None:
        dense = basis.T @ columns
        small += dense @ dense.T
    return np.linalg.eigvalsh(0.5 * (small + small.T))[: len(values)], way


def _second_order(
    system: System, x: NDArray, solve: low_rank.Operator, move: NDArray, step: float
) -> NDArray[np.float64]:
    """Displacement to an equilibrium of second order in `move`, that of first order."""
    objective = Objective(system)
    change = system.gradient(x + step * move) + system.gradient(x - step * move) - 2 * system.gradient(x)
    with np.errstate(invalid="ignore"):
        further = objective.spread(solve(-objective.entries(change) / (2 * step**2)))
    return np.where(np.isfinite(further), further, 0.0)


def _orthonormal(columns: NDArray, against: NDArray, mass: NDArray) -> NDArray[np.float64]:
    """M-orthonormal basis of columns without their components along an M-orthonormal basis."""
    whole = np.sqrt(np.einsum("nk,n,nk->k", columns, mass, columns))
    for _ in range(2):  # the second time rounding of the first
        columns = columns - against @ (against.T @ (mass[:, None] * columns))
    size = np.sqrt(np.einsum("nk,n,nk->k", columns, mass, columns))
    others = size > DEPENDENT * whole  # what is left of the rest is rounding
    columns = columns[:, others] / size[others]
    gram, turn = np.linalg.eigh(columns.T @ (mass[:, None] * columns))
    independent = gram > DEPENDENT * gram.max(initial=0.0)
    return columns @ (turn[:, independent] / np.sqrt(gram[independent]))


def buckling_modes(system: System, x: NDArray, k: int) -> Modes:
    """Factors on all loads at which a shell at rest buckles, by linear theory.

    Parameters
    ----------
    system : System
    x : (n, 3) ndarray of float64
        Positions at rest under the loads, in m.
    k : int
        Largest number of modes.

    Returns
    -------
    Modes
        Load factors, ascending.

    Raises
    ------
    SolveError
        Without loads, with supports that leave the shell free to move, without resistance to some motion,
        or where no load factor is positive.

    Notes
    -----
    The stress grows in proportion to the load, and the shape stays that at rest: K0 + s K1 is singular, K1
    the derivative of the stress part of the Hessian along the small displacement that the loads cause.
    """
    reason = no_buckling(system, x)
    if reason:  # rounding can leave a singular stiffness positive definite
        raise SolveError(reason)
    unloaded, objective = _with_loads(system, 0.0), Objective(system)
    stiffness = _hessian(unloaded, x)
    force = -objective.entries(system.gradient(x) - unloaded.gradient(x))
    try:
        move = objective.spread(Factor(stiffness, pivot=False).solve(force))
    except SolveError as error:
        raise SolveError(MECHANISM) from error
    step = DIFFERENCE_STEP * system.size / float(np.abs(move).max())
    ahead = _stress_part(_with_loads(system, step), x + step * move)
    behind = _stress_part(_with_loads(system, -step), x - step * move)
    try:
        ratio, vectors = largest_ratios(csc_array((behind - ahead) / (2 * step)), stiffness, k)
    except np.linalg.LinAlgError as error:
        raise SolveError(MECHANISM) from error
    # energies of the shapes are 1: what rounding of the matrix makes of them
    rounding = np.einsum("nk,nk->k", abs(vectors), abs(stiffness) @ abs(vectors)) * np.finfo(float).eps
    if rounding.max() > MAX_ROUNDING:
        raise SolveError(MECHANISM)
    significant = ratio > SMALLEST_RATIO * np.abs(ratio).max(initial=0.0)
    if not significant.any():
        raise SolveError("no multiple of the loads makes the shell buckle: they only stiffen it")
    return Modes(
        1 / ratio[significant],
        np.stack([_shape(objective.spread(column)) for column in vectors.T[significant]]),
    )


def no_buckling(system: System, x: NDArray) -> str:
    """Why no load factor of a system is computed, as far as that is known without a factorisation.

    Parameters
    ----------
    system : System
    x : (n, 3) ndarray of float64
        Positions in m.

    Returns
    -------
    str
        With a remedy; "" where nothing prevents it.
    """
    if system.low_rank(x) is not None:
        return "buckling loads of a shell with a gas are not implemented; use pressure without gas"
    unheld = unheld_motions(system)
    if unheld:
        return f"{unheld}, so no load factor is defined; {PINS}"
    if not np.any(system.gradient(x) - _with_loads(system, 0.0).gradient(x)):
        return "no load acts on a free vertex, so nothing buckles; add a load, gravity or pressure"
    return ""


def _hessian(system: System, x: NDArray) -> csc_array:
    """Exact Hessian over the unknowns, without its dense terms of low rank."""
    return csc_array(Objective(system).hessian(Increment(0.0, x), x, "exact"))


def _stress_part(system: System, x: NDArray) -> csc_array:
    """The exact Hessian less its material part."""
    return csc_array(_hessian(system, x) - Objective(system).hessian(Increment(0.0, x), x, "material"))


def _with_loads(system: System, factor: float) -> System:
    """The system with its loads times a factor."""
    scaled = copy.copy(system)
    scaled.potentials = [p if p.scaled is None else p.scaled(factor) for p in system.potentials]
    return scaled


def _shape(move: NDArray) -> NDArray[np.float64]:
    """A displacement whose longest vector has length 1."""
    return move / np.linalg.norm(move, axis=1).max()
