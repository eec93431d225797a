"""Mechanical systems: masses, potentials, dissipation, constraints, and how they move.

`system` and `terms` describe a system, `integrators` its time schemes, `newton` the implicit steps,
`objective` the function that they minimise, `hessian_solver` their linear systems, `equilibrium` its static
state. It has no particular physics.
"""

__all__ = [
    "assembly",
    "asynchronous",
    "constraints",
    "driving",
    "embedding",
    "energy_balance",
    "equilibrium",
    "hessian_solver",
    "increment",
    "integrators",
    "modes",
    "newton",
    "objective",
    "pair_blocks",
    "rigid_motions",
    "rounding",
    "small_loads",
    "stability",
    "system",
    "terms",
    "turning",
    "yielding",
]
