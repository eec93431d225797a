"""Geodesic distances and curves.

`distance` is the common interface of the solvers: `exact` (window propagation), `heat`, `fast_marching` and
`edge_distance`. `paths` and `surface_curves` describe curves; `shortest_paths`, `flipout`, `edge_curves` and
`isolines` compute them. `oriented_cover` provides left and right on any surface.
"""

__all__ = [
    "certificate",
    "distance",
    "distance_query",
    "edge_curves",
    "exact",
    "fast_marching",
    "flipout",
    "isolines",
    "oriented_cover",
    "paths",
    "query",
    "shortest_paths",
    "sources",
    "surface_curves",
]
