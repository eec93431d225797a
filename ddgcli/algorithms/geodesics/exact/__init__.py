"""Exact geodesic distance by batched window propagation; the entry point is `exact_distance`."""

__all__ = ["exact_distance", "tables", "work"]
