"""Discrete conformal maps with cones: Ptolemy flips, Newton's method, layout in the plane.

`conformal_map` runs all of it.
"""

__all__ = [
    "conformal_map",
    "cone_metric",
    "distortion",
    "layout",
    "overlay",
    "projective_lines",
    "ptolemy",
    "targets",
]
