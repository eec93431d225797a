"""Stiffness and mass matrices of the Laplacian, from side lengths alone.

Sign: the stiffness L is positive semidefinite, so that L x = lambda M x has lambda >= 0.
Every function takes a TriangleMesh or an IntrinsicMesh: it reads only `topology` and `side_length`.
"""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array, diags_array

from ddgcli.geometry.intrinsic import corner_cotan, cotan_and_area, face_area, mixed_voronoi_share
from ddgcli.linalg.indices import matrix_indices
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import NEXT, PREVIOUS
from ddgcli.operators.mollify import mollify_mesh

log = logging.getLogger("ddgcli")


def stiffness(mesh: SurfaceMesh) -> csr_array:
    """Cotangent stiffness matrix: off-diagonal entries -(cot + cot)/2, rows summing to zero.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
        Faces without area are mollified first, with a warning (see `operators.mollify`).

    Returns
    -------
    (n, n) csr_array of float64
        Symmetric, positive semidefinite, without unit.

    References
    ----------
    U. Pinkall, K. Polthier, "Computing discrete minimal surfaces and their conjugates", 1993.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> square = ddg.grid(1, 1)
    >>> ddg.stiffness(square).toarray()[0].round(12).tolist()
    [1.0, -0.5, -0.5, 0.0]
    """
    cotan = corner_cotan(mesh.side_length)
    if not np.isfinite(cotan).all():
        mesh, mollification = mollify_mesh(mesh)
        log.warning("%s", mollification)
        cotan = corner_cotan(mesh.side_length)
    return laplacian_of_sides(mesh, 0.5 * cotan[:, PREVIOUS])  # side j is opposite corner j+2


def laplacian_of_sides(mesh: SurfaceMesh, weight: NDArray) -> csr_array:
    """Weighted graph Laplacian from a weight on each side of each face.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    weight : (m, 3) ndarray of float64
        The weights of the sides of an edge add up.

    Returns
    -------
    (n, n) csr_array of float64
        Off-diagonal entries are minus the weights; rows sum to zero.
    """
    n = mesh.n_vertices
    corner = matrix_indices(mesh.faces.T, n, 3 * mesh.n_faces)
    rows, cols = corner.ravel(), corner[NEXT].ravel()
    values = -weight.T.ravel()
    if (rows == cols).any():  # a self-edge has its weight on the diagonal already
        one_way = coo_array((values, (rows, cols)), shape=(n, n)).tocsr()
        both = one_way + one_way.T.tocsr()
        return (both - diags_array(both @ np.ones(n))).tocsr()
    # ones keep the places of the diagonal: to add it as a matrix would take another pass over all entries
    every = np.arange(n, dtype=rows.dtype)
    place = (np.concatenate([rows, every]), np.concatenate([cols, every]))
    one_way = coo_array((np.concatenate([values, np.ones(n)]), place), shape=(n, n)).tocsr()
    both = one_way + one_way.T.tocsr()
    is_diagonal = both.indices == np.repeat(every, np.diff(both.indptr))
    both.data[is_diagonal] = 0.0
    both.data[is_diagonal] = -(both @ np.ones(n))
    both.eliminate_zeros()
    return both


def uniform_stiffness(mesh: SurfaceMesh) -> csr_array:
    """Graph Laplacian of the edges: degree on the diagonal, -1 for every edge between two vertices.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh

    Returns
    -------
    (n, n) csr_array of float64

    Examples
    --------
    >>> import ddgcli as ddg
    >>> ddg.uniform_stiffness(ddg.grid(1, 1)).diagonal().tolist()
    [3.0, 2.0, 2.0, 3.0]
    """
    n = mesh.n_vertices
    tail, head = matrix_indices(mesh.topology.edges.T, n, 2 * mesh.topology.n_edges)
    between = tail != head
    tail, head = tail[between], head[between]
    ones = np.ones(len(tail))
    adjacency = coo_array((ones, (tail, head)), shape=(n, n))
    adjacency = (adjacency + adjacency.T).tocsr()
    return csr_array(diags_array(adjacency @ np.ones(n)) - adjacency)


def lumped_vertex_area(mesh: SurfaceMesh) -> NDArray[np.float64]:
    """Vertex areas: a third of the area of each incident face.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh

    Returns
    -------
    (n,) ndarray of float64
        In length^2; they sum to the area of the surface.
    """
    return corner_sum(mesh, np.repeat(face_area(mesh.side_length) / 3.0, 3))


def voronoi_vertex_area(mesh: SurfaceMesh) -> NDArray[np.float64]:
    """Mixed Voronoi areas of the vertices.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh

    Returns
    -------
    (n,) ndarray of float64
        In length^2; they sum to the area of the surface.

    References
    ----------
    Meyer2003 in docs/references.bib; `mixed_voronoi_share` has the formula.
    """
    cotan, area = cotan_and_area(mesh.side_length)
    with np.errstate(invalid="ignore"):
        share = mixed_voronoi_share(mesh.side_length.T**2, cotan.T, area)
    return corner_sum(mesh, share.T)


def corner_sum(mesh: SurfaceMesh, values: NDArray) -> NDArray[np.float64]:
    """Sum of values on corners over the corners at each vertex.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    values : (m, 3) or (3m,) ndarray of float64

    Returns
    -------
    (n,) ndarray of float64
    """
    return sum_by_index(mesh.faces.ravel(), values.ravel(), mesh.n_vertices)


def lumped_mass(mesh: SurfaceMesh) -> csr_array:
    """Diagonal mass matrix: a third of the area of each face at a vertex.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh

    Returns
    -------
    (n, n) csr_array of float64
        In length^2.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> round(float(ddg.lumped_mass(ddg.grid(4, 4, width=2.0)).sum()), 12)
    2.0
    """
    return diags_array(lumped_vertex_area(mesh)).tocsr()


def voronoi_mass(mesh: SurfaceMesh) -> csr_array:
    """Diagonal mass matrix of mixed Voronoi areas.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh

    Returns
    -------
    (n, n) csr_array of float64
        In length^2.

    References
    ----------
    M. Meyer et al., "Discrete differential-geometry operators for triangulated 2-manifolds", 2003.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> ddg.voronoi_mass(ddg.grid(1, 1)).diagonal().tolist()
    [0.25, 0.25, 0.25, 0.25]
    """
    return diags_array(voronoi_vertex_area(mesh)).tocsr()


def galerkin_mass(mesh: SurfaceMesh) -> csr_array:
    """Consistent mass matrix of piecewise linear functions: area/6 on the diagonal, area/12 beside it.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh

    Returns
    -------
    (n, n) csr_array of float64
        In length^2: u' M v is the integral of the product of the interpolants.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> square = ddg.grid(3, 3)
    >>> x = square.points[:, 0]
    >>> round(float(x @ ddg.galerkin_mass(square) @ x), 12)  # the integral of x^2
    0.333333333333
    """
    n = mesh.n_vertices
    area = face_area(mesh.side_length)
    corner = matrix_indices(mesh.faces.T, n, 3 * mesh.n_faces)
    one_way = coo_array(
        (np.tile(area / 12.0, 3), (corner.ravel(), corner[NEXT].ravel())), shape=(n, n)
    ).tocsr()
    diagonal = corner_sum(mesh, np.repeat(area / 6.0, 3))
    return (one_way + one_way.T.tocsr() + diags_array(diagonal)).tocsr()
