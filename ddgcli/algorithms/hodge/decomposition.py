"""Hodge decomposition of 1-forms and vector fields on surfaces and solids (chapter 7).

Forms are Whitney forms: exact parts are derivatives of vertex potentials, coexact parts star1^-1 d' of
face copotentials, harmonic parts closed and divergence-free. Vectors constant on the faces of a surface split
into gradients of conforming vertex functions, turned gradients of Crouzeix-Raviart edge functions, and the
same harmonic fields (Polthier and Preuss 2003): both splittings are exactly orthogonal.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array, diags_array
from scipy.sparse.linalg import cg, lsmr

from ddgcli.algorithms.hodge.harmonic import ClosedProjection, closed_projection
from ddgcli.algorithms.hodge.homology import Boundary
from ddgcli.geometry.extrinsic import face_normal
from ddgcli.linalg.constrain import Dirichlet, Poisson, floating_components
from ddgcli.linalg.factor import Factor
from ddgcli.mesh.fields import checked_values
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.tet_mesh import TET_FACES, TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import row_cross, row_dot
from ddgcli.operators.averages import cells_to_vertices, vertex_measure
from ddgcli.operators.dec import Complex, complex_of
from ddgcli.operators.whitney import barycentric_gradients, sharp, whitney_load

SpaceMesh = TriangleMesh | TetMesh
LSMR_TOLERANCE = 1e-14
# of the residual of curls, relative to the field: well-shaped cells reach 1e-13 in one pass of LSMR
CURL_TOLERANCE = 1e-9
MAX_CURL_PASSES = 10


@dataclass(frozen=True, eq=False)
class HodgeDecomposition:
    """The three parts of a field, in the form of the input, with their potentials and residuals.

    Attributes
    ----------
    exact, coexact, harmonic : ndarray
        Of the shape of the field.
    potential : (n,) ndarray
        exact = d potential (or its gradient).
    copotential : ndarray or None
        On faces for 1-forms, on edges for face vectors; None for vectors in tetrahedra.
    norms : dict of str to float
        L2 norms of `field` (of its tangent part on surfaces), `exact`, `coexact`, `harmonic`.
    orthogonality : float
        Largest |<a, b>| between two parts, relative to |field|^2.
    reconstruction_residual : float
        |field - sum of parts| / |field|; every part is computed independently. On surfaces the sum is that
        of the tangent part, and the size in the denominator that of the whole field.
    harmonic_residual : float
        Largest curl or divergence left in the harmonic part, relative to the field.
    """

    exact: NDArray[np.float64]
    coexact: NDArray[np.float64]
    harmonic: NDArray[np.float64]
    potential: NDArray[np.float64]
    copotential: NDArray[np.float64] | None
    norms: dict[str, float]
    orthogonality: float
    reconstruction_residual: float
    harmonic_residual: float


def decompose_form(mesh: SpaceMesh, form: NDArray, boundary: Boundary = "tangential") -> HodgeDecomposition:
    """Split a 1-form (values on the edges of the complex) into exact, coexact and harmonic parts.

    Parameters
    ----------
    mesh : TriangleMesh or TetMesh
        Manifold; orientable components of a surface oriented.
    form : (e,) ndarray
        Integrals along the edges.
    boundary : {'tangential', 'normal'}
        Boundary condition of the harmonic part.

    Returns
    -------
    HodgeDecomposition

    Raises
    ------
    ParameterError
        For a form of another length or with values that are not finite.
    """
    projection = ClosedProjection(mesh, boundary)  # with the inner product of forms that are not closed
    form = checked_values(form, projection.complex.counts[1], "edge", parameter="form")
    star1 = projection.star1
    load = star1 @ form
    potential = projection.potential(load)
    exact = projection.derivative @ potential
    closed = projection.closed_part(load)
    harmonic = closed - exact
    flux = star1 @ (form - closed)
    size = np.abs(star1) @ (np.abs(form) + np.abs(closed))
    copotential = _copotential(projection.complex, flux, size, boundary)
    coexact = _coexact(projection, copotential, flux, boundary)
    return _assembled(
        lambda a, b: float(a @ (star1 @ b)),
        form, (exact, coexact, harmonic), potential, copotential,
        _relative(projection.residual(harmonic), harmonic, form),
    )  # fmt: skip


def decompose_cell_vectors(
    mesh: SpaceMesh, vectors: NDArray, boundary: Boundary = "tangential"
) -> HodgeDecomposition:
    """Split a field of vectors constant on cells (faces, or tetrahedra) into its three parts.

    On surfaces the tangent part is split; residuals are relative to the field with its normal part, whose
    rounding is in the tangent part. In tetrahedra the coexact part is a curl of tangential vectors on the
    faces, which are not unique and not returned.

    Parameters
    ----------
    mesh : TriangleMesh or TetMesh
    vectors : (m, 3) ndarray of float64
    boundary : {'tangential', 'normal'}
        Boundary condition of the harmonic part.

    Returns
    -------
    HodgeDecomposition

    Raises
    ------
    ParameterError
        For a field of another length or with values that are not finite.
    """
    projection = closed_projection(mesh, boundary)
    complex_ = projection.complex
    whole = vectors = checked_values(vectors, len(complex_.corners), "cell", parameter="vectors")
    if isinstance(mesh, TriangleMesh):
        vectors, _ = tangent_part(mesh, whole)
    measure = complex_.metric.measure[:, None]
    load = whitney_load(mesh, vectors)
    potential = projection.potential(load)
    exact = sharp(mesh, projection.derivative @ potential)
    form = projection.harmonic_part(load)
    harmonic = sharp(mesh, form)
    if isinstance(mesh, TriangleMesh):
        copotential, coexact = _turned_gradient(mesh, complex_, vectors, boundary)
    else:
        # curls are orthogonal to the other parts, without which the iteration converges on thin cells too
        rest = vectors - exact - harmonic
        size = float(np.sqrt((measure * vectors**2).sum()))
        copotential, coexact = None, _tetrahedron_curl(mesh, complex_, rest, boundary, size)
    return _assembled(
        lambda a, b: float((measure * a * b).sum()),
        vectors, (exact, coexact, harmonic), potential, copotential,
        _relative(projection.residual(form), harmonic, whole), whole,
    )  # fmt: skip


def decompose_vertex_vectors(
    mesh: SpaceMesh, vectors: NDArray, boundary: Boundary = "tangential"
) -> HodgeDecomposition:
    """Split vectors on vertices: average to cells, split there, average the parts back with areas.

    The reconstruction residual measures the loss of the two averages, O(h) for a smooth field.

    Parameters
    ----------
    mesh : TriangleMesh or TetMesh
    vectors : (n, 3) ndarray of float64
    boundary : {'tangential', 'normal'}
        Boundary condition of the harmonic part.

    Returns
    -------
    HodgeDecomposition
        With parts on vertices.

    Raises
    ------
    ParameterError
        For a field of another length or with values that are not finite.
    """
    vectors = checked_values(vectors, mesh.n_vertices, "vertex", parameter="vectors")
    corners = complex_of(mesh).corners
    split = decompose_cell_vectors(mesh, vectors[corners].mean(axis=1), boundary)
    components = [to_vertices(mesh, component) for component in (split.exact, split.coexact, split.harmonic)]
    weight = vertex_measure(corners, complex_of(mesh).metric.measure, mesh.n_vertices)[:, None]
    remainder = vectors - sum(components)
    whole = np.sqrt((weight * vectors**2).sum()) or 1.0
    return replace(
        split,
        exact=components[0],
        coexact=components[1],
        harmonic=components[2],
        reconstruction_residual=float(np.sqrt((weight * remainder**2).sum()) / whole),
    )


def tangent_part(mesh: TriangleMesh, vectors: NDArray) -> tuple[NDArray[np.float64], float]:
    """Remove the normal components of vectors on faces.

    Parameters
    ----------
    mesh : TriangleMesh
    vectors : (m, 3) ndarray of float64

    Returns
    -------
    tangent : (m, 3) ndarray of float64
    largest : float
        The largest normal component, relative to the largest component of a vector.
    """
    normal = face_normal(mesh)
    along = row_dot(vectors, normal)
    largest = np.abs(vectors).max(initial=0.0) or 1.0
    return vectors - along[:, None] * normal, float(np.abs(along).max(initial=0.0) / largest)


def to_vertices(mesh: SpaceMesh, on_cells: NDArray) -> NDArray[np.float64]:
    """Mean over the cells around each vertex, weighted with their measures.

    Parameters
    ----------
    mesh : TriangleMesh or TetMesh
    on_cells : (m, d) ndarray of float64

    Returns
    -------
    (n, d) ndarray of float64
        Zero at vertices without cells.
    """
    complex_ = complex_of(mesh)
    return cells_to_vertices(complex_.corners, complex_.metric.measure, on_cells, mesh.n_vertices)


def _copotential(complex_: Complex, flux: NDArray, size: NDArray, boundary: Boundary) -> NDArray[np.float64]:
    """Face values b with d1' b = flux; for `normal` at interior edges only, boundary edges are free.

    `size`: sums of the absolute values of the terms of the fluxes.
    """
    curl = complex_.derivatives[1].astype(np.float64)
    if boundary == "normal":
        interior = np.flatnonzero(~complex_.boundary_edge)
        curl, flux, size = csr_array(curl[:, interior]), flux[interior], size[interior]
    system, load = (curl @ curl.T).tocsr(), curl @ flux
    if complex_.dimension == 2:
        return Poisson(system).solve(load, size=np.abs(curl) @ size)
    return _conjugate_gradients(system, load)


def _coexact(
    projection: ClosedProjection, copotential: NDArray, flux: NDArray, boundary: Boundary
) -> NDArray[np.float64]:
    rotated = projection.complex.derivatives[1].T @ copotential
    if boundary == "normal":
        rim = projection.complex.boundary_edge
        rotated[rim] = flux[rim]  # unknowns of the copotential on the boundary
    if projection.complex.dimension == 2:
        return Factor(projection.star1).solve(rotated)
    return _conjugate_gradients(projection.star1, rotated)


def _conjugate_gradients(system: csr_array, load: NDArray) -> NDArray[np.float64]:
    """Jacobi-preconditioned solve of a consistent system whose factor would be large (solids)."""
    diagonal = system.diagonal()
    jacobi = diags_array(1.0 / np.where(diagonal > 0, diagonal, 1.0))
    return cg(system, load, rtol=1e-13, maxiter=20_000, M=jacobi)[0]


def _turned_gradient(
    mesh: TriangleMesh, complex_: Complex, vectors: NDArray, boundary: Boundary
) -> tuple[NDArray, NDArray]:
    """Crouzeix-Raviart copotential (e,) and its turned gradient (m, 3); zero on the rim for `tangential`.

    Where two faces run the same way along an edge (one-sided surfaces) the copotential changes its sign over
    it, as the normals do: the value of an edge is that seen from its first face.
    """
    gradient = -2.0 * barycentric_gradients(mesh)[:, [2, 0, 1]]  # of 1 - 2 lambda opposite each side
    gradient *= _copotential_sign(mesh)[..., None]
    turned = row_cross(face_normal(mesh)[:, None], gradient)
    area, n = complex_.metric.measure, complex_.counts[1]
    local = area[:, None, None] * np.einsum("mid,mjd->mij", gradient, gradient)
    index = complex_.cell_edge
    rows, cols = np.repeat(index, 3, axis=1).ravel(), np.tile(index, (1, 3)).ravel()
    system = coo_array((local.ravel(), (rows, cols)), shape=(n, n)).tocsr()
    weights = area[:, None] * np.einsum("mid,md->mi", turned, vectors)
    load = sum_by_index(index, weights, n)
    if boundary == "tangential" and complex_.boundary_edge.any():
        copotential = _zero_on_rim(system, load, complex_)
    else:
        terms = area[:, None] * np.einsum("mid,md->mi", np.abs(turned), np.abs(vectors))
        copotential = Poisson(system).solve(load, size=sum_by_index(index, terms, n))
    return copotential, np.einsum("mi,mid->md", copotential[index], turned)


def _copotential_sign(mesh: TriangleMesh) -> NDArray[np.float64]:
    """(m, 3) -1 at sides whose face lies turned over against the edge's first face, else 1."""
    topology = mesh.topology
    twin, sign = topology.side_twin.ravel(), topology.side_sign.ravel()
    turned = (twin >= 0) & (sign == sign[twin]) & (np.arange(len(twin)) > twin)
    return np.where(turned, -1.0, 1.0).reshape(-1, 3)


