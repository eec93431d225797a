"""Certificate of a distance: bounds that every true distance satisfies, checked without a reference."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.edge_distance import edge_distance
from ddgcli.algorithms.geodesics.sources import Sources, edge_lengths, face_frame
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.ragged import unique_keys
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import vector_length

if TYPE_CHECKING:
    from scipy.sparse import csr_array

ROUNDING_TOLERANCE = 1e-9  # relative to the largest distance; smaller excesses are not violations
MAX_BRUTE_FORCE_STARTS = 16
SYMMETRY_SAMPLES = 4  # vertices of `symmetry`; each costs one distance computation


def certificate(
    mesh: SurfaceMesh,
    sources: Sources,
    distance: NDArray,
    *,
    estimate: float | None = None,
    graph: csr_array | None = None,
) -> dict[str, Any]:
    """Violations of the bounds of every true distance, and the deviation of its gradient from length 1.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    sources : Sources
    distance : (n,) ndarray of float64
        Inf where unreached.
    estimate : float, optional
        Estimate of the largest error relative to the largest distance on a component, not proven.
    graph : csr_array, optional
        Edges that bound the distance from above, as of `edge_distance`. By default those of the mesh; where
        its triangles are needles, paths along those of an intrinsic Delaunay triangulation are far shorter.

    Returns
    -------
    dict
        violations_straight_line : vertices nearer than the straight line in space to the nearest source (None
        without positions); violations_edge_distance : vertices farther than along edges;
        violations_lipschitz : edges whose ends differ by more than the edge length, and lipschitz_excess, the
        largest such excess relative to the edge; certificate_excess : the largest amount by which any of the
        three is violated, relative to the largest edge distance; gradient_deviation : quantiles of
        | |grad d| - 1 | by the area of faces; error_estimate (only with `estimate`) : at most what the bounds
        leave, and at least the proven excess. Counts allow 1e-9 of the largest distance, and 8 units of
        rounding of the largest coordinate.
    """
    finite = np.isfinite(distance)
    slack = ROUNDING_TOLERANCE * float(distance[finite].max(initial=0.0))
    if isinstance(mesh, TriangleMesh):  # positions far from the origin have larger rounding errors
        slack += 8 * np.finfo(float).eps * float(np.abs(mesh.points).max(initial=0.0))
    under = _below_straight_line(mesh, sources, distance)
    excess, steep, step = _steep_edges(mesh, distance, slack)
    worst = max(0.0 if under is None else float(under.max(initial=0.0)), step)
    n_far, relative = 0, 0.0
    if (
        estimate is not None
        or worst > slack
        or not _below_edge_distance(mesh, sources, distance, step, slack)
    ):
        bound = edge_distance(mesh, sources, graph=graph).distance
        over = distance[finite] - bound[finite]
        worst, n_far = max(worst, float(over.max(initial=0.0))), int((over > slack).sum())
        reach = float(bound[np.isfinite(bound)].max(initial=0.0))
        relative = worst / reach if worst > slack and reach > 0 else 0.0
        if estimate is not None:
            proven, possible = _error_bounds(mesh, distance, bound, under, slack)
            estimate = max(proven, min(estimate, possible))
    stated = {} if estimate is None else {"error_estimate": estimate}
    return stated | {
        "violations_straight_line": None if under is None else int((under > slack).sum()),
        "violations_edge_distance": n_far,
        "violations_lipschitz": steep,
        "lipschitz_excess": excess,
        "certificate_excess": relative,
        "gradient_deviation": _gradient_deviation(mesh, distance),
    }


def _below_edge_distance(
    mesh: SurfaceMesh, sources: Sources, distance: NDArray, step: float, slack: float
) -> bool:
    """Whether the steps along edges alone prove that no vertex is farther than along edges.

    The sum of the steps along a path exceeds its length by at most the largest excess of a step for each of
    its edges, fewer than there are vertices.
    """
    if len(sources.points) or not np.isfinite(distance[mesh.topology.referenced_vertex]).all():
        return False
    vertices = sources.at_vertices(mesh)[0].vertex
    return float(distance[vertices].max(initial=0.0)) + mesh.n_vertices * step <= slack


def _below_straight_line(mesh: SurfaceMesh, sources: Sources, distance: NDArray) -> NDArray | None:
    """Amounts by which finite distances fall short of the straight line; None without positions."""
    if not isinstance(mesh, TriangleMesh):
        return None
    finite = np.flatnonzero(np.isfinite(distance))
    plain, _ = sources.at_vertices(mesh)
    starts = plain.positions(mesh)
    # a point of an edge is at most half its length from an end
    half_edge = 0.5 * float(edge_lengths(mesh)[sources.edge].max(initial=0.0))
    largest = float(np.abs(mesh.points).max(initial=0.0))
    scale = 2.0 ** np.frexp(largest)[1] if largest else 1.0  # squares of huge coordinates would overflow
    straight = _nearest(mesh.points[finite] / scale, starts / scale) * scale
    return np.asarray(straight - half_edge - distance[finite])


def _error_bounds(
    mesh: SurfaceMesh, distance: NDArray, bound: NDArray, under: NDArray | None, slack: float
) -> tuple[float, float]:
    """Least and largest error that bounds from below and above allow, relative to the largest distance.

    Both are those of the worst component. `under` is the amount by which finite distances violate the bound
    from below; without one it is 0. The largest distance on a component is at most the largest bound from
    above, however far too long the distances are.
    """
    finite = np.flatnonzero(np.isfinite(distance))
    value, bound = distance[finite], bound[finite]
    below = -value if under is None else under
    violation = np.maximum(below, value - bound)
    return (
        _worst_component(mesh, finite, np.where(violation > slack, violation, 0.0), bound),
        _worst_component(mesh, finite, np.maximum(-below, bound - value), value, bound),
    )


def _worst_component(mesh: SurfaceMesh, vertex: NDArray, error: NDArray, *lengths: NDArray) -> float:
    """Largest error at vertices relative to the largest length on their component, the least of several."""
    component = mesh.topology.vertex_component[vertex]
    largest = np.full(mesh.topology.n_components + 1, np.inf)  # the last one: of vertices without a face
    for values in lengths:
        of_component = np.zeros(len(largest))
        np.maximum.at(of_component, component, values)
        largest = np.minimum(largest, of_component)
    reach = largest[component]
    return float(np.max(error[reach > 0] / reach[reach > 0], initial=0.0))


def excess_over_straight_lines(mesh: SurfaceMesh, sources: Sources, distance: NDArray) -> float:
    """Largest error of lengths of paths that straight lines in space leave, relative to their largest length.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    sources : Sources
    distance : (n,) ndarray of float64
        Not below the true distance; inf where unreached.

    Returns
    -------
    float
        Value of the worst component; inf without positions.
    """
    under = _below_straight_line(mesh, sources, distance)
    if under is None:
        return np.inf
    finite = np.flatnonzero(np.isfinite(distance))
    return _worst_component(mesh, finite, -under, distance[finite] + under)


def _nearest(points: NDArray, starts: NDArray) -> NDArray[np.float64]:
    """(k,) distance of each point to the nearest start; importing a k-d tree is slower for a few starts."""
    if len(starts) > MAX_BRUTE_FORCE_STARTS:
        from scipy.spatial import cKDTree

        return cKDTree(starts).query(points)[0]
    return np.min([vector_length(points - start) for start in starts], axis=0)


def _steep_edges(mesh: SurfaceMesh, distance: NDArray, slack: float) -> tuple[float, int, float]:
    """Largest excess relative to its edge, number of steep edges, and the largest excess."""
    tail, head, length = mesh.topology.side_tail, mesh.topology.side_head, mesh.side_length.ravel()
    finite = np.isfinite(distance)
    with np.errstate(invalid="ignore"):
        excess = np.abs(distance[tail] - distance[head]) - length
    if not finite.all():
        excess[~(finite[tail] & finite[head])] = -np.inf
    over = np.flatnonzero(excess > slack)
    edges = unique_keys(mesh.topology.side_edge.ravel()[over])
    relative = excess[over] / np.where(length[over] > 0, length[over], np.inf)
    return float(relative.max(initial=0.0)), len(edges), float(excess.max(initial=0.0))


def _gradient_deviation(mesh: SurfaceMesh, distance: NDArray) -> dict[str, float] | None:
    norm, area = gradient_norm(mesh, distance)
    use = np.isfinite(norm) & (area > 0)
    return shares_by_area(np.abs(norm[use] - 1.0), area[use]) if use.any() else None


def shares_by_area(values: NDArray, area: NDArray) -> dict[str, float]:
    """Quantiles of values on faces by the area of the faces, and the largest value.

    Parameters
    ----------
    values, area : (k,) ndarray of float64

    Returns
    -------
    dict of str to float
        `median`, `p90`, `p99`, `max`.
    """
    order = np.argsort(values)
    share = np.cumsum(area[order])
    share /= share[-1]
    at = [min(int(np.searchsorted(share, q)), len(order) - 1) for q in (0.5, 0.9, 0.99)]
    median, p90, p99 = (float(values[order[i]]) for i in at)
    return {"median": median, "p90": p90, "p99": p99, "max": float(values.max())}


def gradient_norm(mesh: SurfaceMesh, values: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(m,) length of a vertex function's gradient on faces, nan where it has none; (m,) relative areas."""
    x, y, area = face_gradient(mesh, values[mesh.faces])
    norm = np.hypot(x, y)
    return np.where(np.isfinite(norm), norm, np.nan), area


