"""Oriented cover of a surface (its double cover if it is not orientable).

Faces that are oriented against their neighbours are reversed. A one-sided surface has no consistent
orientation, but its double cover has one: every face twice, in both orientations. A line on the cover is a
line on the surface.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.paths import SIDE_TOLERANCE, SurfacePaths, barycentric_in
from ddgcli.algorithms.geodesics.sources import Sources
from ddgcli.algorithms.geodesics.surface_curves import Curves
from ddgcli.errors import MeshError, counted
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.mesh.double_cover import double_cover
from ddgcli.mesh.remedies import remedy
from ddgcli.mesh.repair import oriented
from ddgcli.mesh.triangle_mesh import TriangleMesh

if TYPE_CHECKING:
    from ddgcli.algorithms.geodesics.exact.exact_distance import ExactDistance

_log = logging.getLogger("ddgcli")


@dataclass(frozen=True, eq=False)
class OrientedCover:
    """An oriented mesh over `base`; its vertices are those of the base.

    Parameters
    ----------
    base, mesh : TriangleMesh
        Face f of `mesh` covers face f % m of `base`.
    turned : (m,) or (2m,) ndarray of bool
        Faces of `mesh` with reversed corners: corner k is corner 2 - k of the base's face.
    """

    base: TriangleMesh
    mesh: TriangleMesh
    turned: NDArray[np.bool_]

    @property
    def is_one_sided(self) -> bool:
        """True if the surface is one-sided: the cover has every face twice."""
        return self.mesh.n_faces > self.base.n_faces

    def require_two_sides(self, what: str) -> None:
        """Raise MeshError on a one-sided surface."""
        if self.is_one_sided:
            raise MeshError(
                f"the surface is one-sided (it contains a Moebius band); {what} needs two sides: "
                f"{remedy('one side', self.base.topology)}"
            )

    def weights(self, face: NDArray, barycentric: NDArray) -> NDArray[np.float64]:
        """Convert barycentric coordinates in faces of the cover to those of the base, or vice versa."""
        return np.where(self.turned[face][:, None], barycentric[:, ::-1], barycentric)

    def lift_points(self, points: SurfacePoints) -> SurfacePoints:
        """Lift points of the base to the cover."""
        return SurfacePoints(points.face, self.weights(points.face, points.barycentric))

    def lift_sources(self, sources: Sources) -> Sources:
        """Lift sources of the base to the cover; edges keep the index of a side's edge on the first copy."""
        edge_of = np.zeros(self.base.topology.n_edges, dtype=np.int64)
        face, j = np.divmod(np.arange(3 * self.base.n_faces), 3)
        side = np.where(self.turned[face], 3 * face + (1 - j) % 3, 3 * face + j)
        edge_of[self.base.topology.side_edge.ravel()] = self.mesh.topology.side_edge.ravel()[side]
        return Sources(sources.vertex, self.lift_points(sources.points), edge_of[sources.edge], sources.curve)

    def lift_exact(self, exact: ExactDistance) -> ExactDistance:
        """Lift an exact distance: convert the sides through which shortest paths arrive."""
        face, j = np.divmod(exact.side, 3)
        turn = (exact.side >= 0) & self.turned[np.maximum(face, 0)]
        length = self.base.side_length.ravel()[exact.side]
        side = np.where(turn, 3 * face + (1 - j) % 3, exact.side)
        return replace(exact, side=side, crossing=np.where(turn, length - exact.crossing, exact.crossing))

    def lift_curves(self, curves: Curves) -> Curves:
        """Lift curves of a two-sided base to the cover."""
        paths = curves.paths
        weights = self.weights(paths.face, paths.barycentric)
        return replace(curves, paths=SurfacePaths(paths.face, weights, paths.start, paths.closed))

    def join_lifts(self, paths: SurfacePaths) -> SurfacePaths:
        """Join separately lifted segments of open paths to one lift of each path.

        A segment may leave a vertex on the other copy of the surface than the previous one arrives on.
        It is then moved to that copy (face f to face (f + m) % 2m), with all following segments. The first
        point lies on the first copy.
        """
        if not self.is_one_sided or not len(paths.face):
            return paths
        topology, m = self.mesh.topology, self.base.n_faces
        face, barycentric = paths.face, paths.barycentric
        arriving = np.concatenate([face[:1], face[:-1]])
        points = np.diff(paths.start)
        first = paths.start[:-1][points > 0]
        arriving[first] = face[first]
        arriving_weights = barycentric_in(topology, face, barycentric, arriving)
        j, i = np.argmax(barycentric, axis=1), np.argmax(arriving_weights, axis=1)
        fans = topology.corner_fans
        fan = fans[arriving, i]
        other = (face + m) % (2 * m)
        at_vertex = (barycentric > SIDE_TOLERANCE).sum(axis=1) == 1
        change = at_vertex & (fans[face, j] != fan) & (fans[other, 2 - j] == fan)
        change[first] = face[first] >= m
        count = np.cumsum(change)
        count -= np.repeat((count - change)[first], points[points > 0])
        move = count % 2 == 1
        return replace(
            paths,
            face=np.where(move, other, face),
            barycentric=np.where(move[:, None], barycentric[:, ::-1], barycentric),
        )

    def lift_values(self, values: NDArray, place: str = "") -> tuple[NDArray, str]:
        """Lift an array of the base to the cover (repeated if it is on faces); return it with its place.

        `place` is "vertex" or "face"; an empty place is inferred from the length, vertices first.
        """
        if not place:
            length = {self.base.n_faces: "face"} | {self.base.n_vertices: "vertex"}
            place = length.get(len(values), "")
        again = self.is_one_sided and place == "face"
        return (np.concatenate([values, values]) if again else values), place

    def project(self, curves: Curves) -> Curves:
        """Project curves of the cover to the base."""
        paths, m = curves.paths, self.base.n_faces
        weights = self.weights(paths.face, paths.barycentric)
        entries = [
            entry | {end: self._projected_point(entry[end]) for end in ("start", "end") if entry.get(end)}
            for entry in curves.entries
        ]
        projected = SurfacePaths(paths.face % m, weights, paths.start, paths.closed)
        return replace(curves, paths=projected, entries=entries)

    def _projected_point(self, point: dict[str, Any]) -> dict[str, Any]:
        face, barycentric = point["face"], point["barycentric"]
        if self.turned[face]:
            barycentric = barycentric[::-1]
        return point | {"face": face % self.base.n_faces, "barycentric": barycentric}


