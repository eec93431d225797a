"""Harmonic 1-forms of surfaces and solids, and the projection of fields onto closed forms.

A closed Whitney 1-form is constant in each cell. So one projection serves forms on edges and vectors on
cells: both enter as the load g, the integral of the field against the Whitney form of every edge.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.sparse import block_array, csr_array

from ddgcli.algorithms.hodge.homology import Boundary, betti_numbers, closed_cochains
from ddgcli.algorithms.hodge.solid_homology import solid_cochains
from ddgcli.choices import FIELD_BOUNDARIES
from ddgcli.errors import ParameterError
from ddgcli.linalg.constrain import Dirichlet, floating_components
from ddgcli.mesh.ragged import list_starts
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.solid_components import solid_components
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.operators.dec import SimplicialMesh, complex_of
from ddgcli.operators.stars import hodge_star
from ddgcli.operators.whitney import barycentric_gradients
from ddgcli.representation import short_repr

MAX_REFINEMENTS = 20  # of a potential on thin tetrahedra; those of good shape take one
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
        self.boundary = boundary
        self.complex = complex_of(mesh)
        self.star1 = hodge_star(self.complex, 1)
        self.cochains = self._cochains(mesh, boundary)
        self.derivative = self.complex.derivatives[0].astype(np.float64)
        self.stiffness = (self.derivative.T @ self.star1 @ self.derivative).tocsr()
        self._fixed, self._floating = self._fixed_vertices(boundary)
        self.exact_solver = Dirichlet(self.stiffness, self._fixed)

    @cached_property
    def _closed_solver(self) -> Dirichlet:
        coupling = self.derivative.T @ self.star1 @ self.cochains
        block = self.cochains.T @ self.star1 @ self.cochains
        system = block_array([[self.stiffness, coupling], [coupling.T, block]]).tocsr()
        return Dirichlet(system, self._fixed)

    def _cochains(self, mesh: SimplicialMesh, boundary: Boundary) -> csr_array:
        if isinstance(mesh, TetMesh):
            return solid_cochains(self.complex, betti_numbers(mesh).of_boundary(boundary)[1], boundary)
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
        potential = self._solve(self.derivative.T @ load)
        free = self._floating >= 0
        if free.any():
            component = self._floating[free]
            total = np.bincount(component, potential[free])
            potential[free] -= (total / np.maximum(np.bincount(component), 1))[component]
        return potential

    def _solve(self, load: NDArray) -> NDArray[np.float64]:
        return self.exact_solver.solve(ZERO_BOUNDARY_VALUES, load)

    def closed_part(self, load: NDArray) -> NDArray[np.float64]:
        """(e,) closed 1-form nearest to the field with this load."""
        if self.cochains.shape[1] == 0:
            return self.derivative @ self.potential(load)
        rhs = np.concatenate([self.derivative.T @ load, self.cochains.T @ load])
        x = self._closed_solver.solve(ZERO_BOUNDARY_VALUES, rhs)
        n = self.complex.counts[0]
        return self.derivative @ x[:n] + self.cochains @ x[n:]

    def harmonic_part(self, load: NDArray) -> NDArray[np.float64]:
        """(e,) harmonic 1-form nearest to the field with this load."""
        if self.cochains.shape[1] == 0:
            return np.zeros(self.complex.counts[1])
        return self.closed_part(load) - self.derivative @ self.potential(load)

    def harmonic_forms(self, count: int | None = None) -> NDArray[np.float64]:
        """(e, b) orthonormal harmonic 1-forms, of all classes or of the first `count`."""
        cochains = self.cochains[:, :count].toarray()
        exact = np.zeros_like(cochains)
        if cochains.shape[1]:
            load = self.derivative.T @ (self.star1 @ cochains)
            exact = self.derivative @ self.exact_solver.solve(np.zeros((1, cochains.shape[1])), load)
        return _orthonormal(cochains - exact, lambda forms: forms.T @ (self.star1 @ forms))

    def residual(self, forms: NDArray) -> float:
        """Largest curl around a face, or divergence at a free vertex, relative to the largest terms."""
        if forms.size == 0 or not np.abs(forms).max():
            return 0.0
        return max(self._curl(forms), self._divergence(forms))

    def _curl(self, forms: NDArray) -> float:
        return float(np.abs(self.complex.derivatives[1] @ forms).max() / np.abs(forms).max())

    def _divergence(self, forms: NDArray) -> float:
        flux = self.star1 @ forms
        divergence = np.abs(self.derivative.T @ flux)
        if self.boundary == "normal":
            divergence = divergence[~self.complex.boundary_vertex]
        return float(divergence.max(initial=0.0) / np.abs(flux).max())


class SolidProjection(ClosedProjection):
    """Projections of vectors in tetrahedra, with residuals from the gradients in cells.

    In cells of thickness t the entries of `star1` are 1/t^2 times the rest of a sum of them. Gradients of
    differences of potentials lose 1/t only, and solves with the stiffness that are refined by their residuals
    keep as many digits.
    """

    def __init__(self, mesh: TetMesh, boundary: Boundary = "tangential") -> None:
        self._gradient = barycentric_gradients(mesh)
        super().__init__(mesh, boundary)

    def _vectors(self, form: NDArray) -> NDArray[np.float64]:
        """(k, 3) vectors in the cells of a closed 1-form."""
        spokes = slice(0, 3)  # of `TET_EDGES`, those from corner 0
        value = self.complex.cell_edge_sign[:, spokes] * form[self.complex.cell_edge[:, spokes]]
        return np.einsum("kj,kjd->kd", value, self._gradient[:, 1:])

    def _load(self, form: NDArray) -> NDArray[np.float64]:
        """(n,) integrals of a closed form against the gradients of the vertex functions, 0 where fixed."""
        measure = self.complex.metric.measure[:, None]
        terms = measure * np.einsum("kid,kd->ki", self._gradient, self._vectors(form))
        load = sum_by_index(self.complex.corners, terms, self.complex.counts[0])
        load[self._fixed] = 0.0
        return load

    def _norm(self, form: NDArray) -> float:
        """L2 norm of a closed form."""
        return float(np.sqrt((self.complex.metric.measure[:, None] * self._vectors(form) ** 2).sum()))

    def _divergence(self, forms: NDArray) -> float:
        """Norm of the exact part of a form relative to that of the form, the largest of all forms."""
        columns = forms.reshape(len(forms), -1).T
        exact = [self.derivative @ super(SolidProjection, self)._solve(self._load(form)) for form in columns]
        norms = [(self._norm(rest), self._norm(form)) for rest, form in zip(exact, columns)]
        return max(rest / whole for rest, whole in norms if whole > 0)

    def _refined(self, load: NDArray, form: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(n,) potential p and the form plus d p, whose divergence is -load, by residuals that fall."""
        potential, smallest = np.zeros(self.complex.counts[0]), np.inf
        for _ in range(MAX_REFINEMENTS):
            residual = load - self._load(form)
            residual[self._fixed] = 0.0
            size = float(np.abs(residual).max(initial=0.0))
            if not size < 0.5 * smallest:
                break
            change = super()._solve(residual)
            potential, smallest = potential + change, size
            form = form + self.derivative @ change
        return potential, form

    def _solve(self, load: NDArray) -> NDArray[np.float64]:
        return self._refined(load, np.zeros(self.complex.counts[1]))[0]

    def harmonic_part(self, load: NDArray) -> NDArray[np.float64]:
        forms = self.harmonic_forms()
        return forms @ (forms.T @ load)

    def harmonic_forms(self, count: int | None = None) -> NDArray[np.float64]:
        zero = np.zeros(self.complex.counts[0])
        columns = [self._refined(zero, form)[1] for form in self.cochains[:, :count].toarray().T]
        root = np.sqrt(self.complex.metric.measure)[:, None]

        def gram(forms: NDArray) -> NDArray[np.float64]:
            vectors = np.stack([(root * self._vectors(form)).ravel() for form in forms.T])
            return vectors @ vectors.T

        return _orthonormal(np.reshape(columns, (-1, self.complex.counts[1])).T, gram)


