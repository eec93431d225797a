"""Thin elastic shells: stretching, bending, gravity, loads, pins, damping, contact.

`scene` declares what a scene may hold, `model` builds the systems from it, `report` measures a run; each
effect is one module.
"""

__all__ = [
    "bending",
    "contact",
    "context",
    "damping",
    "dry_run",
    "epochs",
    "gravity",
    "groups",
    "hinge",
    "last_frame",
    "load",
    "model",
    "obstacle",
    "obstacle_motion",
    "pin",
    "report",
    "scene",
    "stretching",
]
