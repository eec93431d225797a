"""Size of an input, and one use of a kernel."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ddgcli.choices import ITERATIVE_SOLVERS

__all__ = ["KNOWN", "EdgePaths", "InputSize", "Range", "Use", "iterative_suffix"]

Range = tuple[float, float]

KNOWN: Range = (1.0, 1.0)


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
class InputSize:
    """Size of an input.

    Parameters
    ----------
    kind : {'surface', 'tetrahedra', 'curve'}
    elements : int
        Faces, tetrahedra or points of curves; of several inputs the sum.
    edge_length : float, optional
        Mean length of an edge, for costs of neighbourhoods.
    steps : int, optional
        Steps of a simulation, where they are known.
    frame_count : int
        Frames that are written or drawn.
    component_elements : int, optional
        Elements of the largest connected component; default all.
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
    noise : str
        Kind of the noise of the vertices that curvature searches, '' of none.
    fitted_pairs : tuple of float
        Vertices in the balls of a radius that the search for noise fits, for each radius.
    sheared : bool
        Whether curvature tries the neighbours of the Delaunay triangulation.
    adaptive : bool
        `steps` counts frames, between which the steps adapt.
    paths, paths_of_one : EdgePaths, optional
        From all sources together, and from the first alone.
    ball_work : float, optional
        Pairs of a ball with a vertex or face within the radius of curvature.
    signature_pairs : int
        Eigenpairs of heat kernel signatures.
    crossings_per_length : float
        Edges that a straight line of unit length crosses.
    picture_share : float
        Of the pixels of a picture, those that show the surface.
    compactness : float
        Boundary faces of a cube of as many tetrahedra over those of the solid, at most 1: thin solids have
        small separators.
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
        Length of an integral curve in its time; `steps` counts its fixed steps.
    n_components, equal_components : int
        Connected components, and the most that are alike.
    offset_faces : int, optional
        Of an offset body.
    n_curves : int
    betti_number : int
        Of the harmonic fields.
    hole_triangles : float
        Triangles among which the fillings of the holes are chosen.
    compared_work : float
        Seconds of the rows of a comparison with balls over those on a sphere.
    compared_share : float
        Share of the faces that all rows of a comparison would have within its budget.
    """

    kind: str
    elements: int
    edge_length: float | None = None
    steps: int | None = None
    frame_count: int = 1
    component_elements: int | None = None
    angle_deficit: float | None = None
    angle_contrast: float | None = None
    corridor_aspect: float = 0.0
    most_points: float = math.inf
    crossings_per_root_face: float = 0.0
    further_overlay_faces: int = 0
    noise: str = ""
    fitted_pairs: tuple[float, ...] = ()
    sheared: bool = False
    adaptive: bool = False
    paths: EdgePaths | None = None
    paths_of_one: EdgePaths | None = None
    ball_work: float | None = None
    signature_pairs: int = 0
    n_components: int = 1
    equal_components: int = 1
    offset_faces: int | None = None
    n_curves: int = 1
    crossings_per_length: float = 0.0
    mean_chord: float = math.inf
    starts_at_boundary: bool = False
    total_edge_length: float = 0.0
    extent: float = 0.0
    n_legs: int = 0
    leg_length: float = 0.0
    field_length: float | None = None
    compactness: float = 1.0
    picture_share: float = 0.5
    betti_number: int = 0
    hole_triangles: float = 0.0
    compared_work: float = 1.0
    compared_share: float = 1.0


@dataclass(frozen=True)
class Use:
    """One use of a kernel of the table `COEFFICIENTS`.

    Parameters
    ----------
    kernel : str
    times : float
        Factor of its seconds.
    added : float
        Factor of its memory that other kernels do not free; 0: the kernels of a command share memory, and
        the largest counts.
    elements : float, optional
        On which it works, where these are not the elements of the input.
    range : (float, float)
        Least and largest factor of `times`, where only the run shows how long it is.
    assumes : str
        What `times` takes for granted, where only the run shows it.
    once : bool
        `times` counts the part of its seconds that grows with the elements only, not the constant one.
    """

    kernel: str
    times: float = 1.0
    added: float = 0.0
    elements: float | None = None
    range: Range = KNOWN
    assumes: str = ""
    once: bool = False


def iterative_suffix(options: Mapping[str, Any]) -> str:
    """End of the names of kernels that solve linear systems, by the solver: nothing for factorisations."""
    return f" {options['solver']}" if options.get("solver") in ITERATIVE_SOLVERS else ""
