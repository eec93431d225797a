"""Straightest geodesics, thousands at once.

`trace` is the entry point (the exponential map); `batch` advances lines together, `crossing` takes one step
over a side or a vertex, `trace_points` records the points.
"""

__all__ = ["batch", "crossing", "trace", "trace_points"]
