"""Interface of potentials with tensors on the faces.

It is a module of its own so that it can be used without importing effects that the scene does not have.
"""

from __future__ import annotations

from typing import Any

from ddgcli.mechanics.terms import Potential


class TensorPotential(Potential):
    """A potential with tensors on the faces, which a shell can report; members that it lacks are None.

    Attributes
    ----------
    green_strain : method (x) -> ((m, 2, 2) strain, (m, 2, 2) stress in N/m)
        Green strain and second Piola-Kirchhoff stress, in the frames of the faces at rest.
    moment_tensor : method (x, added rotations) -> (m, 2, 2) ndarray
        In N m per metre.
    added_rotations : method () -> ndarray or float
        Rotations that a load adds to edge directors.
    """

    green_strain: Any = None
    moment_tensor: Any = None
    added_rotations: Any = None
