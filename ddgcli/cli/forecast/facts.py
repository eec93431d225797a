"""Facts of an input that single commands depend on: one dataclass a command, each a part of `InputSize`.

The defaults are those of an input about which nothing is known.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

__all__ = [
    "CurvatureFacts",
    "DelaunayFacts",
    "EdgePaths",
    "GeodesicFacts",
    "LaplacianFacts",
    "TradeoffFacts",
]


@dataclass(frozen=True)
class CurvatureFacts:
    """Facts that `curvature` depends on.

    Parameters
    ----------
    edge_length : float, optional
        Mean length of an edge.
    ball_work : float, optional
        Pairs of a ball with a vertex or face within the radius.
    noise : str
        Kind of the noise of the vertices that a run searches, '' of none.
    fitted_pairs : tuple of float
        Vertices in the balls of a radius that the search for noise fits, for each radius.
    sheared : bool
        Whether a run tries the neighbours of the Delaunay triangulation.
    offset_faces : int, optional
        Of an offset body.
    """

    edge_length: float | None = None
    ball_work: float | None = None
    noise: str = ""
    fitted_pairs: tuple[float, ...] = ()
    sheared: bool = False
    offset_faces: int | None = None


@dataclass(frozen=True)
class DelaunayFacts:
    """Facts that `delaunay` depends on.

    Parameters
    ----------
    angle_deficit : float, optional
        Sum over the faces of 1 - (smallest angle / angle of --refine), where that is positive.
    angle_contrast : float, optional
        Sum over the edges of the differences of log(smallest angle) between their faces, where the angles are
        at most that of --refine.
    corridor_aspect : float
        Sum of the aspects beyond that of --refine over the faces between two pieces of the boundary.
    most_points : float
        Steiner points at which --refine stops without --max-points.
    crossings_per_root_face : float
        Crossings of the edges with those of another triangulation, over the root of the number of its faces.
    further_overlay_faces : int
        Of the common subdivision of the mesh and its intrinsic Delaunay triangulation, beyond those of the
        mesh.
    """

    angle_deficit: float | None = None
    angle_contrast: float | None = None
    corridor_aspect: float = 0.0
    most_points: float = math.inf
    crossings_per_root_face: float = 0.0
    further_overlay_faces: int = 0


@dataclass(frozen=True)
class EdgePaths:
    """Edge paths from each vertex to the nearest source.

    Parameters
    ----------
    total, longest : float
        Edges of all paths and of the longest; a path counts at least as many as it is mean lengths long.
    reach_all : bool
        Whether there is one from each vertex.
    windows : float, optional
        Of exact distances, by those of the vertices nearest to the sources.
    longest_length, target_length : float, optional
        Length of the longest path, and mean length of those to the targets of shortest paths.
    """

    total: float
    longest: float
    reach_all: bool = True
    windows: float | None = None
    longest_length: float | None = None
    target_length: float | None = None


@dataclass(frozen=True)
class GeodesicFacts:
    """Facts that `geodesic` depends on: paths from the sources, and the curves that it draws.

    Parameters
    ----------
    paths, paths_of_one : EdgePaths, optional
        From all sources together, and from the first alone.
    crossings_per_length : float
        Edges that a straight line of unit length crosses.
    mean_chord : float
        Mean length of straight lines from boundary to boundary.
    starts_at_boundary : bool
        The first source is a vertex of the boundary.
    total_edge_length, extent : float
        Of the mesh; half the diagonal of its bounding box.
    n_legs : int
        Pairs of successive way-points of straightened and edge paths.
    leg_length : float
        Mean distance in space between both.
    field_length : float, optional
        Length of an integral curve in its time.
    field_steps : int, optional
        Its fixed steps.
    """

    paths: EdgePaths | None = None
    paths_of_one: EdgePaths | None = None
    crossings_per_length: float = 0.0
    mean_chord: float = math.inf
    starts_at_boundary: bool = False
    total_edge_length: float = 0.0
    extent: float = 0.0
    n_legs: int = 0
    leg_length: float = 0.0
    field_length: float | None = None
    field_steps: int | None = None


@dataclass(frozen=True)
class LaplacianFacts:
    """Facts that `laplacian` depends on.

    Parameters
    ----------
    signature_pairs : int
        Eigenpairs of heat kernel signatures.
    n_components, equal_components : int
        Connected components, and the most that are alike.
    compactness : float
        Boundary faces of a cube of as many tetrahedra over those of the solid, at most 1: thin solids have
        small separators.
    """

    signature_pairs: int = 0
    n_components: int = 1
    equal_components: int = 1
    compactness: float = 1.0


@dataclass(frozen=True)
class TradeoffFacts:
    """Facts that `tradeoff` depends on, beside those of the compared command.

    Parameters
    ----------
    ball_work : float
        Seconds of the rows with balls over those on a sphere.
    share : float
        Share of the faces that all rows would have within the budget.
    """

    ball_work: float = 1.0
    share: float = 1.0
