"""Curvature of surfaces and polylines.

`surface_curvature.measure_curvature` is the entry point for surfaces, `polyline.measure_curves` for curves.
The schemes are in `star` (vertex star), `ball` (balls of a radius), `quadric` and `voting`; `measures` and
`totals` hold the integrals.
"""

__all__ = [
    "ball",
    "ball_blocks",
    "clip",
    "curve_frames",
    "deviation",
    "face_balls",
    "frames",
    "grid_coordinates",
    "measures",
    "neighbours",
    "noise",
    "noise_estimate",
    "noise_kind",
    "offset_body",
    "one_sided",
    "point_grid",
    "polyline",
    "polynomial_fits",
    "quadric",
    "regions",
    "rings",
    "scales",
    "star",
    "region_measures",
    "surface_curvature",
    "surface_query",
    "totals",
    "unit_surface",
]
