"""Meshes: immutable positions over a topology, with checks, repair, shapes and annotation.

`TriangleMesh`, `TetMesh`, `IntrinsicMesh` and `CurveSet` are the mesh classes, each in a module of its name;
`topology` holds connectivity, `require` the demands of commands, `fields` meshes with arrays.
"""

__all__ = [
    "bisection",
    "boundary",
    "components",
    "remedies",
    "curve",
    "double_cover",
    "edge_lookup",
    "fields",
    "frozen",
    "intrinsic_mesh",
    "masked",
    "midpoint_subdivision",
    "ragged",
    "repair",
    "require",
    "requirements",
    "scatter",
    "shapes",
    "sides",
    "solid_components",
    "tet_mesh",
    "topology",
    "triangle_mesh",
    "vectors",
]
