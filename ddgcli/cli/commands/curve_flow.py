"""`ddgcli curve-flow`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import click

from ddgcli.choices import CURVE_FLOWS
from ddgcli.cli import options
from ddgcli.cli.options import CommonOptions
from ddgcli.cli.run import Run
from ddgcli.cli.simulation.options import FlowInput, curve_time_options

if TYPE_CHECKING:
    from ddgcli.mesh.curve import CurveSet
    from ddgcli.simulation.outcome import Outcome


@click.command(
    "curve-flow",
    epilog="Choosing a flow: curvature shortens curves until they vanish; area-preserving rounds closed "
    "plane curves; elastic straightens bends at constant length. See docs/curve-flow.md.",
)
@click.argument("mesh_path", metavar="CURVE", type=click.Path(readable=False), cls=FlowInput)
@options.common
@curve_time_options
@click.option(
    "--flow",
    type=click.Choice(CURVE_FLOWS),
    default="curvature",
    show_default=True,
    help="Gradient flow of the length, of the length at constant area, of int kappa^2 at constant length.",
)
@click.option(
    "--length-penalty",
    type=options.NONNEGATIVE_NUMBER,
    metavar="W",
    help="Elastic flow: minimise int kappa^2 + W length (0: the free flow) instead of keeping the length.",
)
@click.option(
    "--redistribute/--no-redistribute",
    default=True,
    show_default=True,
    help="Move points along the curve towards equal distances.",
)
def command(
    mesh_path: str,
    common: CommonOptions,
    overrides: dict[str, Any],
    resume: str | None,
    flow: str,
    length_penalty: float | None,
    redistribute: bool,
) -> None:
    """Gradient flow of the length or the bending energy of the polylines of CURVE, in the plane or in space.

    The ends of open curves stay fixed. A curve that shrinks to a point stays there; the flow ends when all
    have, and without --steps and --duration when no curve moves. Time is in length^2, where length is the
    unit of CURVE; with --flow elastic in length^4.

    \b
    Examples:
      ddgcli curve-flow ellipse.csv -o circle.vtkhdf --flow area-preserving
      ddgcli curve-flow trefoil.obj --flow elastic --plot trefoil.png
    """
    flow_options: dict[str, Any] = {"flow": flow, "redistribute": redistribute}
    if length_penalty is not None:
        flow_options["length_penalty"] = length_penalty
    run = Run("curve-flow", common, **overrides, **flow_options)
    source = run.read(mesh_path, accept=("curve",))
    from ddgcli.cli.simulation.first_steps import begin_flow
    from ddgcli.cli.simulation.scene_input import check_unchanged, fingerprint
    from ddgcli.cli.simulation.simulate import Job, simulate
    from ddgcli.mesh.curve import CurveSet
    from ddgcli.models.curve.flow_run import curve_flow_run
    from ddgcli.models.curve.setup import CurveFlowOptions
    from ddgcli.simulation.account import Account

    built = curve_flow_run(cast(CurveSet, source.mesh), CurveFlowOptions(**flow_options), overrides)
    resolved, digest = fingerprint({"options": flow_options, "time": overrides}, {"mesh": source.sha256})
    check_unchanged(resume, resolved, noun="options")
    unit = "L⁴" if flow == "elastic" else "L²"  # L: the input's length unit
    objective = "elastic_energy" if flow == "elastic" else "length"
    job = Job(
        {"curve": built.model}, [built.curves], built.schedule, Account(), moving=True, resume=resume,
        attributes={"input_sha256": digest, "time_unit": unit, "objective": objective},
        texts={"scene_source": "", "scene_resolved": resolved},
        failure_reason=built.failure_reason,
    )  # fmt: skip
    begin_flow(run, job, bounded=built.bounded)
    outcome = simulate(run, job)
    results, accuracy = built.summary(outcome)
    run.plot(lambda path: _draw(path, built.curves, outcome, unit, run.picture_options))
    run.finish(results, accuracy, converged=not (outcome.failure or outcome.failure_reason))


def _draw(path: str, curves: CurveSet, outcome: Outcome, unit: str, look: dict[str, Any]) -> None:
    """Draw the curves of a few frames, coloured by time."""
    import numpy as np

    from ddgcli.plots.curve import draw_curves

    paths = curves.paths
    drawn_frames = [curve_frame for curve_frame in outcome.picture_frames if curve_frame.points is not None]
    positions = [curve_frame.points[path] for curve_frame in drawn_frames for path, _ in paths]  # type: ignore[index]
    times = [np.full(len(path), curve_frame.time) for curve_frame in drawn_frames for path, _ in paths]
    closed = [flag for _ in drawn_frames for _, flag in paths]
    frame_number = [k for k in range(len(drawn_frames)) for _ in paths]
    draw_curves(path, positions, times, closed=closed, groups=frame_number, label=f"time [{unit}]", **look)
