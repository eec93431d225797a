"""Willmore and mean curvature flow of surfaces.

`energies` lists the discrete energies, `descent` and `flow` hold the steps, `constraints` area and volume,
`setup` builds a flow from a mesh and its options, `report` measures a run.
"""

__all__ = [
    "constraints",
    "descent",
    "energies",
    "flow",
    "gauss_map_energy",
    "hinge_energy",
    "report",
    "scaled",
    "setup",
    "vertex_energies",
]