def _tetrahedron_curl(
    mesh: TetMesh, complex_: Complex, vectors: NDArray, boundary: Boundary, size: float
) -> NDArray[np.float64]:
    """(t, 3) projection on curls of piecewise linear vector potentials with continuous mean tangents.

    A tangential vector b on each face gives the field sum_F +-|F| b_F / |T| in the tetrahedra beside it. The
    complement is the piecewise constant fields with continuous tangential parts: the closed Whitney forms.
    For `tangential`, b is zero on the boundary. `size`: norm of the field that the vectors are a part of.
    """
    n_faces = complex_.counts[2]
    tets = np.arange(len(complex_.corners))
    free = np.ones(n_faces, dtype=bool)
    if boundary == "tangential":
        free[complex_.boundary_faces] = False
    face = complex_.cell_face.ravel()
    first = np.empty(n_faces, dtype=np.int64)
    first[face[::-1]] = np.arange(len(face))[::-1]
    # not the sign of the volume: at an inverted tetrahedron both cells lie on the same side of the face
    sign = np.where(first[face] == np.arange(len(face)), 1.0, -1.0)
    a, b, c = np.moveaxis(mesh.points[mesh.tetrahedra[:, TET_FACES].reshape(-1, 3)[first]], 1, 0)
    face_basis = np.swapaxes(np.linalg.qr(np.stack([b - a, c - a], axis=2))[0], 1, 2)  # (f, 2, 3)
    is_free = free[face]
    cell, face, sign = np.repeat(tets, 4)[is_free], face[is_free], sign[is_free]
    # rows scaled with the square root of the volume, so that the inner product is the plain one
    root = np.sqrt(complex_.metric.measure)
    # (k, 2, 3); |F| is left to the column's scale
    entry = (sign / root[cell])[:, None, None] * face_basis[face]
    rows = np.broadcast_to(3 * cell[:, None, None] + np.arange(3), entry.shape)
    cols = np.broadcast_to(2 * face[:, None, None] + np.arange(2)[:, None], entry.shape)
    shape = (3 * len(tets), 2 * n_faces)
    curl = coo_array((entry.ravel(), (rows.ravel(), cols.ravel())), shape=shape).tocsr()
    scale = np.sqrt((curl**2).sum(axis=0))
    curl = (curl @ diags_array(1.0 / np.where(scale > 0, scale, 1.0))).tocsr()
    weighted = (root[:, None] * vectors).ravel()
    return _on_range(curl, weighted, size).reshape(-1, 3) / root[:, None]


