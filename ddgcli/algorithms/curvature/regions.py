"""Regions around every vertex: lists of members, and the radii that balls may have."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import ParameterError, counted
from ddgcli.geometry.component_sides import component_extents
from ddgcli.mesh.ragged import expand_lists, list_starts
from ddgcli.mesh.topology import NEXT
from ddgcli.mesh.triangle_mesh import TriangleMesh

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

_log = logging.getLogger("ddgcli")


@dataclass(frozen=True, eq=False)
class Regions:
    """One list of members for each vertex.

    Parameters
    ----------
    start : (n + 1,) ndarray of int64
        The members of vertex v are `member[start[v]:start[v + 1]]`.
    member : (p,) ndarray of int
        Vertices.
    """

    start: NDArray[np.int64]
    member: NDArray[np.integer]

    @property
    def count(self) -> NDArray[np.int64]:
        """(n,) number of members of each vertex."""
        return np.diff(self.start)


def chunks(regions: Regions, members: int) -> Iterator[tuple[int, int]]:
    """Ranges of vertices whose regions together have about `members` members.

    Parameters
    ----------
    regions : Regions
    members : int

    Yields
    ------
    first, last : int
        The range [first, last); at least one vertex.
    """
    n = len(regions.start) - 1
    first = 0
    while first < n:
        last = int(np.searchsorted(regions.start, regions.start[first] + members, side="right")) - 1
        last = min(max(last, first + 1), n)
        yield first, last
        first = last


def regions_of_range(regions: Regions, first: int, last: int) -> Regions:
    """Regions of a range of vertices.

    Parameters
    ----------
    regions : Regions
    first, last : int
        The range [first, last).

    Returns
    -------
    Regions
    """
    begin, end = regions.start[first], regions.start[last]
    return Regions(regions.start[first : last + 1] - begin, regions.member[begin:end])


def cosines(centre: NDArray, normal: NDArray, count: NDArray, member: NDArray) -> NDArray[np.float64]:
    """Cosines of the angles between the normals of regions and those of their members.

    Parameters
    ----------
    centre : (3, k) ndarray of float64
        Unit normals of the regions.
    normal : (3, n) ndarray of float64
        Unit normals of all vertices.
    count : (k,) ndarray of int64
        Members of each region.
    member : (p,) ndarray of intp
        Vertices, one region after the other.

    Returns
    -------
    (p,) ndarray of float64
    """
    cosine = np.take(normal[0], member) * np.repeat(centre[0], count)
    cosine += np.take(normal[1], member) * np.repeat(centre[1], count)
    cosine += np.take(normal[2], member) * np.repeat(centre[2], count)
    return cosine


# pairs of a vertex and a face of its ball; more would take more than about three minutes
MAX_BALL_PAIRS = {"quadric": 5e8, "normal-voting": 1e9, "corrected": 1e9, "normal-cycle": 1e9, "cotan": 2e8}


def largest_radius(mesh: TriangleMesh, area: float, scheme: str) -> float:
    """Radius up to which a scheme measures in balls around all vertices.

    Parameters
    ----------
    mesh : TriangleMesh
    area : float
        Area of the surface.
    scheme : str

    Returns
    -------
    float
        In the length unit of the area.
    """
    return float(np.sqrt(MAX_BALL_PAIRS[scheme] * area / np.pi / (float(mesh.n_vertices) * mesh.n_faces)))


def check_radius(mesh: TriangleMesh, area: float, radius: float, unit: float, scheme: str) -> None:
    """Raise an error for a radius whose balls contain so many faces that measuring would take many minutes.

    Parameters
    ----------
    mesh : TriangleMesh
    area : float
        Area of the surface.
    radius : float
    unit : float
        The length unit of `mesh` in units of the input, for the message.
    scheme : str

    Raises
    ------
    ParameterError
    """
    share = min(1.0, np.pi * radius * radius / area)
    pairs = float(mesh.n_vertices) * mesh.n_faces * share
    if pairs > MAX_BALL_PAIRS[scheme]:
        largest = unit * largest_radius(mesh, area, scheme)
        raise ParameterError(
            f"balls of radius {radius * unit:g} would hold {pairs / mesh.n_vertices:.0f} faces each, too "
            f"many for {mesh.n_vertices} vertices; use a radius below {largest:.3g}, or a coarser mesh",
            parameter="radius",
        )


MIN_GROUP_VERTICES = 60  # of components of one size, which are sampled apart


def size_groups(mesh: TriangleMesh) -> list[tuple[NDArray[np.int64], int]]:
    """Vertices and number of the components of each size, up to a factor of two; none where all are alike.

    Sizes with fewer than `MIN_GROUP_VERTICES` vertices are left out: dust beside a body.

    Parameters
    ----------
    mesh : TriangleMesh

    Returns
    -------
    list of ((k,) ndarray of int, int)
    """
    if mesh.topology.n_components == 1:
        return []
    extent = component_extents(mesh)
    octave = np.full(len(extent), -1)
    octave[extent > 0] = np.rint(np.log2(extent.max() / extent[extent > 0]))
    component = mesh.topology.vertex_component
    of_vertex = np.where(component >= 0, octave[component], -1)
    members = {k: np.flatnonzero(of_vertex == k) for k in np.unique(octave[octave >= 0])}
    groups = [(v, int((octave == k).sum())) for k, v in members.items() if len(v) >= MIN_GROUP_VERTICES]
    return groups if len(members) > 1 else []


def check_reach(mesh: TriangleMesh, radius: float) -> None:
    """Raise an error for a radius at which balls contain every component whole; warn where they contain some.

    Parameters
    ----------
    mesh : TriangleMesh
    radius : float
        In the length unit of `mesh`.

    Raises
    ------
    ParameterError
    """
    extent = component_extents(mesh)
    whole = extent <= 2 * radius
    if whole.all():
        widest = float(extent.max())
        raise ParameterError(
            f"a ball of radius {radius:g} holds the whole surface, of extent {widest:.4g}, which leaves no "
            f"curvature at a point; use a radius below {widest / 4:.3g}, or `radius=auto`",
            parameter="radius",
        )
    if whole.any():
        vertices = int(whole[mesh.topology.vertex_component[mesh.topology.referenced_vertex]].sum())
        _log.warning(
            "balls of radius %g hold %s of the surface whole (%s): values there are no "
            "curvature at a point; use a smaller radius",
            radius,
            counted(int(whole.sum()), "component", "components"),
            counted(vertices, "vertex", "vertices"),
        )


EDGES_OF_A_BALL = 3  # of the mean edge: the radius from which balls hold more than two rings


def warn_of_short_radius(mesh: TriangleMesh, radius: float, scheme: str, in_rings: bool) -> None:
    """Report vertices whose balls hold no other vertex, or that all vertices keep their two rings.

    Parameters
    ----------
    mesh : TriangleMesh
    radius : float
        In the length unit of `mesh`.
    scheme : str
    in_rings : bool
        `in_rings` of the measured `PrincipalCurvatures`.
    """
    side = mesh.side_length
    if scheme == "corrected" or (side.max() <= radius and not in_rings):
        return  # corrected measures are constant on faces: small balls have the values of the star
    nearest = np.full(mesh.n_vertices, np.inf)
    for ends in (mesh.faces, mesh.faces[:, NEXT]):
        np.minimum.at(nearest, ends, side)
    is_short = mesh.topology.referenced_vertex & ((nearest > radius) | in_rings)
    short = np.flatnonzero(is_short)
    if len(short) == 0:
        return
    least = EDGES_OF_A_BALL * float(side[is_short[mesh.faces].any(axis=1)].mean())
    works = least < component_extents(mesh).max() / 4
    _log.warning(
        "balls of radius %g hold %s around %s (first: vertex %d): %s; %s",
        radius,
        "no more vertices than two rings" if in_rings else "no other vertex",
        counted(len(short), "vertex", "vertices"),
        short[0],
        "the normal cycle of one corner over the area of its ball grows without limit as the radius shrinks"
        if scheme == "normal-cycle"
        else "the rings are measured instead",
        f"use `radius={least:.3g}` or more" if works else "leave `radius` out",
    )


def listed(regions: Regions, vertices: NDArray) -> Regions:
    """Regions of some vertices, in their order.

    Parameters
    ----------
    regions : Regions
    vertices : (k,) ndarray of int64

    Returns
    -------
    Regions
    """
    _, member = expand_lists(vertices, vertices, (regions.start, regions.member))
    return Regions(list_starts(regions.count[vertices]), member)


def joined(several: Sequence[Regions]) -> Regions:
    """Regions of several blocks, one after the other.

    Parameters
    ----------
    several : sequence of Regions

    Returns
    -------
    Regions
    """
    counts = np.concatenate([regions.count for regions in several])
    return Regions(list_starts(counts), np.concatenate([regions.member for regions in several]))


def larger(one: Regions, other: Regions) -> Regions:
    """The region with more members, for each vertex.

    Parameters
    ----------
    one, other : Regions
        Regions of the same vertices.

    Returns
    -------
    Regions
        From `one` where both have as many.
    """
    return select_regions(one, other, other.count > one.count)


def select_regions(one: Regions, other: Regions, takes_other: NDArray[np.bool_]) -> Regions:
    """Choose the region of each vertex from two lists.

    Parameters
    ----------
    one, other : Regions
        Regions of the same vertices.
    takes_other : (n,) ndarray of bool
        Where to take `other`.

    Returns
    -------
    Regions
    """
    if takes_other.all():
        return other
    if not takes_other.any():
        return one
    count = np.where(takes_other, other.count, one.count)
    member = np.empty(count.sum(), dtype=np.result_type(one.member, other.member))
    # masks of a byte for each member: wide balls have hundreds of millions
    takes = np.repeat(takes_other, count)
    member[takes] = other.member[np.repeat(takes_other, other.count)]
    member[~takes] = one.member[np.repeat(~takes_other, one.count)]
    return Regions(list_starts(count), member)


def balls_around(points: NDArray, few: NDArray, tree: cKDTree, radius: float) -> Regions:
    """Vertices in the balls around a few vertices, connected to them or not.

    Parameters
    ----------
    points : (3, n) ndarray of float64
    few : (k,) ndarray of int64
        Centres.
    tree : cKDTree
        k-d tree of all points.
    radius : float

    Returns
    -------
    Regions
        Members in ascending order.
    """
    # a matrix of distances takes a third of the time of lists of members
    centres = type(tree)(points[:, few].T, balanced_tree=False, compact_nodes=False)
    pairs = centres.sparse_distance_matrix(tree, radius, output_type="ndarray")
    n = points.shape[1]
    order = pairs["i"].astype(np.int64) * n + pairs["j"]
    order.sort()
    centre, member = np.divmod(order, n)
    return Regions(list_starts(np.bincount(centre, minlength=len(few))), member)