def oriented_cover(mesh: TriangleMesh) -> OrientedCover:
    """Oriented cover of a mesh: the mesh itself if its faces are consistently oriented (otherwise with a
    warning).

    Parameters
    ----------
    mesh : TriangleMesh

    Returns
    -------
    OrientedCover
    """
    topology = mesh.topology
    if topology.is_oriented:
        return OrientedCover(mesh, mesh, np.zeros(mesh.n_faces, dtype=bool))
    if topology.face_turn is None:
        _log.warning(
            "the surface is one-sided (it contains a Moebius band): left and right of a "
            "curve are those at its start"
        )
        return _double_cover(mesh)
    reverse_faces, turned = oriented(mesh)
    faces = counted(int(turned.sum()), "face is", "faces are")
    _log.warning(
        f"{faces} oriented against the neighbours (first: face {int(np.argmax(turned))}); curves use the "
        "reversed orientation (left and right are those of the other faces); the mesh is unchanged"
    )
    return OrientedCover(mesh, reverse_faces, turned)


def two_sided_cover(mesh: TriangleMesh, what: str) -> OrientedCover:
    """Oriented cover of a surface that must have two sides.

    Parameters
    ----------
    mesh : TriangleMesh
    what : str
        What needs the two sides, for the message.

    Returns
    -------
    OrientedCover

    Raises
    ------
    MeshError
        On a one-sided surface.
    """
    cover = oriented_cover(mesh)
    cover.require_two_sides(what)
    return cover


def _double_cover(mesh: TriangleMesh) -> OrientedCover:
    cover = TriangleMesh(mesh.points, double_cover(mesh.topology))
    return OrientedCover(mesh, cover, np.arange(2 * mesh.n_faces) >= mesh.n_faces)
