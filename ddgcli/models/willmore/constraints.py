"""Area and volume held fixed along a flow: tangent steps, then a return to the constraint."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import SolveError
from ddgcli.geometry.intrinsic import face_area
from ddgcli.mesh.boundary import boundary_vertex_loops
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import row_dot, unit_vectors
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
        Of `cap_faces`.

    Returns
    -------
    float
        In length^3, positive for outward orientation.
    """
    faces = mesh.faces if caps is None else np.concatenate([mesh.faces, caps])
    return signed_volume(mesh.points, faces)


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
    area, volume : float or None
    caps : (k, 3) ndarray of int, optional
        Faces that close a surface with boundary, for its volume.
    in_place : bool
        Motions along the normals contain no translation. Less the translation such a motion slides vertices
        within the surface: the area hardly depends on it, and would take long to rest.
    """

    area: float | None = None
    volume: float | None = None
    caps: NDArray[np.int64] | None = None
    in_place: bool = False

    @property
    def active(self) -> bool:
        return self.area is not None or self.volume is not None

    def residuals(self, mesh: TriangleMesh) -> dict[str, float]:
        """Relative deviation of each constrained quantity."""
        residuals = {}
        if self.area is not None:
            residuals["area"] = area(mesh) / self.area - 1.0
        if self.volume is not None:
            residuals["volume"] = volume_inside(mesh, self.caps) / self.volume - 1.0
        return residuals

    def gradients(self, mesh: TriangleMesh, free: NDArray) -> list[NDArray]:
        """Gradients (k, 3) of the relative residuals."""
        rows = []
        if self.area is not None:
            rows.append(AreaEnergy(mesh.topology).value_and_gradient(mesh.points)[1][free] / self.area)
        if self.volume is not None:
            rows.append(volume_gradient(mesh)[free] / self.volume)
        return rows

    def admissible_gradient(self, mesh: TriangleMesh, free: NDArray, mass: NDArray, g: NDArray) -> NDArray:
        """The gradient without its part along the constraints' gradients (in the mass inner product)."""
        return self._project(mesh, free, lambda c: c / mass[:, None], g, dual=True)

    def multipliers(
        self, mesh: TriangleMesh, free: NDArray, mass: NDArray, g: NDArray, normal: NDArray
    ) -> NDArray[np.float64]:
        """Multipliers of the constraints' gradients nearest to g (k, 3), seen along unit normals (k, 3)."""
        rows = self.gradients(mesh, free)
        if not rows:
            return np.zeros(0)
        columns = np.stack([row_dot(c, normal) for c in rows], axis=1)
        weight = np.sqrt(1.0 / mass)
        right = weight * row_dot(g, normal)
        share = np.linalg.lstsq(weight[:, None] * columns, right, rcond=PARALLEL_GRADIENT_TOLERANCE)[0]
        return np.asarray(share, dtype=np.float64)

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
        lifted = [solve(c) for c in rows]
        gram = np.array([[np.sum(c * s) for s in lifted] for c in rows])
        right = np.array([np.sum(v * (s if dual else c)) for c, s in zip(rows, lifted)])
        share = np.linalg.lstsq(gram, right, rcond=PARALLEL_GRADIENT_TOLERANCE)[0]
        return v - sum(w * (c if dual else s) for w, c, s in zip(share, rows, lifted))

    def restore(self, mesh: TriangleMesh, free: NDArray, solve: PreconditionerSolve) -> TriangleMesh:
        """The surface moved back on the constraints by Newton steps along their gradients.

        Raises
        ------
        SolveError
            When they are not met within ten steps.
        """
        if not self.active:
            return mesh
        for _ in range(10):
            residual = np.array(list(self.residuals(mesh).values()))
            if np.abs(residual).max() <= CONSTRAINT_TOLERANCE:
                return mesh
            rows = self.gradients(mesh, free)
            lifted = [solve(c) for c in rows]
            gram = np.array([[np.sum(c * s) for s in lifted] for c in rows])
            share = np.linalg.lstsq(gram, residual, rcond=PARALLEL_GRADIENT_TOLERANCE)[0]
            points = np.array(mesh.points)
            points[free] -= sum(w * s for w, s in zip(share, lifted))
            mesh = mesh.moved(points)
        residual = np.array(list(self.residuals(mesh).values()))
        if np.abs(residual).max() <= 1e-10:
            return mesh
        raise SolveError(
            f"area and volume could not be kept (relative residual {np.abs(residual).max():.2g})"
        )
