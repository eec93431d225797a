"""Vectors spread over a surface by parallel transport: the vector heat method.

Sharp, Soliman, Crane, "The Vector Heat Method", 2019: diffuse vectors for a short time with the connection
Laplacian, which carries them along shortest paths; take the directions from there and the lengths from two
scalar diffusions.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ddgcli.algorithms.curves.intrinsic_frames import frame_turn
from ddgcli.algorithms.delaunay.triangulation import flip_to_delaunay
from ddgcli.errors import ParameterError
from ddgcli.linalg.factor import Factor
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.operators.connection import connection_laplacian, side_angles
from ddgcli.operators.laplacian import lumped_mass, stiffness

_log = logging.getLogger("ddgcli")
FAINT = 1e-290  # what has diffused so far is counted as nothing
MOST_TIME = 4.0**14


def _delaunay_frames(mesh: SurfaceMesh) -> tuple[SurfaceMesh, NDArray[np.complex128]]:
    """The intrinsic Delaunay triangulation, and the turn of its frames to those of the mesh."""
    as_it_is = mesh, np.ones(mesh.n_vertices, dtype=np.complex128)
    side_angles(mesh)  # one fan a vertex
    if len(mesh.topology.nonmanifold_edges):
        _log.warning("vectors spread on the faces as they are: edges of three faces have no Delaunay flips")
        return as_it_is
    flipped = flip_to_delaunay(mesh, track=True)
    turn = frame_turn(mesh, flipped) if flipped.flips else None
    if turn is None and flipped.flips:
        _log.warning(
            "vectors spread on the faces as they are: degenerate ones hide the way to the Delaunay ones"
        )
    return as_it_is if turn is None else (flipped.mesh, turn)


@dataclass(frozen=True, eq=False)
class Spread:
    """Vectors carried everywhere.

    Parameters
    ----------
    vector : (n,) ndarray of complex128
        In the vertices' frames.
    residual : float
        Relative residual of the solves that they come from, the largest.
    """

    vector: NDArray[np.complex128]
    residual: float


class VectorHeat:
    """Two factorisations of a mesh, many transports.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
        Consistently oriented, manifold vertices.
    time : float
        Diffusion time in units of the squared mean side length.
    intrinsic_delaunay : bool
        Diffuse on the intrinsic Delaunay triangulation, whose cotangent weights are not negative; values go
        in and out in the frames of `mesh`. Where an edge has three faces, the mesh as it is (told).
    """

    def __init__(self, mesh: SurfaceMesh, time: float = 1.0, *, intrinsic_delaunay: bool = True) -> None:
        if not time > 0:
            raise ParameterError(f"the diffusion time must be positive, found {time}")
        self.turn = np.ones(mesh.n_vertices, dtype=np.complex128)
        if intrinsic_delaunay:
            mesh, self.turn = _delaunay_frames(mesh)
        self.mesh = mesh
        self._factorise(time)

    def _factorise(self, time: float) -> None:
        self.time, mesh = time, self.mesh
        used = mesh.topology.referenced_vertex
        mass, t = lumped_mass(mesh), time * float(np.mean(mesh.side_length)) ** 2
        idle = csr_array((np.where(used, 0.0, 1.0), (np.arange(mesh.n_vertices),) * 2), shape=mass.shape)
        self.scalar = csr_array(mass + t * stiffness(mesh) + idle)
        self.vector = csr_array(mass + t * connection_laplacian(mesh) + idle)
        self._scalar_factor = Factor(self.scalar)
        self._vector_factor = Factor(self.vector, like=self._scalar_factor)

    def transport(self, vertex: NDArray, value: NDArray) -> Spread:
        """Vectors everywhere, parallel to that of the nearest source vertex.

        Parameters
        ----------
        vertex : (k,) ndarray of int64
        value : (k,) ndarray of complex128
            Tangent vectors in the vertices' frames.

        Notes
        -----
        What diffuses falls by e with each square root of the time; where it would fall below the smallest
        number, far from the sources, the time is raised for all.
        """
        n = self.mesh.n_vertices
        size, count = np.zeros(n), np.zeros(n)
        np.add.at(size, vertex, np.abs(value))
        np.add.at(count, vertex, 1.0)
        component = self.mesh.topology.vertex_component
        reached = np.isin(component, component[vertex]) & self.mesh.topology.referenced_vertex
        while True:
            start = np.stack([size, count], axis=1)
            sizes = self._scalar_factor.solve(start)
            if not reached.any() or np.abs(sizes[reached, 1]).min() > FAINT or self.time > MOST_TIME:
                break
            self._factorise(4.0 * self.time)
            _log.info(
                f"vector heat: time raised to {self.time:g} squared sides, so that it reaches everywhere"
            )
        vectors = self._source(vertex, value)
        spread = self._vector_factor.solve(vectors)
        residual = max(_residual(self.scalar, sizes, start), _residual(self.vector, spread, vectors))
        length = np.divide(sizes[:, 0], sizes[:, 1], out=np.zeros(n), where=np.abs(sizes[:, 1]) > FAINT)
        amount = np.abs(spread)
        unit = np.divide(spread, amount, out=np.zeros_like(spread), where=amount > FAINT)
        return Spread(unit * length * self.turn, residual)

    def _source(self, vertex: NDArray, value: NDArray) -> NDArray[np.complex128]:
        start = np.zeros(self.mesh.n_vertices, dtype=np.complex128)
        np.add.at(start, vertex, value * self.turn[vertex].conj())
        return start


def _residual(matrix: csr_array, x: NDArray, b: NDArray) -> float:
    """Largest |A x - b| relative to the largest |b|."""
    return float(np.abs(matrix @ x - b).max(initial=0.0) / (np.abs(b).max(initial=0.0) or 1.0))
