"""Tangent vector fields along geodesics.

Parallel transport (`transport`, `vector_heat`), logarithmic maps (`log_map`, `polar_coordinates`), integral
curves, and `geodesic_query`, which combines them with distances and curves.
"""

__all__ = ["field_curves", "geodesic_query", "integral_curves", "vertex_vectors"]
