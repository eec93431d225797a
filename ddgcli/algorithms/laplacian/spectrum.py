"""Eigenfunctions of the Laplacian and heat kernel signatures."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.laplacian.laplace_operator import LaplaceOperator
from ddgcli.algorithms.laplacian.weyl import pairs_for_times
from ddgcli.errors import ParameterError, SolveError
from ddgcli.linalg.constrain import floating_components
from ddgcli.linalg.eigen import Eigenpairs, smallest_eigenpairs
from ddgcli.progress import ProgressCallback
from ddgcli.representation import short_repr

log = logging.getLogger("ddgcli")

MAX_TRUNCATION = 1e-3  # estimated error of a heat kernel signature, above which a warning is due
# mean square of omitted eigenfunctions at a vertex, over that of the computed ones: those of fine meshes have
# about 1, and at the vertices of random points, where the error is largest, up to 3
OMITTED_SQUARE = 2.0
# of vertex size^(2/d), on surfaces nearly 0.8 squared edges: below the first the kernel of lumped mass
# errs by more than 10 % in the mean (up to 16 % at a vertex), from the second on by 1 to 8 %
SHORTEST_TIME, RESOLVED_TIME = 2.5, 8.0


def check_pair_count(k: int, n: int) -> None:
    """Raise an error for more eigenpairs than vertices of cells.

    Parameters
    ----------
    k, n : int
        Numbers of pairs and of vertices.

    Raises
    ------
    ParameterError
    """
    if k > n:
        raise ParameterError(
            f"{k} eigenpairs exceed the {n} vertices of the faces or tetrahedra; use at most {n}",
            parameter="k",
        )


def spectrum(
    operator: LaplaceOperator, k: int, *, seed: int = 0, progress: ProgressCallback | None = None
) -> Eigenpairs:
    """Smallest eigenpairs of L x = lambda M x.

    Parameters
    ----------
    operator : LaplaceOperator
    k : int
    seed : int
        Seed of the starting block.
    progress : callable, optional
        Called with (converged pairs, k).

    Returns
    -------
    Eigenpairs
        Eigenvectors (n, k) vanish on vertices without faces.

    Raises
    ------
    ParameterError
        For more pairs than vertices.
    """
    vertices = operator.referenced_vertices
    n = len(operator.mass.diagonal())
    check_pair_count(k, len(vertices))
    L, M = (matrix[vertices][:, vertices] for matrix in (operator.stiffness, operator.mass))
    pairs = smallest_eigenpairs(L, M, k, seed=seed, progress=progress)
    vectors = np.zeros((n, k))
    vectors[vertices] = pairs.vectors
    return replace(pairs, vectors=vectors)


@dataclass(frozen=True, eq=False)
class HeatKernelSignature:
    """Heat kernel signatures at several times.

    Parameters
    ----------
    values : (n, t) ndarray of float64
        sum over i of exp(-lambda_i t) phi_i(x)^2, in 1/area (of tetrahedra 1/volume).
    truncation : (t,) ndarray of float64
        Estimate of the largest relative error by the omitted eigenfunctions; 0 where none is omitted.
    """

    values: NDArray[np.float64]
    truncation: NDArray[np.float64]

    __repr__ = short_repr


def signature_pairs(operator: LaplaceOperator, times: Sequence[float]) -> int:
    """Number of eigenpairs that resolve the heat kernel at the shortest time, by Weyl's law.

    Parameters
    ----------
    operator : LaplaceOperator
    times : sequence of float
        In length^2.

    Returns
    -------
    int
        As for `pairs_for_times`.
    """
    measure, n_vertices = float(operator.mass.sum()), len(operator.referenced_vertices)
    return pairs_for_times(measure, operator.dimension, times, n_vertices)


def heat_kernel_signature(
    operator: LaplaceOperator, pairs: Eigenpairs, times: NDArray
) -> HeatKernelSignature:
    """Heat kernel signature from eigenpairs: heat that remains at each vertex after a unit impulse there.

    The constant eigenfunctions of the components are known exactly; there can be more of them than pairs.

    Parameters
    ----------
    operator : LaplaceOperator
    pairs : Eigenpairs
        Of the operator.
    times : (t,) ndarray of float64
        In length^2.

    Returns
    -------
    HeatKernelSignature
        With a warning where the mesh, or the pairs, do not resolve the shortest time.

    Raises
    ------
    SolveError
        When the values leave the floating-point range.

    References
    ----------
    SunOvsjanikovGuibas2009 in docs/references.bib.
    """
    times = np.asarray(times, dtype=np.float64)
    with np.errstate(over="ignore", invalid="ignore"):
        decay = np.exp(-np.outer(pairs.values, times))
        values = pairs.vectors[:, pairs.values > 0] ** 2 @ decay[pairs.values > 0]
        values += _squared_constants(operator)[:, None]
    if not np.isfinite(values).all():
        raise SolveError(
            "the heat kernel leaves the floating-point range at "
            f"{int((~np.isfinite(values)).any(axis=1).sum())} vertices, "
            "whose areas are too small; rescale or repair the mesh"
        )
    truncation = _truncation(operator, pairs, values, times)
    scale = _squared_spacing(operator)
    is_short = times < SHORTEST_TIME * scale
    if is_short.any():
        log.warning(
            "the mesh does not resolve the heat kernel at time %g, below twice its squared edge length, and "
            "more eigenpairs change nothing: use times of at least %.2g, or a finer mesh",
            times.min(),
            RESOLVED_TIME * scale,
        )
    is_coarse = (truncation > MAX_TRUNCATION) & ~is_short
    if is_coarse.any():
        log.warning(
            "%d eigenpairs do not resolve the heat kernel at time %g (an error of about %.2g of it): "
            "use longer times, or more eigenpairs",
            len(pairs.values),
            times[is_coarse].min(),
            truncation[is_coarse].max(),
        )
    return HeatKernelSignature(values, truncation)


def _truncation(
    operator: LaplaceOperator, pairs: Eigenpairs, values: NDArray, times: NDArray
) -> NDArray[np.float64]:
    """(t,) estimate of the largest relative error of heat kernel values by the omitted eigenfunctions.

    Their eigenvalues follow Weyl's law from the last computed one, lambda_j = lambda_k (j / k)^(2/d). Their
    squares at a vertex sum to 1 / mass minus those of the computed ones (with all, X X' = 1 / M), which the
    largest eigenvalues take where the mass is small: no more than `OMITTED_SQUARE` times the computed mean.
    """
    vertices, k = operator.referenced_vertices, len(pairs.values)
    if not 0 < k < len(vertices):
        return np.zeros(len(times))
    ratio = (np.arange(k + 0.5, len(vertices)) / (k - 0.5)) ** (2.0 / operator.dimension)
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        weight = np.array([np.exp(-max(pairs.values[-1], 0.0) * time * ratio).sum() for time in times])
        computed = (pairs.vectors[vertices] ** 2).sum(axis=1)
        rest = 1.0 / (operator.mass @ np.ones(operator.mass.shape[0]))[vertices] - computed
        square = np.minimum(OMITTED_SQUARE * computed / k, np.maximum(rest, 0.0) / (len(vertices) - k))
        tail = square[:, None] * weight
        share = np.where(tail > 0, tail / (values[vertices] + tail), 0.0)
    return np.where(np.isnan(share), 1.0, share).max(axis=0)


def _squared_spacing(operator: LaplaceOperator) -> float:
    """Squared distance of vertices, size^(2/d) for the mean size of a vertex, on the coarsest component."""
    label, measure = _component_measures(operator)[1:]
    size = measure / np.bincount(label, minlength=len(measure))
    return float(size.max(initial=0.0)) ** (2.0 / operator.dimension)


def _squared_constants(operator: LaplaceOperator) -> NDArray[np.float64]:
    """(n,) sum of the squares of the eigenfunctions of value zero: one over the measure of the component."""
    vertices, label, measure = _component_measures(operator)
    result = np.zeros(operator.mass.shape[0])
    result[vertices] = 1.0 / measure[label]
    return result


def _component_measures(operator: LaplaceOperator) -> tuple[NDArray, NDArray, NDArray]:
    """Vertices of components, the component of each, and the areas (volumes) of the components."""
    vertices, size = operator.referenced_vertices, operator.mass @ np.ones(operator.mass.shape[0])
    label = floating_components(operator.stiffness[vertices][:, vertices])
    vertices, label = vertices[label >= 0], label[label >= 0]
    return vertices, label, np.bincount(label, weights=size[vertices])
