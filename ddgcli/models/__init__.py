"""Physical models: shells, fluids, Willmore flows and curve flows, one package each.

They build on mechanics, scenes and algorithms, and never import each other. Effects are single files that a
scene names; what it does not name is not imported.
"""

__all__ = ["curve", "fluid", "shell", "willmore"]
