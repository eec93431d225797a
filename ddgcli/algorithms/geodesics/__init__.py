"""Geodesic distance, shortest and straightened paths, level lines.

`distance` is the common interface of the distance solvers: exact (package `exact`), heat, fast marching and
edge paths. `shortest_paths`, `flipout` and `isolines` make curves; `paths` measures them.
"""

__all__ = [
    "certificate",
    "distance",
    "edge_curves",
    "edge_distance",
    "exact",
    "fast_marching",
    "flipout",
    "flipping_mesh",
    "heat",
    "isolines",
    "oriented_cover",
    "paths",
    "shortest_paths",
    "sources",
    "surface_curves",
]
