"""Repair of triangle meshes: weld, drop, split, orient, fill, keep, cut; each step with maps to the input."""