def gradient_error(mesh: SurfaceMesh, distance: NDArray, *, circular: bool = True) -> float:
    """Root of the area mean of (w (|grad d| - g))^2 over the reached faces: the largest of the components.

    g is the length of the gradient of the interpolant of the distance in the plane from a point as far as the
    source. It is larger than 1 on faces that are wide for their distance, such as the sectors around a pole:
    there a gradient of length 1 is an error. The gradient of a smoothed distance is too short where it turns,
    along boundaries and cut loci, so this follows its error relative to the largest distance on a component.
    w is the area of a face over half of its bounding box along the gradient: an error of a corner that
    changes the gradient of an equilateral face by e is e times the length of a path across it, and less by
    this factor on a long face askew to the path.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    distance : (n,) ndarray of float64
    circular : bool
        False for sources that are curves, whose wavefronts are straight: g is 1.

    Returns
    -------
    float
        0 where no face is reached.
    """
    scale = float(mesh.side_length.max(initial=0.0)) or 1.0
    corner = face_frame(mesh.side_length / scale) @ np.array([1.0, 1j])
    value = distance[mesh.faces] / scale
    with np.errstate(invalid="ignore", divide="ignore"):
        gradient, area = _complex_gradient(corner, value)
        expected = _gradient_of_a_circle(corner, value, gradient) if circular else 1.0
        turned = corner * _unit(gradient).conj()[:, None]
        share = 2 * area / (np.ptp(turned.real, axis=1) * np.ptp(turned.imag, axis=1))
        residual = share * (np.abs(gradient) - expected)
    use = np.isfinite(residual) & (area > 0)
    component = mesh.topology.face_component[use]
    total = np.bincount(component, area[use])
    square = np.bincount(component, area[use] * residual[use] ** 2)
    return float(np.sqrt(np.max(square[total > 0] / total[total > 0], initial=0.0)))


