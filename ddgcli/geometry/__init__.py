"""Formulas on arrays: lengths, angles, areas, normals, unfolding, points on surfaces.

`intrinsic` reads side lengths alone, `extrinsic` positions in space, `faces` positions with components
first; `normals` holds those of vertices, `circle_angles` angles between circumcircles; `unfolding` lays faces
out in the plane; `intersections` lists faces that cross, `t_junctions` vertices inside boundary edges;
`component_sides` has the mean sides of components, `solids` signed distances.
"""

__all__ = [
    "cells",
    "circle_angles",
    "component_sides",
    "remedies",
    "extrinsic",
    "face_frames",
    "faces",
    "hinges",
    "intersections",
    "intrinsic",
    "normals",
    "solids",
    "surface_points",
    "t_junctions",
    "unfolding",
]
