"""From a mesh and options to a flow."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshError, ParameterError
from ddgcli.evolve.loop import Model
from ddgcli.geometry.extrinsic import enclosed_volume
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.willmore.constraints import Constraints, area
from ddgcli.models.willmore.energies import ENERGIES
from ddgcli.models.willmore.flow import LONGEST, Flow, FlowState, Stop
from ddgcli.models.willmore.scaled import centred_at_unit_size

log = logging.getLogger("ddgcli")

FLOWS = ("quadratic", "mean-curvature")
BOUNDARIES = ("clamped", "fixed")


@dataclass(frozen=True)
class Wishes:
    """Options of a flow.

    Parameters
    ----------
    energy, flow, boundary : str
        Of ENERGIES, FLOWS, BOUNDARIES.
    fix_area, fix_volume : bool
    timed : bool
        Steps of a given length, second order in time; else the longest that descend.
    stop : Stop
    """

    energy: str = "sullivan"
    flow: str = "quadratic"
    boundary: str = "clamped"
    fix_area: bool = False
    fix_volume: bool = False
    timed: bool = False
    stop: Stop = Stop()


def free_vertices(topology: Topology, boundary: str) -> NDArray[np.int64]:
    """Vertices that move: `fixed` holds the boundary, `clamped` also its neighbours (and so the normals)."""
    held = np.array(topology.boundary_vertex)
    if boundary == "clamped":
        held[topology.faces[held[topology.faces].any(axis=1)]] = True
    return np.flatnonzero(topology.referenced_vertex & ~held)


def build(mesh: TriangleMesh, wishes: Wishes) -> tuple[Flow, Model]:
    """The flow of a mesh, and the model that the time loop drives.

    Raises
    ------
    MeshError, ParameterError
        On a mesh or a wish that the flow cannot take.
    """
    for value, known, what in (
        (wishes.energy, tuple(ENERGIES), "energy"),
        (wishes.flow, FLOWS, "flow"),
        (wishes.boundary, BOUNDARIES, "boundary"),
    ):
        if value not in known:
            raise ParameterError(f"{what} {value!r} is not available; choose one of {', '.join(known)}")
    unit, centre, scale = centred_at_unit_size(mesh)
    topology = mesh.topology
    free = free_vertices(topology, wishes.boundary)
    if len(free) == 0:
        raise MeshError(
            "no vertex can move: all lie on the boundary or (--boundary clamped) beside it; refine the mesh"
        )
    if wishes.fix_volume and not topology.is_closed:
        raise ParameterError("--fix-volume needs a closed surface; this one has a boundary")
    mean_curvature = wishes.flow == "mean-curvature"
    if mean_curvature and (wishes.fix_area or wishes.fix_volume):
        raise ParameterError("--flow mean-curvature keeps neither area nor volume; use --flow quadratic")
    constraints = Constraints(
        area(unit) if wishes.fix_area else None, enclosed_volume(unit) if wishes.fix_volume else None
    )
    if constraints.volume is not None and abs(constraints.volume) < 1e-9:
        raise MeshError("the surface encloses no volume; --fix-volume has nothing to keep")
    energy = ENERGIES[wishes.energy].build(topology)
    started = energy.value(unit.points)
    if not math.isfinite(started):
        raise MeshError(
            f"the {wishes.energy} energy is not finite here: at some vertex the faces' normals cancel; "
            "unfold it or use --energy cotan"
        )
    flow = Flow(
        topology,
        energy,
        free,
        constraints,
        mean_curvature,
        wishes.timed,
        wishes.stop,
        centre,
        scale,
        area(unit),
    )
    start = FlowState(unit.points, started, 0.0, longest_step(flow))
    model = Model(start, flow.advance, flow.observe, flow.pack, flow.unpack, stop=lambda state: state.stopped)
    return flow, model


def longest_step(flow: Flow) -> float:
    """First step of the descent, at unit size."""
    return LONGEST * (flow.area / (4.0 * math.pi)) ** 2
