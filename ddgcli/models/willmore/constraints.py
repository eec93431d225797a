"""Area and volume held fixed along a flow: tangent steps, then a return to the constraint."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import SolveError
from ddgcli.geometry.intrinsic import face_area
from ddgcli.mesh.boundary import boundary_vertex_loops
from ddgcli.mesh.ragged import group_by_key
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import cone_volume, ratio, row_dot, unit_vectors
from ddgcli.models.willmore.area_energy import AreaEnergy, signed_volume, volume_gradient

PreconditionerSolve = Callable[[NDArray], NDArray]
CONSTRAINT_TOLERANCE = 1e-13  # relative residual at which a constraint counts as met
PARALLEL_GRADIENT_TOLERANCE = 1e-10  # relative size below which two constraint gradients count as parallel


def area(mesh: TriangleMesh) -> float:
    """Total area of a surface.

    Parameters
    ----------
    mesh : TriangleMesh

    Returns
    -------
    float
        In length^2.
    """
    return float(face_area(mesh.side_length).sum())


def areas(mesh: TriangleMesh, component: NDArray | None) -> NDArray[np.float64]:
    """Area of the surface, or of each of some components.

    Parameters
    ----------
    mesh : TriangleMesh
    component : (n,) ndarray of int, optional
        Of each vertex; -1 where its area does not count.

    Returns
    -------
    (c,) ndarray of float64
        In length^2.
    """
    if component is None:
        return np.array([area(mesh)])
    label = component[mesh.faces[:, 0]] + 1  # 0 for faces that do not count
    return sum_by_index(label, face_area(mesh.side_length), int(component.max()) + 2)[1:]


def cap_faces(topology: Topology) -> NDArray[np.int64]:
    """Faces that close every boundary loop, without new vertices.

    Where the boundary stays, the volume inside changes as if any other caps were there.

    Parameters
    ----------
    topology : Topology

    Returns
    -------
    (k, 3) ndarray of int64
    """
    fans = [
        np.stack([np.full(len(loop) - 2, loop[0]), loop[2:], loop[1:-1]], axis=1)
        for loop in boundary_vertex_loops(topology)
    ]
    return np.concatenate(fans) if fans else np.zeros((0, 3), dtype=np.int64)


def volume_inside(mesh: TriangleMesh, caps: NDArray | None = None) -> float:
    """Signed volume inside a surface and its caps.

    Parameters
    ----------
    mesh : TriangleMesh
    caps : (k, 3) ndarray of int64, optional
        As returned by `cap_faces`.

    Returns
    -------
    float
        In length^3, positive for outward orientation.
    """
    faces = mesh.faces if caps is None else np.concatenate([mesh.faces, caps])
    return signed_volume(mesh.points, faces)


def volumes_inside(
    mesh: TriangleMesh, caps: NDArray | None, component: NDArray | None
) -> NDArray[np.float64]:
    """Signed volume inside a surface and its caps, or of each of some closed components.

    Parameters
    ----------
    mesh : TriangleMesh
    caps : (k, 3) ndarray of int64, optional
        Of a surface as a whole.
    component : (n,) ndarray of int, optional
        Of each vertex; -1 where its volume does not count.

    Returns
    -------
    (c,) ndarray of float64
        In length^3, positive for outward orientation.
    """
    if component is None:
        return np.array([volume_inside(mesh, caps)])
    label = component[mesh.faces[:, 0]]
    counts = label >= 0
    label, corner = label[counts], mesh.points[mesh.faces[counts]]
    n_faces = np.bincount(label)
    # from the mean of a component's corners, as far from the others as it may be
    middle = sum_by_index(label, corner.mean(axis=1), len(n_faces)) / n_faces[:, None]
    a, b, c = (corner - middle[label][:, None]).transpose(1, 2, 0)
    return sum_by_index(label, cone_volume(a, b, c), len(n_faces))


def reduced_volumes(mesh: TriangleMesh) -> NDArray[np.float64]:
    """Volume of each component over that of the sphere of its area.

    Parameters
    ----------
    mesh : TriangleMesh
        Closed.

    Returns
    -------
    (c,) ndarray of float64
        Not negative; 0 of a component without area.
    """
    component = mesh.topology.vertex_component
    volume = 6.0 * np.sqrt(np.pi) * np.abs(volumes_inside(mesh, None, component))
    return ratio(volume, areas(mesh, component) ** 1.5)


def _translations(mesh: TriangleMesh, free: NDArray) -> list[NDArray]:
    """The translations along the volume's gradient, as covectors (k, 3): n_axis times that gradient."""
    swept = volume_gradient(mesh)[free]
    normal = unit_vectors(swept)
    return [swept * normal[:, axis : axis + 1] for axis in range(3)]


