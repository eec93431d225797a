"""Tangent vector fields along geodesics.

Parallel transport (`transport`, `vector_heat`), logarithmic maps (`log_map`, `polar_coordinates`), integral
curves, the fan of geodesics (`fan`), signed distance, and `geodesic_query`, which combines them with
distances and curves after `geodesic_task` has checked them.
"""

__all__ = [
    "curve_starts",
    "fan",
    "field_curves",
    "geodesic_query",
    "geodesic_task",
    "integral_curves",
    "signed_distance",
    "tangent_field",
    "vertex_vectors",
]
