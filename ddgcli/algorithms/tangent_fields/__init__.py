"""Tangent vector fields on surfaces.

Parallel transport along curves (`transport`) and over the surface (`vector_heat`), the logarithmic map
(`log_map`, `polar_coordinates`), and integral curves (`integral_curves`).
"""

__all__ = [
    "field_curves",
    "integral_curves",
    "intrinsic_frames",
    "log_map",
    "polar_coordinates",
    "transport",
    "vector_heat",
    "vertex_vectors",
]
