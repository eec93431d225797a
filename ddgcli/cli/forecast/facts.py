"""Properties of an input (facts) on which the cost of single commands depends, one dataclass per command.

They are members of `InputSize`. The defaults are assumptions about an unknown input.
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
    """Properties on which the cost of `curvature` depends.

    Parameters
    ----------
    edge_length : float, optional
        Mean length of an edge.
    ball_work : float, optional
        Pairs of a ball with a vertex or face within the radius.
    noise : str
        Kind of noise for which the run fits balls; '' for none.
    fitted_pairs : tuple of float
        Number of vertices in the balls that the noise estimate fits, for each radius.
    sheared : bool
        Whether a run tries the neighbours of the Delaunay triangulation.
    offset_faces : int, optional
        Number of faces of an offset body.
    """

    edge_length: float | None = None
    ball_work: float | None = None
    noise: str = ""
    fitted_pairs: tuple[float, ...] = ()
    sheared: bool = False
    offset_faces: int | None = None


@dataclass(frozen=True)
class DelaunayFacts:
    """Properties on which the cost of `delaunay` depends.

    Parameters
    ----------
    angle_deficit : float, optional
        Sum over the faces of max(0, 1 - smallest angle / angle of --refine).
    angle_contrast : float, optional
        Sum over the edges of the differences of log(smallest angle) between their faces, where the angles are
        at most that of --refine.
    corridor_aspect : float
        Sum of the aspect ratios above that of --refine, over faces between two pieces of the boundary.
    most_points : float
        Steiner points at which --refine stops without --max-points.
    crossings_per_root_face : float
        Crossings of the edges with those of another triangulation, over the square root of its face count.
    further_overlay_faces : int
        Faces of the common subdivision with the intrinsic Delaunay triangulation minus those of the mesh.
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
        Edges of all paths and of the longest; at least the length of a path over the mean edge length.
    reach_all : bool
        Whether there is a path from each vertex.
    windows : float, optional
        Windows of exact distances, extrapolated from the vertices nearest to the sources.
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
    """Properties on which the cost of `geodesic` depends: paths from the sources, and curves.

    Parameters
    ----------
    paths, paths_of_one : EdgePaths, optional
        Paths from all sources together, and from the first source alone.
    crossings_per_length : float
        Edges that a straight line of unit length crosses.
    mean_chord : float
        Mean length of straight lines from boundary to boundary.
    starts_at_boundary : bool
        Whether the first source is a boundary vertex.
    total_edge_length, extent : float
        Total length of the edges, and half the diagonal of the bounding box.
    n_legs : int
        Pairs of successive way-points of straightened and edge paths.
    leg_length : float
        Mean distance in space of such a pair.
    field_length : float, optional
        Length of an integral curve.
    field_steps : int, optional
        Number of fixed steps of an integral curve.
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
    """Properties on which the cost of `laplacian` depends.

    Parameters
    ----------
    signature_pairs : int
        Eigenpairs of heat kernel signatures.
    n_components, equal_components : int
        Number of connected components, and largest number of equal ones.
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
    """Properties on which the cost of `tradeoff` depends, besides those of the compared command.

    Parameters
    ----------
    ball_work : float
        Seconds of the rows with balls, over those on a sphere.
    share : float
        Fraction of the faces for which all rows would fit into the time budget.
    """

    ball_work: float = 1.0
    share: float = 1.0
