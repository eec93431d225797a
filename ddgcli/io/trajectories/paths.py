"""Paths of particles in a trajectory as polylines."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ddgcli.choices import PARTICLES
from ddgcli.errors import ParameterError
from ddgcli.io.trajectories.trajectory import Trajectory
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.periodic import crosses_side


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
    names = [name for name in source.scalars if name.startswith(PARTICLES)]
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
    by_fluid = {
        name.removeprefix(PARTICLES): source.scalars[name].reshape(source.n_frames, -1, 3)
        for name in check_particles(source)
    }
    rows = np.concatenate(list(by_fluid.values()), axis=1)
    places = rows[list(frame_numbers)].transpose(1, 0, 2)  # (particles, frames, 3)
    count, length = places.shape[:2]
    number = np.arange(count * length).reshape(count, length)
    lines = np.stack([number[:, :-1].ravel(), number[:, 1:].ravel()], axis=1)
    points = places.reshape(-1, 3)
    if (periods := source.periods) is not None:
        count_of = [positions.shape[1] * (length - 1) for positions in by_fluid.values()]
        period = np.repeat([periods.of_object[fluid] for fluid in by_fluid], count_of, axis=0)
        lines = lines[~crosses_side(points[lines[:, 1]] - points[lines[:, 0]], period).any(axis=1)]
    arrays = {
        "path_id": np.repeat(np.arange(count), length),
        "time": np.tile(source.times[list(frame_numbers)], count),
    }
    return CurveSet(points, lines, arrays)
