"""Willmore and mean curvature flow of surfaces.

`energies` lists the discrete energies, `descent` and `flow` hold the steps, `constraints` area and volume,
`state` the state of a flow, `edge_flips` and `redistribution` what keeps triangles good, `setup` builds a
flow from a mesh and its options, `report` and `self_intersections` measure a run, `flow_run` joins the two
for the command and the library, `endings` lists why flows end.
"""

__all__ = [
    "area_energy",
    "conformal",
    "constraints",
    "descent",
    "endings",
    "energies",
    "film_polish",
    "films",
    "flow",
    "flow_options",
    "flow_run",
    "gauss_map_energy",
    "helfrich_energy",
    "hinge_energy",
    "hinges",
    "observation",
    "option_checks",
    "quadratic_energy",
    "remesh_step",
    "remeshing",
    "report",
    "scaled",
    "second_energy",
    "secant_pairs",
    "self_intersections",
    "setup",
    "state",
    "step_lengths",
    "step_rules",
    "triangle_quality",
    "trust_region",
    "vertex_energies",
    "vertex_noise",
]
