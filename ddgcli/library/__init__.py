"""Functions that `import ddgcli as ddg` exposes.

Each module adapts one topic of the core to notebooks: pairs of arrays are accepted instead of a mesh
(`mesh_arguments`), orchestration that a user would repeat is done once, and results are plain objects
(`result`). There are no formulas here. `ddgcli/__init__.py` holds the table of exported names.
"""

__all__ = [
    "costs",
    "curvatures",
    "curves",
    "decomposition",
    "distances",
    "equations",
    "evolution",
    "fields",
    "files",
    "flows",
    "forms",
    "mesh_arguments",
    "meshes",
    "operators",
    "pictures",
    "repairs",
    "result",
    "simulations",
    "triangulations",
    "wavefronts",
]
