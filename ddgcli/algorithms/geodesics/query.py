"""What a geodesic query names: sources, method, curves, and the rules between them.

This module imports no numpy, so that the command line can read the names of the methods at no cost.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ddgcli.choices import LOG_MAP_METHODS
from ddgcli.errors import ParameterError


@dataclass(frozen=True)
class DistanceQuery:
    """Sources, method and further results of a distance computation.

    Parameters
    ----------
    source : sequence of sequence of int
        Source vertices.
    source_point, target_point : sequence of (3,) positions
        Sources and targets at the nearest points of the surface.
    source_face, target_face : sequence of (face, barycentric coordinates)
    source_edges : str, optional
        Name of an array of edges whose points are all sources.
    source_boundary : bool
        The boundary is a source, each loop of it one.
    method : {'exact', 'heat', 'fast-marching', 'dijkstra'}
    tolerance, operator, heat_time, heat_refine : optional
        See `DistanceOptions`.
    each_source : bool
        Also compute one distance array for each source.
    gradient : bool
        Also compute the gradient on faces.
    isolines : int, optional
        Number of level lines.
    compare : sequence of str
        Methods to compare with.
    certify : bool
        Also check symmetry and the triangle inequality on sampled pairs.
    """

    source: tuple[Any, ...] = ()
    source_point: tuple[Any, ...] = ()
    source_face: tuple[Any, ...] = ()
    source_edges: str | None = None
    source_boundary: bool = False
    target_point: tuple[Any, ...] = ()
    target_face: tuple[Any, ...] = ()
    method: str = "exact"
    tolerance: float | None = None
    operator: str | None = None
    heat_time: float | None = None
    heat_refine: int | None = None
    each_source: bool = False
    gradient: bool = False
    isolines: int | None = None
    compare: tuple[str, ...] = ()
    certify: bool = False

    @property
    def has_source(self) -> bool:
        """True if there is at least one source."""
        return bool(self.source or self.source_point or self.source_face or self.has_source_edges)

    @property
    def has_source_edges(self) -> bool:
        """True if edges are sources."""
        return self.source_edges is not None or self.source_boundary

    @property
    def without_source_edges(self) -> str:
        """Remedy of what needs other sources than edges, for an error."""
        names = [name for name in ("source_edges", "source_boundary") if getattr(self, name)]
        return f"leave {' and '.join(f'`{name}`' for name in names)} out"

    @property
    def vertices(self) -> list[int]:
        """Source vertices in order."""
        return [vertex for group in self.source for vertex in group]

    def check(self, *, needs_source: bool = True) -> None:
        """Raise ParameterError for parameters that the method does not have, or that need a source.

        `method` and `isolines` need none with a signed distance, which has them too.
        """
        for name in ("tolerance", "target_point", "target_face"):
            if getattr(self, name) not in (None, ()) and self.method != "exact":
                raise ParameterError(
                    f"belongs to `method=exact`, not to {self.method}; leave one of them out", parameter=name
                )
        for name in ("operator", "heat_time", "heat_refine"):
            if getattr(self, name) is not None and self.method != "heat" and "heat" not in self.compare:
                raise ParameterError(
                    f"belongs to `method=heat`, not to {self.method}; leave one of them out", parameter=name
                )
        if self.has_source_edges and self.tolerance is not None:
            raise ParameterError(
                f"needs sources at vertices or points; {self.without_source_edges}", parameter="tolerance"
            )
        names = ("target_point", "target_face", "each_source", "gradient", "compare", "certify")
        is_set = {name: bool(getattr(self, name)) for name in names}
        is_set["isolines"] = needs_source and self.isolines is not None
        is_set["tolerance"] = self.tolerance is not None
        is_set["method"] = needs_source and self.method != DistanceQuery.method
        for name, value in is_set.items():
            if value and not self.has_source:
                raise ParameterError("needs a source, such as `source=0`", parameter=name)


@dataclass(frozen=True)
class CurveQuery:
    """Curves on a surface, and vector fields at its vertices.

    Parameters
    ----------
    path_to : sequence of int
        Target vertices of shortest paths from the nearest source.
    trace : sequence of (face, barycentric coordinates, direction, length)
        Straightest geodesics.
    at_boundary : {'stop', 'reflect'}
        What straightest geodesics do at the boundary.
    straighten, loop : sequence of list of int
        Way-points of open and of closed geodesics.
    curve : sequence of list of int
        Way-points of edge paths.
    field : str, optional
        Name of the vector field of integral curves.
    field_seeds : int, optional
        Number of random starts of integral curves.
    field_time, field_order, field_step, field_tolerance : optional
        See `integral_curves`.
    transport : bool
        Transport a tangent frame along the curves.
    darboux : bool
        Compute Darboux frames and normal curvatures of the curves.
    log_map : bool
        Compute the logarithmic map of the source.
    spread_vector : sequence of (3,) vectors
        Tangent vectors at the source vertices, to transport to all vertices.
    """

    path_to: tuple[int, ...] = ()
    trace: tuple[Any, ...] = ()
    at_boundary: str = "stop"
    straighten: tuple[Any, ...] = ()
    loop: tuple[Any, ...] = ()
    curve: tuple[Any, ...] = ()
    field: str | None = None
    field_seeds: int | None = None
    field_time: float | None = None
    field_order: str = "4"
    field_step: float | None = None
    field_tolerance: float | None = None
    transport: bool = False
    darboux: bool = False
    log_map: bool = False
    spread_vector: tuple[Any, ...] = ()

    @property
    def has_curves(self) -> bool:
        """True if the query names at least one curve."""
        return bool(self.path_to or self.trace or self.straighten or self.loop or self.curve or self.field)

    @property
    def has_vectors(self) -> bool:
        """True if the query names vectors at the vertices."""
        return bool(self.log_map or self.spread_vector)

    def check(self, distance: DistanceQuery) -> None:
        """Raise ParameterError for parameters that exclude each other or lack what they refer to."""
        self._check_sources(distance.has_source, distance.method)
        for name in ("log_map", "spread_vector", "field"):
            if getattr(self, name) and distance.has_source_edges:
                raise ParameterError(
                    f"starts at vertices or points; {distance.without_source_edges}", parameter=name
                )
        for name in ("field_seeds", "field_time", "field_step", "field_tolerance"):
            if getattr(self, name) is not None and not self.field:
                raise ParameterError("belongs to `field`; give that too", parameter=name)
        if self.field_order != CurveQuery.field_order and not self.field:
            raise ParameterError("belongs to `field`; give that too", parameter="field_order")
        if self.at_boundary != CurveQuery.at_boundary and not self.trace:
            raise ParameterError("belongs to `trace`; give that too", parameter="at_boundary")
        if self.field_step is not None and self.field_tolerance is not None:
            raise ParameterError(
                "fixes the step, but `field_tolerance` adapts it; give one of them", parameter="field_step"
            )
        for name in ("transport", "darboux"):
            if getattr(self, name) and not self.has_curves and distance.isolines is None:
                raise ParameterError("has no curves; add some, such as `path_to` or `trace`", parameter=name)

    def _check_sources(self, has_source: bool, method: str) -> None:
        if self.path_to and not has_source:
            raise ParameterError("needs a source, such as `source=0`", parameter="path_to")
        if self.path_to and method != "exact":
            raise ParameterError(
                f"follows the exact distance, not that of {method}; use `method=exact`", parameter="path_to"
            )
        if self.log_map and not has_source:
            raise ParameterError("needs a source, such as `source=0`", parameter="log_map")
        if self.log_map and method not in LOG_MAP_METHODS:
            remedies = " or ".join(f"`method={name}`" for name in LOG_MAP_METHODS)
            raise ParameterError(f"has no method {method}; use {remedies}", parameter="log_map")
        if self.field_seeds is not None and has_source:
            raise ParameterError(
                "sets random starts, but there are sources; leave one of them out", parameter="field_seeds"
            )
        if self.spread_vector and not has_source:
            raise ParameterError("needs source vertices, such as `source=0`", parameter="spread_vector")


@dataclass(frozen=True)
class WaveQuery:
    """Distance matrix, Voronoi regions, signed distance, fan of geodesics, types of vertices.

    Parameters
    ----------
    target : sequence of sequence of int
        Target vertices: columns of the distance matrix, whose rows are the source vertices.
    jobs : int
        Processes for the rows of the matrix and for the distances of each source.
    voronoi : bool
        Compute the nearest source of each face.
    signed_distance : str, optional
        Name of the array of the curves.
    fan : int, optional
        Number of rays from the one source.
    fan_length : float, optional
        Length of the rays.
    fan_circles : int
        Number of geodesic circles at even lengths.
    vertex_types : bool
        Compute the types of vertices.
    """

    target: tuple[Any, ...] = ()
    jobs: int = 1
    voronoi: bool = False
    signed_distance: str | None = None
    fan: int | None = None
    fan_length: float | None = None
    fan_circles: int = 8
    vertex_types: bool = False

    @property
    def targets(self) -> list[int]:
        """Target vertices in order."""
        return [vertex for group in self.target for vertex in group]

    @property
    def needs_no_source(self) -> bool:
        """True if the query has results without sources."""
        return self.signed_distance is not None or self.vertex_types

    def check(self, distance: DistanceQuery) -> None:
        """Raise ParameterError for parameters that lack what they refer to."""
        for name in ("target", "voronoi", "fan"):
            if getattr(self, name) and not distance.has_source:
                raise ParameterError("needs a source, such as `source=0`", parameter=name)
        if self.voronoi and distance.method != "exact":
            raise ParameterError(
                f"belongs to `method=exact`, not to {distance.method}; leave one of them out",
                parameter="voronoi",
            )
        if self.signed_distance and distance.method not in ("exact", "heat"):
            raise ParameterError(
                f"has no method {distance.method}; use `method=exact` or `method=heat`",
                parameter="signed_distance",
            )
        if (self.fan is None) != (self.fan_length is None):
            name, other = ("fan_length", "fan") if self.fan is None else ("fan", "fan_length")
            raise ParameterError(f"needs `{other}`; give both", parameter=name)
        if self.fan_circles != WaveQuery.fan_circles and self.fan is None:
            raise ParameterError("belongs to `fan`; give that too", parameter="fan_circles")
        if self.jobs > 1 and not (self.target or distance.each_source):
            raise ParameterError(
                "is for the distances to each `target` and for `each_source`; add one", parameter="jobs"
            )
