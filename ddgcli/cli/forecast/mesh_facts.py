"""Properties of a mesh on which the time of commands depends, each computed within milliseconds."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ddgcli.choices import DEFAULT_OFFSET_ANGLE

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ddgcli.cli.forecast.facts import EdgePaths
    from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
    from ddgcli.mesh.tet_mesh import TetMesh
    from ddgcli.mesh.triangle_mesh import TriangleMesh

__all__ = [
    "angle_contrast",
    "angle_deficit",
    "corridor_aspect",
    "ball_work",
    "clipping_work",
    "compactness",
    "component_counts",
    "crossings_per_length",
    "crossings_per_root_face",
    "delaunay_mesh",
    "edge_paths",
    "handles",
    "has_sheared_fits",
    "harmonic_fields",
    "mean_chord",
    "noise_of_vertices",
    "offset_faces",
    "picture_share",
    "signature_pairs",
]

SAMPLED_BALLS, SAMPLED_POINTS = 200, 50_000  # sample for the number of vertices in balls
COUNTED_BALLS = 24  # sampled balls for each radius of the noise estimate
SAMPLED_BLOCKS, BALLS_PER_BLOCK = 6, 120  # sampled blocks of consecutive vertices, whose balls are one search
SAMPLED_PAIRS = 1e6  # largest number of pairs of a sampled ball and a vertex in it
CLIPPING_SCHEMES = ("corrected", "normal-cycle")
SEARCH_OF_BALL = 30.0  # vertices in a ball that cost as much as the search for it
CURVE_SOURCES = ("source_edges", "source_boundary")
POINTS_OF_MEASURED_FACE = 2.1  # points per face on offset bodies of spheres, where each arc has one step
SAME_AREA_DECIMALS = 6  # decimals of the logarithms of equal areas
LEAST_ANGLE = 1e-9  # smallest angle of a face, relative to that of the refinement
PICTURE_PIXELS = (1290, 1050)  # size without a colour bar; only the aspect ratio matters
CLIPS_PER_BALL, CLIPS_PER_FACE_INSIDE = 27.0, 0.035  # cost of a ball and of a face inside, in clipped faces


def noise_of_vertices(mesh: TriangleMesh, scheme: str) -> tuple[str, tuple[float, ...]]:
    """Kind of noise ('' for none), and number of vertices in the balls of the noise estimate for each radius.

    The kind is that of the first step of the run's own estimate.
    """

    from ddgcli.algorithms.curvature.deviation import vertex_deviation
    from ddgcli.algorithms.curvature.grid_coordinates import precision_steps
    from ddgcli.algorithms.curvature.noise_estimate import BENDING_SAMPLE_SIZE, radii_of_search
    from ddgcli.algorithms.curvature.noise_kind import noise_kind
    from ddgcli.algorithms.curvature.totals import filled_normals
    from ddgcli.geometry.extrinsic import dihedral_angle_and_length
    from ddgcli.geometry.faces import Faces

    unit, extent = _unit_surface(mesh)
    if unit is None:
        return "", ()
    faces = Faces.of(unit)
    dihedral, _ = dihedral_angle_and_length(unit, filled_normals(faces, unit.topology).T)
    steps = precision_steps(mesh.points)
    unit_steps = None if steps is None else steps / extent
    deviation = None if faces.flat.all() else vertex_deviation(unit, faces, dihedral, unit_steps)
    if deviation is None:
        return "", ()
    kind, deviation = noise_kind(unit, faces, dihedral, deviation)
    if not kind:
        return "", ()
    radii = radii_of_search(unit, faces, deviation, scheme)
    return kind, tuple(BENDING_SAMPLE_SIZE * count for count in _ball_counts(unit, radii, COUNTED_BALLS))


def has_sheared_fits(mesh: TriangleMesh) -> bool:
    """Whether fits of two rings try the neighbours of the Delaunay triangulation too."""
    from ddgcli.algorithms.curvature.neighbours import is_sheared
    from ddgcli.geometry.faces import Faces

    unit, _ = _unit_surface(mesh)
    return unit is not None and is_sheared(unit, Faces.of(unit))


def _unit_surface(mesh: TriangleMesh) -> tuple[TriangleMesh | None, float]:
    """The surface that `curvature` measures (oriented, of unit extent) or None, and the original extent."""
    import numpy as np

    from ddgcli.mesh.repair import faces_to_turn, reverse_faces

    topology = mesh.topology
    extent = float(np.ptp(mesh.points / 2, axis=0).max()) if mesh.n_faces else 0.0
    if not (extent > 0.0 and (topology.is_oriented or topology.is_orientable)):
        return None, extent
    unit = mesh.moved_unchecked((mesh.points - mesh.points[mesh.faces[0, 0]]) / extent)
    return unit if topology.is_oriented else reverse_faces(unit, faces_to_turn(unit)), extent


def angle_deficit(mesh: TriangleMesh | IntrinsicMesh, degrees: float) -> float:
    """Sum over the faces of max(0, 1 - smallest angle / degrees).

    The mesh is the intrinsic Delaunay triangulation from which a refinement starts.
    """
    return float((1.0 - _small_angles(mesh, degrees)).sum())


def angle_contrast(mesh: TriangleMesh | IntrinsicMesh, degrees: float) -> float:
    """Sum over the edges of the differences of log(smallest angle), at most `degrees`, of both faces."""
    import numpy as np

    twin = mesh.topology.side_twin
    logarithm = np.log(np.maximum(_small_angles(mesh, degrees), LEAST_ANGLE))
    difference = np.abs(logarithm[:, None] - logarithm[np.maximum(twin, 0) // 3])
    return 0.5 * float(difference[twin >= 0].sum())


def corridor_aspect(mesh: TriangleMesh | IntrinsicMesh, degrees: float) -> float:
    """Sum of the aspect ratios above that of an angle, over the faces between two pieces of the boundary.

    Between them point spacing cannot grow: a strip needs as many points as its length over its width. At a
    sharp corner of the boundary it can, so such faces do not count.
    """
    import numpy as np

    from ddgcli.geometry.intrinsic import corner_angle, face_area

    topology, length = mesh.topology, mesh.side_length
    faces = np.flatnonzero(topology.boundary_vertex[topology.faces].all(axis=1))
    if len(faces) == 0:
        return 0.0
    at_boundary = topology.side_twin.reshape(-1, 3)[faces] < 0
    smallest = corner_angle(length[faces]).argmin(axis=1)
    index = np.arange(len(faces))
    is_corner = at_boundary[index, smallest] & at_boundary[index, smallest - 1]
    side = np.where(at_boundary, length[faces], 0.0).max(axis=1)
    unit = float(length.max()) or 1.0  # no square over- or underflows
    area = face_area(length[faces] / unit)
    aspect = np.divide((side / unit) ** 2, 2.0 * area, out=np.zeros(len(faces)), where=area > 0)
    beyond = np.maximum(aspect - 1.0 / math.tan(math.radians(degrees)), 0.0)
    return float(beyond[~is_corner].sum())


def _small_angles(mesh: TriangleMesh | IntrinsicMesh, degrees: float) -> NDArray:
    """Smallest angle of each face over `degrees`, at most 1."""
    import numpy as np

    from ddgcli.geometry.intrinsic import corner_angle

    smallest = np.degrees(corner_angle(mesh.side_length)).min(axis=1, initial=180.0)
    return np.minimum(smallest / degrees, 1.0)


def crossings_per_root_face(mesh: TriangleMesh | IntrinsicMesh) -> float:
    """Crossings of the edges with those of n equal triangles that cover the surface, over the root of n.

    By the formula of Cauchy and Crofton: 2 / pi for each pair of lengths on a unit of area.
    """
    from ddgcli.geometry.intrinsic import face_area

    unit = float(mesh.side_length.max(initial=0.0)) or 1.0  # no square over- or underflows
    root_area = math.sqrt(float(face_area(mesh.side_length / unit).sum()))
    of_equilateral = 1.5 * math.sqrt(4.0 / math.sqrt(3.0))  # half the sides of a triangle of area 1
    return crossings_per_length(mesh) * unit * root_area * of_equilateral if root_area else 0.0


def delaunay_mesh(mesh: TriangleMesh | IntrinsicMesh) -> tuple[TriangleMesh | IntrinsicMesh, int]:
    """The intrinsic Delaunay triangulation, and the number of faces of its overlay minus those of the mesh.

    The mesh itself if it is invalid, which is an error of the run.
    """
    from contextlib import suppress

    from ddgcli.algorithms.delaunay.triangulation import flip_to_delaunay
    from ddgcli.errors import InputError, without_warnings

    with without_warnings(), suppress(InputError):  # the run itself reports both
        flipped = flip_to_delaunay(mesh, track=True)
        crossings = 0 if flipped.crossings is None else int(flipped.crossings.clip(min=0).sum())
        return flipped.mesh, crossings  # of both sides of each edge: two faces for each crossing
    return mesh, 0


def ball_work(mesh: TriangleMesh, radius: float, scheme: str) -> float:
    """Pairs of a ball around a vertex and a vertex or a face in it: the unit of kernels with a radius."""
    import numpy as np

    unit = float(mesh.side_length.max()) or 1.0  # no square over- or underflows
    pairs = _clipped_faces if scheme in CLIPPING_SCHEMES else _ball_vertices
    whole = float(np.ptp(mesh.points / unit, axis=0).sum())  # wider balls contain no more
    return mesh.n_vertices * pairs(mesh.moved_unchecked(mesh.points / unit), min(radius / unit, whole))


def _ball_vertices(mesh: TriangleMesh, radius: float) -> float:
    """Mean number of vertices within a radius of a vertex, from a sample, and the work of the search."""
    return SEARCH_OF_BALL + 1.0 + _ball_counts(mesh, [radius], SAMPLED_BALLS)[0]


def _ball_counts(mesh: TriangleMesh, radii: Sequence[float], n_balls: int) -> list[float]:
    """Mean number of vertices within each radius of a vertex and beside it, from a sample."""
    import numpy as np

    points = mesh.points.T
    every = max(1, mesh.n_vertices // SAMPLED_POINTS)
    sample = np.ascontiguousarray(points[:, ::every])
    centres = points[:, :: max(1, mesh.n_vertices // n_balls)].T
    square = np.sort([((sample - p[:, None]) ** 2).sum(axis=0) for p in centres], axis=1)
    inside = [np.searchsorted(row, np.square(radii), side="right") for row in square]
    return [every * max(0.0, count - 1.0 / every) for count in np.mean(inside, axis=0).tolist()]


def _clipped_faces(mesh: TriangleMesh, radius: float) -> float:
    """Mean work of clipping the ball around a vertex, from a sample."""
    from ddgcli.algorithms.curvature.ball_blocks import ball_blocks
    from ddgcli.algorithms.curvature.face_balls import FaceBalls

    balls = FaceBalls(mesh, radius)
    wide = int(SAMPLED_PAIRS / (SAMPLED_BLOCKS * _ball_vertices(mesh, radius)))
    n_balls, block = 0, max(1, min(BALLS_PER_BLOCK, wide))
    for vertex, near in ball_blocks(balls.tree, radius, SAMPLED_BLOCKS):
        balls.around(vertex[:block], near)
        n_balls += len(vertex[:block])
    return clipping_work(balls.n_clipped / n_balls, balls.n_inside / n_balls)


def clipping_work(clipped: float, inside: float) -> float:
    """Work of a ball with numbers of faces that it clips and that it contains, in clipped faces."""
    return CLIPS_PER_BALL + clipped + CLIPS_PER_FACE_INSIDE * inside


def edge_paths(mesh: TriangleMesh, options: Mapping[str, Any]) -> tuple[EdgePaths, EdgePaths]:
    """Edge paths from all sources of `geodesic` together, and from the first source alone."""
    import numpy as np
    from scipy.sparse.csgraph import dijkstra

    from ddgcli.algorithms.geodesics.edge_distance import edge_graph
    from ddgcli.algorithms.geodesics.exact.work import predicted_windows
    from ddgcli.algorithms.geodesics.sources import check_sources
    from ddgcli.cli.forecast.facts import EdgePaths

    sources = _source_vertices(mesh, options)
    targets = np.array(options.get("path_to") or (), dtype=np.int64)
    targets = targets[(targets >= 0) & (targets < mesh.n_vertices)]
    graph, mean_length = edge_graph(mesh), float(mesh.side_length.mean()) or 1.0

    def paths_from(vertices: NDArray) -> EdgePaths:
        count, length = (
            dijkstra(graph, indices=vertices, unweighted=unweighted, min_only=True)
            for unweighted in (True, False)
        )
        reached = np.isfinite(count)
        # small faces among large ones count by length, stretched faces by number
        edges = np.maximum(count[reached], length[reached] / mean_length)
        windows = None  # not known for curves, from which strips start
        if options.get("method", "exact") == "exact" and not any(map(options.get, CURVE_SOURCES)):
            windows = predicted_windows(mesh, check_sources(mesh, vertices), int(reached.sum()))
        at_targets = length[targets][np.isfinite(length[targets])]
        return EdgePaths(
            float(edges.sum()), float(edges.max(initial=0.0)), bool(reached.all()), windows,
            longest_length=float(length[reached].max(initial=0.0)),
            target_length=float(at_targets.mean()) if len(at_targets) else None,
        )  # fmt: skip

    of_all = paths_from(sources)
    return of_all, of_all if len(sources) == 1 else paths_from(sources[:1])


def _source_vertices(mesh: TriangleMesh, options: Mapping[str, Any]) -> NDArray:
    """Vertices of faces at or beside the sources; the first one where the options name none of the mesh."""
    import numpy as np

    used = np.flatnonzero(mesh.topology.referenced_vertex)
    vertices = np.array(options.get("source") or [], dtype=np.int64)
    faces = np.array([face for face, _ in options.get("source_face") or ()], dtype=np.int64)
    faces = faces[(faces >= 0) & (faces < mesh.n_faces)]
    points = np.array(options.get("source_point") or (), dtype=float).reshape(-1, 3)
    near = [int(used[np.argmin(((mesh.points[used] - point) ** 2).sum(axis=1))]) for point in points]
    boundary = np.flatnonzero(mesh.topology.boundary_vertex & bool(options.get("source_boundary")))
    vertices = np.concatenate([vertices, mesh.faces[faces, 0], near, boundary]).astype(np.int64)
    vertices = np.unique(vertices[(vertices >= 0) & (vertices < mesh.n_vertices)])
    return vertices if len(vertices) else used[:1]


def crossings_per_length(mesh: TriangleMesh | IntrinsicMesh) -> float:
    """Mean number of edges that a line of unit length crosses, by the formula of Cauchy and Crofton."""
    from ddgcli.geometry.intrinsic import face_area

    unit = float(mesh.side_length.max(initial=0.0)) or 1.0  # no square over- or underflows
    area = float(face_area(mesh.side_length / unit).sum())
    edges = 0.5 * float((mesh.side_length / unit).sum())  # a side at the boundary is half an edge
    return 2.0 / math.pi * edges / area / unit if area > 0.0 else 0.0


def mean_chord(mesh: TriangleMesh | IntrinsicMesh) -> float:
    """Mean length of straight lines from boundary to boundary, by Santalo's formula; inf without boundary.

    It holds for disks from which every line exits; handles and bulges make lines longer.
    """
    from ddgcli.geometry.intrinsic import face_area

    unit = float(mesh.side_length.max(initial=0.0)) or 1.0  # no square over- or underflows
    at_boundary = mesh.topology.side_twin < 0
    perimeter = float((mesh.side_length / unit)[at_boundary].sum())
    return (
        math.pi * float(face_area(mesh.side_length / unit).sum()) / perimeter * unit
        if perimeter
        else math.inf
    )


def signature_pairs(mesh: TriangleMesh | IntrinsicMesh | TetMesh, times: Sequence[float]) -> int:
    """Number of eigenpairs of heat kernel signatures at these times."""
    import numpy as np

    from ddgcli.algorithms.laplacian.weyl import pairs_for_times
    from ddgcli.geometry.intrinsic import face_area
    from ddgcli.mesh.tet_mesh import TetMesh

    if isinstance(mesh, TetMesh):
        return pairs_for_times(float(np.abs(mesh.signed_volume).sum()), 3, times, mesh.n_vertices)
    return pairs_for_times(float(face_area(mesh.side_length).sum()), 2, times, mesh.n_vertices)


def wave_steps(mesh: TriangleMesh | IntrinsicMesh | TetMesh, duration: float) -> int:
    """Number of default steps of a wave from one vertex, whose frequency is 1 / size^(1/d) of a vertex."""
    import numpy as np

    from ddgcli.algorithms.laplacian.evolution_times import EvolutionTimes
    from ddgcli.geometry.intrinsic import face_area
    from ddgcli.mesh.tet_mesh import TetMesh

    sizes, d = (mesh.signed_volume, 3) if isinstance(mesh, TetMesh) else (face_area(mesh.side_length), 2)
    spacing = float(np.abs(sizes).sum() / max(mesh.n_vertices, 1)) ** (1.0 / d)
    times = EvolutionTimes.of(duration, None, None)
    return times.for_waves_of(1.0 / spacing).steps if spacing > 0 else times.steps


def harmonic_fields(mesh: TriangleMesh | IntrinsicMesh) -> int:
    """Dimension of the harmonic fields of a manifold surface, by Euler's formula."""
    topology = mesh.topology
    closed = topology.n_components if not topology.boundary_vertex.any() else 0
    return max(0, topology.n_components + closed - topology.euler_characteristic)


