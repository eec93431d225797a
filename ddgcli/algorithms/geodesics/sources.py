"""Sources of a distance: vertices, points on faces, and curves of edges."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshError, ParameterError, renamed_parameters
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.mesh.frozen import FrozenArrays, frozen
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.ragged import unique_keys
from ddgcli.mesh.triangle_mesh import TriangleMesh


def no_indices() -> NDArray[np.int64]:
    """Empty array of numbers of elements.

    Returns
    -------
    (0,) ndarray of int64
    """
    return np.zeros(0, dtype=np.int64)


def edge_lengths(mesh: SurfaceMesh) -> NDArray[np.float64]:
    """Length of each edge of the topology.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh

    Returns
    -------
    (e,) ndarray of float64
    """
    length = np.zeros(mesh.topology.n_edges)
    length[mesh.topology.side_edge.ravel()] = mesh.side_length.ravel()
    return length


@dataclass(frozen=True, eq=False)
class Sources(FrozenArrays):
    """Sources of a distance, numbered: first the vertices, then the points, then the curves.

    Parameters
    ----------
    vertex : (k,) ndarray of int64
    points : SurfacePoints
    edge : (e,) ndarray of int64
        Edges of the mesh (rows of `topology.edges`) whose points are all sources.
    curve : (e,) ndarray of int64
        Index of the curve of each edge, from 0.
    """

    vertex: NDArray[np.int64]
    points: SurfacePoints = field(default_factory=SurfacePoints.none)
    edge: NDArray[np.int64] = field(default_factory=no_indices)
    curve: NDArray[np.int64] = field(default_factory=no_indices)

    def __post_init__(self) -> None:
        for name in ("vertex", "edge", "curve"):
            object.__setattr__(
                self, name, frozen(np.asarray(getattr(self, name), dtype=np.int64).reshape(-1))
            )

    @classmethod
    def at(
        cls,
        vertices: Iterable[int],
        points: SurfacePoints | None = None,
        edge: NDArray | None = None,
        curve: NDArray | None = None,
    ) -> Sources:
        """Sources at a sequence of vertices, at points, and on curves of edges."""
        vertex = np.fromiter(vertices, dtype=np.int64)
        points = SurfacePoints.none() if points is None else points
        if edge is None or curve is None:
            return cls(vertex, points)
        return cls(vertex, points, edge, curve)

    @property
    def n_curves(self) -> int:
        """Number of curves."""
        return int(self.curve.max(initial=-1)) + 1

    @property
    def first_curve(self) -> int:
        """Index of the first curve among the sources."""
        return len(self.vertex) + len(self.points)

    def __len__(self) -> int:
        return self.first_curve + self.n_curves

    def corners(self, mesh: SurfaceMesh, index: int) -> NDArray[np.int64]:
        """Vertex of a source, the corners of its face, or the vertices of its curve."""
        if index < len(self.vertex):
            return self.vertex[index : index + 1]
        if index < self.first_curve:
            return mesh.faces[self.points.face[index - len(self.vertex)]]
        return unique_keys(mesh.topology.edges[self.edge[self.curve == index - self.first_curve]])

    def curve_vertices(self, mesh: SurfaceMesh) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Vertices of the curves, and the index of the source to which each belongs."""
        ends = mesh.topology.edges[self.edge].reshape(-1)
        vertex, first = np.unique(ends, return_index=True)
        return vertex, self.first_curve + np.repeat(self.curve, 2)[first]

    def at_vertices(self, mesh: SurfaceMesh) -> tuple[Sources, NDArray[np.int64]]:
        """The sources with the vertices of each curve in place of the curve, and the number here of each."""
        vertex, index = self.curve_vertices(mesh)
        own = np.arange(self.first_curve)
        k = len(self.vertex)
        return (
            Sources(np.concatenate([self.vertex, vertex]), self.points),
            np.concatenate([own[:k], index, own[k:]]),
        )

    def positions(self, mesh: TriangleMesh) -> NDArray[np.float64]:
        """(k, 3) positions in space of the vertices and the points."""
        return np.concatenate([mesh.points[self.vertex], self.points.positions(mesh)])

    def describe(self, mesh: SurfaceMesh) -> list[dict[str, Any]]:
        """Summary entries of the sources: vertex, or face and barycentric coordinates; position."""
        entries: list[dict[str, Any]] = [{"vertex": int(v)} for v in self.vertex]
        for face, weights in zip(self.points.face, self.points.barycentric):
            entries.append({"face": int(face), "barycentric": weights.tolist()})
        if isinstance(mesh, TriangleMesh):
            for entry, position in zip(entries, self.positions(mesh)):
                entry["position"] = position.tolist()
        for index in range(self.n_curves):
            edge = self.edge[self.curve == index]
            ends = mesh.topology.edges[edge]
            closed = bool((np.unique(ends, return_counts=True)[1] == 2).all())
            length = float(edge_lengths(mesh)[edge].sum())
            entries.append(
                {"edges": len(edge), "length": length, "closed": closed, "first": ends[0].tolist()}
            )
        return entries

    def each(self) -> list[Sources]:
        """Single sources, in order."""
        none = np.zeros(0, dtype=np.int64)
        singles = [Sources(self.vertex[i : i + 1]) for i in range(len(self.vertex))]
        for i in range(len(self.points)):
            point = SurfacePoints(self.points.face[i : i + 1], self.points.barycentric[i : i + 1])
            singles.append(Sources(none, point))
        for index in range(self.n_curves):
            edge = self.edge[self.curve == index]
            singles.append(Sources(none, SurfacePoints.none(), edge, np.zeros(len(edge), dtype=np.int64)))
        return singles


