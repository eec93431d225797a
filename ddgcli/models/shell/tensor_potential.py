"""Potentials with tensors on the faces; the module loads no effect, so that scenes without them cost none."""

from __future__ import annotations

from typing import Any

from ddgcli.mechanics.terms import Potential


class TensorPotential(Potential):
    """A potential of which a shell reports tensors; a member that is None is one that it does not have.

    Attributes
    ----------
    green_strain : method (x) -> ((m, 2, 2) strain, (m, 2, 2) second stress in N/m)
        In the frames of the faces at rest.
    moment_tensor : method (x, added rotations) -> (m, 2, 2) ndarray
        N m per metre.
    added_rotations : method () -> ndarray or float
        Rotations of edges that a load adds.
    """

    green_strain: Any = None
    moment_tensor: Any = None
    added_rotations: Any = None
