"""Eigenforms of the Hodge Laplacian of 1-forms on surfaces and tetrahedra."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.hodge.harmonic import harmonic_basis
from ddgcli.errors import ParameterError
from ddgcli.geometry.remedies import warn_of_solid
from ddgcli.linalg.eigen import Eigenpairs, NullSpace, smallest_eigenpairs
from ddgcli.mesh.components import connected_labels
from ddgcli.mesh.require import require
from ddgcli.mesh.require_solid import require_manifold_body
from ddgcli.mesh.requirements import require_sized_cells
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators.dec import Complex, complex_of
from ddgcli.operators.dec_matrices import form_laplacian
from ddgcli.operators.whitney import sharp
from ddgcli.progress import ProgressCallback
from ddgcli.representation import short_repr


@dataclass(frozen=True, eq=False)
class FormSpectrum:
    """Smallest eigenpairs of the Hodge Laplacian of 1-forms.

    Parameters
    ----------
    pairs : Eigenpairs
        `vectors` (e, k): integrals along the edges; those of the kernel have the value 0 exactly.
    edges : (e, 2) ndarray of int64
        Tail and head of each edge.
    fields : (k, m, 3) ndarray of float64
        The forms as vectors on cells (means of their Whitney interpolation).
    kernel : int
        Number of eigenvalues zero among the k: the first Betti number of the mesh, if k is larger.
    """

    pairs: Eigenpairs
    edges: NDArray[np.int64]
    fields: NDArray[np.float64]
    kernel: int

    __repr__ = short_repr


def check_forms(mesh: TriangleMesh | TetMesh, k: int) -> Complex:
    """Simplicial complex of a mesh that has k eigenforms; raises the errors of `form_spectrum` for any other.

    Parameters
    ----------
    mesh : TriangleMesh or TetMesh
    k : int

    Returns
    -------
    Complex

    Raises
    ------
    MeshError, ParameterError
    """
    if isinstance(mesh, TetMesh):
        require_sized_cells(mesh, "laplacian")
        require_manifold_body(mesh, "the spectrum of forms")
        warn_of_solid(mesh)
    surface = mesh.boundary if isinstance(mesh, TetMesh) else mesh
    require(surface, "the spectrum of forms", manifold=True, oriented=True)
    complex_ = complex_of(mesh)
    if k > complex_.counts[1]:
        raise ParameterError(
            f"{k} eigenforms exceed the {complex_.counts[1]} edges; use at most that", parameter="k"
        )
    return complex_


def form_spectrum(
    mesh: TriangleMesh | TetMesh, k: int, *, seed: int = 0, progress: ProgressCallback | None = None
) -> FormSpectrum:
    """The k smallest eigenpairs of (d delta + delta d) a = lambda a on 1-forms.

    Whitney forms with their Galerkin star; the star of functions in delta is lumped. The boundary is natural:
    forms are tangential to it. The kernel is the `harmonic_basis`, as many forms as the first Betti number,
    whatever the sizes of cells and components.

    Parameters
    ----------
    mesh : TriangleMesh or TetMesh
        A surface is an oriented manifold.
    k : int
    seed : int
        Seed of the starting block.
    progress : callable, optional
        Called with (converged pairs, k).

    Returns
    -------
    FormSpectrum

    Raises
    ------
    MeshError
        For a mesh that is not an oriented manifold, or has cells without size.
    ParameterError
        For more pairs than edges.
    """
    complex_ = check_forms(mesh, k)
    L, star = form_laplacian(complex_, 1)
    null_space = NullSpace(harmonic_basis(mesh, count=k).forms.T, _shift(complex_))
    pairs = smallest_eigenpairs(L, star, k, seed=seed, progress=progress, null_space=null_space)
    return FormSpectrum(pairs, complex_.edges, sharp(mesh, pairs.vectors.T), int((pairs.values == 0).sum()))


def _shift(complex_: Complex) -> NDArray[np.float64]:
    """(e,) 1 / length^2 of the component of each edge, the size of its first eigenvalue."""
    tail, head = complex_.edges.T
    label = connected_labels(tail, head, complex_.counts[0])[1]
    measure = np.bincount(label[complex_.corners[:, 0]], complex_.metric.measure)
    return np.power(measure[label[tail]], -2.0 / complex_.dimension)