def closed_projection(mesh: SimplicialMesh, boundary: Boundary = "tangential") -> ClosedProjection:
    """Projections onto exact and closed 1-forms of a surface or a solid.

    Parameters
    ----------
    mesh : TriangleMesh, IntrinsicMesh or TetMesh
    boundary : {'tangential', 'normal'}

    Returns
    -------
    ClosedProjection
    """
    if isinstance(mesh, TetMesh):
        return SolidProjection(mesh, boundary)
    return ClosedProjection(mesh, boundary)


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

    __repr__ = short_repr


def harmonic_basis(
    mesh: SimplicialMesh, boundary: Boundary = "tangential", *, count: int | None = None
) -> HarmonicBasis:
    """Orthonormal basis of the harmonic 1-forms; its size is the first Betti number (relative for `normal`).

    Whitney forms, Galerkin star: closed exactly, divergence-free against every vertex function.

    Parameters
    ----------
    mesh : TriangleMesh, IntrinsicMesh or TetMesh
    boundary : {'tangential', 'normal'}
    count : int, optional
        Of the forms, where fewer than the Betti number are needed.

    Returns
    -------
    HarmonicBasis
    """
    if isinstance(mesh, TetMesh):
        return _solid_basis(mesh, boundary, count)
    return _basis(mesh, boundary, count)


def _basis(mesh: SimplicialMesh, boundary: Boundary, count: int | None) -> HarmonicBasis:
    """Basis of a surface, or of one component of a solid."""
    if boundary in FIELD_BOUNDARIES and not betti_numbers(mesh).of_boundary(boundary)[1]:
        return HarmonicBasis(np.zeros((0, complex_of(mesh).counts[1])), 0.0)
    projection = closed_projection(mesh, boundary)
    forms = projection.harmonic_forms(count)
    return HarmonicBasis(forms.T, projection.residual(forms))


def _solid_basis(mesh: TetMesh, boundary: Boundary, count: int | None) -> HarmonicBasis:
    """Bases of the components, one after the other: an iteration over all would stop by the largest body."""
    components = solid_components(mesh)
    bases = [_basis(component.mesh, boundary, count) for component in components]
    start = list_starts([len(basis.forms) for basis in bases])
    forms = np.zeros((start[-1], len(mesh.edges)))
    for component, basis, first in zip(components, bases, start):
        forms[first : first + len(basis.forms), component.edges] = basis.forms
    return HarmonicBasis(forms[:count], max((basis.residual for basis in bases), default=0.0))


def _orthonormal(columns: NDArray, gram: Callable[[NDArray], NDArray]) -> NDArray[np.float64]:
    """Orthonormalise columns by Cholesky factors of their inner products, twice for full precision."""
    for _ in range(2 if columns.shape[1] else 0):
        columns = solve_triangular(np.linalg.cholesky(gram(columns)), columns.T, lower=True).T
    return columns
