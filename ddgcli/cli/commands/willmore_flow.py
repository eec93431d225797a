"""`ddgcli willmore-flow`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from ddgcli.choices import WILLMORE_BOUNDARIES, WILLMORE_ENERGIES, WILLMORE_FLOWS
from ddgcli.cli import options
from ddgcli.cli.options import CommonOptions
from ddgcli.cli.run import Run
from ddgcli.cli.simulation.options import FlowInput, flow_time_options
from ddgcli.errors import ParameterError

if TYPE_CHECKING:
    from ddgcli.io.mesh_file import MeshInput
    from ddgcli.mesh.midpoint_subdivision import MidpointSubdivision


def _names(names: tuple[str, ...]) -> str:
    """Metavar of an option that takes one of these names."""
    return f"[{'|'.join(names)}]"


@click.command(
    "willmore-flow",
    epilog="Choosing a method: no --dt for the shape of least energy; --dt and --duration for the flow in "
    "time, with --integrator rosenbrock (the default, second order) or semi-implicit (first order, a "
    "quarter cheaper per step; mean-curvature has no other). --energy gauss-map for closed surfaces, "
    "cotan for open ones; the other energies are for comparison. See "
    "docs/willmore-flow.md and docs/accuracy/willmore-flow.md.",
)
@click.argument("mesh_path", metavar="MESH", type=click.Path(readable=False), cls=FlowInput)
@options.common
@flow_time_options
@options.subdivide
@click.option(
    "--flow", default="quadratic", show_default=True, metavar=_names(WILLMORE_FLOWS), help="Method."
)
@click.option(
    "--energy",
    metavar=_names(WILLMORE_ENERGIES),
    help="Discrete bending energy.  [default: gauss-map; with a boundary cotan]",
)
@click.option(
    "--boundary",
    metavar=_names(WILLMORE_BOUNDARIES),
    help="What stays fixed at the boundary.  [default: clamped; mean-curvature: fixed]",
)
@click.option("--fix-area", is_flag=True, help="Keep the area of each component.")
@click.option("--fix-volume", is_flag=True, help="Keep the volume that each component encloses.")
@click.option(
    "--fill",
    metavar="LOOP",
    help="First close the boundary loop through this vertex (or all) with a patch; move the patch only.",
)
@click.option(
    "--spontaneous-curvature",
    metavar="H0",
    type=options.REAL_NUMBER,
    help="Minimise int (H - H0)^2; unit 1/length, positive as on a sphere. Needs --fix-area or --fix-volume.",
)
@click.option(
    "--stop-gradient",
    type=options.POSITIVE_NUMBER,
    help="Stop when |gradient| area / energy is below this.  [default: 1e-6]",
)
@click.option(
    "--stop-energy",
    type=options.POSITIVE_NUMBER,
    help="Stop when a step lowers the energy by less than this fraction.  [default: 1e-8]",
)
@click.option(
    "--remesh",
    metavar="LENGTH",
    help="Split, collapse and flip edges towards this length during the flow; mean: that of the input.",
)
@click.option("--remesh-adaptive", is_flag=True, help="With --remesh: shorter where the surface is curved.")
@click.option("--report-energy", metavar="all", help="Report every energy at every frame.")
@click.option(
    "--region",
    metavar="ARRAY|FILE",
    help="Move these vertices only: an array of the input, or a file: a value per vertex (0: fixed), or "
    "vertex indices.",
)
def command(
    mesh_path: str,
    common: CommonOptions,
    overrides: dict[str, Any],
    resume: str | None,
    subdivide: int,
    **parameters: Any,
) -> None:
    """Gradient flow of the bending energy int H^2 of MESH (or of its area).

    Without --dt and --duration the flow minimises: each step is as long as the decrease of the energy allows,
    and the flow stops at a stationary shape. With them, steps follow the flow in time. Time is in length^4,
    where length is the unit of MESH; with --flow mean-curvature in length^2.

    \b
    Examples:
      ddgcli willmore-flow torus.obj -o clifford.ply
      ddgcli willmore-flow bumpy.obj --dt 1e-4 --duration 0.05 -o run.vtkhdf
      ddgcli willmore-flow cap.off --boundary clamped --fix-area --report-energy all
    """
    stated_options = {k: v for k, v in parameters.items() if v} | (
        {"subdivide": subdivide} if subdivide else {}
    )
    run = Run("willmore-flow", common, **overrides, **stated_options)
    source = run.read(mesh_path, flat_faces=True, subdivide=subdivide)
    from ddgcli.cli.simulation.first_steps import begin_flow
    from ddgcli.cli.simulation.plot import Picture, draw_run
    from ddgcli.cli.simulation.simulate import Job, simulate
    from ddgcli.models.willmore.flow_run import flow_run
    from ddgcli.simulation.account import Account

    flow_options = _flow_options(parameters, overrides)
    base, subdivision = _with_subdivision(source)
    region, fill = _region(base, parameters["region"]), _vertex_or_name(parameters["fill"])
    built = flow_run(base.surface, flow_options, overrides, region=region, fill=fill, subdivision=subdivision)
    described = {**built.description, "time": overrides, "subdivide": subdivide, "fill": parameters["fill"]}
    time_unit = "L²" if parameters["flow"] == "mean-curvature" else "L⁴"  # L: the input's length unit
    job = Job(
        {"surface": built.model}, [built.mesh], built.schedule, Account(), moving=True, resume=resume,
        **_stored_texts(described, source.sha256, resume, time_unit),
        changing_faces=built.flow.keeps_triangles,
        changing_vertices=built.flow.remesh is not None,
        failure_reason=built.failure_reason,
    )  # fmt: skip
    begin_flow(run, job, bounded=built.bounded)
    outcome = simulate(run, job)
    results, accuracy = built.summary(outcome)
    picture = Picture(edges=True, energy="energy", time_unit=time_unit)
    run.plot(lambda path: draw_run(path, outcome, picture, common))
    run.finish(results, accuracy, converged=not (outcome.failure or outcome.failure_reason))


def _stored_texts(
    described: dict[str, Any], input_hash: str, resume: str | None, unit: str
) -> dict[str, Any]:
    """Attributes and texts of the trajectory: what ran; raise an error for a resumed run that differs."""
    from ddgcli.cli.simulation.scene_input import check_unchanged, fingerprint

    resolved, digest = fingerprint(described, {"mesh": input_hash})
    check_unchanged(resume, resolved, noun="options")
    return {
        "attributes": {"input_sha256": digest, "time_unit": unit},
        "texts": {"scene_source": "", "scene_resolved": resolved},
    }


def _with_subdivision(source: MeshInput) -> tuple[MeshInput, MidpointSubdivision | None]:
    """The input as it was read, and the subdivision of its surface; None without `--subdivide`."""
    from ddgcli.cli.subdivided_input import SubdividedInput

    return (source.base, source.subdivision) if isinstance(source, SubdividedInput) else (source, None)


def _vertex_or_name(loop: str | None) -> int | str | None:
    """The number in the text of `--fill`; `all` and None as they are."""
    return int(loop) if loop is not None and loop.isdecimal() else loop


def _region(base: MeshInput, name: str | None) -> Any:
    """Array of the vertices that `--region` names; None without it."""
    if name is None:
        return None
    from ddgcli.io.arrays import input_array

    values, place = input_array(base, name, parameter="region")
    if place not in ("vertex", ""):
        raise ParameterError(f"{name!r} is a {place} array; name one of the vertices", parameter="region")
    return values


def _flow_options(parameters: dict[str, Any], overrides: dict[str, Any]) -> Any:
    from ddgcli.models.willmore.flow_options import FlowOptions, remesh_length
    from ddgcli.models.willmore.state import Stop

    return FlowOptions(
        **{name: parameters[name] for name in ("energy", "flow", "boundary", "fix_area", "fix_volume")},
        spontaneous_curvature=parameters["spontaneous_curvature"] or 0.0,
        remesh=remesh_length(parameters["remesh"]),
        remesh_adaptive=parameters["remesh_adaptive"],
        report_energy=parameters["report_energy"],
        integrator=overrides.get("integrator"),
        stop=Stop(parameters["stop_gradient"], parameters["stop_energy"]),
    )
