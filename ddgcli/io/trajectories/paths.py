"""Paths of particles in a trajectory as polylines."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ddgcli.errors import ParameterError
from ddgcli.io.trajectories.trajectory import Trajectory
from ddgcli.mesh.curve import CurveSet

PREFIX = "particles_"
LONGEST_STEP = 0.5  # of the size of a periodic grid: longer segments cross its sides and are left out


def check_particles(source: Trajectory) -> list[str]:
    """Names of the scalars that hold particles.

    Parameters
    ----------
    source : Trajectory

    Returns
    -------
    list of str

    Raises
    ------
    ParameterError
        The trajectory has no particles.
    """
    names = [name for name in source.scalars if name.startswith(PREFIX)]
    if not names:
        raise ParameterError(
            "the run has no particles; name the effect particles in a scene of fluid-sim", parameter="source"
        )
    return names


def particle_paths(source: Trajectory, frame_numbers: Sequence[int]) -> CurveSet:
    """Paths of particles as polylines from frame to frame.

    Segments that cross the sides of a periodic grid are left out.

    Parameters
    ----------
    source : Trajectory
    frame_numbers : sequence of int
        In the order of the polylines.

    Returns
    -------
    CurveSet
        With the arrays `path_id` and `time` on its points.

    Raises
    ------
    ParameterError
        The trajectory has no particles.
    """
    names = check_particles(source)
    rows = np.concatenate([source.scalars[name].reshape(source.n_frames, -1, 3) for name in names], axis=1)
    places = rows[list(frame_numbers)].transpose(1, 0, 2)  # (particles, frames, 3)
    count, length = places.shape[:2]
    number = np.arange(count * length).reshape(count, length)
    lines = np.stack([number[:, :-1].ravel(), number[:, 1:].ravel()], axis=1)
    points = places.reshape(-1, 3)
    if "wraps" in source.face(0):
        size = np.ptp(source.points(0), axis=0)
        jump = np.abs(points[lines[:, 1]] - points[lines[:, 0]])
        lines = lines[(jump <= LONGEST_STEP * size).all(axis=1)]
    arrays = {
        "path_id": np.repeat(np.arange(count), length),
        "time": np.tile(source.times[list(frame_numbers)], count),
    }
    return CurveSet(points, lines, arrays)
