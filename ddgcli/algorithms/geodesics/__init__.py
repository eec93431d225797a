"""Geodesic distances and curves.

`distance` is the common interface of the solvers: `exact` (window propagation), `heat`, `fast_marching` and
`edge_distance`. `paths` and `surface_curves` describe curves; `shortest_paths`, `flipout`, `edge_curves` and
`isolines` compute them. `oriented_cover` provides left and right on any surface. `edge_sets` reads sources
that are edges, `curve_wavefronts` divides them into pieces, `flippable_mesh` reads paths of edges;
`distance_matrix` and `voronoi` measure many sources at once.
"""

__all__ = [
    "certificate",
    "curve_wavefronts",
    "darboux",
    "distance",
    "distance_matrix",
    "distance_query",
    "edge_curves",
    "edge_distance",
    "edge_sets",
    "exact",
    "fast_marching",
    "flipout",
    "flippable_mesh",
    "isolines",
    "oriented_cover",
    "path_results",
    "paths",
    "query",
    "shortest_paths",
    "sources",
    "surface_curves",
    "voronoi",
]
