"""Flattening a surface with boundary: harmonic onto a disk, conformal with a free boundary."""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array, diags_array

from ddgcli.algorithms.conformal.distortion import angle_distortion, distortion_arrays, planar_area
from ddgcli.algorithms.laplacian.laplace_operator import LaplaceOperator
from ddgcli.errors import MeshError, counted
from ddgcli.geometry.intrinsic import face_area
from ddgcli.linalg.constrain import Dirichlet
from ddgcli.linalg.factor import Factor
from ddgcli.linalg.residual_gate import LARGEST_RESIDUAL
from ddgcli.mesh.boundary import boundary_vertex_loops
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.remedies import remedy
from ddgcli.mesh.require import require
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import NEXT
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.representation import short_repr

log = logging.getLogger("ddgcli")

# shift of the conformal energy in its inverse iteration, relative to the boundary's mass; its size affects
# only the speed of the iteration
ENERGY_SHIFT = 1e-7
MAX_ITERATIONS = 500
MIN_MOMENT = 1e-6  # relative size above which a second moment is not rounding


@dataclass(frozen=True, eq=False)
class Parameterization:
    """A flattening and its quality.

    Parameters
    ----------
    uv : (n, 2) ndarray of float64
    flipped : int
        Triangles of the operator's own triangulation with area of the wrong sign, beyond rounding.
    flipped_input : int
        Triangles of the input mesh likewise.
    collapsed_input : int
        Triangles of the input mesh whose area in the plane is lost in rounding (in long protrusions).
    distortion_mean, distortion_max : float
        Ratio of the singular values of the map on the input triangles (1 where conformal), area mean and max.
    residual : float
        Relative residual of the linear or eigenvalue problem.
    distortion : dict of str to ndarray
        Arrays on the faces of the mesh (see `distortion_arrays`).
    converged : bool
    """

    uv: NDArray[np.float64]
    flipped: int
    flipped_input: int
    collapsed_input: int
    distortion_mean: float
    distortion_max: float
    residual: float
    distortion: dict[str, NDArray[np.float64]]
    converged: bool = True

    __repr__ = short_repr


def parameterize_harmonic(mesh: TriangleMesh, operator: LaplaceOperator) -> Parameterization:
    """Harmonic map onto the unit disk, with the boundary on the circle by arc length.

    Weights of an intrinsic Delaunay operator are not negative inside, so that no triangle of it is flipped.
    The longest of several boundary loops maps to the circle; fans fill the others, so that the same holds.
    The disk is turned so that u grows most along x (y, z where nothing depends on x).

    Parameters
    ----------
    mesh : TriangleMesh
        A disk, perhaps with holes.
    operator : LaplaceOperator

    Returns
    -------
    Parameterization

    Raises
    ------
    MeshError
        When the surface is not a disk, perhaps with holes.

    References
    ----------
    W. Tutte, "How to draw a graph", 1963; Floater2003 in docs/references.bib.
    """
    loops = boundary_loops(mesh, "a harmonic map")
    loop = loops[0]
    angle = _arc_length_angle(mesh.points[loop])
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    order = np.argsort(loop)
    vertices = operator.referenced_vertices
    local = _local_numbers(mesh.n_vertices, vertices, loops)
    filled = _with_fans(operator.stiffness[vertices][:, vertices], [local[hole] for hole in loops[1:]])
    problem = Dirichlet(filled, local[loop])
    inside = problem.solve(circle[order])
    uv = np.zeros((mesh.n_vertices, 2))
    z = inside[: len(vertices), 0] + 1j * inside[: len(vertices), 1]
    z = z * _turn_to_axes(z, operator.mass.diagonal()[vertices], mesh.points[vertices])
    uv[vertices] = _planar(z)
    return _with_quality(mesh, operator.surface, uv, problem.residual(inside), True)


def parameterize_conformal(mesh: TriangleMesh, operator: LaplaceOperator) -> Parameterization:
    """Conformal map with free boundary: the smallest conformal energy for given boundary size.

    The result has the area of the surface, its centre at the origin and its longer axis along u, which grows
    along x (y, z where nothing depends on x).

    Parameters
    ----------
    mesh : TriangleMesh
        A disk, perhaps with holes.
    operator : LaplaceOperator

    Returns
    -------
    Parameterization
        With a warning where the iteration did not converge.

    Raises
    ------
    MeshError
        When the surface is not a disk, perhaps with holes.

    References
    ----------
    P. Mullen et al., "Spectral conformal parameterization", 2008.
    """
    loops = boundary_loops(mesh, "a conformal map")
    vertices = operator.referenced_vertices
    local = _local_numbers(mesh.n_vertices, vertices, loops)
    H, B = _conformal_energy(mesh, operator.stiffness[vertices][:, vertices], loops, local)
    z, residual, converged = _smallest_complex(H, B, local[loops[0]])
    if not converged:
        log.warning("the conformal map did not converge: residual %.2g", residual)
    uv = np.zeros((mesh.n_vertices, 2))
    uv[vertices] = _principal_axes(z, operator.mass.diagonal()[vertices], mesh.points[vertices])
    total = 0.5 * planar_area(uv[mesh.faces]).sum()
    uv *= np.sqrt(face_area(mesh.side_length).sum() / total) if total > 0 else 1.0
    return _with_quality(mesh, operator.surface, uv, residual, converged)


