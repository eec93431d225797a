"""Observations of shells for a frame: positions, velocities, strains, energies, momenta, reaction forces."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.mechanics.driving import contact_forces, reactions
from ddgcli.mechanics.system import Motion, System
from ddgcli.mesh.vectors import row_cross, vector_length
from ddgcli.models.shell.context import ShellContext
from ddgcli.models.shell.groups import Group
from ddgcli.simulation.model import Observation


def observed(group: Group, system: System, step_size: float, motion: Motion) -> dict[str, Observation]:
    """Observation of each shell of a group; the first one has the scalars of the group.

    Parameters
    ----------
    group : Group
    system : System
    step_size : float
        In s.
    motion : Motion

    Returns
    -------
    dict of str to Observation
    """
    current = system.with_memory_at(motion.memory).at(motion.time)
    scalars = measures(current, motion)
    plastic = [arrays["work"][0] for arrays in motion.memory if "work" in arrays]
    if plastic:
        scalars["plastic_work"] = float(sum(plastic))
    for potential in current.potentials:
        if potential.observed is not None:
            scalars |= potential.observed(motion.x)
    for edges in current.constraints:
        scalars |= edges.observed(motion.x, motion.multipliers)
    for name, (force, moment) in reactions(current, motion, step_size).items():
        scalars |= {f"reaction_force_{name}": force, f"reaction_moment_{name}": moment}
    for name, (force, moment) in contact_forces(current, motion, step_size).items():
        scalars |= {f"contact_force_{name}": force, f"contact_moment_{name}": moment}
    return _observations(group, motion, scalars, current)


def _observations(
    group: Group, motion: Motion, scalars: dict[str, Any], system: System
) -> dict[str, Observation]:
    """Observations from the motion and the scalars of a group."""
    x, v = group.split(motion.x), group.split(motion.v)
    return {
        name: Observation(
            x[name],
            {"velocity": v[name], "strain": strain(context, x[name])},
            scalars if k == 0 else {},
            shell_index,
            face=_on_faces(group, name, system, x[name]),
            n_faces=context.mesh.n_faces,
        )
        for k, ((name, context), shell_index) in enumerate(zip(group.shells.items(), group.shell_indices))
    }


def _on_faces(group: Group, name: str, system: System, x: NDArray) -> dict[str, NDArray]:
    """The face arrays that the section of the shell requests."""
    context = group.shells[name]
    if not context.shell.face_arrays:
        return {}
    from ddgcli.mechanics.embedding import terms_of_rows
    from ddgcli.models.shell.face_arrays import face_arrays

    first = int(group.ends[list(group.shells).index(name)])
    terms = terms_of_rows(list(system.potentials), slice(first, first + context.mesh.n_vertices))
    arrays = face_arrays(context, terms, x)
    return {key: arrays[key] for key in context.shell.face_arrays}


def strain(context: ShellContext, x: NDArray) -> NDArray[np.float64]:
    """(n,) largest |l / l0 - 1| over the edges at each vertex."""
    topology = context.mesh.topology
    rest = context.mesh.side_length.ravel()
    tail, head = topology.side_tail, topology.side_head
    now = vector_length(x[head] - x[tail])
    relative = np.abs(now / rest - 1)
    largest = np.zeros(len(x))
    np.maximum.at(largest, tail, relative)
    np.maximum.at(largest, head, relative)
    return largest


@np.errstate(over="ignore", invalid="ignore")
def measures(system: System, motion: Motion) -> dict[str, Any]:
    """Energies by effect, momenta and iterations; infinite on overflow."""
    momentum = system.mass[:, None] * motion.v
    energies = {f"energy_{name}": value for name, value in system.energies(motion.x).items()}
    kinetic = 0.5 * float(np.sum(momentum * motion.v))
    return {
        "energy_kinetic": kinetic,
        **energies,
        "energy": kinetic + sum(energies.values()),
        "momentum": momentum.sum(axis=0),
        "angular_momentum": row_cross(motion.x, momentum).sum(axis=0),
        "newton_iterations": float(motion.newton),
        **({"external_work": motion.work} if system.driven else {}),
    }
