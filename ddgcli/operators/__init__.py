"""Discrete differential operators as sparse matrices.

`laplacian` stiffness and mass, `dec` exterior derivatives, `stars` Hodge stars, `whitney` Whitney forms,
`gradient` gradient and divergence, `connection` the connection Laplacian, `tufted` the tufted cover,
`averages` means at vertices.
"""

__all__ = [
    "averages",
    "connection",
    "dec",
    "dec_matrices",
    "form_products",
    "gradient",
    "laplacian",
    "mollify",
    "star_errors",
    "stars",
    "tufted",
    "whitney",
]
