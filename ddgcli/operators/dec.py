"""Discrete exterior calculus on triangles and tetrahedra: complexes and exterior derivatives.

A k-form is a number on each oriented k-simplex: the integral of the form over it. Derivatives are integer, so
that d d = 0 exactly. The metric enters through the Hodge stars alone (`operators.stars`), which read only
edge lengths: the same code serves meshes in space and intrinsic triangulations.
Chapters 7 and 8 of the notes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ddgcli.geometry.cells import (
    TET_EDGES,
    CellMetric,
    embedded_triangle_metric,
    tetrahedron_metric,
    triangle_metric,
)
from ddgcli.linalg.indices import matrix_indices
from ddgcli.mesh.edge_lookup import edge_indices
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.require_solid import require_sized_solid
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import vector_length

SimplicialMesh = TriangleMesh | IntrinsicMesh | TetMesh
_COMPLEXES: WeakKeyDictionary[SimplicialMesh, Complex] = WeakKeyDictionary()


def d0(topology: Topology) -> csr_array:
    """Exterior derivative of functions on vertices.

    Parameters
    ----------
    topology : Topology

    Returns
    -------
    (e, n) csr_array of int8
        Value at the head of the edge minus value at its tail.

    Examples
    --------
    >>> d0(Topology(np.array([[0, 1, 2]]), 3)).toarray().tolist()
    [[-1, 1, 0], [-1, 0, 1], [0, -1, 1]]
    """
    return _incidence(topology.edges, np.array([-1, 1], dtype=np.int8), topology.n_vertices)


def d1(topology: Topology) -> csr_array:
    """(m, e) int8 derivative of edge values: sum around each face, with the sides' signs."""
    return _incidence(topology.side_edge, topology.side_sign, topology.n_edges)


def _incidence(index: NDArray, sign: NDArray, n_columns: int) -> csr_array:
    """Matrix with row i holding sign[i] at columns index[i]; entries in one place (self-edges) add up."""
    rows, per_row = index.shape
    values = np.broadcast_to(sign, index.shape).astype(np.int8).ravel()
    start, column = (
        matrix_indices(a, index.size, n_columns)
        for a in (np.arange(0, rows * per_row + 1, per_row), index.flatten())
    )
    # copied: sum_duplicates sorts in place
    matrix = csr_array((values, column, start), shape=(rows, n_columns))
    matrix.sum_duplicates()
    return matrix


@dataclass(frozen=True, eq=False)
class Complex:
    """A simplicial complex of dimension 2 or 3 with the metric of its cells.

    Attributes
    ----------
    dimension : int
    counts : tuple of int
        Number of k-simplices for k = 0 .. dimension.
    derivatives : tuple of csr_array of int8
        `derivatives[k]` takes k-forms to (k+1)-forms.
    corners : (m, dimension+1) ndarray of int64
        Vertices of the top cells.
    edges : (e, 2) ndarray of int64
        Tail and head of each edge.
    faces : (f, 3) ndarray of int64
        Vertices of each triangle in the order of its orientation; of tetrahedra ascending.
    cell_edge, cell_edge_sign : (m, 3 or 6) ndarray
        Edge of each local edge and +1 where the cell runs along it.
    face_edge, face_edge_sign : (f, 3) ndarray
        Edges around each face from its first corner on, and +1 where the face runs along them.
    cell_face, cell_face_sign : (m, 4) ndarray
        Tetrahedra only: face opposite corner i, +1 where its orientation is outward.
    metric : CellMetric
    boundary_faces : ndarray of int64
        Indices of the (dimension-1)-simplices with one cell.
    """

    dimension: int
    counts: tuple[int, ...]
    derivatives: tuple[csr_array, ...]
    corners: NDArray[np.int64]
    edges: NDArray[np.int64]
    faces: NDArray[np.int64]
    cell_edge: NDArray[np.int64]
    cell_edge_sign: NDArray
    face_edge: NDArray[np.int64]
    face_edge_sign: NDArray
    cell_face: NDArray[np.int64]
    cell_face_sign: NDArray
    metric: CellMetric
    boundary_faces: NDArray[np.int64]

    @cached_property
    def boundary_vertex(self) -> NDArray[np.bool_]:
        """(n,) True on the boundary."""
        mask = np.zeros(self.counts[0], dtype=bool)
        mask[self.edges[self.boundary_edge]] = True
        return mask

    @cached_property
    def boundary_edge(self) -> NDArray[np.bool_]:
        """(e,) True on the boundary."""
        mask = np.zeros(self.counts[1], dtype=bool)
        if self.dimension == 2:
            mask[self.boundary_faces] = True
        elif len(self.boundary_faces):
            boundary_rows = self.derivatives[1][self.boundary_faces]
            mask[boundary_rows.indices] = True
        return mask


