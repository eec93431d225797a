"""Exact geodesic distance on polyhedral surfaces, by propagation of windows in batches.

`exact_distance` is the entry point; the other modules hold its tables, the wavefront, the pruning of
windows and the bookkeeping.
"""

__all__ = [
    "bundles",
    "children",
    "dominance",
    "exact_distance",
    "pool",
    "shadow",
    "tables",
    "targets",
    "tolerance",
    "wavefront",
]
