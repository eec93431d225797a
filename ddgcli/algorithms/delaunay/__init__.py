"""Intrinsic Delaunay triangulations of surfaces.

Edge flips (`triangulation`, `flips`), cuts of boundary edges (`boundary_splits`), refinement by Steiner
points (`refine`), the common subdivision with the input (`common_subdivision`), and the transfer of functions
(`transfer`) and points (`point_location`) between the two. `intrinsic_delaunay` runs all of it.
"""

__all__ = [
    "boundary_splits",
    "circumcentres",
    "common_subdivision",
    "dual",
    "flips",
    "gluing",
    "intrinsic_delaunay",
    "normal_coordinates",
    "overlay_lines",
    "overlay_pieces",
    "point_location",
    "refine",
    "refine_batches",
    "steiner_base",
    "transfer",
    "triangulation",
    "vertex_locations",
]
