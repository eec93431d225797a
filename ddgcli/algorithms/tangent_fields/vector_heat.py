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
from scipy.sparse import csc_array, csr_array

from ddgcli.algorithms.delaunay.triangulation import flip_to_delaunay
from ddgcli.algorithms.tangent_fields.intrinsic_frames import frame_turn
from ddgcli.errors import ParameterError
from ddgcli.linalg.factor import Factor
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.operators.connection import connection_laplacian, side_angles
from ddgcli.operators.laplacian import lumped_mass, stiffness

_log = logging.getLogger("ddgcli")
FAINT = 1e-290  # what has diffused so far is counted as nothing
MOST_TIME = 4.0**14
REFINED_FROM = 1e-12  # residual above which a solution is refined


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
class TransportedVectors:
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
        in and out in the frames of `mesh`. Where an edge has three faces, the mesh as it is (with a warning).
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
        self._t = time * float(np.mean(mesh.side_length)) ** 2
        idle = csr_array((np.where(used, 0.0, 1.0), (np.arange(mesh.n_vertices),) * 2))
        self._mass = lumped_mass(mesh) + idle
        self._vector = Factor(csc_array(self._mass + self._t * connection_laplacian(mesh)))
        self._scalar: Factor | None = None

    @property
    def scalar(self) -> Factor:
        """Diffusion of numbers, factorised when lengths or doubts first ask for it."""
        if self._scalar is None:
            matrix = csc_array(self._mass + self._t * stiffness(self.mesh))
            self._scalar = Factor(matrix, like=self._vector)
        return self._scalar

    def transport(self, vertex: NDArray, value: NDArray) -> TransportedVectors:
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
        component = self.mesh.topology.vertex_component
        reached = np.isin(component, component[vertex]) & self.mesh.topology.referenced_vertex
        vectors = self._source(vertex, value)
        spread, residual = _solved(self._vector, vectors)
        while self._too_faint(spread, vertex, reached) and self.time <= MOST_TIME:
            self._factorise(4.0 * self.time)
            spread, residual = _solved(self._vector, vectors)
            _log.info(
                f"vector heat: time raised to {self.time:g} squared sides, so that it reaches everywhere"
            )
        size = np.abs(value)
        length = np.where(reached, size.max(initial=0.0), 0.0)
        if np.ptp(size) > 0:
            length, scalar_residual = self._lengths(vertex, size)
            residual = max(residual, scalar_residual)
        amount = np.abs(spread)
        unit = np.divide(spread, amount, out=np.zeros_like(spread), where=amount > FAINT)
        return TransportedVectors(unit * length * self.turn, residual)

    def _too_faint(self, spread: NDArray, vertex: NDArray, reached: NDArray) -> bool:
        """Whether some place holds less than any number; vectors that only cancel there are no sign of it."""
        if np.abs(spread[reached]).min(initial=np.inf) > FAINT:
            return False
        count = _solved(self.scalar, np.bincount(vertex, minlength=len(spread)).astype(np.float64))[0]
        return not np.abs(count[reached]).min(initial=np.inf) > FAINT

    def _lengths(self, vertex: NDArray, size: NDArray) -> tuple[NDArray, float]:
        """Diffused lengths over diffused ones, and the residual."""
        n = self.mesh.n_vertices
        start = np.stack([np.bincount(vertex, size, n), np.bincount(vertex, minlength=n)], axis=1)
        sizes, residual = _solved(self.scalar, start)
        faint = ~(np.abs(sizes[:, 1]) > FAINT)
        return np.divide(sizes[:, 0], sizes[:, 1], out=np.zeros(n), where=~faint), residual

    def _source(self, vertex: NDArray, value: NDArray) -> NDArray[np.complex128]:
        start = np.zeros(self.mesh.n_vertices, dtype=np.complex128)
        np.add.at(start, vertex, value * self.turn[vertex].conj())
        return start


def _solved(factor: Factor, b: NDArray) -> tuple[NDArray, float]:
    """Solution and its largest |A x - b| relative to the largest |b|; refined where that is not small."""
    x = factor.solve(b, refine=False)
    residual = factor.residual(x, b)
    if not residual < REFINED_FROM:
        x = factor.solve(b)
        residual = factor.residual(x, b)
    return x, residual
