"""Vector heat method: parallel transport of vectors to a whole surface.

N. Sharp, Y. Soliman, K. Crane, "The Vector Heat Method", 2019: short-time diffusion with the connection
Laplacian transports vectors along shortest paths and gives the directions; two scalar diffusions give the
lengths.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array

from ddgcli.algorithms.delaunay.boundary_splits import split_obtuse_boundary
from ddgcli.algorithms.delaunay.triangulation import (
    check_area,
    flip_to_delaunay,
    glue,
    negative_cotan_edges,
)
from ddgcli.algorithms.tangent_fields.intrinsic_frames import frame_turn
from ddgcli.errors import counted
from ddgcli.geometry.component_sides import component_mean_side, on_vertices
from ddgcli.linalg.factor import Factor
from ddgcli.linalg.scaled_rows import scaled_rows
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.remedies import remedy
from ddgcli.operators.connection import check_tangent_planes, connection_laplacian
from ddgcli.operators.laplacian import lumped_mass, stiffness

_log = logging.getLogger("ddgcli")
MIN_VALUE = 1e-290  # smaller diffused values have no direction
MAX_TIME = 4.0**14  # in squared mean side lengths
REFINEMENT_RESIDUAL = 1e-12  # solutions with a larger residual are refined


def check_vector_heat(mesh: SurfaceMesh) -> None:
    """Raise the errors of the vector heat method that need no flips and no solves.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
        Consistently oriented.

    Raises
    ------
    MeshError
    """
    check_tangent_planes(mesh)
    glue(mesh)
    check_area(mesh)


def _delaunay_frames(mesh: SurfaceMesh) -> tuple[SurfaceMesh, NDArray[np.complex128]] | None:
    """Intrinsic Delaunay triangulation without obtuse angles opposite its boundary, and the rotation of its
    vertex frames to those of the mesh; None where that rotation is unknown."""
    check_tangent_planes(mesh)
    flipped = flip_to_delaunay(mesh, track=True)
    turn = frame_turn(mesh, flipped) if flipped.flips else np.ones(mesh.n_vertices, dtype=np.complex128)
    if turn is None:
        _log.warning("vectors diffuse on the faces of the mesh: degenerate faces hide the Delaunay frames")
        return None
    split = split_obtuse_boundary(flipped.mesh, track_turn=True)
    is_unchanged = not flipped.flips and split.mesh is flipped.mesh
    return mesh if is_unchanged else split.mesh, turn * split.turn


@dataclass(frozen=True, eq=False)
class TransportedVectors:
    """Vectors at all vertices.

    Parameters
    ----------
    vector : (n,) ndarray of complex128
        In the vertices' frames.
    residual : float
        Largest relative residual of the solves.
    extended : (n + s,) ndarray of complex128
        At the vertices of the triangulation of the diffusion, in its frames; the last s of them are Steiner
        points on the boundary.
    """

    vector: NDArray[np.complex128]
    residual: float
    extended: NDArray[np.complex128]


class VectorHeat:
    """Factorised vector heat method of a mesh, for many transports.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
        Consistently oriented, manifold vertices.
    intrinsic_delaunay : bool
        Diffuse on the intrinsic Delaunay triangulation, with Steiner points on boundary edges opposite obtuse
        angles: no cotangent weight is negative, so that diffused numbers stay positive and vectors keep their
        sense. Values are in the frames of `mesh`. If degenerate faces hide the frames of the triangulation,
        diffuse on the mesh itself (with a warning).

    Attributes
    ----------
    vector : Factor
        Of the diffusion of vectors.
    time : (n_components,) ndarray of float64
        Diffusion time on each component, in units of its squared mean side length.
    """

    def __init__(self, mesh: SurfaceMesh, *, intrinsic_delaunay: bool = True) -> None:
        self.turn = np.ones(mesh.n_vertices, dtype=np.complex128)
        delaunay = _delaunay_frames(mesh) if intrinsic_delaunay else None
        self._on_input_faces = delaunay is None
        if delaunay:
            mesh, self.turn = delaunay
        self.mesh = mesh
        self._factorise(np.ones(mesh.topology.n_components))

    def _factorise(self, time: NDArray) -> None:
        self.time, mesh = time, self.mesh
        referenced = mesh.topology.referenced_vertex
        self._t = on_vertices(mesh, time * component_mean_side(mesh) ** 2)
        idle = csr_array((np.where(referenced, 0.0, 1.0), (np.arange(mesh.n_vertices),) * 2))
        self._mass = lumped_mass(mesh) + idle
        with np.errstate(invalid="ignore"):  # the factorisation refuses entries that are not finite
            matrix = csc_array(self._mass + scaled_rows(connection_laplacian(mesh), self._t))
        self.vector = Factor(matrix)
        self._scalar: Factor | None = None

    @property
    def scalar(self) -> Factor:
        """Factorised scalar diffusion, created on first access."""
        if self._scalar is None:
            matrix = csc_array(self._mass + scaled_rows(stiffness(self.mesh), self._t))
            self._scalar = Factor(matrix, like=self.vector)
        return self._scalar

    def transport(self, vertex: NDArray, value: NDArray) -> TransportedVectors:
        """Vectors at all vertices, parallel to that of the nearest source vertex.

        Parameters
        ----------
        vertex : (k,) ndarray of int64
        value : (k,) ndarray of complex128
            Tangent vectors in the vertices' frames.

        Notes
        -----
        Diffused values fall by a factor e per square root of the time. If they underflow far from the
        sources, the time is raised on their component.
        """
        component = self.mesh.topology.vertex_component
        has_source = np.zeros(self.mesh.topology.n_components + 1, dtype=bool)
        has_source[component[vertex]] = True
        has_source[-1] = False  # vertices without a face
        reached = has_source.take(component)
        vectors = self._source(vertex, value)
        diffused, residual = _solve(self.vector, vectors)
        amount = np.abs(diffused)
        while (short := self._too_short(amount, vertex, reached)).any():
            self._factorise(np.where(short, 4.0 * self.time, self.time))
            diffused, residual = _solve(self.vector, vectors)
            amount = np.abs(diffused)
            _log.info(
                f"vector heat: time raised to {self.time.max():g} squared side lengths to avoid underflow"
            )
        size = np.abs(value)
        length = np.where(reached, size.max(initial=0.0), 0.0)
        if np.ptp(size) > 0:
            length, scalar_residual = self._lengths(vertex, size)
            residual = max(residual, scalar_residual)
        if self._on_input_faces:
            self._check_positive(vertex, reached)
        inverse = np.divide(1.0, amount, out=np.zeros(len(amount)), where=amount > MIN_VALUE)
        direction, n = diffused * inverse, len(self.turn)
        vector = direction[:n] * (length[:n] * self.turn)
        return TransportedVectors(vector, residual, direction * length)

    def _too_short(self, amount: NDArray, vertex: NDArray, reached: NDArray) -> NDArray[np.bool_]:
        """Components where values underflow at some vertex (small values by cancellation do not count)."""
        short = np.zeros(len(self.time), dtype=bool)
        if amount.min(initial=np.inf, where=reached) > MIN_VALUE:
            return short
        count = _solve(self.scalar, np.bincount(vertex, minlength=len(amount)).astype(np.float64))[0]
        short[self.mesh.topology.vertex_component[reached & ~(np.abs(count) > MIN_VALUE)]] = True
        return short & (self.time <= MAX_TIME)

    def _check_positive(self, vertex: NDArray, reached: NDArray) -> None:
        """Warn if scalars diffused on faces as they are are not positive: vectors are reversed there."""
        if not negative_cotan_edges(self.mesh):
            return
        heat = _solve(self.scalar, np.bincount(vertex, minlength=self.mesh.n_vertices).astype(np.float64))[0]
        if count := int((reached & ~(heat > 0)).sum()):
            _log.warning(
                f"the heat is not positive at {counted(count, 'vertex', 'vertices')}, for faces with obtuse "
                f"angles: vectors are reversed there; {remedy('no area')}"
            )

    def _lengths(self, vertex: NDArray, size: NDArray) -> tuple[NDArray, float]:
        """Diffused lengths divided by diffused indicators, and the residual."""
        n = self.mesh.n_vertices
        start = np.stack([np.bincount(vertex, size, n), np.bincount(vertex, minlength=n)], axis=1)
        sizes, residual = _solve(self.scalar, start)
        underflowed = ~(np.abs(sizes[:, 1]) > MIN_VALUE)
        return np.divide(sizes[:, 0], sizes[:, 1], out=np.zeros(n), where=~underflowed), residual

    def _source(self, vertex: NDArray, value: NDArray) -> NDArray[np.complex128]:
        start = np.zeros(self.mesh.n_vertices, dtype=np.complex128)
        np.add.at(start, vertex, value * self.turn[vertex].conj())
        return start


def _solve(factor: Factor, b: NDArray) -> tuple[NDArray, float]:
    """Solve A x = b, with refinement if needed; return x and the largest |A x - b| relative to the largest
    |b|."""
    x = factor.solve(b, refine=False)
    residual = factor.residual(x, b)
    if not residual < REFINEMENT_RESIDUAL:
        x = factor.solve(b)
        residual = factor.residual(x, b)
    return x, residual
