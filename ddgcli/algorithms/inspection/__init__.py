"""Inspection of meshes and of results.

`quality` measures triangles and finds defects, `report` gathers what `info` shows, `compare_summaries`
compares a summary with a stored one.
"""

__all__ = ["compare_arrays", "compare_summaries", "inspect_mesh", "quality"]
