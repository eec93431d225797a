"""How far bending by hinges is off that of the material's plate, in given shapes of shells."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import SolveError
from ddgcli.mechanics.terms import LinearOperator
from ddgcli.models.shell.context import ShellContext

if TYPE_CHECKING:
    from ddgcli.models.shell.midedge import MidedgeBending

WARNING_FACTOR = 1.1  # of the stiffness by hinges over that of the plate in a shape
BENT_START = 1e-6  # of the bending energy, that a shell may have at the start
LEAST_BENDING = 1e-6  # of D / size^2: less is the rounding of a rigid motion


def frequency_factor(
    contexts: Mapping[str, ShellContext], points: NDArray, shapes: Sequence[NDArray], values: NDArray
) -> float:
    """Largest factor by which hinges make frequencies too high, by the plate's stiffness in their shapes.

    Parameters
    ----------
    contexts : mapping of str to ShellContext
        In the order of their vertices.
    points : (n, 3) ndarray of float64
        Positions in m of the vertices of all shells.
    shapes : sequence of (n, 3) ndarray
    values : (k,) ndarray
        Frequencies in Hz of the shapes.

    Returns
    -------
    float
        1 where no shell has hinges.
    """
    mass = np.concatenate([context.mass for context in contexts.values()])
    inertia = np.array([float(mass @ (shape**2).sum(axis=1)) for shape in shapes])
    stiffness = np.sign(values) * (2 * np.pi * values) ** 2 * inertia
    return float(np.sqrt(_stiffness_factor(contexts, points, shapes, stiffness)))


def load_factor(contexts: Mapping[str, ShellContext], points: NDArray, shapes: Sequence[NDArray]) -> float:
    """Largest factor by which hinges make buckling loads too high, by the plate in their shapes.

    Parameters
    ----------
    contexts : mapping of str to ShellContext
    points : (n, 3) ndarray of float64
    shapes : sequence of (n, 3) ndarray

    Returns
    -------
    float
        1 where no shell has hinges.
    """
    stiffness = np.zeros(len(shapes))
    for context, rows in _rows(contexts):
        for term in context.elastic:
            stiffness += _quotients(term.material_operator(points[rows]), shapes, rows)
    return _stiffness_factor(contexts, points, shapes, stiffness)


def deflection_factor(contexts: Mapping[str, ShellContext], points: NDArray) -> float:
    """Factor by which hinges make deflections at equilibrium too small, by the energy of the plate there.

    Parameters
    ----------
    contexts : mapping of str to ShellContext
    points : (n, 3) ndarray of float64
        Positions in m at equilibrium.

    Returns
    -------
    float
        1 where no shell has hinges, and where a shell was bent at the start.

    Notes
    -----
    Of a linear shell this is a lower bound for the work of dead loads, which is twice the energy: by the
    principle of minimum potential energy the plate's is at least that of this shape, scaled at best.
    """
    elastic, hinges, plate = 0.0, 0.0, 0.0
    for context, rows in _rows(contexts):
        x, rest = points[rows], np.asarray(context.mesh.points)
        elastic += sum(term.energy(x) for term in context.elastic)
        if (potential := _plate(context)) is not None:
            own = context.terms["bending"][0]
            if own.energy(rest) > BENT_START * own.energy(x):
                return 1.0
            hinges, plate = hinges + own.energy(x), plate + potential.energy(x)
    least = elastic - hinges + plate
    return max(1.0, elastic / least) if hinges > 0.0 and least > 0.0 else 1.0


def warn_of_hinges(factor: float, what: str, error: str = "high") -> None:
    """Warn where hinges do not bend as the plate of the material.

    Parameters
    ----------
    factor : float
        Of the numbers by hinges over those of the plate.
    what : str
        What the numbers are.
    error : {'high', 'small'}
        What they are in place of the plate's.
    """
    if factor > WARNING_FACTOR:
        logging.getLogger("ddgcli").warning(
            "hinges do not bend as the plate of the material on this mesh: %s are about %.2f times too %s; "
            'write bending = { model = "midedge" }', what, factor, error,
        )  # fmt: skip


def _rows(contexts: Mapping[str, ShellContext]) -> list[tuple[ShellContext, slice]]:
    """Each shell and its vertices."""
    ends = np.cumsum([0, *(context.mesh.n_vertices for context in contexts.values())]).tolist()
    return [(context, slice(*pair)) for context, *pair in zip(contexts.values(), ends, ends[1:])]


def _quotients(operator: LinearOperator, shapes: Sequence[NDArray], rows: slice) -> NDArray[np.float64]:
    return np.array([float(np.sum(shape[rows] * operator(shape[rows]))) for shape in shapes])


def _stiffness_factor(
    contexts: Mapping[str, ShellContext], points: NDArray, shapes: Sequence[NDArray], stiffness: NDArray
) -> float:
    """Largest factor of stiffnesses (k,) over those with the plate in place of the hinges, at least 1.

    By Rayleigh's principle the plate is no stiffer in its own shapes than in these.
    """
    hinges, plate, least = np.zeros(len(shapes)), np.zeros(len(shapes)), np.inf
    for context, rows in _rows(contexts):
        if (pair := _operators(context, points[rows])) is not None:
            hinges += _quotients(pair[0], shapes, rows)
            plate += _quotients(pair[1], shapes, rows)
            least = min(least, LEAST_BENDING * pair[2] / float(np.ptp(points[rows], axis=0).max()) ** 2)
    bent = np.minimum(hinges, stiffness) > least
    if not bent.any():
        return 1.0
    of_plate = (stiffness - hinges + plate)[bent]
    return float((stiffness[bent] / of_plate)[of_plate > 0.0].max(initial=1.0))


def _operators(context: ShellContext, x: NDArray) -> tuple[LinearOperator, LinearOperator, float] | None:
    """Bending stiffness by hinges and of the plate, and D; None where there are no hinges or no plate."""
    plate = _plate(context)
    if plate is None:
        return None
    return context.terms["bending"][0].material_operator(x), plate.material_operator(x), plate.rigidity


def _plate(context: ShellContext) -> MidedgeBending | None:
    """Bending of the plate in place of the hinges; None where there are no hinges or no plate."""
    from ddgcli.models.shell.bending import plate_bending

    terms = context.terms.get("bending", [])
    if not terms or hasattr(terms[0], "moment_tensor"):
        return None
    parameters = next(p for effect, p, _ in context.scene.effects if effect.name == "bending")
    try:
        return plate_bending(parameters, context)
    except (ValueError, SolveError):  # needles, and edges that cannot be clamped
        return None
