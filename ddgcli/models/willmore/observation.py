"""What a frame of a flow shows of its surface besides the energy."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.intrinsic import corner_angle
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.willmore.constraints import Constraints, area, reduced_volumes, volume_inside
from ddgcli.models.willmore.film_polish import mean_curvature_spread
from ddgcli.models.willmore.state import FlowState
from ddgcli.simulation.model import Observation


def measured(
    mesh: TriangleMesh, constraints: Constraints, scale: float, n_components: int
) -> dict[str, float]:
    """Area, smallest angle, volume and reduced volume of a surface.

    The volume of a closed surface, or of one whose constraints have caps; the reduced volume of a closed one
    of one component.

    Parameters
    ----------
    mesh : TriangleMesh
        At unit size.
    constraints : Constraints
    scale : float
        Length unit of `mesh` in units of the input.
    n_components : int
        At the start: components that have ended are not part of `mesh`.

    Returns
    -------
    dict of str to float
        In the unit of the input.
    """
    total = area(mesh)
    scalar = {
        "area": total * scale**2,
        "min_angle_degrees": float(np.degrees(corner_angle(mesh.side_length).min())),
    }
    closed = mesh.topology.is_closed
    if closed or constraints.caps is not None:
        volume = volume_inside(mesh, constraints.caps)
        scalar["volume"] = volume * scale**3
        if closed:
            if n_components == 1:
                scalar["reduced_volume"] = float(reduced_volumes(mesh)[0])
            if constraints.in_place:
                scalar["mean_curvature_spread"] = mean_curvature_spread(mesh)
    for name, residual in constraints.residuals(mesh).items():
        scalar[f"{name}_residual"] = float(residual[np.abs(residual).argmax()])
    return scalar


def relative_distance(a: FlowState, b: FlowState, area: float) -> float:
    """Largest distance between the vertices of two states, relative to the radius of the sphere of an area.

    Parameters
    ----------
    a, b : FlowState
    area : float

    Returns
    -------
    float
    """
    apart = np.sqrt(np.max(np.sum((a.points - b.points) ** 2, axis=1), initial=0.0))
    return float(apart / math.sqrt(area / (4.0 * math.pi)))


def frame_of(
    state: FlowState, scalar: dict[str, float], original: NDArray, movable: NDArray, scale: float,
    centre: NDArray, own_faces: bool,
) -> Observation:  # fmt: skip
    """A state's surface in the input's frame.

    Parameters
    ----------
    state : FlowState
    scalar : dict of str to float
    original : (m, 3) ndarray
        Positions of the input, which vertices that stay have to the last bit.
    movable : (n,) ndarray of bool
        Of the state's vertices.
    scale : float
    centre : (3,) ndarray
    own_faces : bool
        Faces change.

    Returns
    -------
    Observation
    """
    origin = state.remeshing.origin
    at_start = original if origin is None else original[origin]
    moved = movable if state.steps else np.zeros_like(movable)
    points = np.where(moved[:, None], state.points * scale + centre, at_start)
    vertex = {} if origin is None else {"input_vertex": origin}
    return Observation(points, vertex, scalar, faces=state.topology.faces if own_faces else None)


def counters(state: FlowState, energy_unit: float) -> dict[str, Any]:
    """Energy and counts of a state; of its remeshings and the ends of its components where there may be some.

    Parameters
    ----------
    state : FlowState
    energy_unit : float
        Unit of the state's energy in that of the output.

    Returns
    -------
    dict of str to float or (c,) ndarray
    """
    scalar: dict[str, Any] = {
        "energy": state.energy * energy_unit,
        "steps": float(state.steps),
        "energy_increases": float(state.increases),
        "area_increases": float(state.area_increases),
        "redistributions": float(state.redistributions),
        "flips": float(state.flips),
        "large_constant_steps": float(state.large_constant_steps),
        "self_intersections": float(state.self_intersections),
    }
    if len(state.ends.time):
        scalar["end_time_by_component"] = np.nan_to_num(state.ends.time, nan=-1.0)
        scalar["singular_by_component"] = state.ends.singular.astype(np.float64)
    if state.remeshing.origin is not None:
        scalar["remeshes"] = float(state.remeshing.count)
        scalar["remesh_energy_change"] = state.remeshing.change * energy_unit
    return scalar
