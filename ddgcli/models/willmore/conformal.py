"""Conformal steps: the mean curvature half-density changes, and a spin transformation follows it.

Quaternions are arrays (..., 4) with the real part first; matrices of quaternions are sparse real matrices of
4 x 4 blocks.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array

from ddgcli.algorithms.hodge.harmonic import harmonic_basis
from ddgcli.errors import SolveError
from ddgcli.geometry.intrinsic import face_area
from ddgcli.geometry.normals import sphere_normals
from ddgcli.linalg.factor import Factor
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import NEXT, PREVIOUS
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import row_cross, row_dot
from ddgcli.models.willmore.area_energy import AreaEnergy
from ddgcli.models.willmore.step_rules import LEAST_NEWTON_FALL, MIN_CONFORMAL_SHARE
from ddgcli.models.willmore.vertex_energies import FaceSides
from ddgcli.operators.laplacian import lumped_vertex_area, stiffness, voronoi_vertex_area

SHIFT = 1e-9  # of the Dirac operator's square, relative to the largest diagonal, so that it can be factorised
POWER_ITERATIONS = 4  # of the inverse iteration for the smallest eigenvector

VertexArea = Callable[[TriangleMesh], NDArray[np.float64]]


def conformal_step(
    mesh: TriangleMesh, share: float, vertex_area: VertexArea = lumped_vertex_area
) -> TriangleMesh:
    """A closed connected surface after its mean curvature has gone a share of the way to a constant.

    Parameters
    ----------
    mesh : TriangleMesh
    share : float
        1 takes all of the curvature's admissible part away at once, to first order.
    vertex_area : callable
        TriangleMesh -> (n,) areas by which the integral of the mean curvature at a vertex is divided.

    Returns
    -------
    TriangleMesh
        With the centroid and the area of the mesh.

    Raises
    ------
    SolveError
        When a factorisation fails.

    Notes
    -----
    K. Crane, U. Pinkall, P. Schroeder, "Robust fairing via conformal curvature flow", 2013; the Dirac
    operator is that of "Spin transformations of discrete surfaces", 2011.
    """
    change = _curvature_change(mesh, vertex_area)
    spin = _smallest_spinor(mesh, share * change)
    points = _integrated(mesh, spin)
    mass = lumped_vertex_area(mesh)[:, None]
    old_centre = (mass * mesh.points).sum(axis=0) / mass.sum()
    moved = mesh.moved_unchecked(points)
    scale = np.sqrt(mass.sum() / face_area(moved.side_length).sum())
    new_mass = lumped_vertex_area(moved)[:, None]
    centre = (new_mass * points).sum(axis=0) / new_mass.sum()
    return mesh.moved_unchecked(scale * (points - centre) + old_centre)


@dataclass(frozen=True, eq=False)
class ConformalStep:
    """A surface after a conformal step that lowered an energy.

    Parameters
    ----------
    mesh : TriangleMesh
    energy : float
    next_length : float
        Share of the curvature's way to a constant that the next step begins with.
    """

    mesh: TriangleMesh
    energy: float
    next_length: float


def descending_step(
    mesh: TriangleMesh, share: float, value: Callable[[TriangleMesh], float], before: float
) -> ConformalStep | None:
    """A conformal step by the share, or by ever smaller halves of it, until an energy is lower than before.

    Curvature by lumped areas comes first, which bad faces disturb less; where that hardly lowers the energy,
    the better of it and of curvature by Voronoi areas, which does not alternate with the degrees of vertices.

    Parameters
    ----------
    mesh : TriangleMesh
    share : float
    value : callable
        TriangleMesh -> energy.
    before : float
        Energy of the mesh.

    Returns
    -------
    ConformalStep or None
        None where no share lowers the energy.
    """
    best = None
    for vertex_area in (lumped_vertex_area, voronoi_vertex_area):
        step = _descending_step(mesh, share, value, before, vertex_area)
        if step is not None and (best is None or step.energy < best.energy):
            best = step
        if best is not None and before - best.energy > LEAST_NEWTON_FALL * best.energy:
            return best
    return best


def _descending_step(
    mesh: TriangleMesh,
    share: float,
    value: Callable[[TriangleMesh], float],
    before: float,
    vertex_area: VertexArea,
) -> ConformalStep | None:
    while share >= MIN_CONFORMAL_SHARE:
        moved = conformal_step(mesh, share, vertex_area)
        energy = value(moved)
        if energy < before:
            return ConformalStep(moved, energy, min(1.0, 2.0 * share))
        share *= 0.5
    return None


def distance_from_rest(mesh: TriangleMesh) -> float:
    """Integral of the square of the admissible part of H: about the energy that the flow could still release.

    Parameters
    ----------
    mesh : TriangleMesh

    Returns
    -------
    float
        Without unit.
    """
    return float((lumped_vertex_area(mesh) * _curvature_change(mesh, voronoi_vertex_area) ** 2).sum())


def log_ratio_change(start: TriangleMesh, end: TriangleMesh) -> dict[str, float]:
    """Change of the logarithm of the ratio of two sides of a face, which is 0 for a conformal map.

    Parameters
    ----------
    start, end : TriangleMesh
        With the same faces.

    Returns
    -------
    dict of str to float
        `log_ratio_change_max`, `log_ratio_change_mean` over the faces.
    """
    stretch = np.log(end.side_length / start.side_length)
    change = stretch.max(axis=1) - stretch.min(axis=1)
    return {"log_ratio_change_max": float(change.max()), "log_ratio_change_mean": float(change.mean())}


def _curvature_change(mesh: TriangleMesh, vertex_area: VertexArea) -> NDArray[np.float64]:
    """(n,) the flow's speed of the mean curvature, -H without what would tear the surface.

    A constant part changes the size only, and is left out. The gradient of the area at a vertex integrates H
    over its Voronoi cell: divided by lumped areas, it alternates with the degrees of the vertices.
    """
    mass = lumped_vertex_area(mesh)
    by_area = AreaEnergy(mesh.topology).value_and_gradient(mesh.points)[1]
    curvature = 0.5 * row_dot(by_area, sphere_normals(mesh)) / vertex_area(mesh)
    basis = np.concatenate([np.ones((len(mass), 1)), _tearing_changes(mesh, mass)], axis=1)
    weighted = np.sqrt(mass)[:, None] * basis
    share = np.linalg.lstsq(weighted, np.sqrt(mass) * curvature, rcond=None)[0]
    return -(curvature - basis @ share)


def _tearing_changes(mesh: TriangleMesh, mass: NDArray) -> NDArray[np.float64]:
    """(n, 3 + 6 genus) changes of the mean curvature after which, to first order, the surface does not close.

    The normal's coordinates, for which the spinor's equation has no solution; and for every harmonic form w
    those whose spinor s turns the edges into a form with a part along w: its derivative by the change, by one
    solution of the adjoint equation each.
    """
    basis = [sphere_normals(mesh)]
    if mesh.topology.genus:
        faces = FaceSides.at(mesh.points, mesh.faces)
        e = _imaginary(faces.opposite)
        factor = _shifted_factor(_dirac_squared(mesh, np.zeros(mesh.n_faces)))
        forms = harmonic_basis(mesh).forms
        side = mesh.topology.side_edge[:, NEXT]
        sense = mesh.topology.side_sign[:, NEXT]
        weight = 0.5 * _corner_cotan(faces)
        for form in np.asarray(forms).reshape(-1, mesh.topology.n_edges):
            along = weight * sense * form[side]
            for axis in range(3):
                basis.append(_by_change(mesh, e, along, axis, factor)[:, None] / mass[:, None])
    return np.concatenate(basis, axis=1)


def _by_change(
    mesh: TriangleMesh, e: NDArray, along: NDArray, axis: int, factor: Factor
) -> NDArray[np.float64]:
    """(n,) derivative by the change of the sum over sides of along * (conj(s) e + e s)_axis, at s = 1."""
    unit = np.zeros(4)
    unit[1 + axis] = 1.0
    # conj(s) e + e s = 2 Re(s) e + 2 cross(e, Im(s)) for imaginary e; s is the mean of the ends' spinors
    by_spinor = np.empty_like(e)
    by_spinor[..., 0] = 2.0 * e[..., 1 + axis]
    by_spinor[..., 1:] = 2.0 * row_cross(unit[1:], e[..., 1:])
    by_spinor *= 0.5 * along[..., None]
    right = sum_by_index(mesh.faces[:, NEXT], by_spinor, mesh.n_vertices)
    right += sum_by_index(mesh.faces[:, PREVIOUS], by_spinor, mesh.n_vertices)
    adjoint = factor.solve(_without_constants(right).ravel(), refine=False).reshape(-1, 4)
    by_face = 0.5 * np.einsum("fki,fki->f", e, adjoint[mesh.faces])
    return sum_by_index(mesh.faces, np.repeat(by_face[:, None] / 3.0, 3, axis=1), mesh.n_vertices)


def _without_constants(right: NDArray) -> NDArray[np.float64]:
    """Right sides orthogonal to constant spinors, the kernel of the Dirac operator."""
    return right - right.mean(axis=0)


def _imaginary(v: NDArray) -> NDArray[np.float64]:
    return np.concatenate([np.zeros((*v.shape[:-1], 1)), v], axis=-1)


def _product(p: NDArray, q: NDArray) -> NDArray[np.float64]:
    """Hamilton product of quaternions (..., 4)."""
    real = p[..., :1] * q[..., :1] - np.sum(p[..., 1:] * q[..., 1:], axis=-1, keepdims=True)
    imaginary = p[..., :1] * q[..., 1:] + q[..., :1] * p[..., 1:] + row_cross(p[..., 1:], q[..., 1:])
    return np.concatenate([real, imaginary], axis=-1)


def _left_matrix(q: NDArray) -> NDArray[np.float64]:
    """(..., 4, 4) matrices of the products with q from the left."""
    return np.stack([_product(q, np.broadcast_to(unit, q.shape)) for unit in np.eye(4)], axis=-1)


def _dirac_squared(mesh: TriangleMesh, rho: NDArray) -> csc_array:
    """(4n, 4n) real matrix of (D - rho)* (D - rho), rho (m,) on the faces."""
    faces = FaceSides.at(mesh.points, mesh.faces)
    e, area = _imaginary(faces.opposite), faces.area
    rows, columns, blocks = [], [], []
    for i in range(3):
        for j in range(3):
            block = -_product(e[:, i], e[:, j]) / (4.0 * area)[:, None]
            block += (rho / 6.0)[:, None] * (e[:, j] - e[:, i])
            block[:, 0] += area * rho**2 / 9.0
            rows.append(mesh.faces[:, i])
            columns.append(mesh.faces[:, j])
            blocks.append(_left_matrix(block))
    row, column, block = np.concatenate(rows), np.concatenate(columns), np.concatenate(blocks)
    n, inner = mesh.n_vertices, np.arange(4)
    row4 = np.broadcast_to((4 * row)[:, None, None] + inner[:, None], block.shape).ravel()
    column4 = np.broadcast_to((4 * column)[:, None, None] + inner, block.shape).ravel()
    matrix = csc_array((block.ravel(), (row4, column4)), shape=(4 * n, 4 * n))
    return csc_array(0.5 * (matrix + matrix.T))


def _shifted_factor(matrix: csc_array) -> Factor:
    size = matrix.shape[0]
    shift = SHIFT * float(np.abs(matrix.diagonal()).max())
    return Factor(csc_array(matrix + csc_array((np.full(size, shift), (np.arange(size),) * 2))))


def _smallest_spinor(mesh: TriangleMesh, change: NDArray) -> NDArray[np.float64]:
    """(n, 4) eigenvector of the smallest eigenvalue of (D - change)* (D - change), by inverse iteration."""
    n, mass = mesh.n_vertices, np.repeat(lumped_vertex_area(mesh), 4)
    factor = _shifted_factor(_dirac_squared(mesh, change[mesh.faces].mean(axis=1)))
    spin = np.tile([1.0, 0.0, 0.0, 0.0], n)
    for _ in range(POWER_ITERATIONS):
        spin = factor.solve(mass * spin, refine=False)
        size = float(np.sqrt((mass * spin**2).sum() / mass.sum()))
        if not (np.isfinite(size) and size > 0.0):
            raise SolveError("the spin transformation could not be computed")
        spin = spin / size
    return spin.reshape(n, 4)


def _corner_cotan(faces: FaceSides) -> NDArray[np.float64]:
    """(m, 3) cotangents of the corners."""
    squared = row_dot(faces.opposite, faces.opposite)
    return (squared[:, NEXT] + squared[:, PREVIOUS] - squared) / (4.0 * faces.area[:, None])


def _integrated(mesh: TriangleMesh, spin: NDArray) -> NDArray[np.float64]:
    """(n, 3) positions whose edges are nearest conj(s) e s, s the spinor on the edge: a Poisson problem."""
    faces = FaceSides.at(mesh.points, mesh.faces)
    e = _imaginary(faces.opposite)  # from corner k + 1 to corner k + 2
    tail, head = spin[mesh.faces][:, NEXT], spin[mesh.faces][:, PREVIOUS]
    conj = np.array([1.0, -1.0, -1.0, -1.0])
    rotated = (
        _product(_product(conj * tail, e), tail) / 3.0
        + _product(_product(conj * tail, e), head) / 6.0
        + _product(_product(conj * head, e), tail) / 6.0
        + _product(_product(conj * head, e), head) / 3.0
    )[..., 1:]
    flux = 0.5 * _corner_cotan(faces)[..., None] * rotated
    right = sum_by_index(mesh.faces[:, PREVIOUS], flux, mesh.n_vertices)
    right -= sum_by_index(mesh.faces[:, NEXT], flux, mesh.n_vertices)
    right -= right.mean(axis=0)
    L = csc_array(stiffness(mesh))
    rest = np.arange(1, mesh.n_vertices)
    points = np.zeros((mesh.n_vertices, 3))
    points[1:] = Factor(csc_array(L[rest][:, rest])).solve(right[1:])
    return points
