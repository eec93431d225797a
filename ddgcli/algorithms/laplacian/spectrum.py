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

# default bound on the eigenpairs of a heat kernel signature, and the weight of the first one left out


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
            parameter="eigen",
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
        Of the starting block.
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
        exp(-lambda_k t): the weight of the first omitted eigenfunction, an estimate of the relative error.
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
        As of `pairs_for_times`.
    """
    measure, n_vertices = float(operator.mass.sum()), len(operator.referenced_vertices)
    return pairs_for_times(measure, operator.dimension, times, n_vertices)


def heat_kernel_signature(
    operator: LaplaceOperator, pairs: Eigenpairs, times: NDArray
) -> HeatKernelSignature:
    """Heat that remains at each vertex after each time from a unit source there, by eigenpairs.

    The constants of the components, of which there can be more than pairs, are known without them.

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
        With a warning where the pairs do not resolve the shortest time.

    Raises
    ------
    SolveError
        When the values leave the range of numbers.

    References
    ----------
    SunOvsjanikovGuibas2009 in docs/references.bib.
    """
    times = np.asarray(times, dtype=np.float64)
    with np.errstate(over="ignore"):
        decay = np.exp(-np.outer(pairs.values, times))
    truncation = decay[-1] if len(pairs.values) < len(pairs.vectors) else np.zeros(len(times))
    if (truncation > 1e-3).any():
        log.warning(
            "%d eigenpairs do not resolve the heat kernel at time %g (the next one weighs %.2g): "
            "increase `eigen`, or use longer times",
            len(pairs.values),
            times[truncation > 1e-3].min(),
            truncation.max(),
        )
    with np.errstate(over="ignore", invalid="ignore"):
        values = pairs.vectors[:, pairs.values > 0] ** 2 @ decay[pairs.values > 0]
        values += _squared_constants(operator)[:, None]
    if not np.isfinite(values).all():
        raise SolveError(
            f"the heat kernel leaves the range of numbers at {int((~np.isfinite(values)).any(axis=1).sum())} "
            "vertices, whose areas are too small; rescale or repair the mesh"
        )
    return HeatKernelSignature(values, truncation)


def _squared_constants(operator: LaplaceOperator) -> NDArray[np.float64]:
    """(n,) sum of the squares of the eigenfunctions of value zero: one over the measure of the component."""
    vertices, measure = operator.referenced_vertices, operator.mass @ np.ones(operator.mass.shape[0])
    label = floating_components(operator.stiffness[vertices][:, vertices])
    vertices, label = vertices[label >= 0], label[label >= 0]
    result = np.zeros(len(measure))
    result[vertices] = 1.0 / np.bincount(label, weights=measure[vertices])[label]
    return result