@dataclass(frozen=True, eq=False)
class VertexDistances:
    """Distance of each vertex to the nearest source, by any method.

    Parameters
    ----------
    distance : (n,) ndarray of float64
        inf at unreached vertices.
    nearest_source : (n,) ndarray of int64
        Index of the nearest source (vertices, points, curves); -1 at unreached vertices.
    """

    distance: NDArray[np.float64]
    nearest_source: NDArray[np.int64]


def check_sources(
    mesh: SurfaceMesh, sources: Sources | NDArray | list[int] | int, what: str = "source"
) -> Sources:
    """Check that sources lie on `mesh`: vertices in range and used by a face.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    sources : Sources, vertex index or array of vertex indices
    what : str
        Noun for one of them, in errors.

    Returns
    -------
    Sources

    Raises
    ------
    ParameterError
        When there is no source, or a source is out of range or on a vertex without a face.
    MeshError
        When the mesh has no triangles.
    """
    if not isinstance(sources, Sources):
        sources = Sources(np.asarray(sources))
    if len(sources) == 0:
        raise ParameterError(
            f"no {what}; name a vertex, such as `sources=0`, or a point on the surface", parameter="sources"
        )
    n = mesh.n_vertices
    if mesh.n_faces == 0:
        raise MeshError("no triangles; a distance along the surface needs a surface")
    outside = np.flatnonzero((sources.vertex < 0) | (sources.vertex >= n))
    if len(outside):
        raise ParameterError(
            f"{what} vertex {sources.vertex[outside[0]]} is outside 0..{n - 1}", parameter="sources"
        )
    unused = np.flatnonzero(~mesh.topology.referenced_vertex[sources.vertex])
    if len(unused):
        raise ParameterError(
            f"{what} vertex {sources.vertex[unused[0]]} belongs to no face; choose a vertex of the surface",
            parameter="sources",
        )
    with renamed_parameters(face="sources", barycentric="sources"):
        SurfacePoints.checked(sources.points.face, sources.points.barycentric, mesh.n_faces)
    outside = np.flatnonzero((sources.edge < 0) | (sources.edge >= mesh.topology.n_edges))
    if len(outside):
        raise ParameterError(
            f"source edge {sources.edge[outside[0]]} is outside 0..{mesh.topology.n_edges - 1}",
            parameter="sources",
        )
    return sources


def face_frame(side_length: NDArray) -> NDArray[np.float64]:
    """Corners of each face in its plane: corner 0 at the origin, corner 1 on the x axis, corner 2 above it.

    Parameters
    ----------
    side_length : (m, 3) ndarray of float64

    Returns
    -------
    (m, 3, 2) ndarray of float64
    """
    from ddgcli.geometry.intrinsic import face_area

    a, b, c = side_length.T
    flat_corners = np.zeros((len(side_length), 3, 2))
    flat_corners[:, 1, 0] = a
    with np.errstate(divide="ignore", invalid="ignore"):
        x = 0.5 * (a + (c - b) * (c + b) / a)
        y = 2.0 * face_area(side_length) / a
    flat_corners[:, 2, 0] = np.where(a > 0, x, 0.0)
    flat_corners[:, 2, 1] = np.where(a > 0, y, c)
    return flat_corners


def corner_distance(side_length: NDArray, barycentric: NDArray) -> NDArray[np.float64]:
    """Straight distances from points in faces to the corners.

    Parameters
    ----------
    side_length : (k, 3) ndarray of float64
        Of the face of each point.
    barycentric : (k, 3) ndarray of float64

    Returns
    -------
    (k, 3) ndarray of float64
    """
    flat_corners = face_frame(side_length)
    position = np.einsum("kc,kcd->kd", barycentric, flat_corners)
    return np.linalg.norm(flat_corners - position[:, None], axis=2)
