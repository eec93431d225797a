"""Conversion of the motion of shells to the named arrays of a checkpoint, and back without any rounding."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.mechanics.system import NO_MULTIPLIERS, Motion, System

PAST_ARRAYS = ("past_x", "past_v", "past_dt")  # arrays of a checkpoint


def unpacked(system: System, multistep: bool, arrays: dict[str, NDArray]) -> Motion:
    """Motion from the arrays of a checkpoint; the inverse of `packed`.

    Parameters
    ----------
    system : System
        The system whose terms have the memories of the checkpoint.
    multistep : bool
        Whether the scheme keeps positions and velocities of the step before.
    arrays : dict of str to ndarray

    Returns
    -------
    Motion
    """
    count, excess, time, work = (float(value) for value in arrays["scalars"])
    memory = tuple(
        {name: arrays[f"memory_{k}_{name}"] for name in term.initial()}
        for k, term in enumerate(system.memories)
    )
    past = tuple(arrays[name] for name in PAST_ARRAYS) if multistep else ()
    multipliers = arrays.get("multipliers", NO_MULTIPLIERS)
    return Motion(
        arrays["x"], arrays["v"], arrays["a"], int(count), excess, time, work, memory, past, multipliers
    )


def packed(motion: Motion) -> dict[str, NDArray]:
    """Arrays of a checkpoint.

    Parameters
    ----------
    motion : Motion

    Returns
    -------
    dict of str to ndarray
    """
    scalars = np.array([motion.newton, motion.balance_excess, motion.time, motion.work])
    memory = {
        f"memory_{k}_{name}": array
        for k, arrays in enumerate(motion.memory)
        for name, array in arrays.items()
    }
    return {
        "x": motion.x,
        "v": motion.v,
        "a": motion.a,
        "scalars": scalars,
        **memory,
        **dict(zip(PAST_ARRAYS, motion.past)),
        **({"multipliers": motion.multipliers} if len(motion.multipliers) else {}),
    }
