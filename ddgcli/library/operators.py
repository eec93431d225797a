"""Matrices of discrete operators, as scipy.sparse arrays."""

from __future__ import annotations

from scipy.sparse import csr_array

from ddgcli.algorithms.laplacian.laplace_operator import LaplaceOperator
from ddgcli.algorithms.laplacian.laplace_operator import laplace_operator as core_laplace_operator
from ddgcli.library.mesh_arguments import accepts_arrays
from ddgcli.mesh.require import require
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators import connection, laplacian
from ddgcli.operators import gradient as gradients
from ddgcli.operators.dec import SimplicialMesh, complex_of
from ddgcli.operators.dec_matrices import check_cells, dec_matrices
from ddgcli.operators.star_errors import star_errors, warn_of_star_errors
from ddgcli.operators.stars import Star
from ddgcli.operators.stars import hodge_star as core_hodge_star

__all__ = [
    "connection_laplacian",
    "d0",
    "d1",
    "d2",
    "dec_operators",
    "divergence",
    "galerkin_mass",
    "gradient",
    "hodge_star",
    "laplace_operator",
    "lumped_mass",
    "stiffness",
    "uniform_stiffness",
    "voronoi_mass",
]

stiffness = accepts_arrays("surface", "intrinsic")(laplacian.stiffness)
uniform_stiffness = accepts_arrays("surface", "intrinsic")(laplacian.uniform_stiffness)
lumped_mass = accepts_arrays("surface", "intrinsic")(laplacian.lumped_mass)
voronoi_mass = accepts_arrays("surface", "intrinsic")(laplacian.voronoi_mass)
galerkin_mass = accepts_arrays("surface", "intrinsic")(laplacian.galerkin_mass)
gradient = accepts_arrays("surface")(gradients.gradient)
divergence = accepts_arrays("surface")(gradients.divergence)
connection_laplacian = accepts_arrays("surface", "intrinsic")(connection.connection_laplacian)


@accepts_arrays("surface", "tetrahedra")
def laplace_operator(
    mesh: TriangleMesh | TetMesh, operator: str | None = None, mass: str = "lumped"
) -> LaplaceOperator:
    """Stiffness and mass of a chosen Laplacian.

    Parameters
    ----------
    mesh : TriangleMesh, TetMesh or (points, cells) pair
        Any triangles for 'cotan', 'tufted' and 'uniform'; an oriented surface without edges of three faces
        for 'intrinsic-delaunay'; tetrahedra for 'cotan' and 'uniform', with lumped or galerkin mass.
    operator : {'cotan', 'intrinsic-delaunay', 'tufted', 'uniform'}, optional
        Default 'intrinsic-delaunay', and 'tufted' where the mesh is not manifold or not oriented.
    mass : {'lumped', 'voronoi', 'galerkin'}
        Mass matrix of the triangulation that carries the operator.

    Returns
    -------
    LaplaceOperator
        `stiffness` L and `mass` M (n, n), so that L x = lambda M x has lambda >= 0; `surface`, the
        triangulation on which they were assembled; `preparation`, counts of its changes (flips, ...).

    Raises
    ------
    MeshError
        For a mesh without area, or one that cannot have the operator.
    ParameterError
        On an unknown operator or mass.

    References
    ----------
    A. Bobenko, B. Springborn, "A discrete Laplace-Beltrami operator for simplicial surfaces", 2007.
    N. Sharp, K. Crane, "A Laplacian for nonmanifold triangle meshes", 2020 (tufted).

    Examples
    --------
    >>> import ddgcli as ddg
    >>> operator = ddg.laplace_operator(ddg.icosphere(2))
    >>> operator.name, operator.stiffness.shape
    ('intrinsic-delaunay', (162, 162))
    """
    return core_laplace_operator(mesh, operator, mass)


@accepts_arrays("surface", "intrinsic", "tetrahedra")
def d0(mesh: SimplicialMesh) -> csr_array:
    """Exterior derivative of functions on vertices.

    Parameters
    ----------
    mesh : TriangleMesh, IntrinsicMesh, TetMesh or (points, cells) pair

    Returns
    -------
    (e, n) csr_array of int8
        Value at the edge's head minus value at its tail. Edges of a surface are those of
        `mesh.topology.edges`.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> mesh = ddg.icosphere(1)
    >>> int((ddg.d1(mesh) @ ddg.d0(mesh)).count_nonzero())
    0
    """
    return complex_of(mesh).derivatives[0].copy()  # the complex is cached


