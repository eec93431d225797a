"""Intrinsic Delaunay triangulations of surfaces.

Edge flips (`triangulation`, `flips`), cuts of boundary edges (`boundary_splits`), refinement by Steiner
points (`refine`), the common subdivision with the input (`common_subdivision`), and functions carried between
the two (`transfer`). `report` runs all of it.
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
    "steiner_places",
    "transfer",
    "triangulation",
]
