"""Intrinsic Delaunay triangulations, maps between them and the plane, and subdivision."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from ddgcli.algorithms.conformal.conformal_map import ConformalMap
from ddgcli.algorithms.conformal.conformal_map import conformal_map as core_conformal_map
from ddgcli.algorithms.delaunay.dual import CircumcentricDual
from ddgcli.algorithms.delaunay.dual import circumcentric_dual as core_circumcentric_dual
from ddgcli.algorithms.delaunay.intrinsic_delaunay import DelaunayResult
from ddgcli.algorithms.delaunay.intrinsic_delaunay import intrinsic_delaunay as core_intrinsic_delaunay
from ddgcli.algorithms.delaunay.triangulation import flip_to_delaunay
from ddgcli.errors import ParameterError, renamed_parameters
from ddgcli.library.arguments import real_array
from ddgcli.library.mesh_arguments import accepts_arrays
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh, SurfaceMesh
from ddgcli.mesh.midpoint_subdivision import MidpointSubdivision
from ddgcli.mesh.triangle_mesh import TriangleMesh

__all__ = ["circumcentric_dual", "conformal_map", "delaunay_refinement", "intrinsic_delaunay", "subdivide"]


@accepts_arrays("surface", "intrinsic")
def circumcentric_dual(mesh: SurfaceMesh) -> CircumcentricDual:
    """Circumcentric dual of a triangulation; dual lengths of an intrinsic Delaunay one are non-negative.

    Parameters
    ----------
    mesh : TriangleMesh, IntrinsicMesh or (points, faces) pair
        Every face has an area.

    Returns
    -------
    CircumcentricDual
        `circumcentre` (m, 3) in barycentric coordinates, `circumradius`, `dual_length` (e,) and `dual_area`
        (n,), both signed, `edge_length`, `edge_faces`.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> dual = ddg.circumcentric_dual(ddg.intrinsic_delaunay(ddg.torus(12, 6)))
    >>> bool(dual.dual_length.min() > -1e-12), dual.area_residual < 1e-12
    (True, True)
    """
    return core_circumcentric_dual(mesh)


@accepts_arrays("surface")
def conformal_map(
    mesh: TriangleMesh,
    cones: Mapping[int, float] | None = None,
    *,
    boundary: str = "free",
    boundary_values: ArrayLike | None = None,
    operator: str | None = None,
) -> ConformalMap:
    """Discrete conformal map to the plane with prescribed angle sums, of a surface of any genus.

    Parameters
    ----------
    mesh : TriangleMesh or (points, faces) pair
        A connected oriented manifold, closed or with boundary.
    cones : mapping of vertex to degrees, optional
        Angle sums; 360 at other interior vertices. On the boundary with `boundary='angles'` only.
    boundary : {'free', 'lengths', 'angles'}
        'free' keeps the lengths of boundary edges; 'lengths' takes logarithmic scale factors; 'angles' takes
        angle sums in degrees; without values the boundary is straight, or nearly a circle.
    boundary_values : (n,) array_like, optional
        Read at boundary vertices.
    operator : {'intrinsic-delaunay', 'cotan'}, optional
        Triangulation that defines the conformal class; default the intrinsic Delaunay triangulation.

    Returns
    -------
    ConformalMap
        `uv` (n, 2), None where vertices on seams have several positions; `scale` (n,), log scale factors;
        `flat`, the flat IntrinsicMesh; `layout`; `overlay()`, the common subdivision with `uv` and
        distortion; `accuracy`; `converged`.

    Raises
    ------
    MeshError
        For several components, or no oriented manifold.
    ParameterError
        For angle sums that contradict Gauss-Bonnet, or values that do not belong to `boundary`.

    References
    ----------
    M. Gillespie, B. Springborn, K. Crane, "Discrete Conformal Equivalence of Polyhedral Surfaces", 2021.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> flat = ddg.conformal_map(ddg.icosphere(2), {0: 180, 3: 180, 6: 180, 9: 180})
    >>> flat.converged, flat.uv is None, flat.overlay().vertex["uv"].shape[1]
    (True, True, 2)
    """
    values = None if boundary_values is None else np.asarray(boundary_values, dtype=float)
    return core_conformal_map(mesh, cones=cones, boundary=boundary, boundary_values=values, operator=operator)


@accepts_arrays("surface", "intrinsic")
def intrinsic_delaunay(mesh: SurfaceMesh) -> IntrinsicMesh:
    """Intrinsic Delaunay triangulation of a surface, by edge flips: same vertices, same metric.

    Parameters
    ----------
    mesh : TriangleMesh, IntrinsicMesh or (points, faces) pair
        Oriented, without edges of three faces.

    Returns
    -------
    IntrinsicMesh
        `faces` (m, 3) and `side_length` (m, 3). Opposite angles of every inner edge sum to at most pi, to
        1e-9, so that cotangent weights are not negative. Operators, distances and eigenpairs take it.

    Raises
    ------
    MeshError
        For an edge of three faces, or faces of opposite orientation.

    References
    ----------
    A. Bobenko, B. Springborn, "A discrete Laplace-Beltrami operator for simplicial surfaces", 2007.
    N. Sharp, Y. Soliman, K. Crane, "Navigating intrinsic triangulations", 2019.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> sphere = ddg.icosphere(2)
    >>> needle = sphere.moved(sphere.points * [1, 1, 5])
    >>> for triangulation in (needle, ddg.intrinsic_delaunay(needle)):
    ...     L = ddg.stiffness(triangulation).tocoo()
    ...     print("negative weights:", bool((L.data[L.row != L.col] > 1e-9).any()))
    negative weights: True
    negative weights: False
    """
    return flip_to_delaunay(mesh).mesh


@accepts_arrays("surface")
def delaunay_refinement(
    mesh: TriangleMesh,
    degrees: float | None = 25.0,
    *,
    max_points: int | None = None,
    overlay: bool = False,
    transfer: Mapping[str, ArrayLike] | None = None,
    condition: bool = False,
    seed: int = 0,
) -> DelaunayResult:
    """Intrinsic Delaunay refinement: insert Steiner points until no angle is smaller than `degrees`.

    Parameters
    ----------
    mesh : TriangleMesh or (points, faces) pair
        Oriented, without edges of three faces.
    degrees : float or None
        Smallest angle, above 0 and at most 33 degrees; None for edge flips alone.
    max_points : int, optional
        Maximum number of Steiner points; default ten per vertex, at least 100,000.
    overlay : bool
        Also compute the common subdivision of both triangulations; see `overlay()` of the result.
    transfer : mapping of str to (n,) or (n, k) array_like, optional
        Functions on the vertices of `mesh`: `vertex` has those of the triangulation that are nearest in L2,
        `overlay()` their interpolants.
    condition : bool
        Also measure the condition number of the Laplacian before and after.
    seed : int
        Seed of the choice among faces, where more faces need a point than one batch can handle.

    Returns
    -------
    DelaunayResult
        `mesh` (IntrinsicMesh; the vertices of the input come first), `vertex` (`input_face` and
        `input_barycentric`: where each vertex lies on the input), `results` (angles and edges before and
        after), `accuracy`, and `reached`.

    Raises
    ------
    MeshError, ParameterError

    References
    ----------
    N. Sharp, Y. Soliman, K. Crane, "Navigating intrinsic triangulations", 2019.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> refined = ddg.delaunay_refinement(ddg.cylinder(48, 2), degrees=25)
    >>> refined.results["before"]["min_angle_degrees"] < 25 <= refined.results["after"]["min_angle_degrees"]
    True
    """
    if max_points is not None and max_points < 0:
        raise ParameterError(f"must be 0 or more, not {max_points}", parameter="max_points")
    functions = {name: np.asarray(real_array(f, "transfer")) for name, f in (transfer or {}).items()}
    with renamed_parameters(transferred="transfer"):
        return core_intrinsic_delaunay(
            mesh, degrees=degrees, max_points=max_points, subdivide=overlay, transferred=functions,
            condition=condition, seed=seed,
        )  # fmt: skip


@accepts_arrays("surface")
def subdivide(mesh: TriangleMesh, times: int = 1) -> TriangleMesh:
    """Same surface with every face split in four at its edge midpoints.

    Parameters
    ----------
    mesh : TriangleMesh or (points, faces) pair
    times : int
        At most 6.

    Returns
    -------
    TriangleMesh
        Vertices of `mesh` keep their indices.

    Raises
    ------
    ParameterError

    Examples
    --------
    >>> import ddgcli as ddg
    >>> ddg.subdivide(ddg.torus(12, 6)).n_faces  # 4 * 144
    576
    """
    return MidpointSubdivision.of(mesh, times).mesh
