"""Intrinsic Delaunay triangulations."""

from __future__ import annotations

from ddgcli.algorithms.delaunay.intrinsic_delaunay import DelaunayResult
from ddgcli.algorithms.delaunay.intrinsic_delaunay import intrinsic_delaunay as core_intrinsic_delaunay
from ddgcli.algorithms.delaunay.triangulation import flip_to_delaunay
from ddgcli.library.mesh_arguments import accepts_arrays
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh, SurfaceMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh

__all__ = ["delaunay_refinement", "intrinsic_delaunay"]


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
    mesh: TriangleMesh, degrees: float = 25.0, *, max_points: int | None = None, seed: int = 0
) -> DelaunayResult:
    """Intrinsic Delaunay refinement: insert Steiner points until no angle is smaller than `degrees`.

    Parameters
    ----------
    mesh : TriangleMesh or (points, faces) pair
        Oriented, without edges of three faces.
    degrees : float
        Smallest angle, above 0 and at most 33 degrees.
    max_points : int, optional
        Most Steiner points; default ten for each vertex, at least 100,000.
    seed : int
        Seed of the choice among faces, where more need a point than a batch may try.

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
    return core_intrinsic_delaunay(mesh, degrees=degrees, max_points=max_points, seed=seed)
