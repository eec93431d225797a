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

DIFFERENCE_STEP = 1e-4  # largest move for differences of Hessians, over the size of the object
MAX_ROUNDING = 0.1  # rounding of the energy of a buckling mode over that energy
MECHANISM = (
    "parts of the shell move without resistance, so no load factor is defined: "
    "buckling loads need stretching, bending and pins"
)
PINS = "pin more vertices: three that are not on one line hold all motions"
REST_STEP = 1e-3  # largest move for differences along the path to the equilibrium, over the object's size
FREE_FORCE = 1e-6  # force on a rigid motion over the largest force, above which the shell accelerates
# eigenvalue of a Gram matrix over the largest, and rest of a column over the column, below which columns are
# dependent
DEPENDENT = 1e-10
REST_SHIFT = 1e-3  # shift over the lowest elastic eigenvalue; bounds rigid motions towards the equilibrium
ZERO_EIGENVALUE = 1e-8  # eigenvalue over the largest, below which a mode is a rigid motion
ZERO_FREQUENCY = 1e-4  # frequency over the largest, below which a mode at the equilibrium is a rigid motion
RIGID_MOTIONS = 6  # largest number for one body
DRIVEN_MOVE = 0.1  # test move along the rigid motions that loads drive, over the object's size
SMALLEST_RATIO = 1e-9  # ratio over the largest, below which a load stiffens a shape or does nothing


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
        Estimates of the values at the nearby equilibrium, to second order in the displacement.
    displacement : float
        Largest displacement to that equilibrium by linear theory, over the size of the object.
    accelerates : bool
        Whether the forces at the start drive motions that nothing resists.
    rotates : bool
        Whether those motions include rotations, which change the forces.
    """

    values: NDArray[np.float64]
    shapes: NDArray[np.float64]
    at_equilibrium: NDArray[np.float64] | None = None
    displacement: float = 0.0
    accelerates: bool = False
    rotates: bool = False


def natural_modes(system: System, x: NDArray, k: int, *, equilibrium: bool = False) -> Modes:
    """Lowest frequencies and shapes of small undamped vibrations about given positions.

    Parameters
    ----------
    system : System
    x : (n, 3) ndarray of float64
        Positions in m.
    k : int
        Number of modes.
    equilibrium : bool
        Whether to estimate also the frequencies at the nearby equilibrium, if `x` is not one.

    Returns
    -------
    Modes
        Frequencies in Hz; negative for the square root of a negative eigenvalue (an unstable direction).
    """
    matrix, objective = _hessian(system, x), Objective(system)
    mass = objective.gather(np.repeat(system.mass[:, None], 3, axis=1))
    count = int(np.count_nonzero(mass))
    k = min(k, count)
    if k == 0:
        return Modes(np.zeros(0), np.zeros((0, *x.shape)))
    columns = objective.columns(x)
    values, vectors = lowest_eigenpairs(matrix, mass, k, columns=columns)
    frequencies = _frequency(values)
    shapes = np.stack([_shape(objective.scatter(column)) for column in vectors.T])
    force = -objective.gather(system.gradient(x))
    if not (equilibrium and force.any()):
        return Modes(frequencies, shapes)
    if _is_zero(values)[-1]:  # rigid motions may be missing, and the estimate needs an elastic mode
        values, vectors = lowest_eigenpairs(matrix, mass, min(k + RIGID_MOTIONS, count), columns=columns)
    rigid = vectors[:, _is_zero(values)]
    drive = rigid @ (rigid.T @ force)
    balanced, displacement = values, 0.0
    if not _is_zero(values).all():
        balance = force - mass * drive
        balanced, displacement = _at_equilibrium(system, x, matrix, mass, balance, values, vectors)
    accelerates = bool(np.abs(mass * drive).max() > FREE_FORCE * np.abs(force).max())
    rotates = accelerates and _changes_forces(system, x, objective.scatter(drive))
    at_rest = _frequency(balanced)
    at_rest[np.abs(at_rest) <= ZERO_FREQUENCY * np.abs(at_rest).max()] = 0.0
    return Modes(frequencies, shapes, at_rest[:k], displacement, accelerates, rotates)


def _is_zero(values: NDArray) -> NDArray[np.bool_]:
    """Which eigenvalues belong to rigid motions."""
    return np.abs(values) <= ZERO_EIGENVALUE * np.abs(values).max()


def _changes_forces(system: System, x: NDArray, motion: NDArray) -> bool:
    """Whether elastic forces change along a motion: true of a linearised rotation, not of a translation."""
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
    """Eigenvalues at the equilibrium under a force, and the displacement there over the size of the object.

    The estimate is of second order in the displacement, because the sag of a flat plate stiffens it to second
    order only. The reduced basis has the modes and the static response of all other modes to their coupling:
    a mode of a sagged plate stretches it, less so if the plate also moves in its plane. Away from equilibrium
    the Hessian contains terms of the unbalanced force; under a pressure without stress, a free shell resists
    or drives rotations. `force` does not contain the component that accelerates the shell as a whole, for
    which there is no equilibrium. The values are returned unchanged if rounding or a barrier prevents the
    estimate.
    """
    objective, columns = Objective(system), Objective(system).columns(x)
    elastic = np.abs(values[np.abs(values) > ZERO_EIGENVALUE * np.abs(values).max()])
    shift = REST_SHIFT * elastic.min() + 2.0 * max(0.0, -float(values[0]))
    try:
        factor = Factor(csc_array(stiffness + diags_array(shift * mass)))
        solve = low_rank.solver(factor.solve, columns)
        move = objective.scatter(solve(force))
    except SolveError:
        return values, 0.0
    displacement = float(np.abs(move).max()) / system.size
    step = min(1.0, REST_STEP / displacement) if displacement else 1.0
    further = _second_order(system, x, solve, move, step)
    ahead, behind = (_hessian(system, x + s * move + s * s * further) for s in (step, -step))
    first, second = (ahead - behind) / (2 * step), (ahead + behind - 2 * stiffness) / (2 * step**2)
    if not (np.isfinite(first.data).all() and np.isfinite(second.data).all()):  # a barrier was crossed
        return values, displacement
    load = first @ vectors
    load -= mass[:, None] * (vectors @ (vectors.T @ load))
    responses = np.stack([solve(column) for column in load.T], axis=1)
    basis = np.concatenate([vectors, _orthonormal(responses, vectors, mass)], axis=1)
    small = basis.T @ ((stiffness + first + second) @ basis)
    if columns is not None:
        dense = basis.T @ columns
        small += dense @ dense.T
    return np.linalg.eigvalsh(0.5 * (small + small.T))[: len(values)], displacement


def _second_order(
    system: System, x: NDArray, solve: low_rank.Operator, move: NDArray, step: float
) -> NDArray[np.float64]:
    """Second-order term of the displacement to an equilibrium; `move` is the first-order term."""
    objective = Objective(system)
    change = system.gradient(x + step * move) + system.gradient(x - step * move) - 2 * system.gradient(x)
    with np.errstate(invalid="ignore"):
        further = objective.scatter(solve(-objective.gather(change) / (2 * step**2)))
    return np.where(np.isfinite(further), further, 0.0)


def _orthonormal(columns: NDArray, against: NDArray, mass: NDArray) -> NDArray[np.float64]:
    """M-orthonormal basis of columns, orthogonal to an M-orthonormal basis `against`."""
    norm = np.sqrt(np.einsum("nk,n,nk->k", columns, mass, columns))
    for _ in range(2):  # the second pass removes the rounding of the first
        columns = columns - against @ (against.T @ (mass[:, None] * columns))
    size = np.sqrt(np.einsum("nk,n,nk->k", columns, mass, columns))
    others = size > DEPENDENT * norm  # the rest of the others is rounding
    columns = columns[:, others] / size[others]
    gram, turn = np.linalg.eigh(columns.T @ (mass[:, None] * columns))
    independent = gram > DEPENDENT * gram.max(initial=0.0)
    return columns @ (turn[:, independent] / np.sqrt(gram[independent]))


def buckling_modes(system: System, x: NDArray, k: int) -> Modes:
    """Load factors of linear buckling of a shell at rest, and the buckling shapes.

    Parameters
    ----------
    system : System
    x : (n, 3) ndarray of float64
        Positions at rest, in m.
    k : int
        Largest number of modes.

    Returns
    -------
    Modes
        Load factors, ascending.

    Raises
    ------
    SolveError
        Without loads, if the supports leave the shell free to move, if nothing resists some motion, or if no
        load factor is positive.

    Notes
    -----
    The stress is proportional to the load, and the shape stays that at rest: the load factors s make
    K0 + s K1 singular, with K1 the derivative of the geometric part of the Hessian along the small
    displacement that the loads cause.
    """
    reason = no_buckling(system, x)
    if reason:  # rounding can leave a singular stiffness positive definite
        raise SolveError(reason)
    unloaded, objective = _with_loads(system, 0.0), Objective(system)
    stiffness = _hessian(unloaded, x)
    force = -objective.gather(system.gradient(x) - unloaded.gradient(x))
    try:
        move = objective.scatter(Factor(stiffness, pivot=False).solve(force))
    except SolveError as error:
        raise SolveError(MECHANISM) from error
    step = DIFFERENCE_STEP * system.size / float(np.abs(move).max())
    ahead = _stress_part(_with_loads(system, step), x + step * move)
    behind = _stress_part(_with_loads(system, -step), x - step * move)
    try:
        ratio, vectors = largest_ratios(csc_array((behind - ahead) / (2 * step)), stiffness, k)
    except np.linalg.LinAlgError as error:
        raise SolveError(MECHANISM) from error
    # rounding of the elastic energies of the shapes, which are normalised to 1
    rounding = np.einsum("nk,nk->k", abs(vectors), abs(stiffness) @ abs(vectors)) * np.finfo(float).eps
    if rounding.max() > MAX_ROUNDING:
        raise SolveError(MECHANISM)
    significant = ratio > SMALLEST_RATIO * np.abs(ratio).max(initial=0.0)
    if not significant.any():
        raise SolveError("no multiple of the loads makes the shell buckle: they only stiffen it")
    return Modes(
        1 / ratio[significant],
        np.stack([_shape(objective.scatter(column)) for column in vectors.T[significant]]),
    )


def no_buckling(system: System, x: NDArray) -> str:
    """Reason why a system has no buckling loads, as far as known without a factorisation.

    Parameters
    ----------
    system : System
    x : (n, 3) ndarray of float64
        Positions in m.

    Returns
    -------
    str
        Reason and remedy; "" if there is none.
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
    """Exact Hessian over the unknowns, without low-rank terms."""
    return csc_array(Objective(system).hessian(Increment(0.0, x), x, "exact"))


def _stress_part(system: System, x: NDArray) -> csc_array:
    """Geometric part of the Hessian: the exact Hessian minus its material part."""
    return csc_array(_hessian(system, x) - Objective(system).hessian(Increment(0.0, x), x, "material"))


def _with_loads(system: System, factor: float) -> System:
    """The system with its loads times a factor."""
    scaled = copy.copy(system)
    scaled.potentials = [p if p.scaled is None else p.scaled(factor) for p in system.potentials]
    return scaled


def _shape(move: NDArray) -> NDArray[np.float64]:
    """The displacement scaled so that its longest vector has length 1."""
    return move / np.linalg.norm(move, axis=1).max()
