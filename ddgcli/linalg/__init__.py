"""Linear algebra without meshes: factorisation, ordering, eigenpairs, constrained solves.

`factor` is the only place where matrices are factorised; `backends` holds the solvers behind it, `eigen`
smallest eigenpairs, `exponential` diffusion in time, `constrain` Dirichlet problems, `conjugate` conjugate
gradients, `displacements` those of mechanical systems whose factors do not fit, `secant` quasi-Newton
equations.
"""

__all__ = [
    "aggregation",
    "assembly_tree",
    "backends",
    "condition",
    "conjugate",
    "constrain",
    "displacements",
    "dissection",
    "eigen",
    "exponential",
    "factor",
    "indices",
    "iterative",
    "lanczos",
    "low_rank",
    "modes",
    "multifrontal",
    "ordering",
    "residual_gate",
    "scaled_rows",
    "secant",
    "separators",
    "superlu",
]