def complex_of(mesh: SimplicialMesh) -> Complex:
    """Simplicial complex of a mesh: simplices, exterior derivatives and metric; kept as long as the mesh.

    Parameters
    ----------
    mesh : TriangleMesh, IntrinsicMesh or TetMesh

    Returns
    -------
    Complex

    Raises
    ------
    MeshError
        When a cell has no area or volume.
    """
    if mesh not in _COMPLEXES:
        _COMPLEXES[mesh] = _tet_complex(mesh) if isinstance(mesh, TetMesh) else _surface_complex(mesh)
    return _COMPLEXES[mesh]


def _surface_complex(mesh: TriangleMesh | IntrinsicMesh) -> Complex:
    topology = mesh.topology
    n_faces = topology.n_faces
    if isinstance(mesh, TriangleMesh):
        metric = embedded_triangle_metric(mesh)
    else:
        metric = triangle_metric(mesh.side_length)
    return Complex(
        dimension=2,
        counts=(topology.n_vertices, topology.n_edges, n_faces),
        derivatives=(d0(topology), d1(topology)),
        corners=topology.faces,
        edges=topology.edges,
        faces=topology.faces,
        cell_edge=topology.side_edge,
        cell_edge_sign=topology.side_sign.astype(float),
        face_edge=topology.side_edge,
        face_edge_sign=topology.side_sign.astype(float),
        cell_face=np.zeros((n_faces, 0), dtype=np.int64),
        cell_face_sign=np.zeros((n_faces, 0)),
        metric=metric,
        boundary_faces=topology.boundary_edges,
    )


def _tet_complex(mesh: TetMesh) -> Complex:
    tets = mesh.tetrahedra
    require_sized_solid(mesh)  # by positions, as repairs: lengths round otherwise
    local = tets[:, TET_EDGES]
    edges, faces = mesh.edges, mesh.triangles
    edge_sign = np.where(local[..., 0] < local[..., 1], 1, -1)
    face_sign = mesh.face_sign
    face_edge = edge_indices(edges, faces[:, [[0, 1], [1, 2], [0, 2]]])
    face_edge_sign = np.array([1, 1, -1])
    length = vector_length(mesh.points[local[..., 1]] - mesh.points[local[..., 0]])
    return Complex(
        dimension=3,
        counts=(mesh.n_vertices, len(edges), len(faces), len(tets)),
        derivatives=(
            _incidence(edges, np.array([-1, 1]), mesh.n_vertices),
            _incidence(face_edge, face_edge_sign, len(edges)),
            _incidence(mesh.cell_triangle, face_sign, len(faces)),
        ),
        corners=tets,
        edges=edges,
        faces=faces,
        cell_edge=mesh.cell_edge,
        cell_edge_sign=edge_sign.astype(float),
        face_edge=face_edge,
        face_edge_sign=np.broadcast_to(face_edge_sign.astype(float), face_edge.shape),
        cell_face=mesh.cell_triangle,
        cell_face_sign=face_sign.astype(float),
        metric=tetrahedron_metric(length),
        boundary_faces=np.flatnonzero(np.bincount(mesh.cell_triangle.ravel(), minlength=len(faces)) == 1),
    )