def handles(boundary: TriangleMesh) -> int:
    """First Betti number of a solid in space: the sum of the genera of its boundary surfaces."""
    topology = boundary.topology
    return max(0, topology.n_components - topology.euler_characteristic // 2)


def compactness(mesh: TetMesh) -> float:
    """Boundary faces of a cube of as many tetrahedra over those of the mesh, at most 1."""
    of_cube = 12.0 * (len(mesh.tetrahedra) / 6.0) ** (2.0 / 3.0)  # two on a square, six in a cell
    return min(1.0, round(of_cube / max(len(mesh.boundary.faces), 1), 9))


def component_counts(mesh: TriangleMesh | IntrinsicMesh) -> tuple[int, int]:
    """Number of components with faces, and largest number of them with equal face counts and areas."""
    import numpy as np

    from ddgcli.geometry.intrinsic import face_area

    if not len(mesh.faces):
        return 1, 1
    label = mesh.topology.vertex_component.take(mesh.faces[:, 0])
    count = np.bincount(label)
    unit = float(mesh.side_length.max()) or 1.0  # no square over- or underflows
    area = np.bincount(label, face_area(mesh.side_length / unit))[count > 0]
    count = count[count > 0]
    with np.errstate(divide="ignore"):
        alike = np.stack([count, np.round(np.log(area), SAME_AREA_DECIMALS)], axis=1)
    return len(count), int(np.unique(alike, axis=0, return_counts=True)[1].max())


def hole_triangles(mesh: TriangleMesh | IntrinsicMesh, most_edges: int) -> float:
    """Number of vertex triples of a boundary loop, summed over the loops of at most `most_edges` edges."""
    import numpy as np

    from ddgcli.mesh.components import connected_labels

    rim = mesh.topology.edges[mesh.topology.boundary_edges]
    label = connected_labels(rim[:, 0], rim[:, 1], mesh.n_vertices)[1]
    count = np.bincount(label[rim[:, 0]])
    return float((count[count <= most_edges].astype(float) ** 3).sum() / 6)


def offset_faces(mesh: TriangleMesh, options: Mapping[str, Any]) -> int | None:
    """Estimated number of faces of an offset body from its number of points; None if the run is an error.

    Points are counted before they are merged: short arcs have two per face, long ones fewer.
    """
    from ddgcli.algorithms.curvature.offset_body import check_offset
    from ddgcli.errors import InputError

    try:
        angle = options.get("offset_angle") or DEFAULT_OFFSET_ANGLE
        return round(check_offset(mesh, options["offset"], angle).n_points / POINTS_OF_MEASURED_FACE)
    except InputError:
        return None


def picture_share(mesh: TriangleMesh) -> float:
    """Fraction of a picture that shows the surface, from its projected area in the view of the picture.

    Half of a closed surface is behind the other half; folds hide more.
    """
    import numpy as np

    from ddgcli.geometry.extrinsic import face_area_vector
    from ddgcli.plots.raster import fitted_camera, unit_box, view_axes
    from ddgcli.plots.viewpoint import up_axis_of

    if not mesh.n_faces:
        return 0.0
    mesh = mesh.moved_unchecked(unit_box(mesh.points)(mesh.points))
    axes = view_axes(mesh.points, None, up_axis_of(mesh))
    camera = fitted_camera(mesh.points, axes, *PICTURE_PIXELS)
    seen = float(np.abs(face_area_vector(mesh) @ axes[2]).sum()) * camera.scale**2
    layers = 1 if mesh.topology.boundary_vertex.any() else 2
    return min(1.0, seen / (layers * camera.width * camera.height))
