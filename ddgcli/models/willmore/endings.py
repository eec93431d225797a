"""Why flows end."""

from __future__ import annotations

from enum import StrEnum

from ddgcli.models.willmore.step_rules import FILM_REST_FALL, REST_FALL, REST_GRADIENT
from ddgcli.simulation.model import Ending


class EndingKind(StrEnum):
    """State of the surface at the end of a flow.

    `LIMIT` is a criterion looser than rest: one that the user chose, or that of conformal flows. At an
    `IMMOVABLE` end no vertex can move, at that of an `EMPTY_PATCH` since the patches have none. `UNRESOLVED`
    ends are neither at rest nor on the flow.
    """

    AT_REST = "at rest"
    MESH_ERROR = "at rest but for the mesh's error"
    EQUAL_CURVATURE = "equal curvature"
    LIMIT = "limit"
    IMMOVABLE = "immovable"
    EMPTY_PATCH = "empty patch"
    COLLAPSED = "collapsed"
    SINGULAR = "singular"
    UNRESOLVED = "unresolved"


VANISHED_ENERGY = Ending(EndingKind.AT_REST, "the energy has vanished")
ROUNDING = Ending(EndingKind.AT_REST, "rounding hides what the energy could still fall by")
NO_STEP = Ending(EndingKind.AT_REST, "no step lowers the energy")
MESH_ERROR = Ending(EndingKind.MESH_ERROR, "what is left of the gradient is the mesh's own error")
UNEVEN_FILM = Ending(
    EndingKind.MESH_ERROR,
    "curvature equal but for the mesh's own error: it has no film of equal curvature nearby",
)
EMPTY_PATCH = Ending(EndingKind.EMPTY_PATCH, "no vertex can move: the patches have no vertices inside")
COLLAPSE = Ending(EndingKind.COLLAPSED, "the surface collapsed")
LOWER_BOUND = Ending(
    EndingKind.UNRESOLVED,
    "the next step would go below the least energy of such surfaces: the mesh is too coarse or uneven",
)
FALSE_REST = Ending(
    EndingKind.UNRESOLVED,
    "what is left of the gradient is the mesh's own error, but the energy is above that of spheres: the mesh "
    "is too coarse somewhere",
)
FALSE_TORUS_REST = Ending(
    EndingKind.UNRESOLVED,
    "what is left of the gradient is the mesh's own error, but the energy is above that of the Clifford "
    "torus",
)
SLOW_NEWTON = Ending(
    EndingKind.UNRESOLVED,
    "steps hardly lower the energy, but it is above that of spheres: the mesh is too coarse somewhere",
)
CRUMPLING = Ending(
    EndingKind.UNRESOLVED, "a second energy rises faster than this one falls: the faces crumple"
)
NOT_CONFORMAL_REST = Ending(
    EndingKind.UNRESOLVED,
    "no conformal step lowers the energy, but the curvature is less even than its conformal class allows",
)
PINCH = Ending(EndingKind.UNRESOLVED, "the surface pinches off: no film of this topology spans the boundary")
THIN_STAR = Ending(EndingKind.UNRESOLVED, "the closed surface pinches off, or its triangles were too slender")
FOLDED = Ending(EndingKind.UNRESOLVED, "faces are folded over: the triangles were too slender")


def small_gradient(limit: float) -> Ending:
    """Ending by a gradient below a limit.

    Parameters
    ----------
    limit : float

    Returns
    -------
    Ending
        At rest where the limit is at most the default one.
    """
    return Ending(_kind_of_limit(limit, REST_GRADIENT), f"gradient below {limit:g}")


def small_fall(limit: float, of_area: bool) -> Ending:
    """Ending by a relative fall of the energy below a limit.

    Parameters
    ----------
    limit : float
    of_area : bool
        The energy is an area or a volume.

    Returns
    -------
    Ending
        At rest where the limit is at most the default one.
    """
    kind = _kind_of_limit(limit, FILM_REST_FALL if of_area else REST_FALL)
    return Ending(kind, f"energy fell by less than {limit:g} of itself in a step")


def small_area_fall(limit: float) -> Ending:
    """Ending by a relative fall of the area below a limit, in mean curvature flow.

    Parameters
    ----------
    limit : float

    Returns
    -------
    Ending
    """
    return Ending(_kind_of_limit(limit, REST_FALL), f"area fell by less than {limit:g} of itself in a step")


def _kind_of_limit(limit: float, rest: float) -> EndingKind:
    return EndingKind.AT_REST if limit <= rest else EndingKind.LIMIT


def equal_curvature(variation: float, at_all_vertices: bool = False) -> Ending:
    """Ending of a film whose curvature varies less than a limit.

    Parameters
    ----------
    variation : float
    at_all_vertices : bool
        Also by the balance along the surface.

    Returns
    -------
    Ending
    """
    place = "at all vertices " if at_all_vertices else ""
    return Ending(EndingKind.EQUAL_CURVATURE, f"curvature equal {place}to {variation:g}")


def immovable(boundary: str, in_region: bool) -> Ending:
    """Ending of a flow that moves no vertex.

    Parameters
    ----------
    boundary : str
        Of WILLMORE_BOUNDARIES.
    in_region : bool
        Only a region may move.

    Returns
    -------
    Ending
    """
    place, beside = " of the region" * in_region, ", or beside it" * (boundary == "clamped")
    text = f"no vertex can move: all{place} lie on the boundary, which is {boundary}{beside}"
    return Ending(EndingKind.IMMOVABLE, text)


def singular(time: float) -> Ending:
    """Ending of mean curvature flow where the last component became singular.

    Parameters
    ----------
    time : float

    Returns
    -------
    Ending
    """
    return Ending(
        EndingKind.SINGULAR,
        f"the surface became singular at time {time:.6g}: most of it has shrunk to lines, or its faces are "
        "too slender",
    )
