"""Measuring algorithms on meshes, one package a topic.

Each takes meshes and arrays and returns result objects with arrays, numbers and their accuracy. Topics import
the layers below (mesh, geometry, linalg, operators) and the topics that `tests/test_layers.py` names.
"""

__all__ = [
    "conformal",
    "curvature",
    "delaunay",
    "geodesics",
    "hodge",
    "inspection",
    "laplacian",
    "repair",
    "tangent_fields",
    "tracing",
]
