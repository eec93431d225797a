"""Equations of the Laplacian on surfaces.

`choice` assembles the operator and its mass; `poisson`, `spectrum`, `parameterize` and `smooth` solve with
them; `report` runs the tasks of one call.
"""

__all__ = ["laplace_operator", "parameterize", "poisson", "smooth", "spectrum", "tasks"]
