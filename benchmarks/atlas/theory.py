"""Convergence rates that theory gives, beside the observed ones, with their sources.

A rate is the power of the mesh size (mesh class `steps`: of the step) with which the mean error falls.
"none": no theorem is known to us, or there is a counterexample; see the source.
"""

from __future__ import annotations

from ddgcli.mechanics.integrators import INTEGRATORS

# vertex stars that are symmetric to leading order: errors of odd order cancel there
SYMMETRIC_CLASSES = ("good", "right", "meshes", "steps")

SOURCES = {
    "curvature": """
`quadric` 3: a fit of degree n gives second derivatives to order n - 1 (Cazals, Pouget 2005), n = 4 where
quartic terms are taken in. libigl, `pymeshlab quadric`: the same with n = 2, so 1, and 2 where rings are
symmetric. `cotan`, `pymeshlab discrete`, `normal-cycle` at the star: 2 on stars that are symmetric to
leading order (Xu 2006), else none: they do not converge pointwise (counterexamples: Hildebrandt, Polthier,
Wardetzky 2006). `corrected` at the star: none, its normals are of first order only. Balls of k edges: the
measures err by the order of the edges (Cohen-Steiner, Morvan 2003; Lachaud, Romon, Thibert 2022), over an
area of their square that leaves no pointwise rate; the ball's own smoothing is of order 2.
""",
    "geodesic": """
`exact`, pygeodesic 2: the length metric of inscribed meshes with bounded angles (Hildebrandt, Polthier,
Wardetzky 2006). With `--tolerance` TAU 1 where it is used: the slack is a number of edge lengths.
`fast-marching`, potpourri3d's 1 (Kimmel, Sethian 1998). `heat`: none proven at t = h^2 (Crane, Weischedel,
Wardetzky 2013 observe about 1). `dijkstra` 0: paths along edges keep their angle however fine the mesh.
pymeshlab: none documented.
""",
    "laplacian": """
2 for linear elements on inscribed meshes, lumped or not (Dziuk 1988; Dodziuk, Patodi 1976; Strang, Fix
1973), on stretched triangles as long as the largest angle stays away from 180 degrees (Babuska, Aziz 1976);
Delaunay flips and covers are the same elements on another triangulation.
""",
    "delaunay": """
2, with a logarithm in the largest error (Dziuk 1988), for every triangulation of an inscribed polyhedron:
the surface alone errs by this order, so flips and refinement can lower the constant but not raise the rate.
""",
    "willmore-flow": """
`gauss-map`, `sullivan`, `cotan` 2 where vertex stars are symmetric to leading order (as the pointwise
curvature, Xu 2006); else none, the limit depends on the triangulation (Wardetzky 2006). `gauss-map` errs
in the difference of the principal curvatures alone: not at all on spheres. `hinge`: none, the limit depends
on the directions of the edges (Grinspun et al. 2006). Steps: 2, a two-stage Rosenbrock method (Hairer,
Wanner 1996; docs/willmore-flow.md).
""",
    "fluid-sim": """
In the step: 4 for `conservative` (rk4), 2 for `energy` (midpoint rule), 2 for `circulation` (points move with
the flow at mid-step, back-and-forth error compensation: Dupont and Liu 2003). In the mesh: 2 for
`conservative` and `energy` (linear elements, Dziuk 1988); `circulation` and `covector`: 2 together with
the step, by fitted velocities (Zhang and Naga 2005); `covector` has no limit of small steps on one mesh,
for every
step interpolates.
""",
    "shell-sim": """
In the step: the order of each integrator (Hairer, Lubich, Wanner 2006; Newmark's with gamma = 1/2: 2). In
the mesh: "1, then 0": the clamped column of cells is an error of first order, and the plate that a hinge mesh
converges to is not the isotropic one but depends on the pattern (docs/shell-sim.md), so an error stays.
""",
}


def theory(command: str, mesh_class: str, configuration: str) -> str:
    """Rate that theory gives a configuration, "none" where it gives none."""
    return _RULES[command](mesh_class, configuration, configuration.split(" dt=")[0].split(" ")[0])


def _curvature(mesh_class: str, configuration: str, method: str) -> str:
    even = mesh_class in SYMMETRIC_CLASSES
    if configuration.startswith("pymeshlab discrete"):
        return "2" if even else "none"
    if method in ("libigl", "pymeshlab"):
        return "2" if even else "1"
    if method == "quadric":
        return "3"
    if method in ("cotan", "normal-cycle") and "own" in configuration:
        return "2" if even else "none"
    return "none"


def _geodesic(_: str, configuration: str, method: str) -> str:
    if method == "exact":
        return "2" if configuration.split("tolerance=")[-1].split()[0] == "0" else "1"
    rates = {"pygeodesic": "2", "fast-marching": "1", "dijkstra": "0"}
    return "1" if configuration == "potpourri3d fast marching" else rates.get(method, "none")


def _willmore(mesh_class: str, _: str, method: str) -> str:
    return "2" if mesh_class in SYMMETRIC_CLASSES and method in ("gauss-map", "sullivan", "cotan") else "none"


def _fluid(mesh_class: str, configuration: str, method: str) -> str:
    if mesh_class == "steps":
        return {"conservative": "4", "energy": "2", "circulation": "2"}[configuration]
    return "2"


def _shell(mesh_class: str, configuration: str, _: str) -> str:
    return str(INTEGRATORS[configuration].order) if mesh_class == "steps" else "1, then 0"


_RULES = {
    "curvature": _curvature,
    "geodesic": _geodesic,
    "laplacian": lambda *_: "2",
    "delaunay": lambda *_: "2",
    "willmore-flow": _willmore,
    "fluid-sim": _fluid,
    "shell-sim": _shell,
}