def _on_range(matrix: csr_array, vector: NDArray, size: float) -> NDArray[np.float64]:
    """Projection of a vector on the range of a matrix, to rounding of `size`, by LSMR.

    In thin cells LSMR ends before it converges; further passes solve for the remainder while it halves.
    """
    projection, norm = np.zeros_like(vector), float(np.linalg.norm(vector))
    for _ in range(MAX_CURL_PASSES):
        if norm <= LSMR_TOLERANCE * size:
            break
        tolerance = LSMR_TOLERANCE * size / norm
        rest = vector - projection
        solution = lsmr(matrix, rest, atol=LSMR_TOLERANCE, btol=tolerance, conlim=0, maxiter=20_000)[0]
        projection += matrix @ solution
        previous, norm = norm, float(np.linalg.norm(vector - projection))
        if norm > 0.5 * previous or norm < CURL_TOLERANCE * size:
            break
    return projection


def _zero_on_rim(system: csr_array, load: NDArray, complex_: Complex) -> NDArray[np.float64]:
    """Solve with zero on boundary edges; closed components keep one edge at zero."""
    rim = complex_.boundary_edge.copy()
    label = floating_components(system)
    covered = np.zeros(int(label.max(initial=0)) + 1, dtype=bool)
    covered[label[rim & (label >= 0)]] = True
    closed = np.flatnonzero((label >= 0) & ~covered[np.maximum(label, 0)])
    rim[closed[np.unique(label[closed], return_index=True)[1]]] = True
    return Dirichlet(system, rim).solve(np.zeros(()), load)


