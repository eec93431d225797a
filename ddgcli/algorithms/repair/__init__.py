"""Repair of triangle meshes: weld, drop, split, orient, fill, keep and cut, each step with maps from the
vertices and faces of the result to those of the input; of tetrahedra: drop and orient cells.
"""

__all__ = ["patches", "pipeline", "solid"]
