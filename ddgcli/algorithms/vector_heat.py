"""Vectors spread over a surface by parallel transport: the vector heat method.

Sharp, Soliman, Crane, "The Vector Heat Method", 2019: diffuse vectors for a short time with the connection
Laplacian, which carries them along shortest paths; take the directions from there and the lengths from two
scalar diffusions.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ddgcli.errors import ParameterError
from ddgcli.geometry.unfolding import SurfaceMesh
from ddgcli.linalg.factor import Factor
from ddgcli.operators.connection import connection_laplacian
from ddgcli.operators.laplacian import lumped_mass, stiffness


class VectorHeat:
    """Two factorisations of a mesh, many transports.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
        Consistently oriented, manifold vertices.
    time : float
        Diffusion time in units of the squared mean side length.
    """

    def __init__(self, mesh: SurfaceMesh, time: float = 1.0) -> None:
        if not time > 0:
            raise ParameterError(f"the diffusion time must be positive, found {time}")
        self.mesh = mesh
        used = mesh.topology.referenced_vertex
        mass, t = lumped_mass(mesh), time * float(np.mean(mesh.side_length)) ** 2
        idle = csr_array((np.where(used, 0.0, 1.0), (np.arange(mesh.n_vertices),) * 2), shape=mass.shape)
        self.scalar = csr_array(mass + t * stiffness(mesh) + idle)
        self.vector = csr_array(mass + t * connection_laplacian(mesh) + idle)
        self._scalar_factor, self._vector_factor = Factor(self.scalar), Factor(self.vector)

    def transport(self, vertex: NDArray, value: NDArray) -> NDArray[np.complex128]:
        """(n,) vectors everywhere, parallel to that of the nearest source vertex.

        Parameters
        ----------
        vertex : (k,) ndarray of int64
        value : (k,) ndarray of complex128
            Tangent vectors in the vertices' frames.
        """
        n = self.mesh.n_vertices
        start = np.zeros(n, dtype=np.complex128)
        np.add.at(start, vertex, value)
        size, count = np.zeros(n), np.zeros(n)
        np.add.at(size, vertex, np.abs(value))
        np.add.at(count, vertex, 1.0)
        spread = self._vector_factor.solve(start)
        sizes = self._scalar_factor.solve(np.stack([size, count], axis=1))
        length = np.divide(sizes[:, 0], sizes[:, 1], out=np.zeros(n), where=np.abs(sizes[:, 1]) > 1e-300)
        amount = np.abs(spread)
        unit = np.divide(spread, amount, out=np.zeros_like(spread), where=amount > 1e-300)
        return unit * length

    def residual(self, vertex: NDArray, value: NDArray) -> float:
        """Relative residual of the vector solve."""
        start = np.zeros(self.mesh.n_vertices, dtype=np.complex128)
        np.add.at(start, vertex, value)
        x = self._vector_factor.solve(start)
        return float(np.abs(self.vector @ x - start).max() / (np.abs(start).max() or 1.0))