@dataclass(frozen=True)
class Constraints:
    """Targets of the area and of the enclosed volume; None where it is free.

    Parameters
    ----------
    area, volume : (c,) ndarray or None
        Of the surface (c = 1), or of each component that keeps its own.
    caps : (k, 3) ndarray of int, optional
        Faces that close a surface with boundary, for its volume.
    in_place : bool
        Motions along the normals contain no translation. Less the translation such a motion slides vertices
        within the surface: the area hardly depends on it, and would take long to rest.
    component : (n,) ndarray of int, optional
        Index of each vertex's component among the c that each keep their own, with all vertices that move;
        -1 elsewhere.
    """

    area: NDArray[np.float64] | None = None
    volume: NDArray[np.float64] | None = None
    caps: NDArray[np.int64] | None = None
    in_place: bool = False
    component: NDArray[np.int64] | None = None

    @property
    def active(self) -> bool:
        return self.area is not None or self.volume is not None

    @property
    def count(self) -> int:
        """Number of surfaces that each keep their own area and volume."""
        return 1 if self.component is None else int(self.component.max()) + 1

    def label(self, free: NDArray) -> NDArray[np.int64]:
        """Index of the component of each free vertex among those that keep their own (k,)."""
        return np.zeros(len(free), np.int64) if self.component is None else self.component[free]

    def residuals(self, mesh: TriangleMesh) -> dict[str, NDArray[np.float64]]:
        """Relative deviation (c,) of each constrained quantity."""
        residuals = {}
        if self.area is not None:
            residuals["area"] = areas(mesh, self.component) / self.area - 1.0
        if self.volume is not None:
            residuals["volume"] = volumes_inside(mesh, self.caps, self.component) / self.volume - 1.0
        return residuals

    def gradients(self, mesh: TriangleMesh, free: NDArray) -> list[NDArray]:
        """Gradients (k, 3) of the relative residuals: one array of each quantity, of all components."""
        rows, label = [], self.label(free)[:, None]
        if self.area is not None:
            rows.append(AreaEnergy(mesh.topology).value_and_gradient(mesh.points)[1][free] / self.area[label])
        if self.volume is not None:
            rows.append(volume_gradient(mesh)[free] / self.volume[label])
        return rows

    def admissible_gradient(self, mesh: TriangleMesh, free: NDArray, mass: NDArray, g: NDArray) -> NDArray:
        """The gradient without its part along the constraints' gradients (in the mass inner product)."""
        return self._project(mesh, free, lambda c: c / mass[:, None], g, dual=True)

    def multipliers(
        self, mesh: TriangleMesh, free: NDArray, mass: NDArray, g: NDArray, normal: NDArray
    ) -> NDArray[np.float64]:
        """Multipliers (r, c) of the constraints' gradients nearest to g, seen along unit normals (k, 3)."""
        rows = self.gradients(mesh, free)
        if not rows:
            return np.zeros((0, self.count))
        columns = np.stack([row_dot(c, normal) for c in rows], axis=1)
        weight = np.sqrt(1.0 / mass)
        right, label = weight * row_dot(g, normal), self.label(free)
        share = np.empty((len(rows), self.count))
        start, member = group_by_key(label, np.arange(len(label)), self.count)
        for k in range(self.count):
            own = member[start[k] : start[k + 1]]
            share[:, k] = np.linalg.lstsq(
                weight[own, None] * columns[own], right[own], rcond=PARALLEL_GRADIENT_TOLERANCE
            )[0]
        return share

    def tangent_motion(
        self, mesh: TriangleMesh, free: NDArray, solve: PreconditionerSolve, motion: NDArray
    ) -> NDArray:
        """The motion made tangent to the constraints, in the preconditioner's metric."""
        return self._project(mesh, free, solve, motion, dual=False)

    def _project(
        self, mesh: TriangleMesh, free: NDArray, solve: PreconditionerSolve, v: NDArray, dual: bool
    ) -> NDArray:
        if not (self.active or self.in_place):
            return v
        rows = self.gradients(mesh, free) + (_translations(mesh, free) if self.in_place else [])
        span = ConstraintSpan.of(rows, solve, self.label(free), self.count)
        return v - (span.combined(span.dual_shares(v), rows) if dual else span.combined(span.shares(v)))

    def restore(self, mesh: TriangleMesh, free: NDArray, solve: PreconditionerSolve) -> TriangleMesh:
        """The surface moved back on the constraints by Newton steps along their gradients.

        Raises
        ------
        SolveError
            When they are not met within ten steps.
        """
        if not self.active:
            return mesh
        label = self.label(free)
        for _ in range(10):
            residual = np.array(list(self.residuals(mesh).values()))
            if np.abs(residual).max() <= CONSTRAINT_TOLERANCE:
                return mesh
            span = ConstraintSpan.of(self.gradients(mesh, free), solve, label, self.count)
            points = np.array(mesh.points)
            points[free] -= span.combined(span.solved(residual))
            mesh = mesh.moved_unchecked(points)
        residual = np.array(list(self.residuals(mesh).values()))
        if np.abs(residual).max() <= 1e-10:
            return mesh
        raise SolveError(
            f"area and volume could not be kept (relative residual {np.abs(residual).max():.2g})"
        )