def _complex_gradient(corner: NDArray, value: NDArray) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
    """Gradients on faces with corner 0 at the origin, as complex numbers, and the areas of the faces."""
    first, second = corner[:, 1], corner[:, 2]
    area = 0.5 * first.real * second.imag
    turned = (value[:, 2] - value[:, 0]) * first - (value[:, 1] - value[:, 0]) * second
    return 1j * turned / (2 * area), area


def _gradient_of_a_circle(corner: NDArray, value: NDArray, gradient: NDArray) -> NDArray[np.float64]:
    """(m,) length of the interpolant's gradient for a source in the plane, as far as each face."""
    centred = corner - corner.mean(axis=1, keepdims=True)
    mean = value.mean(axis=1, keepdims=True)
    away, circle = _unit(gradient), gradient
    for _ in range(2):  # the source lies behind the centroid; turn it until its gradient has this direction
        circle, _ = _complex_gradient(corner, np.abs(mean + centred * away.conj()[:, None]))
        away = away * _unit(gradient) * _unit(circle).conj()
    return np.abs(circle)


def _unit(value: NDArray) -> NDArray[np.complex128]:
    """Complex numbers of length 1; 1 for 0."""
    size = np.abs(value)
    return np.asarray(np.where(size > 0, value / size, 1.0))


def face_gradient(mesh: SurfaceMesh, corner: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Gradients of piecewise linear functions on faces, in the frames of the faces.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    corner : (..., m, 3) ndarray of float64
        Values at the corners.

    Returns
    -------
    x, y : (..., m) ndarrays of float64
        Not finite on faces without area or with values that are not finite.
    area : (m,) ndarray of float64
        Relative areas. Everything is computed from lengths scaled by the longest side, without overflow.
    """
    scale = float(mesh.side_length.max(initial=0.0)) or 1.0
    flat_corners = face_frame(mesh.side_length / scale)
    base, across, height = flat_corners[:, 1, 0], flat_corners[:, 2, 0], flat_corners[:, 2, 1]
    with np.errstate(invalid="ignore", divide="ignore"):
        x = (corner[..., 1] - corner[..., 0]) / scale / base
        y = ((corner[..., 2] - corner[..., 0]) / scale - x * across) / height
    return x, y, 0.5 * base * height


def symmetry(mesh: SurfaceMesh, measure: Callable[[Sources], NDArray], *, seed: int = 0) -> dict[str, Any]:
    """Asymmetry and violated triangle inequalities of distances between random vertices.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    measure : callable
        Function from sources to the distances of all vertices.
    seed : int
        Seed of the choice of vertices.

    Returns
    -------
    dict
        symmetry_residual : largest |d(a, b) - d(b, a)| relative to the largest of the distances;
        triangle_residual : largest d(a, c) - d(a, b) - d(b, c), relative to the same; sampled_pairs.
    """
    vertices = np.flatnonzero(mesh.topology.referenced_vertex)
    sample = np.random.default_rng(seed).choice(
        vertices, size=min(SYMMETRY_SAMPLES, len(vertices)), replace=False
    )
    table = np.stack([measure(Sources(np.array([v])))[sample] for v in sample])
    finite = np.isfinite(table) & np.isfinite(table.T)
    scale = float(table[finite].max(initial=0.0)) or 1.0
    skew = np.abs(np.where(finite, table, 0.0) - np.where(finite, table, 0.0).T)
    with np.errstate(invalid="ignore"):
        detour = table[:, None, :] - table[:, :, None] - table[None, :, :]
    broken = float(np.nan_to_num(detour, nan=0.0, posinf=0.0, neginf=0.0).max(initial=0.0))
    return {
        "symmetry_residual": float(skew.max(initial=0.0)) / scale,
        "triangle_residual": max(broken, 0.0) / scale,
        "sampled_pairs": int(np.triu(finite, 1).sum()),
    }
