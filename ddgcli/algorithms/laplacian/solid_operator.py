"""The Laplacian of a mesh of tetrahedra with a choice of operator and mass matrix."""

from __future__ import annotations

from scipy.sparse import csr_array

from ddgcli.choices import SOLID_MASSES, SOLID_OPERATORS
from ddgcli.errors import MeshError, ParameterError
from ddgcli.mesh.requirements import require_sized_cells
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.operators.dec import complex_of
from ddgcli.operators.stars import hodge_star

STAR_OF_MASS = {"lumped": "barycentric", "galerkin": "galerkin"}


def check_solid_operator(mesh: TetMesh, operator: str, mass: str) -> None:
    """Raise an error for an operator or a mass that tetrahedra do not have, or a mesh without tetrahedra.

    Parameters
    ----------
    mesh : TetMesh
    operator, mass : str

    Raises
    ------
    ParameterError, MeshError
    """
    if operator not in SOLID_OPERATORS:
        raise ParameterError(
            f"{operator!r} is an operator of surfaces; tetrahedra have {' and '.join(SOLID_OPERATORS)}",
            parameter="operator",
        )
    if mass not in SOLID_MASSES:
        raise ParameterError(
            f"{mass!r} is a mass of surfaces; tetrahedra have {' and '.join(SOLID_MASSES)}", parameter="mass"
        )
    if len(mesh.tetrahedra) == 0:
        raise MeshError("no tetrahedra; laplacian needs a surface or a mesh of tetrahedra")
    require_sized_cells(mesh, "laplacian")


def solid_matrices(
    mesh: TetMesh, operator: str = "cotan", mass: str = "lumped"
) -> tuple[csr_array, csr_array]:
    """Stiffness and mass of a mesh of tetrahedra.

    Parameters
    ----------
    mesh : TetMesh
    operator : {'cotan', 'uniform'}
        Linear finite elements, whose weights are cotangents of dihedral angles, or the graph Laplacian.
    mass : {'lumped', 'galerkin'}
        A quarter of each volume to its corners, or the consistent mass of linear functions.

    Returns
    -------
    stiffness, mass : (n, n) csr_array
        In length (`uniform`: no unit) and length^3; rows of vertices without tetrahedra are empty.

    Raises
    ------
    ParameterError
        For an operator or a mass of surfaces.
    MeshError
        Without tetrahedra, or with one that has no volume.
    """
    check_solid_operator(mesh, operator, mass)
    complex_ = complex_of(mesh)
    gradient = complex_.derivatives[0].astype(float)
    weighted = gradient if operator == "uniform" else hodge_star(complex_, 1, "galerkin") @ gradient
    return csr_array(gradient.T @ weighted), hodge_star(complex_, 0, STAR_OF_MASS[mass])
