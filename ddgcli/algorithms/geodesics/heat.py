"""Heat method: distance from two linear systems, factorised once for any number of sources."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array, diags_array

from ddgcli.algorithms.geodesics.sources import Sources, check_sources, corner_distance, face_frame
from ddgcli.choices import DEFAULT_HEAT_TIME
from ddgcli.errors import MeshError, ParameterError, renamed_parameters
from ddgcli.geometry.component_sides import component_mean_side, on_vertices
from ddgcli.linalg.constrain import Dirichlet, Poisson
from ddgcli.linalg.factor import Factor
from ddgcli.linalg.scaled_rows import scaled_rows
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.ragged import unique_keys
from ddgcli.mesh.require import check_size
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import NEXT
from ddgcli.operators.laplacian import lumped_vertex_area, stiffness

log = logging.getLogger("ddgcli")

MIN_RELATIVE_HEAT = 1e-200  # below it, heat is computed again from rescaled values at the rim
MAX_STAGES = 200


@dataclass(frozen=True, eq=False)
class HeatDistance:
    """Distances by the heat method.

    Parameters
    ----------
    distance : (n,) ndarray of float64
        At the vertices of the mesh of the sources; inf on components without a source.
    steiner_distance : (s,) ndarray of float64
        At the further vertices of the triangulation of the systems.
    residuals : tuple of two callables
        Functions that compute `heat_residual` and `poisson_residual`.
    n_stages : int
        Number of continuations of the heat where it underflows float64.
    cold_faces : int
        Faces of reached components without a gradient of heat; the second system interpolates there.
    nonpositive_vertices : int
        Vertices of reached components where the heat is not positive: cotangent weights below zero cause it,
        or rounding. The gradient is wrong around them.
    """

    distance: NDArray[np.float64]
    steiner_distance: NDArray[np.float64]
    residuals: tuple[Callable[[], float], Callable[[], float]]
    n_stages: int
    cold_faces: int
    nonpositive_vertices: int

    @property
    def extended(self) -> NDArray[np.float64]:
        """(n + s,) distances of all vertices of the triangulation of the systems."""
        return np.concatenate([self.distance, self.steiner_distance])

    @cached_property
    def heat_residual(self) -> float:
        """Largest |A x - b| of the first system, relative to the largest |b|; computed on first access."""
        return self.residuals[0]()

    @cached_property
    def poisson_residual(self) -> float:
        """The same for the last solve of the second system."""
        return self.residuals[1]()


def diffusion_time(mesh: SurfaceMesh, factor: float) -> NDArray[np.float64]:
    """A multiple of the squared mean side length of each component, in units of squared length.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    factor : float

    Returns
    -------
    (n_components,) ndarray of float64

    Raises
    ------
    MeshError
        All sides are zero, or the square of their mean under- or overflows.
    ParameterError
        The factor is not positive, or its product with the square of a component under- or overflows.
    """
    h = float(mesh.side_length.mean()) if mesh.n_faces else 1.0
    check_size(h, in_range=False)
    if not 0 < h * h < np.inf:
        raise MeshError(f"the mean side length, {h:.3g}, over- or underflows if squared; rescale the mesh")
    side = component_mean_side(mesh)
    with np.errstate(over="ignore", invalid="ignore"):
        time: NDArray[np.float64] = factor * side * side
    bad = np.flatnonzero(~((time > 0) & (time < np.inf)))
    if len(bad):
        raise ParameterError(
            f"{factor:g} squared mean side lengths ({side[bad[0]]:g}) are not a positive finite time; "
            "change it",
            parameter="factor",
        )
    return time


class HeatSolver:
    """Both systems of the heat method, factorised for many sources.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
        Triangulation of the systems: intrinsic Delaunay for the maximum principle, a tufted cover for
        non-manifold surfaces.
    time : float, optional
        t of (M + t L) u = source, in length units squared. Default: `time_factor` h^2, h the mean side of
        each component, so that the distance on it does not depend on others.
    time_factor : float
    refine : int
        Number of times that the gradient of the result is normalised and integrated again. 0 is the published
        method, whose error does not vanish: t = h^2 is a fixed fraction of the decay length, so the direction
        of the heat's gradient keeps an error of about 1 %. Each round costs one solve and removes most of it.
    source_mesh : TriangleMesh or IntrinsicMesh, optional
        Mesh on whose faces source points lie; same metric, and its vertices are the first of `mesh`. Default:
        `mesh`.

    References
    ----------
    K. Crane, C. Weischedel, M. Wardetzky, "Geodesics in heat", 2013.
    """

    def __init__(
        self,
        mesh: SurfaceMesh,
        *,
        time: float | None = None,
        time_factor: float = DEFAULT_HEAT_TIME,
        refine: int = 0,
        source_mesh: SurfaceMesh | None = None,
    ) -> None:
        self.mesh, self.refine, self.source_mesh = mesh, refine, source_mesh or mesh
        if time is not None and not 0 < time < np.inf:
            raise ParameterError(f"must be positive and finite, not {time}", parameter="time")
        n = mesh.topology.n_components
        with renamed_parameters(factor="time_factor"):
            self.time = diffusion_time(mesh, time_factor) if time is None else np.full(n, time)
        self.stiffness = stiffness(mesh)
        self._area = lumped_vertex_area(mesh)
        flow = scaled_rows(self.stiffness, on_vertices(mesh, self.time))
        self._system = _with_diagonal(flow, _positive(mesh, self._area))
        self._heat = Factor(self._system)
        self._poisson: Poisson | None = None
        self._dirichlet: Dirichlet | None = None
        self._boundary = mesh.topology.boundary_vertex.copy()
        # a tufted cover has none of its own
        self._boundary[: self.source_mesh.n_vertices] |= self.source_mesh.topology.boundary_vertex
        flat_corners = face_frame(mesh.side_length)  # corners (0, 0), (base, 0), (x, y)
        _, right, apex = flat_corners.transpose(1, 2, 0)
        self._base, self._x, self._y = right[0].copy(), apex[0].copy(), apex[1].copy()
        self._corner = np.ascontiguousarray(mesh.faces.T)

    @property
    def poisson(self) -> Poisson:
        """Second system, factorised on first access."""
        if self._poisson is None:
            self._poisson = Poisson(self.stiffness, self._area, like=self._heat)
        return self._poisson

    @cached_property
    def absorbing(self) -> Dirichlet:
        """First system with heat zero on the boundary, factorised on first access."""
        return Dirichlet(self._system, self._boundary, like=self._heat)

    @property
    def solver(self) -> str:
        """Name of the linear solver."""
        return self._heat.solver

    def distance(self, sources: Sources | NDArray | list[int] | int) -> HeatDistance:
        """Distance to the nearest of the sources.

        One source reuses both factorisations; the additive constant fits the distances of its one-ring.
        Several sources are fixed at zero, and their one-rings at the edge lengths, in a system of their own.
        """
        sources = check_sources(self.source_mesh, sources)
        start = self._start(sources)
        reached = self._reached(start)
        heat, level, n_stages, heat_residual = self._diffuse(start, reached)
        direction, cold = self._direction(heat, level if n_stages else None)
        direction *= -1.0
        near, spoke = self._near(sources)
        distance, poisson_residual = self._integrate(direction, near, spoke, len(sources))
        for _ in range(self.refine):
            direction, _ = self._direction(distance, None)
            distance, poisson_residual = self._integrate(direction, near, spoke, len(sources))
        distance = np.maximum(distance, 0.0)
        distance[near[spoke == 0]] = 0.0
        cold_faces = int((cold & reached[self._corner[0]]).sum()) if cold.any() else 0
        distance[~reached] = np.inf
        n, residuals = self.source_mesh.n_vertices, (heat_residual, poisson_residual)
        nonpositive = int(np.count_nonzero(reached & ~(heat > 0)))
        return HeatDistance(distance[:n], distance[n:], residuals, n_stages, cold_faces, nonpositive)

    def time_at(self, sources: Sources) -> float:
        """Diffusion time, in length units squared, on the component of the first source."""
        vertex = np.append(sources.vertex, self.source_mesh.faces[sources.points.face, 0])[0]
        return float(self.time[self.mesh.topology.vertex_component[vertex]])

    def _reached(self, start: NDArray) -> NDArray[np.bool_]:
        """(n,) True on the components where heat starts."""
        topology = self.mesh.topology
        component = topology.vertex_component
        has_heat = np.zeros(topology.n_components + 1, dtype=bool)
        has_heat[component[start > 0]] = True
        has_heat[-1] = False  # vertices without a face
        return has_heat.take(component)

    # -- first system -------------------------------------------------------------------------------

    def _start(self, sources: Sources) -> NDArray[np.float64]:
        """Unit heat at each source, shared among the corners of its face for a point."""
        start = np.zeros(self.mesh.n_vertices)
        np.add.at(start, sources.vertex, 1.0)
        np.add.at(start, self.source_mesh.faces[sources.points.face], sources.points.barycentric)
        return start

    def _diffuse(self, start: NDArray, inside: NDArray) -> tuple[NDArray, NDArray, int, Callable[[], float]]:
        """Heat as value * exp(level): the sum of those of an insulated and of an absorbing boundary.

        A straight boundary reflects with opposite signs in the two (Crane et al. 2013, section 3.4).
        A source on the boundary has no absorbed heat.
        """
        heat = self._heat.solve(start, refine=False)
        peak = heat.max(initial=0.0) or 1.0
        value, level, n_stages = self._continued(heat / peak, inside, partial(self._heat.solve, refine=False))
        residual = partial(self._heat.residual, heat, start)
        free = ~self._boundary
        if not start[free].any() or free.all():
            return value, level, n_stages, residual
        absorbed = self.absorbing.solve_held_at_zero(start, refine=False)
        solve = partial(self.absorbing.solve_held_at_zero, refine=False)
        other, other_level, more_stages = self._continued(absorbed / peak, inside & free, solve)
        value += other * np.exp(np.minimum(other_level - level, -np.log(MIN_RELATIVE_HEAT)))
        absorbed_residual = partial(self.absorbing.residual, absorbed, start)
        return value, level, n_stages + more_stages, lambda: max(residual(), absorbed_residual())

    def _continued(
        self, value: NDArray, inside: NDArray, solve: Callable[[NDArray], NDArray]
    ) -> tuple[NDArray, NDArray, int]:
        """Heat as value * exp(level), continued from rescaled values at the rim where it underflows."""
        level = np.zeros(len(value))
        cold = inside & ~(np.abs(value) > MIN_RELATIVE_HEAT)
        n_stages = 0
        while cold.any() and n_stages < MAX_STAGES:
            load, reference = self._load_at_rim(value, level, cold)
            largest = np.abs(load).max(initial=0.0)
            if not largest > 0:
                break
            heat = solve(load / largest)[cold]
            peak = np.abs(heat).max(initial=0.0)
            if not peak > 0:
                break
            value[cold] = heat / peak
            level[cold] = reference + np.log(largest) + np.log(peak)
            cold &= ~(np.abs(value) > MIN_RELATIVE_HEAT)
            n_stages += 1
        value[~(value > MIN_RELATIVE_HEAT)] = 0.0
        return value, level, n_stages

    def _load_at_rim(self, value: NDArray, level: NDArray, cold: NDArray) -> tuple[NDArray, float]:
        """Right-hand side, times exp(-reference), whose solution is the heat on `cold` and zero elsewhere.

        The first factorisation thus continues the heat: A (chi u) is known from u at the rim of `cold`, since
        A u vanishes there. The error is rounding times A^-1 |load|, a small multiple of u on `cold`.
        """
        system = self._system
        column = np.repeat(np.arange(len(cold), dtype=system.indices.dtype), np.diff(system.indptr))
        # the absorbing boundary has no heat to give
        across = np.flatnonzero(cold[column] & ~cold[system.indices] & (value[system.indices] != 0))
        warm, beyond, entry = system.indices[across], column[across], system.data[across]
        reference = level[warm].max(initial=-np.inf)
        load = np.zeros(len(cold))
        np.subtract.at(load, beyond, entry * value[warm] * np.exp(level[warm] - reference))
        np.add.at(load, warm, entry * value[beyond] * np.exp(level[beyond] - reference))
        return load, reference

    def _direction(self, value: NDArray, level: NDArray | None) -> tuple[NDArray, NDArray]:
        """(2, m) unit gradient of value * exp(level) in each face's frame, and faces without a gradient."""
        v = value[self._corner]
        if level is not None:
            corner_level = level[self._corner]
            v *= np.exp(corner_level - corner_level.max(axis=0))
        rise = v[1:] - v[0]  # the gradients of the three hats sum to zero
        size = np.abs(rise).max(axis=0)
        rise /= np.where(size > 0, size, 1.0)
        gradient = np.empty((2, len(size)))  # times twice the area
        np.multiply(rise[0], self._y, out=gradient[0])
        np.multiply(rise[1], self._base, out=gradient[1])
        gradient[1] -= rise[0] * self._x
        length = np.sqrt(gradient[0] ** 2 + gradient[1] ** 2)
        cold = ~(length > 0)
        gradient /= np.where(cold, 1.0, length)
        return gradient, cold

    # -- second system ------------------------------------------------------------------------------

    def _near(self, sources: Sources) -> tuple[NDArray, NDArray]:
        """Vertices at or next to a source, and their straight distance to it."""
        mesh = self.mesh
        points = sources.points
        is_source = np.zeros(mesh.n_vertices, dtype=bool)
        is_source[sources.vertex] = True
        beside = np.flatnonzero(np.isin(self._corner, sources.vertex).any(axis=0))
        length = mesh.side_length[beside].ravel()
        tail, head = mesh.faces[beside].ravel(), mesh.faces[beside][:, NEXT].ravel()
        reach = corner_distance(self.source_mesh.side_length[points.face], points.barycentric)
        around = self.source_mesh.faces[points.face]
        vertex = np.concatenate(
            [sources.vertex, head[is_source[tail]], tail[is_source[head]], around.ravel()]
        )
        spoke = np.concatenate(
            [np.zeros(len(sources.vertex)), length[is_source[tail]], length[is_source[head]], reach.ravel()]
        )
        near, index = np.unique(vertex, return_inverse=True)
        least = np.full(len(near), np.inf)
        np.minimum.at(least, index, spoke)
        return near, least

    def _integrate(
        self, direction: NDArray, near: NDArray, spoke: NDArray, n_sources: int
    ) -> tuple[NDArray, Callable[[], float]]:
        """Function with gradient nearest to the field, fitted to the known values near the sources."""
        along, across = 0.5 * direction
        flux = np.empty(self._corner.shape)
        np.multiply(along, self._y, out=flux[1])
        flux[1] -= across * self._x
        np.multiply(across, self._base, out=flux[2])
        np.add(flux[1], flux[2], out=flux[0])
        np.negative(flux[0], out=flux[0])
        load = sum_by_index(self._corner, flux, self.mesh.n_vertices)
        if n_sources == 1:
            distance = self.poisson.pinned_solve(load)
            ring = spoke > 0
            shift = (distance[near[ring]] - spoke[ring]).mean() if ring.any() else distance[near].min()
            return distance - shift, partial(self.poisson.residual, distance, load)
        fixed = unique_keys(np.concatenate([near, self._unreached_anchors(near)]))
        value = np.zeros(len(fixed))
        value[np.searchsorted(fixed, near)] = spoke
        if self._dirichlet is None or not np.array_equal(self._dirichlet.fixed, fixed):
            self._dirichlet = Dirichlet(self.stiffness, fixed, like=self._heat)
        distance = self._dirichlet.solve(value, load)
        return distance, partial(self._dirichlet.residual, distance, load)

    def _unreached_anchors(self, near: NDArray) -> NDArray[np.int64]:
        """Vertices to fix against singularity: unused ones, and one of each unreached component."""
        component = self.mesh.topology.vertex_component
        first = np.unique(component, return_index=True)[1]
        other = first[~np.isin(component[first], component[near])]
        return np.concatenate([other, np.flatnonzero(component < 0)])


def _positive(mesh: SurfaceMesh, area: NDArray) -> NDArray[np.float64]:
    """Vertex areas; where they vanish the largest on the component."""
    if (area > 0).all():
        return area
    component = mesh.topology.vertex_component
    largest = np.zeros(mesh.topology.n_components + 1)  # the last one of vertices without a face
    np.maximum.at(largest, component, area)
    return np.where(area > 0, area, np.where(largest > 0, largest, 1.0)[component])


def _with_diagonal(matrix: csr_array, diagonal: NDArray) -> csc_array:
    """matrix + diagonal, for a symmetric matrix whose values it changes."""
    row = np.repeat(np.arange(len(diagonal), dtype=matrix.indices.dtype), np.diff(matrix.indptr))
    at = np.flatnonzero(matrix.indices == row)
    if len(at) < len(diagonal):  # vertices that no face uses
        return csc_array(matrix + diags_array(diagonal))
    matrix.data[at] += diagonal[row[at]]
    return csc_array((matrix.data, matrix.indices, matrix.indptr), shape=matrix.shape)
