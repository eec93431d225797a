"""What theory says of each command, and which method to take when, as the tables bear out."""

ADVICE = {
    "curvature": """
Theory: on smooth surfaces a quadric fit converges at second order on any sampling; corrected measures in
balls that shrink more slowly than the edges; cotangent and normal-cycle values at the star on regular meshes.
""",
    "geodesic": """
Theory: the exact polyhedral distance converges to the smooth one at second order; fast marching at
first; heat at first at best; paths along edges not at all.
""",
    "laplacian": """
Theory: eigenvalues converge at second order; from above for the Galerkin mass.
""",
    "delaunay": """
Theory: second order on every family; flips and refinement lower the constant where triangles are bad.
""",
}
