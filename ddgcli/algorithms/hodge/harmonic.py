"""Harmonic 1-forms of surfaces and solids, and the projection of fields onto closed forms.

A closed Whitney 1-form is constant in each cell. So one projection serves forms on edges and vectors on
cells: both enter as the load g, the integral of the field against the Whitney form of every edge.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.sparse import block_array, csr_array

from ddgcli.algorithms.hodge.homology import Boundary, betti_numbers, closed_cochains
from ddgcli.algorithms.hodge.solid_homology import solid_cochains
from ddgcli.choices import FIELD_BOUNDARIES
from ddgcli.errors import ParameterError
from ddgcli.linalg.constrain import Dirichlet, floating_components
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.operators.dec import Complex, SimplicialMesh, complex_of
from ddgcli.operators.stars import hodge_star

ZERO_BOUNDARY_VALUES = np.zeros(())


class ClosedProjection:
    """Orthogonal projections onto exact and closed 1-forms, with their factorisations.

    Parameters
    ----------
    mesh : TriangleMesh, IntrinsicMesh or TetMesh
        Manifold and oriented.
    boundary : {'tangential', 'normal'}
        `tangential`: potentials are free, so that harmonic fields run along the boundary. `normal`:
        potentials vanish on the boundary, so that harmonic fields are normal to it.

    Attributes
    ----------
    complex : Complex
    star1 : (e, e) csr_array
        Galerkin star, the inner product of 1-forms.
    cochains : (e, b) csr_array
        Closed 1-forms, one for each class of the cohomology.
    """

    def __init__(self, mesh: SimplicialMesh, boundary: Boundary = "tangential") -> None:
        if boundary not in FIELD_BOUNDARIES:
            raise ParameterError(
                f"{boundary!r} is not one of {', '.join(FIELD_BOUNDARIES)}", parameter="boundary"
            )
        self.complex = complex_of(mesh)
        self.star1 = hodge_star(self.complex, 1)
        self.cochains = self._cochains(mesh, boundary)
        self.derivative = self.complex.derivatives[0].astype(np.float64)
        self.stiffness = (self.derivative.T @ self.star1 @ self.derivative).tocsr()
        fixed, self._floating = self._fixed_vertices(boundary)
        self.exact_solver = Dirichlet(self.stiffness, fixed)
        if self.cochains.shape[1] == 0:
            self.closed_solver = self.exact_solver
            return
        coupling = self.derivative.T @ self.star1 @ self.cochains
        block = self.cochains.T @ self.star1 @ self.cochains
        system = block_array([[self.stiffness, coupling], [coupling.T, block]]).tocsr()
        self.closed_solver = Dirichlet(system, fixed)

    def _cochains(self, mesh: SimplicialMesh, boundary: Boundary) -> csr_array:
        if isinstance(mesh, TetMesh):
            betti = betti_numbers(mesh)
            count = (betti.absolute if boundary == "tangential" else betti.relative)[1]
            return solid_cochains(self.complex, count, boundary)
        return closed_cochains(mesh, boundary)

    def _fixed_vertices(self, boundary: Boundary) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Vertices where solves fix the potential, and the component of those whose mean is free.

        The boundary is fixed for `normal`, and one vertex of each component that has none; components with a
        fixed boundary have the number -1.
        """
        fixed = np.zeros(self.complex.counts[0], dtype=bool)
        if boundary == "normal":
            fixed |= self.complex.boundary_vertex
        label = floating_components(self.stiffness)
        covered = np.zeros(int(label.max(initial=-1)) + 1, dtype=bool)
        covered[label[fixed & (label >= 0)]] = True
        floating = np.full(len(label), -1, dtype=np.int64)
        if not covered.all():
            free = np.flatnonzero((label >= 0) & ~covered[np.maximum(label, 0)])
            fixed[free[np.unique(label[free], return_index=True)[1]]] = True
            floating[free] = label[free]
        return np.flatnonzero(fixed), floating

    def potential(self, load: NDArray) -> NDArray[np.float64]:
        """(n,) potential of the exact part of the field with this load.

        It is zero on a fixed boundary; elsewhere its mean over the vertices of each component is zero.
        """
        potential = self.exact_solver.solve(ZERO_BOUNDARY_VALUES, self.derivative.T @ load)
        free = self._floating >= 0
        if free.any():
            component = self._floating[free]
            total = np.bincount(component, potential[free])
            potential[free] -= (total / np.maximum(np.bincount(component), 1))[component]
        return potential

    def closed_part(self, load: NDArray) -> NDArray[np.float64]:
        """(e,) closed 1-form nearest to the field with this load."""
        if self.cochains.shape[1] == 0:
            return self.derivative @ self.potential(load)
        rhs = np.concatenate([self.derivative.T @ load, self.cochains.T @ load])
        x = self.closed_solver.solve(ZERO_BOUNDARY_VALUES, rhs)
        n = self.complex.counts[0]
        return self.derivative @ x[:n] + self.cochains @ x[n:]

    def harmonic_part(self, load: NDArray) -> NDArray[np.float64]:
        """(e,) harmonic 1-form nearest to the field with this load."""
        if self.cochains.shape[1] == 0:
            return np.zeros(self.complex.counts[1])
        return self.closed_part(load) - self.derivative @ self.potential(load)