def boundary_loops(mesh: TriangleMesh, subject: str) -> list[NDArray[np.int64]]:
    """Boundary loops of a disk with holes, longest first.

    Parameters
    ----------
    mesh : TriangleMesh
    subject : str
        Subject of the message.

    Returns
    -------
    list of (k,) ndarray of int64
        Vertices in the order of the faces.

    Raises
    ------
    MeshError
        When the surface is not oriented, not connected, closed, or has handles.
    """
    require(mesh, subject, manifold=True, oriented=True)
    topology = mesh.topology
    if topology.n_components != 1:
        raise MeshError(f"{topology.n_components} components; {subject} takes one: {remedy('components')}")
    if topology.is_closed:
        raise MeshError(f"the surface is closed; {subject} needs a boundary: {remedy('no boundary')}")
    if topology.genus:
        raise MeshError(f"{topology.genus} handles; {subject} takes a surface without: {remedy('handles')}")
    loops = boundary_vertex_loops(topology)
    if len(loops) > 1:
        log.warning("the surface has %d boundary loops; the longest bounds the map", len(loops))
    return sorted(loops, key=lambda loop: -_perimeter(mesh.points[loop]))


def _local_numbers(n_vertices: int, vertices: NDArray, loops: list[NDArray]) -> NDArray[np.int64]:
    """(n,) index of each vertex among those of the operator; MeshError where a boundary vertex has none."""
    local = np.full(n_vertices, -1)
    local[vertices] = np.arange(len(vertices))
    require_size_at_boundary(loops, local >= 0)
    return local


def require_size_at_boundary(loops: list[NDArray], has_size: NDArray) -> None:
    """Raise an error for boundary vertices that have only faces without area.

    Parameters
    ----------
    loops : list of (k,) ndarray of int64
    has_size : (n,) ndarray of bool

    Raises
    ------
    MeshError
    """
    missing = [int(v) for loop in loops for v in loop[~has_size[loop]]]
    if missing:
        vertices = counted(len(missing), "boundary vertex has", "boundary vertices have")
        raise MeshError(
            f"{vertices} only faces without area (first: vertex {missing[0]}); {remedy('no area')}"
        )


def _with_fans(L: csr_array, holes: list[NDArray]) -> csr_array:
    """Stiffness with one more unknown in each hole, connected to its k vertices as in a regular k-gon.

    Weights along the holes become those of interior edges, at least 0.
    """
    if not holes:
        return L
    n = L.shape[0]
    tails, heads, weights = [], [], []
    for number, hole in enumerate(holes):
        k, following = len(hole), np.roll(hole, -1)
        along = -np.asarray(L[hole, following]).ravel()
        filled = np.maximum(along + 0.5 * max(1.0 / np.tan(2 * np.pi / k), 0.0), 0.0)
        tails += [hole, hole]
        heads += [following, np.full(k, n + number)]
        weights += [filled - along, np.full(k, np.tan(np.pi / k))]
    i, j, w = np.concatenate(tails), np.concatenate(heads), np.concatenate(weights)
    size = n + len(holes)
    fans = coo_array(
        (np.concatenate([-w, -w, w, w]), (np.r_[i, j, i, j], np.r_[j, i, i, j])), shape=(size, size)
    )
    padded = L.tocoo()
    return csr_array(coo_array((padded.data, padded.coords), shape=(size, size)) + fans)


def _perimeter(points: NDArray) -> float:
    return float(np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1).sum())


def _arc_length_angle(points: NDArray) -> NDArray[np.float64]:
    step = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    along = np.concatenate([[0.0], np.cumsum(step)])
    return 2 * np.pi * along[:-1] / along[-1]


