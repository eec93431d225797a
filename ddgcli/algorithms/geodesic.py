"""One door to the distance methods: the same question, the same answer form."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesic_sources import Sources, checked_sources
from ddgcli.errors import ParameterError
from ddgcli.operators.laplacian import SurfaceMesh

if TYPE_CHECKING:
    from ddgcli.algorithms.geodesic_exact import ExactDistance

log = logging.getLogger("ddgcli")


@dataclass(frozen=True, eq=False)
class Measured:
    """Distances by one method.

    Parameters
    ----------
    distance : (n,) ndarray of float64
        inf where no source reaches.
    nearest_source : (n,) ndarray of int64, or None
        Number of the nearest source, -1 where none reaches.
    results, accuracy : dict
        What the method tells of its work and of its error.
    exact : ExactDistance, optional
        Of the exact method: how the shortest path arrives at each vertex.
    """

    distance: NDArray[np.float64]
    nearest_source: NDArray[np.int64] | None
    results: dict[str, Any] = field(default_factory=dict)
    accuracy: dict[str, Any] = field(default_factory=dict)
    exact: ExactDistance | None = None

    @property
    def arrays(self) -> dict[str, NDArray]:
        """The vertex arrays to write, by their names in files."""
        named = {"geodesic_distance": self.distance, "nearest_source": self.nearest_source}
        return {name: values for name, values in named.items() if values is not None}


def _exact(mesh: SurfaceMesh, sources: Sources) -> Measured:
    from ddgcli.algorithms.geodesic_exact import exact_distance

    exact = exact_distance(mesh, sources)
    return Measured(exact.distance, exact.nearest_source, {"windows": exact.windows}, exact=exact)


def _dijkstra(mesh: SurfaceMesh, sources: Sources) -> Measured:
    from ddgcli.algorithms.geodesic_edges import edge_distance

    edges = edge_distance(mesh, sources)
    return Measured(edges.distance, edges.nearest_source)


METHODS = {"exact": _exact, "dijkstra": _dijkstra}


def measure_distance(mesh: SurfaceMesh, sources: Sources, method: str = "exact") -> Measured:
    """Distance from every vertex to the nearest source by the named method, unreachable vertices reported.

    Raises
    ------
    ParameterError
        On an unknown method or a bad source.
    """
    if method not in METHODS:
        raise ParameterError(f"method {method!r} is not one of {', '.join(METHODS)}")
    sources = checked_sources(mesh, sources)
    measured = METHODS[method](mesh, sources)
    unreachable = report_unreachable(mesh, measured.distance)
    finite = measured.distance[np.isfinite(measured.distance)]
    summary = {
        "method": method,
        "sources": len(sources),
        "max_distance": float(finite.max(initial=0.0)),
        "unreachable": unreachable,
    }
    return replace(measured, results=summary | measured.results)


def report_unreachable(mesh: SurfaceMesh, distance: NDArray) -> int:
    """Number of vertices at distance inf; a warning names their components."""
    lost = np.isinf(distance)
    count = int(lost.sum())
    if not count:
        return 0
    component = mesh.topology.vertex_component[lost]
    numbers, sizes = np.unique(component[component >= 0], return_counts=True)
    for number, size in list(zip(numbers, sizes))[:5]:
        first = int(np.flatnonzero(mesh.topology.vertex_component == number)[0])
        log.warning(
            f"component {number} ({size} vertices, first: vertex {first}) is not reached by any source; "
            "its distance is inf"
        )
    if len(numbers) > 5:
        log.warning(f"{len(numbers) - 5} more components ({sizes[5:].sum()} vertices) are not reached")
    unused = int((component < 0).sum())
    if unused:
        log.warning(f"{unused} vertices belong to no face; their distance is inf")
    return count