@dataclass(frozen=True, eq=False)
class HarmonicBasis:
    """Harmonic 1-forms, orthonormal in the Galerkin inner product.

    Attributes
    ----------
    forms : (b, e) ndarray
        Values on the edges of the complex (`topology.edges` of a surface).
    residual : float
        Largest weak divergence or curl, relative to the forms.
    """

    forms: NDArray[np.float64]
    residual: float


def harmonic_basis(mesh: SimplicialMesh, boundary: Boundary = "tangential") -> HarmonicBasis:
    """Orthonormal basis of the harmonic 1-forms; its size is the first Betti number (relative for `normal`).

    Whitney forms, Galerkin star: closed exactly, divergence-free against every vertex function.

    Parameters
    ----------
    mesh : TriangleMesh, IntrinsicMesh or TetMesh
    boundary : {'tangential', 'normal'}

    Returns
    -------
    HarmonicBasis
    """
    projection = ClosedProjection(mesh, boundary)
    cochains = projection.cochains.toarray()
    exact = np.zeros_like(cochains)
    if cochains.shape[1]:
        load = projection.derivative.T @ (projection.star1 @ cochains)
        exact = projection.derivative @ projection.exact_solver.solve(np.zeros((1, cochains.shape[1])), load)
    forms = _orthonormal(cochains - exact, projection.star1)
    return HarmonicBasis(forms.T, harmonic_residual(projection.complex, projection.star1, forms, boundary))


def _orthonormal(columns: NDArray, inner: csr_array) -> NDArray[np.float64]:
    """Orthonormalise columns by Cholesky factors, twice for full precision."""
    for _ in range(2 if columns.shape[1] else 0):
        gram = columns.T @ (inner @ columns)
        columns = solve_triangular(np.linalg.cholesky(gram), columns.T, lower=True).T
    return columns


def harmonic_residual(complex_: Complex, star1: csr_array, forms: NDArray, boundary: Boundary) -> float:
    """Largest curl around a face, or divergence at a free vertex, relative to the largest terms.

    Parameters
    ----------
    complex_ : Complex
    star1 : (e, e) csr_array
        Hodge star of 1-forms.
    forms : (e, b) ndarray of float64
    boundary : {'tangential', 'normal'}
        With 'normal' boundary vertices are not free.

    Returns
    -------
    float
    """
    if forms.size == 0 or not np.abs(forms).max():
        return 0.0
    curl = np.abs(complex_.derivatives[1] @ forms).max() / np.abs(forms).max()
    flux = star1 @ forms
    divergence = np.abs(complex_.derivatives[0].T @ flux)
    if boundary == "normal":
        divergence = divergence[~complex_.boundary_vertex]
    return float(max(curl, divergence.max(initial=0.0) / np.abs(flux).max()))
