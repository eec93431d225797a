"""Rigid motions that the supports of a system do not prevent, and messages about them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ddgcli.mechanics.system import System
from ddgcli.mechanics.terms import Potential
from ddgcli.mesh.vectors import row_cross

NULL_TOLERANCE = 1e-9  # singular value over the largest, below which it is zero; others are much larger
TEST_ANGLE = 0.1  # rad, of the finite motion that tests for resistance
ROUNDING_MARGIN = 100.0  # change of the energy over its rounding, above which a motion meets resistance


def unheld_motions(system: System) -> str:
    """Message about the rigid motions that fixed coordinates and clamps leave free.

    Parameters
    ----------
    system : System

    Returns
    -------
    str
        Such as "the supports leave a rotation free, about the axis (0, 1, 0) through (0, 0.5, 0)"; "" if
        there is none, or if contact may prevent it.
    """
    if system.barriers:
        return ""
    if not system.support_mask.any():
        return "nothing holds the shell"
    x = np.asarray(system.start)
    center, _, motions = _unsupported(system, x)
    elastic = [potential for potential in system.potentials if len(potential.stencil)]
    unheld = [motion for motion in motions if _is_unresisted(system, elastic, x, motion)]
    if not unheld:
        return ""
    if len(unheld) > 1:
        return f"the supports leave {len(unheld)} of 6 rigid motions free"
    shift, turn = unheld[0][:3] * system.size, unheld[0][3:]
    rate = float(np.linalg.norm(turn))
    if rate * system.size < NULL_TOLERANCE * np.linalg.norm(shift):
        return f"the supports leave a translation free, along {_triple(shift / np.linalg.norm(shift))}"
    axis, through = _triple(turn / rate), _triple(center + row_cross(turn, shift) / rate**2)
    return f"the supports leave a rotation free, about the axis {axis} through {through}"


def moves_freely(system: System, x: NDArray) -> bool:
    """Whether the supports leave rigid motions free, and no potential resists any of them.

    Parameters
    ----------
    system : System
    x : (n, 3) ndarray of float64
        Positions in m.

    Returns
    -------
    bool
        Also False if contact may prevent them.
    """
    if system.barriers:
        return False
    _, _, motions = _unsupported(system, x)
    return len(motions) > 0 and all(_is_unresisted(system, system.potentials, x, m) for m in motions)


def unsupported_fields(system: System, x: NDArray) -> NDArray[np.float64]:
    """Velocity fields of the rigid motions that fixed coordinates leave free.

    Parameters
    ----------
    system : System
    x : (n, 3) ndarray of float64
        Positions in m.

    Returns
    -------
    (n, 3, k) ndarray of float64
    """
    _, fields, motions = _unsupported(system, x)
    return np.where(system.free[..., None], fields @ motions.T, 0.0)


def _unsupported(system: System, x: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Centre, velocities (n, 3, 6) of rigid motions about it, (k, 6) combinations that move no support.

    The first three coefficients are translations over the size of the system, the others rotations.
    """
    center = x.mean(axis=0)
    arms = (x - center) / system.size
    fields = np.zeros((len(x), 3, 6))
    for i, unit in enumerate(np.eye(3)):
        fields[..., i] = unit
        fields[..., 3 + i] = row_cross(unit, arms)
    prevented = fields[system.support_mask]
    if not len(prevented):
        return center, fields, np.eye(6)
    _, values, motions = np.linalg.svd(prevented, full_matrices=len(prevented) < 6)
    return center, fields, motions[int((values > NULL_TOLERANCE * values[0]).sum()) :]


def _is_unresisted(system: System, potentials: Sequence[Potential], x: NDArray, motion: NDArray) -> bool:
    """Whether potentials are constant in a finite rigid motion; a clamp that holds directions resists it."""
    center, shift, turn = x.mean(axis=0), motion[:3], motion[3:]
    angles = TEST_ANGLE * turn / max(float(np.linalg.norm(turn)), NULL_TOLERANCE)
    moved = Rotation.from_rotvec(angles).apply(x - center) + center + TEST_ANGLE * system.size * shift
    change = sum(potential.energy(moved) - potential.energy(x) for potential in potentials)
    length = system.rounding.length + float(np.finfo(float).eps) * system.size
    rounding = system.rounding.stiffness * length**2 + system.rounding.force * length
    return bool(abs(change) <= ROUNDING_MARGIN * rounding)


def _triple(vector: NDArray) -> str:
    return "(" + ", ".join(f"{round(float(value), 6) + 0.0:g}" for value in vector) + ")"