@dataclass(frozen=True, eq=False)
class ConstraintSpan:
    """Motions along the gradients of constraints, in a metric that does not couple components.

    Parameters
    ----------
    rows, lifted : list of (k, 3) ndarray
        Covectors of r quantities, and the metric's solutions for them.
    label : (k,) ndarray of int
        Component of each vertex.
    gram : (c, r, r) ndarray
        Products of rows and lifted rows of each component.
    """

    rows: list[NDArray]
    lifted: list[NDArray]
    label: NDArray[np.int64]
    gram: NDArray[np.float64]

    @classmethod
    def of(
        cls, rows: list[NDArray], solve: PreconditionerSolve, label: NDArray, count: int
    ) -> ConstraintSpan:
        """One solve of a quantity, however many components there are: none reaches into another."""
        lifted = [solve(c) for c in rows]
        gram = [[_sums(c, s, label, count) for s in lifted] for c in rows]
        return cls(rows, lifted, label, np.moveaxis(np.array(gram), 2, 0))

    def solved(self, right: NDArray) -> NDArray[np.float64]:
        """Shares (r, c) of the lifted rows whose products with the rows are `right` (r, c)."""
        inverse = np.linalg.pinv(self.gram, rcond=PARALLEL_GRADIENT_TOLERANCE)
        return (inverse @ right.T[:, :, None])[:, :, 0].T

    def shares(self, motion: NDArray) -> NDArray[np.float64]:
        """Shares (r, c) of the lifted rows in a motion (k, 3)."""
        return self.solved(np.array([_sums(motion, c, self.label, len(self.gram)) for c in self.rows]))

    def dual_shares(self, covector: NDArray) -> NDArray[np.float64]:
        """Shares (r, c) of the rows in a covector (k, 3)."""
        return self.solved(np.array([_sums(covector, s, self.label, len(self.gram)) for s in self.lifted]))

    def combined(self, shares: NDArray, fields: list[NDArray] | None = None) -> NDArray[np.float64]:
        """Sum (k, 3) of the lifted rows, or of other fields, by shares (r, c)."""
        return combined(shares, self.lifted if fields is None else fields, self.label)


def combined(shares: NDArray, fields: list[NDArray], label: NDArray) -> NDArray[np.float64]:
    """Sum of fields by shares of each component.

    Parameters
    ----------
    shares : (r, c) ndarray
    fields : list of (k, 3) ndarray
    label : (k,) ndarray of int

    Returns
    -------
    (k, 3) ndarray
    """
    terms = (share[label][:, None] * field for share, field in zip(shares, fields, strict=True))
    return sum(terms, np.zeros((len(label), 3)))


def _sums(a: NDArray, b: NDArray, label: NDArray, count: int) -> NDArray[np.float64]:
    """Sums (c,) of a * b over the vertices of each component."""
    if count == 1:
        return np.array([np.sum(a * b)])
    return sum_by_index(label, row_dot(a, b), count)
