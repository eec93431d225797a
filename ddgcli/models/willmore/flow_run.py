"""Run of a flow: what the time loop needs before it, and the results after it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import ParameterError
from ddgcli.mesh.midpoint_subdivision import MidpointSubdivision
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.willmore import report, setup
from ddgcli.models.willmore.flow import Flow
from ddgcli.models.willmore.flow_options import FlowOptions, with_stop
from ddgcli.models.willmore.option_checks import chosen_scheme
from ddgcli.models.willmore.self_intersections import report_of
from ddgcli.simulation.frames import mesh_of_frame
from ddgcli.simulation.model import Model, Schedule
from ddgcli.simulation.outcome import Outcome


@dataclass(frozen=True, eq=False)
class FlowRun:
    """A flow of a mesh that is ready to run; see `flow_run`.

    Parameters
    ----------
    mesh : TriangleMesh
        Subdivided, and with patches in its holes, where that is chosen.
    options : FlowOptions
        With every default.
    flow : Flow
    model : Model
    schedule : Schedule
    bounded : bool
        The user chose the steps or the duration.
    region : (n,) ndarray of bool or None
    unfilled : TriangleMesh or None
        The surface without the patches that `mesh` adds to it; they are the region.
    """

    mesh: TriangleMesh
    options: FlowOptions
    flow: Flow
    model: Model
    schedule: Schedule
    bounded: bool
    region: NDArray[np.bool_] | None
    unfilled: TriangleMesh | None

    @property
    def description(self) -> dict[str, Any]:
        """The options and the region as plain data, which a resumed run must repeat."""
        region = "" if self.region is None else sha256(self.region.tobytes()).hexdigest()
        return {"options": asdict(self.options), "region": region}

    def failure_reason(self, outcome: Outcome) -> str:
        """Why a run that came to its end is unreliable, with a warning; or ""."""
        return report.failure_reason(
            outcome.ending, self.mesh, self._last(outcome), self.options, bounded=self.bounded
        )

    def summary(self, outcome: Outcome) -> tuple[dict[str, Any], dict[str, Any]]:
        """Results and accuracy of a run, with warnings of what its frames show."""
        series, last = outcome.series, self._last(outcome)
        times = outcome.times if self.flow.timed else None
        results, accuracy = report.summary(
            series, self.flow.convention, self.schedule.steps, outcome.ending, outcome.failure,
            bounded=self.bounded, times=times,
        )  # fmt: skip
        results["self_intersections"] = report_of(series, times, last)
        results |= report.component_results(last)
        report.warn_of_closed_hole(series, times, last)
        report.warn_of_surfaces(self.mesh, last, self.options, results["energy"][0], self.unfilled)
        if self.unfilled is not None and self.region is not None:
            n_faces = self.mesh.n_faces - self.unfilled.n_faces
            results["patch"] = {"vertices": int(self.region.sum()), "faces": n_faces}
        if self.options.report_energy:
            results["energies"] = report.every_energy(series)
        return results, accuracy

    def _last(self, outcome: Outcome) -> TriangleMesh:
        return self.mesh if outcome.last is None else mesh_of_frame(self.mesh, outcome.last)


def flow_run(
    mesh: TriangleMesh,
    options: FlowOptions,
    times: Mapping[str, Any],
    *,
    region: NDArray | None = None,
    fill: int | str | None = None,
    subdivision: MidpointSubdivision | None = None,
) -> FlowRun:
    """Build the run of a flow from the options that the user chose.

    Parameters
    ----------
    mesh : TriangleMesh
    options : FlowOptions
        As chosen; what follows from `times` and from the mesh is filled in.
    times : mapping
        `steps`, `duration`, `step`, `frame_every`, `tolerance`; None or absent where not chosen.
    region : (n,) or (k,) ndarray, optional
        Vertices of `mesh` that may move, in a form of `region_mask`.
    fill : int or 'all', optional
        Vertex on the boundary loop to close; only its patch moves. See `fill_loops`.
    subdivision : MidpointSubdivision, optional
        Of `mesh`: the surface that flows.

    Returns
    -------
    FlowRun

    Raises
    ------
    MeshError, ParameterError
        On a mesh or an option that the flow cannot take.
    """
    if fill is not None and region is not None:
        raise ParameterError("moves the new patch only; leave `region` out", parameter="fill")
    mask, unfilled = None if region is None else setup.region_mask(region, mesh.topology), None
    if subdivision is not None:
        mesh, mask = subdivision.mesh, None if mask is None else subdivision.vertex_mask(mask)
    if fill is not None:
        from ddgcli.algorithms.repair.patches import fill_loops  # with all of scipy.spatial

        unfilled = mesh
        mesh, mask = fill_loops(mesh, fill)
    options = replace(options, timed=any(times.get(name) for name in ("step", "duration")))
    chosen_scheme(options)
    bounded = any(times.get(name) for name in ("steps", "duration"))
    options = with_stop(options, mesh.topology, bounded)
    flow, model = setup.build(mesh, options, mask)
    return FlowRun(mesh, options, flow, model, setup.schedule(flow, times), bounded, mask, unfilled)
