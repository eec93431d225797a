"""Equations of the Laplacian on surfaces and tetrahedra.

`laplace_operator` (of tetrahedra `solid_operator`) assembles the operator and its mass; `form_spectrum`,
`poisson`, `spectrum`, `parameterize`, `smooth` and `evolution` (heat and wave equation in time) solve with
them; `implicit_step` is the step of `smooth` and of mean curvature flow in time; `check_tasks` checks the
`tasks` of one call against the mesh, `solve_tasks` solves them.
"""

__all__ = [
    "check_tasks",
    "evolution",
    "evolution_times",
    "form_spectrum",
    "implicit_step",
    "laplace_operator",
    "parameterize",
    "poisson",
    "smooth",
    "solid_operator",
    "solve_tasks",
    "spectrum",
    "tasks",
    "weyl",
]
