"""Thin elastic shells: stretching, bending, gravity, loads, pins, damping, contact.

`scene` declares what a scene may hold, `shell_scene` goes from a scene to models and from their frames to
results, `model` builds the systems, `group_model` their models, `report` measures a run; each effect is one
module.
"""

__all__ = [
    "bending",
    "contact",
    "context",
    "damping",
    "dry_run",
    "epochs",
    "gravity",
    "group_model",
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
    "shell_scene",
    "stretching",
]
