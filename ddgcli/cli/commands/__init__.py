"""The commands of `ddgcli`, one thin file each: parse options, call the core, write results.

Nothing here is imported before its command runs, so that `--help` loads no numerics.
"""

__all__ = [
    "check",
    "curvature",
    "delaunay",
    "fluid_sim",
    "frames",
    "geodesic",
    "geodesic_curves",
    "geodesic_distance",
    "hodge",
    "info",
    "laplacian",
    "shell_sim",
    "tradeoff",
    "tradeoff_options",
    "willmore_flow",
]
