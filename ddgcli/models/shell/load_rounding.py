"""Check of equilibria under loads that are smaller than the rounding of the elastic forces."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ddgcli.mechanics.rigid_motions import unheld_motions
from ddgcli.mechanics.small_loads import MAX_UNBALANCED, force_rounding, larger_loads, largest_load
from ddgcli.mechanics.system import System
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.shell.equilibrium_advice import needle_advice

log = logging.getLogger("ddgcli")


def load_rounding_reason(
    end: Mapping[str, NDArray],
    systems: Mapping[str, System],
    meshes: Mapping[str, Sequence[TriangleMesh]],
    time: float,
) -> str:
    """Reason why equilibria under loads below the rounding of elastic forces are unreliable.

    Residual forces above the loads are the elastic forces of rounded positions. The positions are then
    correct up to rounding, and a message is logged. This does not hold with needles among the faces: their
    stiffness hides that of the other faces in the Hessian, and deflections may be much too small.

    Parameters
    ----------
    end : mapping of str to (n, 3) ndarray
        Positions of each system in m.
    systems : mapping of str to System
    meshes : mapping of str to sequence of TriangleMesh
        Meshes of the shells of each system.
    time : float
        Time of the loads, in s.

    Returns
    -------
    str
        "" if they are reliable.
    """
    reason = ""
    for name, system in systems.items():
        if system.memories:  # without the memory of the run, forces after yielding cannot be computed here
            continue
        at_end, x = system.at(time).with_own_account(), end[name]
        largest = largest_load(at_end, x)
        left = float(np.abs(at_end.gradient(x)).max())
        if left > MAX_UNBALANCED * largest > 0:
            needles = needle_advice(meshes[name])
            message = (
                f"object {name}: forces of {left:.3g} N are left on vertices, whose loads are at most "
                f"{largest:.3g} N: the loads are below the rounding of the elastic forces, and so are the "
                f"reactions; {needles or _advice(system, largest, left)}"
            )
            log.error(message)
            reason = message if needles and left > largest else reason
    return reason


def _advice(system: System, largest: float, left: float) -> str:
    unheld = unheld_motions(system)
    if unheld:
        return f"{unheld}, hold it by pins"
    return f"{larger_loads(largest, max(left, force_rounding(system)))}, or take a softer material"
