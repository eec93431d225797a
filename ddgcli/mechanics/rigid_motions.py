"""Rigid motions of a whole system that its supports do not prevent, in words."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ddgcli.mechanics.system import System
from ddgcli.mesh.vectors import row_cross

NULL_TOLERANCE = 1e-9  # of the largest singular value; supports that act on coordinates have none near it
TEST_ANGLE = 0.1  # rad
ROUNDING_MARGIN = 100.0  # over the energy that rounded positions have


def unheld_motions(system: System) -> str:
    """Rigid motions that fixed coordinates and clamps leave free.

    Parameters
    ----------
    system : System

    Returns
    -------
    str
        Such as "the supports leave a rotation free, about the axis (0, 1, 0) through (0, 0.5, 0)"; "" where
        there is none, or where contact may prevent it.
    """
    if system.barriers:
        return ""
    x = np.asarray(system.start)
    center = x.mean(axis=0)
    arms = (x - center) / system.size
    fields = np.zeros((len(x), 3, 6))
    for i, unit in enumerate(np.eye(3)):
        fields[..., i] = unit
        fields[..., 3 + i] = row_cross(unit, arms)
    prevented = fields[~system.free]
    if not len(prevented):
        return "nothing holds the shell"
    _, values, motions = np.linalg.svd(prevented, full_matrices=len(prevented) < 6)
    rank = int((values > NULL_TOLERANCE * values[0]).sum())
    unheld = [motion for motion in motions[rank:] if _costs_nothing(system, x, center, motion)]
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


def _costs_nothing(system: System, x: NDArray, center: NDArray, motion: NDArray) -> bool:
    """Whether the elements store no energy in a finite rotation: a clamp that holds directions would."""
    turned = Rotation.from_rotvec(TEST_ANGLE * motion[3:] / max(float(np.linalg.norm(motion[3:])), 1e-300))
    moved = turned.apply(x - center) + center
    elastic = [potential for potential in system.potentials if len(potential.stencil)]
    stored = sum(potential.energy(moved) - potential.energy(x) for potential in elastic)
    length = system.rounding.length + float(np.finfo(float).eps) * system.size
    return bool(stored <= ROUNDING_MARGIN * system.rounding.stiffness * length**2)


def _triple(vector: NDArray) -> str:
    return "(" + ", ".join(f"{round(float(value), 6) + 0.0:g}" for value in vector) + ")"