def _relative(residual: float, component: NDArray, whole: NDArray) -> float:
    """Convert a residual relative to a part to one relative to the whole field."""
    largest = np.abs(whole).max(initial=0.0)
    return float(residual * np.abs(component).max(initial=0.0) / largest) if largest else 0.0


def _assembled(inner, field, components, potential, copotential, residual, whole=None) -> HodgeDecomposition:
    """Decomposition with its residuals, relative to `whole`, whose tangent part the field is."""
    exact, coexact, harmonic = components
    norm = {name: np.sqrt(max(inner(component, component), 0.0)) for name, component in zip(
        ("field", "exact", "coexact", "harmonic"), (field, *components))}  # fmt: skip
    scale = (norm["field"] if whole is None else np.sqrt(inner(whole, whole))) or 1.0
    pairs = ((exact, coexact), (exact, harmonic), (coexact, harmonic))
    remainder = field - sum(components)
    return HodgeDecomposition(
        exact=exact,
        coexact=coexact,
        harmonic=harmonic,
        potential=potential,
        copotential=copotential,
        norms={name: float(value) for name, value in norm.items()},
        orthogonality=max(abs(inner(a / scale, b / scale)) for a, b in pairs),
        reconstruction_residual=float(np.sqrt(inner(remainder, remainder)) / scale),
        harmonic_residual=residual,
    )
