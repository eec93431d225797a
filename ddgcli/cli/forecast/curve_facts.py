"""Numbers and lengths of the curves that `geodesic` traces, on which its cost depends."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ddgcli.cli.forecast.facts import GeodesicFacts

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ddgcli.mesh.triangle_mesh import TriangleMesh

__all__ = ["curve_facts", "field_facts", "has_curves"]

WAY_POINT_OPTIONS = ("straighten", "loop", "curve")
CURVE_OPTIONS = ("path_to", "trace", "fan", "field", "isolines", *WAY_POINT_OPTIONS)


def has_curves(options: Mapping[str, Any]) -> bool:
    """Whether the options name curves on a surface."""
    return any(options.get(name) for name in CURVE_OPTIONS)


def curve_facts(mesh: TriangleMesh, options: Mapping[str, Any]) -> GeodesicFacts:
    """Properties on which the cost of curves on a surface depends."""
    from ddgcli.cli.forecast.mesh_facts import crossings_per_length, mean_chord

    n_legs, length = way_point_legs(mesh, options)
    first = next(iter(options.get("source") or ()), -1)
    return GeodesicFacts(
        crossings_per_length=crossings_per_length(mesh),
        mean_chord=mean_chord(mesh),
        starts_at_boundary=0 <= first < mesh.n_vertices and bool(mesh.topology.boundary_vertex[first]),
        # a side at the boundary is half an edge
        total_edge_length=0.5 * float(mesh.side_length.sum()),
        extent=_extent(mesh),
        n_legs=n_legs,
        leg_length=length,
    )


def way_point_legs(mesh: TriangleMesh, options: Mapping[str, Any]) -> tuple[int, float]:
    """Number of pairs of successive way-points, and their mean distance in space; of those in the mesh."""
    import numpy as np

    from ddgcli.mesh.vectors import vector_length

    tails, heads = [], []
    for name in WAY_POINT_OPTIONS:
        for stops in options.get(name) or ():
            stops = [*stops, *(stops[:1] if name == "loop" else ())]
            tails += stops[:-1]
            heads += stops[1:]
    ends = np.array([tails, heads], dtype=np.int64)
    ends = ends[:, ((ends >= 0) & (ends < mesh.n_vertices)).all(axis=0)]
    if not ends.size:
        return 0, 0.0
    legs = mesh.points[ends[0]] - mesh.points[ends[1]]
    return ends.shape[1], float(vector_length(legs).mean())


def field_facts(mesh: TriangleMesh, values: NDArray, options: Mapping[str, Any]) -> dict[str, Any]:
    """Fields of `GeodesicFacts` for integral curves: their length, and the number of fixed steps.

    Empty for an invalid field, which is an error of the run.
    """
    import numpy as np

    from ddgcli.algorithms.tangent_fields.tangent_field import default_duration
    from ddgcli.errors import ParameterError

    values = np.asarray(values, dtype=float)
    if values.ndim != 2 or not len(values):
        return {}
    try:
        crossing_time = default_duration(mesh, values)  # of the bounding box
    except ParameterError:
        return {}
    duration, step = options.get("field_time") or crossing_time, options.get("field_step")
    if not (np.isfinite(duration / crossing_time) and duration > 0.0):
        return {}
    steps = None if step is None else max(1, math.ceil(min(duration / step, 1e9)))
    return {"field_length": 2.0 * _extent(mesh) * duration / crossing_time, "field_steps": steps}


def _extent(mesh: TriangleMesh) -> float:
    """Half the diagonal of the bounding box."""
    import numpy as np

    from ddgcli.mesh.vectors import vector_length

    return 0.5 * float(vector_length(np.ptp(mesh.points, axis=0))) if mesh.n_vertices else 0.0
