"""Incompressible flow on surfaces: vorticity, harmonic part, transport, viscosity.

`scene` declares what a scene may hold, `fluid_scene` goes from a scene to models and from their frames to
results, `model` builds a flow, `report` measures a run; the other modules are transport schemes and effects.
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
    "fluid_scene",
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
