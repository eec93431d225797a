"""Comparison of a distance with the results of other methods."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.distance import DistanceOptions, prepare_solver
from ddgcli.algorithms.geodesics.sources import Sources
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh


def compare(
    mesh: SurfaceMesh,
    sources: Sources,
    distance: NDArray,
    methods: list[str],
    options: DistanceOptions | None = None,
) -> dict[str, dict[str, Any]]:
    """Differences of a distance from the results of other methods, and their seconds.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    sources : Sources
    distance : (n,) ndarray of float64
        Distance to compare with the other methods.
    methods : list of str
    options : DistanceOptions, optional
        Options of the other methods; their tolerance is set to 0.

    Returns
    -------
    dict of str to dict
        For each method its errors, relative to its largest distance, and seconds; `setup_seconds` is spent
        once for any number of sources.
    """
    table: dict[str, dict[str, Any]] = {}
    for method in methods:
        start = time.perf_counter()
        # an exact reference must have no tolerance
        solver = prepare_solver(mesh, method, replace(options or DistanceOptions(), tolerance=0.0))
        ready = time.perf_counter()
        other = solver(sources).distance
        end = time.perf_counter()
        both = np.isfinite(distance) & np.isfinite(other)
        error = np.where(both, np.abs(np.where(both, distance, 0.0) - np.where(both, other, 0.0)), 0.0)
        scale = float(other[both].max(initial=0.0)) or 1.0
        table[method] = {
            "max_error": float(error.max(initial=0.0)) / scale,
            "max_error_at": int(np.argmax(error)) if len(error) else None,
            "mean_error": float(error[both].mean()) / scale if both.any() else 0.0,
            "setup_seconds": ready - start,
            "seconds": end - ready,
        }
    return table
