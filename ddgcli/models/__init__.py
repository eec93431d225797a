"""Physical models: shells, fluids and Willmore flows, one package each.

They build on mechanics, scenes and algorithms, and never import each other. Effects are single files that a
scene names; what it does not name is not imported.
"""

__all__ = ["fluid", "shell", "willmore"]
