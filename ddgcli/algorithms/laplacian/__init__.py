"""Equations of the Laplacian on surfaces.

`laplace_operator` assembles the operator and its mass; `poisson`, `spectrum`, `parameterize`, `smooth` and
`evolution` (heat and wave equation in time) solve with them; `tasks` runs the tasks of one call.
"""

__all__ = ["evolution", "laplace_operator", "parameterize", "poisson", "smooth", "spectrum", "tasks"]