def _conformal_energy(
    mesh: TriangleMesh, L: csr_array, loops: list[NDArray], local: NDArray
) -> tuple[csr_array, csr_array]:
    """Hermitian H with z* H z = Dirichlet energy - area, and the boundary's mass B of sum one."""
    n = L.shape[0]
    tail = np.concatenate(loops)
    head = np.concatenate([np.roll(loop, -1) for loop in loops])
    length = np.linalg.norm(mesh.points[head] - mesh.points[tail], axis=1)
    i, j = local[tail], local[head]
    quarter = np.full(len(i), 0.25j)
    area = coo_array((np.concatenate([-quarter, quarter]), (np.r_[i, j], np.r_[j, i])), shape=(n, n))
    boundary = sum_by_index(i, length, n) + sum_by_index(j, length, n)
    return csr_array(0.5 * L - area), csr_array(diags_array(boundary / boundary.sum()))


def _smallest_complex(H: csr_array, B: csr_array, loop: NDArray) -> tuple[NDArray, float, bool]:
    """Eigenvector of H z = lambda B z of smallest lambda beside the constants, by inverse iteration."""
    factor = Factor(H + ENERGY_SHIFT * B)
    b = B.diagonal()
    z = np.zeros(len(b), dtype=complex)
    z[loop] = np.exp(2j * np.pi * np.arange(len(loop)) / len(loop))
    residual, size = np.inf, abs(H).max()
    for _ in range(MAX_ITERATIONS):
        z = factor.solve(b * z)
        z -= (b * z).sum()
        z /= np.sqrt((b * np.abs(z) ** 2).sum())
        value = np.vdot(z, H @ z).real
        before = residual
        error = H @ z - value * (b * z)
        residual = float(np.abs(error).max() / (size * np.abs(z).max()))
        if residual < 1e-13 or (residual < 1e-10 and residual > 0.9 * before):
            break
    return z, residual, residual < 1e-8


def _principal_axes(z: NDArray, weight: NDArray, points: NDArray) -> NDArray[np.float64]:
    """(n, 2) real coordinates, centred, the longer axis along u; turned to x where no axis is longer."""
    z = z - (weight * z).sum() / weight.sum()
    moment = (weight * z * z).sum()
    if abs(moment) <= MIN_MOMENT * (weight * np.abs(z) ** 2).sum():
        return _planar(z * _turn_to_axes(z, weight, points))
    z = z * np.exp(-0.5j * np.angle(moment))
    return _planar(z * _turn_to_axes(z.real, weight, points))


def _turn_to_axes(values: NDArray, weight: NDArray, points: NDArray) -> complex:
    """Unit factor (of real values a sign) by which they grow along x, y or z, the first that they depend on.

    Positions alone decide, not the indices of the vertices.
    """
    offset = points - weight @ points / weight.sum()
    offset = offset / (np.abs(offset).max() or 1.0)
    moment = (weight * values) @ offset
    size = np.sqrt((weight * np.abs(values) ** 2).sum() * (weight @ offset**2).sum())
    first = moment[np.argmax(np.abs(moment) > MIN_MOMENT * size)]
    return complex(np.conj(first) / abs(first)) if first else 1.0


def _planar(z: NDArray) -> NDArray[np.float64]:
    return np.stack([z.real, z.imag], axis=1)


def _with_quality(
    mesh: TriangleMesh, surface: SurfaceMesh, uv: NDArray, residual: float, converged: bool
) -> Parameterization:
    """The parameterization with its flips and its distortion."""
    flipped, _ = _flipped_and_collapsed(uv[surface.faces])
    flipped_input, collapsed_input = _flipped_and_collapsed(uv[mesh.faces])
    if collapsed_input:
        log.warning(
            "%s in the plane: no area but rounding",
            counted(collapsed_input, "triangle of the mesh collapses", "triangles of the mesh collapse"),
        )
    if flipped_input:
        log.warning(
            "%s flipped in the plane: a discrete conformal map flips none",
            counted(flipped_input, "triangle of the mesh is", "triangles of the mesh are"),
        )
    area, stretch = face_area(mesh.side_length), angle_distortion(mesh, uv[mesh.faces])
    good = np.isfinite(stretch)
    mean = float((area * stretch)[good].sum() / area[good].sum()) if good.any() else float("inf")
    largest = float(stretch[good].max(initial=1.0))
    arrays = distortion_arrays(mesh, uv[mesh.faces])
    converged = converged and bool(residual <= LARGEST_RESIDUAL)
    return Parameterization(
        uv, flipped, flipped_input, collapsed_input, mean, largest, residual, arrays, converged
    )


def _flipped_and_collapsed(corners: NDArray) -> tuple[int, int]:
    """Number of (m, 3, 2) triangles with negative area, and with an area below the rounding of uv."""
    area = planar_area(corners)
    longest = np.abs(corners[:, NEXT] - corners).max(axis=(1, 2))
    rounding = 8 * np.finfo(float).eps * np.abs(corners).max() * longest
    return int((area < -rounding).sum()), int((np.abs(area) <= rounding).sum())
