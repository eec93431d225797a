"""Run of a curve flow: what the time loop needs before it, and the results after it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from ddgcli.mesh.curve import CurveSet
from ddgcli.models.curve import report, setup
from ddgcli.models.curve.flow import CurveFlow
from ddgcli.simulation.model import Model, Schedule
from ddgcli.simulation.outcome import Outcome


@dataclass(frozen=True, eq=False)
class CurveFlowRun:
    """A flow of curves that is ready to run; see `curve_flow_run`.

    Parameters
    ----------
    curves : CurveSet
        Without repeated points.
    options : CurveFlowOptions
    flow : CurveFlow
    model : Model
    schedule : Schedule
    bounded : bool
        The user chose the steps or the duration.
    """

    curves: CurveSet
    options: setup.CurveFlowOptions
    flow: CurveFlow
    model: Model
    schedule: Schedule
    bounded: bool

    def failure_reason(self, outcome: Outcome) -> str:
        """Why a run that came to its end is unreliable; or ""."""
        return "a fold" if report.folds_back(outcome.series) else ""

    def summary(self, outcome: Outcome) -> tuple[dict[str, Any], dict[str, Any]]:
        """Results and accuracy of a run, with warnings of what its frames show."""
        return report.summary(
            self.flow, outcome.times, outcome.series, self.schedule.steps, outcome.ending, outcome.failure
        )


def curve_flow_run(
    curves: CurveSet, options: setup.CurveFlowOptions, times: Mapping[str, Any]
) -> CurveFlowRun:
    """Build the run of a curve flow from the options that the user chose.

    Parameters
    ----------
    curves : CurveSet
    options : CurveFlowOptions
        Without `steps` and `duration` the flow stops at rest.
    times : mapping
        `steps`, `duration`, `step`, `frame_every`, `tolerance`; None or absent where not chosen.

    Returns
    -------
    CurveFlowRun

    Raises
    ------
    MeshError, ParameterError
        On curves or options that the flow cannot take.
    """
    curves = setup.without_repeated_points(curves)
    bounded = any(times.get(name) for name in ("steps", "duration"))
    options = replace(options, stop_at_rest=not bounded)
    flow, model = setup.build(curves, options)
    return CurveFlowRun(curves, options, flow, model, setup.schedule(flow, times), bounded)
