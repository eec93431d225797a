"""For each command: its question on a mesh, its methods and their parameters, the reference.

`table` imports the module of a question when it is needed.
"""

__all__ = ["curvature", "delaunay", "geodesic", "laplacian", "simulate", "table", "willmore_flow"]
