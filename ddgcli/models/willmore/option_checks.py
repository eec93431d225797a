"""Checks of the options of a flow, and the time scheme that they choose."""

from __future__ import annotations

import logging

from numpy.typing import NDArray

from ddgcli.choices import WILLMORE_BOUNDARIES, WILLMORE_ENERGIES, WILLMORE_FLOWS
from ddgcli.errors import MeshError, ParameterError
from ddgcli.mesh.remedies import remedy
from ddgcli.mesh.require import require
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.willmore.flow_options import SCHEMES, FlowOptions

# options of flows in time, which those to rest do not take
TIME_OPTIONS = "`step`, `duration`, `tolerance`, `frame_every` and `integrator`"


def schemes_of(flow: str) -> tuple[str, ...]:
    """Time schemes of a flow, the default first.

    Parameters
    ----------
    flow : str

    Returns
    -------
    tuple of str

    Raises
    ------
    ParameterError
        When there is no such flow.
    """
    _require_known(flow, WILLMORE_FLOWS, "flow")
    return SCHEMES[flow]


def chosen_scheme(options: FlowOptions) -> str:
    """Name of the time scheme: that of the options, or the flow's default.

    Parameters
    ----------
    options : FlowOptions

    Returns
    -------
    str

    Raises
    ------
    ParameterError
        When the flow has no such scheme, or follows no clock.
    """
    schemes = schemes_of(options.flow)
    if options.integrator is None:
        return schemes[0]
    if options.integrator not in schemes:
        raise ParameterError(
            f"{options.integrator!r} is not available with `flow={options.flow}`; choose "
            f"{' or '.join(schemes)}",
            parameter="integrator",
        )
    if not options.timed:
        raise ParameterError(
            "needs `step` or `duration`; steps to rest have no time scheme", parameter="integrator"
        )
    return options.integrator


def check_options(
    mesh: TriangleMesh,
    options: FlowOptions,
    region: NDArray | None,
    energy_name: str,
    boundary: str,
    kind: str,
) -> None:
    """Check that the flow of a mesh can take its options.

    Parameters
    ----------
    mesh : TriangleMesh
    options : FlowOptions
    region : (n,) ndarray of bool or None
        Vertices that may move.
    energy_name, boundary : str
        Those of the options, or the defaults.
    kind : {'descent', 'newton', 'conformal'}
        Kind of the steps.

    Raises
    ------
    MeshError, ParameterError
        When it cannot.
    """
    _require_known(energy_name, WILLMORE_ENERGIES, "energy")
    _require_known(boundary, WILLMORE_BOUNDARIES, "boundary")
    if options.report_energy not in (None, "all"):
        raise ParameterError(f"{options.report_energy!r}: write all", parameter="report_energy")
    _require_rest(mesh.topology, energy_name, options)
    if options.boundary is not None and mesh.topology.is_closed:
        logging.getLogger("ddgcli").warning("`boundary` has no effect on a closed surface")
    chosen_scheme(options)
    if kind == "conformal":
        _require_conformal(mesh, options, region)
    if kind == "newton" and options.timed:
        raise ParameterError(f"`flow=newton` goes to rest: leave {TIME_OPTIONS} out, or use `flow=quadratic`")


def _require_known(value: str, names: tuple[str, ...], parameter: str) -> None:
    if value not in names:
        raise ParameterError(
            f"{value!r} is not available; choose one of {', '.join(names)}", parameter=parameter
        )


def _require_rest(topology: Topology, name: str, options: FlowOptions) -> None:
    """Raise ParameterError where steps to rest would shrink a closed surface to a point."""
    conserved = options.fix_area or options.fix_volume or options.timed
    if name == "quadratic" and options.flow != "mean-curvature" and topology.is_closed and not conserved:
        raise ParameterError(
            "'quadratic' grows with the square of the size: a closed surface would shrink to a point; use "
            "`fix_area`, `step` or another `energy`",
            parameter="energy",
        )


def _require_conformal(mesh: TriangleMesh, options: FlowOptions, region: NDArray | None) -> None:
    """Raise MeshError or ParameterError where `flow=conformal` has no meaning."""
    require(mesh, "`flow=conformal`", closed=True)
    if mesh.topology.n_components != 1:
        raise MeshError(
            f"`flow=conformal` takes one component at a time: {remedy('components', mesh.topology)}"
        )
    if options.fix_area or options.fix_volume or options.spontaneous_curvature:
        raise ParameterError(
            "`flow=conformal` keeps the shapes of the triangles and the area, no volume and "
            "no spontaneous curvature; use `flow=quadratic`"
        )
    if region is not None or options.timed:
        raise ParameterError(
            f"`flow=conformal` moves the whole surface to rest: leave `region`, {TIME_OPTIONS} out"
        )
