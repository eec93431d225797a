"""Meshes: immutable positions over a topology, with checks, repair, shapes and annotation.

`TriangleMesh`, `TetMesh`, `IntrinsicMesh` and `CurveSet` are the mesh classes, each in a module of its name;
`topology` holds connectivity, `require` the demands of commands, `fields` meshes with arrays.
"""

__all__ = [
    "bisection",
    "boundary",
    "cell_complex",
    "cell_moves",
    "coincident_faces",
    "components",
    "remedies",
    "curve",
    "double_cover",
    "edge_lookup",
    "fields",
    "flat_cells",
    "frozen",
    "intrinsic_mesh",
    "masked",
    "midpoint_subdivision",
    "periodic",
    "plane",
    "ragged",
    "repair",
    "require",
    "require_solid",
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
