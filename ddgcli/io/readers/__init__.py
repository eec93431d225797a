"""Readers of mesh formats, one module a format or group of formats.

Each turns bytes into a `raw_mesh.RawMesh`, or refuses them with the place of the error. `foreign` guards
meshio and trimesh.
"""

__all__ = [
    "cells",
    "foreign",
    "obj",
    "off",
    "ply",
    "raw_mesh",
    "stl",
    "tables",
    "text",
    "triangulate",
    "vtk_legacy",
    "vtk_xml",
    "vtkhdf",
]