@accepts_arrays("surface", "intrinsic", "tetrahedra")
def d1(mesh: SimplicialMesh) -> csr_array:
    """Exterior derivative of 1-forms, numbers on edges.

    Parameters
    ----------
    mesh : TriangleMesh, IntrinsicMesh, TetMesh or (points, cells) pair

    Returns
    -------
    (m, e) csr_array of int8
        Sum around each face, with the signs of its sides.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> mesh = ddg.icosphere(1)
    >>> ddg.d1(mesh).shape == (mesh.n_faces, mesh.topology.n_edges)
    True
    """
    return complex_of(mesh).derivatives[1].copy()  # the complex is cached


@accepts_arrays("tetrahedra")
def d2(mesh: SimplicialMesh) -> csr_array:
    """Exterior derivative of 2-forms on tetrahedra, numbers on their faces.

    Parameters
    ----------
    mesh : TetMesh or (points, tetrahedra) pair

    Returns
    -------
    (k, f) csr_array of int8
        Sum over the four faces of each tetrahedron, outward.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> V, T = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 2, 3]]
    >>> int((ddg.d2((V, T)) @ ddg.d1((V, T))).count_nonzero())
    0
    """
    return complex_of(mesh).derivatives[2].copy()  # the complex is cached


@accepts_arrays("surface", "intrinsic", "tetrahedra")
def hodge_star(mesh: SimplicialMesh, degree: int, kind: Star = "galerkin") -> csr_array:
    """Hodge star of k-forms as a symmetric matrix: the inner product of a and b is a' star b.

    Parameters
    ----------
    mesh : TriangleMesh, IntrinsicMesh, TetMesh or (points, cells) pair
    degree : int
        From 0 to the dimension of the mesh.
    kind : {'circumcentric', 'barycentric', 'galerkin'}
        'galerkin' is the mass matrix of Whitney forms; the other two are diagonal, dual measure over primal
        measure.

    Returns
    -------
    (n_k, n_k) csr_array
        In length^(dimension - 2 degree).

    Raises
    ------
    ParameterError
        On a degree that the mesh does not have, or an unknown kind.

    References
    ----------
    A. Hirani, "Discrete exterior calculus", 2003; D. Arnold, R. Falk, R. Winther, "Finite element exterior
    calculus, homological techniques, and applications", 2006.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> mesh = ddg.icosphere(2)
    >>> d, star = ddg.d0(mesh), ddg.hodge_star(mesh, 1, "circumcentric")
    >>> bool(abs(d.T @ star @ d - ddg.stiffness(mesh)).max() < 1e-12)
    True
    """
    return core_hodge_star(complex_of(mesh), degree, kind)


@accepts_arrays("surface", "tetrahedra")
def dec_operators(mesh: TriangleMesh | TetMesh, star: Star = "galerkin") -> dict[str, csr_array]:
    """Operators of discrete exterior calculus of every degree, by name.

    Parameters
    ----------
    mesh : TriangleMesh, TetMesh or (points, cells) pair
        Surfaces are oriented manifolds.
    star : {'galerkin', 'circumcentric', 'barycentric'}

    Returns
    -------
    dict of str to csr_array
        `d0` ... (integers), `star0` ..., `codifferential1` ... (k-forms to (k-1)-forms) and `laplacian0` ...
        (symmetric: star d delta + d' star d); forms are numbers on vertices, edges, faces, tetrahedra.

    Raises
    ------
    MeshError
        For a surface that is not an oriented manifold, cells without size, or a star without an inverse.

    References
    ----------
    A. Hirani, "Discrete exterior calculus", 2003.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> operators = ddg.dec_operators(ddg.icosphere(1))
    >>> [name for name in operators if name.startswith("laplacian")]
    ['laplacian0', 'laplacian1', 'laplacian2']
    """
    if isinstance(mesh, TriangleMesh):
        require(mesh, "dec_operators", manifold=True, oriented=True)
    check_cells(mesh)
    complex_ = complex_of(mesh)
    matrices = dec_matrices(complex_, star).matrices
    warn_of_star_errors(star_errors(complex_, mesh.points, star), star, complex_.dimension)
    return matrices
