"""Incompressible flow on surfaces: vorticity, harmonic part, transport, viscosity.

`scene` declares what a scene may hold, `model` builds a flow from it, `report` measures a run; the other
modules are transport schemes and effects.
"""

__all__ = [
    "boundary",
    "cells",
    "circulation",
    "conservative",
    "context",
    "diffusion",
    "dye",
    "flows",
    "forces",
    "harmonic",
    "initial",
    "model",
    "obstacle_refinement",
    "particles",
    "effect_parts",
    "recovery",
    "report",
    "scene",
    "smoothing",
    "sources",
    "space",
    "transport",
    "viscosity",
]
