"""Discrete differential operators as sparse matrices.

`laplacian` stiffness and mass, `dec` exterior derivatives, `stars` Hodge stars, `whitney` Whitney forms,
`gradient` gradient and divergence, `connection` the connection Laplacian, `tufted` the tufted cover.
"""

__all__ = [
    "connection",
    "dec",
    "dec_matrices",
    "form_products",
    "gradient",
    "laplacian",
    "mollify",
    "stars",
    "tufted",
    "whitney",
]
