"""Options of a flow, and what they choose by default."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ddgcli.errors import ParameterError
from ddgcli.mesh.topology import Topology
from ddgcli.models.willmore.energies import DEFAULT_ENERGY, DEFAULT_OPEN_ENERGY
from ddgcli.models.willmore.state import (
    CONFORMAL_STOP,
    CONSTRAINED_NEWTON_STOP,
    DEFAULT_STOP,
    FILM_STOP,
    NEWTON_STOP,
    Stop,
)

# time schemes of each flow, the default first; `semi-implicit` is of first order
SCHEMES = {
    "quadratic": ("rosenbrock", "semi-implicit"),
    "newton": ("trust-region",),
    "circle-angle": ("rosenbrock", "semi-implicit"),
    "conformal": ("conformal",),
    "mean-curvature": ("semi-implicit",),
}


@dataclass(frozen=True)
class FlowOptions:
    """Options of a flow.

    Parameters
    ----------
    energy : str or None
        Of ENERGIES; None for the default, see `chosen_energy`.
    flow : str
        Of WILLMORE_FLOWS.
    boundary : str or None
        Of WILLMORE_BOUNDARIES; None for the default, see `chosen_boundary`.
    fix_area, fix_volume : bool
    spontaneous_curvature : float
        H0 of int (H - H0)^2, one over the length unit of the input; positive as on a sphere.
    report_energy : 'all', optional
        Every frame has the values of all energies.
    timed : bool
        Steps have the length that the schedule prescribes; else each is as long as the descent allows.
    integrator : str or None
        Of SCHEMES of the flow; None for the default.
    remesh : float or 'mean', optional
        Length of edges, in the unit of the input, that flows to rest keep; mean: that of the input.
    remesh_adaptive : bool
        Edges are shorter where the surface is curved.
    stop : Stop
    """

    energy: str | None = None
    flow: str = "quadratic"
    boundary: str | None = None
    fix_area: bool = False
    fix_volume: bool = False
    spontaneous_curvature: float = 0.0
    report_energy: str | None = None
    timed: bool = False
    integrator: str | None = None
    remesh: str | float | None = None
    remesh_adaptive: bool = False
    stop: Stop = Stop()


def remesh_length(remesh: str | float | None) -> str | float | None:
    """Convert the length of edges that remeshing keeps to a number.

    Parameters
    ----------
    remesh : str, float or None

    Returns
    -------
    'mean', float or None
        'mean' and None as they are.

    Raises
    ------
    ParameterError
        For another text than a number.
    """
    if remesh is None or remesh == "mean":
        return remesh
    try:
        return float(remesh)
    except ValueError:
        raise ParameterError(
            f"{remesh!r} is not a length; write a number, or mean", parameter="remesh"
        ) from None


def chosen_energy(topology: Topology, options: FlowOptions) -> str:
    """Name of the energy: that of the options, else `gauss-map` on closed surfaces and `cotan` on open ones.

    Parameters
    ----------
    topology : Topology
    options : FlowOptions

    Returns
    -------
    str

    Raises
    ------
    ParameterError
        When `gauss-map` is chosen where it does not hold.
    """
    free_slope = chosen_boundary(options) != "clamped" and not topology.is_closed
    if free_slope and options.energy == DEFAULT_ENERGY:
        raise ParameterError(
            f"{DEFAULT_ENERGY!r} leaves the faces at the boundary out, where the slope is free; use "
            f"`energy={DEFAULT_OPEN_ENERGY}` or `boundary=clamped`",
            parameter="energy",
        )
    if options.flow == "circle-angle":
        if options.energy not in (None, "circle-angle"):
            raise ParameterError(
                "`flow=circle-angle` lowers its own energy; use `flow=quadratic`", parameter="energy"
            )
        return "circle-angle"
    return options.energy or (DEFAULT_ENERGY if topology.is_closed else DEFAULT_OPEN_ENERGY)


def chosen_boundary(options: FlowOptions) -> str:
    """Name of the boundary condition: that of the options, else `clamped`, for soap films `fixed`.

    Parameters
    ----------
    options : FlowOptions

    Returns
    -------
    str
    """
    return options.boundary or ("fixed" if options.flow == "mean-curvature" else "clamped")


def is_film(options: FlowOptions, topology: Topology) -> bool:
    """Whether a mean curvature flow goes to rest: area or volume is conserved, or there is a boundary.

    Otherwise the surface shrinks to a point, and steps follow the flow in time.

    Parameters
    ----------
    options : FlowOptions
    topology : Topology

    Returns
    -------
    bool
    """
    conserved = options.fix_area or options.fix_volume
    return options.flow == "mean-curvature" and (conserved or not (topology.is_closed or options.timed))


def with_stop(options: FlowOptions, topology: Topology, bounded: bool) -> FlowOptions:
    """The options with a clock and, where none are chosen, the flow's criteria for ending.

    Parameters
    ----------
    options : FlowOptions
        `timed` where a step or a duration is chosen; `stop` with the criteria that are chosen.
    topology : Topology
    bounded : bool
        Whether steps or a duration are chosen.

    Returns
    -------
    FlowOptions
    """
    film = is_film(options, topology)
    timed = options.timed or (options.flow == "mean-curvature" and not film)
    if timed and bounded:
        default = Stop()
    elif film:
        default = FILM_STOP
    elif options.flow == "conformal":
        default = CONFORMAL_STOP
    elif options.flow == "newton":
        default = CONSTRAINED_NEWTON_STOP if options.fix_area or options.fix_volume else NEWTON_STOP
    else:
        default = Stop(DEFAULT_STOP.gradient, DEFAULT_STOP.fall, not timed)
    stop = Stop(
        options.stop.gradient or default.gradient, options.stop.fall or default.fall, default.mesh_error
    )
    return replace(options, timed=timed, stop=stop)
