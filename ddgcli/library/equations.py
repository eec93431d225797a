"""Equations of the Laplacian: eigenpairs, Poisson and harmonic problems, flattening, smoothing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from ddgcli.algorithms.laplacian import parameterize as maps
from ddgcli.algorithms.laplacian import poisson as problems
from ddgcli.algorithms.laplacian import smooth as smoothing
from ddgcli.algorithms.laplacian import spectrum
from ddgcli.algorithms.laplacian.laplace_operator import laplace_operator
from ddgcli.errors import ParameterError
from ddgcli.library.mesh_arguments import accepts_arrays
from ddgcli.linalg.eigen import Eigenpairs
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh

__all__ = [
    "eigenpairs",
    "harmonic_interpolation",
    "heat_kernel_signature",
    "mean_curvature_flow",
    "parameterize",
    "poisson",
]


@accepts_arrays("surface", "tetrahedra")
def eigenpairs(
    mesh: TriangleMesh | TetMesh,
    k: int = 10,
    *,
    operator: str | None = None,
    mass: str = "lumped",
    seed: int = 0,
) -> Eigenpairs:
    """Smallest eigenpairs of the Laplacian, L x = lambda M x.

    Parameters
    ----------
    mesh : TriangleMesh, TetMesh or (points, cells) pair
    k : int
        Number of pairs, from 1 to the number of vertices.
    operator, mass : str, optional
        See `laplace_operator`.
    seed : int
        Seed of the starting block.

    Returns
    -------
    Eigenpairs
        `values` (k,) ascending, in 1/length^2; `vectors` (n, k), M-orthonormal; `residuals` (k,) relative;
        `complete`, whether a count by inertia confirms that no eigenvalue is missing.

    Raises
    ------
    MeshError, ParameterError

    Examples
    --------
    >>> import ddgcli as ddg
    >>> pairs = ddg.eigenpairs(ddg.icosphere(3), 4)  # on the sphere: 0, 2, 2, 2
    >>> pairs.values.round(1).tolist(), pairs.complete
    ([0.0, 2.0, 2.0, 2.0], True)
    """
    return spectrum.spectrum(laplace_operator(mesh, operator, mass), k, seed=seed)


@accepts_arrays("surface", "tetrahedra")
def heat_kernel_signature(
    mesh: TriangleMesh | TetMesh,
    times: Sequence[float],
    *,
    operator: str | None = None,
    mass: str = "lumped",
    seed: int = 0,
) -> spectrum.HeatKernelSignature:
    """Heat kernel signature: the heat that remains at each vertex at each time after a unit impulse there.

    Parameters
    ----------
    mesh : TriangleMesh, TetMesh or (points, cells) pair
    times : (t,) sequence of float
        Positive, in length^2.
    operator, mass : str, optional
        See `laplace_operator`.
    seed : int
        Seed of the eigensolver.

    Returns
    -------
    HeatKernelSignature
        `values` (n, t) in 1/length^2; `truncation` (t,), an estimate of the largest relative error by
        the eigenfunctions that were left out.

    Raises
    ------
    MeshError, ParameterError

    References
    ----------
    J. Sun, M. Ovsjanikov, L. Guibas, "A concise and provably informative multi-scale signature based on heat
    diffusion", 2009.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> signature = ddg.heat_kernel_signature(ddg.icosphere(2), [1.0, 5.0])
    >>> signature.values.shape
    (162, 2)
    """
    time = np.asarray(times, dtype=np.float64)
    if time.ndim != 1 or not len(time) or not (np.isfinite(time) & (time > 0)).all():
        raise ParameterError("must be a list of positive numbers", parameter="times")
    laplacian = laplace_operator(mesh, operator, mass)
    pairs = spectrum.spectrum(laplacian, spectrum.signature_pairs(laplacian, time.tolist()), seed=seed)
    return spectrum.heat_kernel_signature(laplacian, pairs, time)


@accepts_arrays("surface", "tetrahedra")
def poisson(
    mesh: TriangleMesh | TetMesh,
    source: ArrayLike,
    fixed: Mapping[int, float] | None = None,
    *,
    operator: str | None = None,
    mass: str = "lumped",
) -> problems.Solution:
    """Solution u of the Poisson problem L u = M f: minus the Laplacian of u is f.

    Parameters
    ----------
    mesh : TriangleMesh, TetMesh or (points, cells) pair
    source : (n,) or (n, c) array_like of float
        f at the vertices, not integrated.
    fixed : mapping of vertex to value, optional
        Dirichlet values. Without them the boundary is natural, f loses its mean on every component (with a
        warning where it has one), and u has mean zero there.
    operator, mass : str, optional
        See `laplace_operator`.

    Returns
    -------
    Solution
        `values` in the shape of the source, in units of f times length^2; `residual`, relative; `imbalance`,
        the share of f that was its mean.

    Raises
    ------
    MeshError, ParameterError

    Examples
    --------
    >>> import ddgcli as ddg
    >>> sphere = ddg.icosphere(3)
    >>> z = sphere.points[:, 2]  # an eigenfunction: minus the Laplacian of z is 2 z
    >>> solution = ddg.poisson(sphere, z)
    >>> float(abs(solution.values - z / 2).max()) < 0.01, solution.residual < 1e-10
    (True, True)
    """
    values = problems.checked_source(np.asarray(source, dtype=np.float64), mesh.n_vertices)
    return problems.poisson(laplace_operator(mesh, operator, mass), values, fixed)


@accepts_arrays("surface", "tetrahedra")
def harmonic_interpolation(
    mesh: TriangleMesh | TetMesh,
    fixed: Mapping[int, float],
    *,
    operator: str | None = None,
    mass: str = "lumped",
) -> problems.Solution:
    """Harmonic function with given values at some vertices: L u = 0 at all others.

    Parameters
    ----------
    mesh : TriangleMesh, TetMesh or (points, cells) pair
    fixed : mapping of vertex to value
        At least one vertex.
    operator, mass : str, optional
        See `laplace_operator`.

    Returns
    -------
    Solution
        `values` (n,) and the relative `residual`.

    Raises
    ------
    MeshError, ParameterError

    Examples
    --------
    >>> import ddgcli as ddg
    >>> square = ddg.grid(4, 4)
    >>> ends = {v: x for v, (x, _, _) in enumerate(square.points) if x in (0, 1)}
    >>> linear = ddg.harmonic_interpolation(square, ends)
    >>> bool(abs(linear.values - square.points[:, 0]).max() < 1e-12)
    True
    """
    return problems.harmonic(laplace_operator(mesh, operator, mass), fixed)


@accepts_arrays("surface")
def parameterize(
    mesh: TriangleMesh,
    method: Literal["conformal", "harmonic"] = "conformal",
    *,
    operator: str | None = None,
) -> maps.Parameterization:
    """Map of a surface with boundary to the plane.

    Parameters
    ----------
    mesh : TriangleMesh or (points, faces) pair
        One oriented component of genus 0 with boundary.
    method : {'conformal', 'harmonic'}
        'conformal': spectral, free boundary, area of the surface. 'harmonic': onto the unit disk, boundary by
        arc length; no triangle of the intrinsic Delaunay triangulation is flipped.
    operator : str, optional
        See `laplace_operator`.

    Returns
    -------
    Parameterization
        `uv` (n, 2); `flipped_input`, `collapsed_input` (triangles); `distortion_mean`, `distortion_max`
        (ratio of singular values, 1 where conformal); `residual`; `converged`.

    Raises
    ------
    MeshError
        When the surface is closed, in pieces, or has handles.
    ParameterError
        On an unknown method.

    References
    ----------
    P. Mullen et al., "Spectral conformal parameterization", 2008.
    M. Floater, "One-to-one piecewise linear mappings over triangulations", 2003.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> flat = ddg.parameterize(ddg.grid(6, 6))
    >>> round(flat.distortion_max, 6), flat.flipped_input
    (1.0, 0)
    """
    methods = {"conformal": maps.parameterize_conformal, "harmonic": maps.parameterize_harmonic}
    if method not in methods:
        raise ParameterError(f"{method!r} is not one of {', '.join(methods)}", parameter="method")
    return methods[method](mesh, laplace_operator(mesh, operator))


@accepts_arrays("surface")
def mean_curvature_flow(
    mesh: TriangleMesh,
    time: float,
    *,
    steps: int = 10,
    flow: str = "mean-curvature",
    operator: str | None = None,
    mass: str = "lumped",
) -> smoothing.SmoothingResult:
    """Surface after implicit mean curvature flow, dx/dt = -2 H n, for some time.

    Parameters
    ----------
    mesh : TriangleMesh or (points, faces) pair
        Boundary vertices stay where they are.
    time : float
        In length^2.
    steps : int
        Backward Euler steps.
    flow : {'mean-curvature', 'conformalized'}
        'conformalized': with the stiffness of the first surface throughout, which keeps angles and does not
        pinch thin parts off.
    operator, mass : str, optional
        See `laplace_operator`.

    Returns
    -------
    SmoothingResult
        `mesh`; `area` before and after every step, in length^2; `time` reached (shorter where the surface
        vanished before); `residual`, relative; `time_error`, the excess of area that the steps
        leave, relative to the area at the end.

    Raises
    ------
    MeshError, ParameterError

    References
    ----------
    M. Desbrun et al., "Implicit fairing of irregular meshes using diffusion and curvature flow", 1999.
    M. Kazhdan, J. Solomon, M. Ben-Chen, "Can mean-curvature flow be modified to be non-singular?", 2012.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> flow = ddg.mean_curvature_flow(ddg.icosphere(2), 0.1, steps=20)  # r^2 = 1 - 4 t
    >>> round(float((flow.mesh.points[0] ** 2).sum()), 1)
    0.6
    """
    return smoothing.smooth(mesh, time, steps=steps, flow=flow, operator=operator, mass=mass)
