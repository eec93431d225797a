"""Results and accuracy of a flow, from the scalars of its frames."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import counted
from ddgcli.geometry.intrinsic import corner_angle
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import row_matrix
from ddgcli.models.willmore import endings
from ddgcli.models.willmore.constraints import reduced_volumes
from ddgcli.models.willmore.descent import folded_faces
from ddgcli.models.willmore.endings import EndingKind
from ddgcli.models.willmore.energies import ENERGIES, SECOND_ENERGIES
from ddgcli.models.willmore.flow_options import FlowOptions, chosen_energy, is_film
from ddgcli.models.willmore.least_energies import is_spheres
from ddgcli.simulation.model import Ending

RELEASE_ADVICE = ": begin with a finer mesh (`subdivide`), or use `boundary=free`"
# growth of the bending energy, and smallest angle in degrees, at which a hole has closed
CLOSED_HOLE_GROWTH, CLOSED_HOLE_ANGLE = 10.0, 1.0
FLAT_ENERGY = 1e-9  # smaller energies, which have no unit, are the rounding of flat surfaces
ENERGY_RATIO_WARNING = 1.2  # growth of the ratio of two energies at which a warning is due
REFINEMENT_ANGLE = 25  # smallest angle that the advice names for `delaunay --refine`
# degrees, below which refinement helps: in space, faces of a refined mesh have smaller angles than intrinsic
# ones
NEEDLE_ANGLE = 20
SLENDER_ANGLE = 30  # degrees; angles of remeshed surfaces are above


def summary(
    series: Mapping[str, NDArray],
    convention: str,
    limit: int,
    ending: Ending | None,
    failure: str,
    *,
    bounded: bool,
    times: NDArray | None = None,
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Results and accuracy of a flow.

    Parameters
    ----------
    series : mapping of str to (T,) ndarray
        Scalars of every frame.
    convention : str
    limit : int
        Steps allowed.
    ending : Ending or None
        Why it ended before.
    failure : str
        Why it failed, or "".
    bounded : bool
        The caller chose the steps or the duration; else an end before rest is a warning.
    times : (T,) ndarray, optional
        Of the frames of a flow in time.

    Returns
    -------
    results, accuracy : dict
    """
    if not (bounded or ending or failure):
        logging.getLogger("ddgcli").warning(
            "the surface is not at rest after %d steps, the most without `steps` or `duration`; "
            "`steps=%d` leads further", limit, 5 * limit,
        )  # fmt: skip
    if ending is not None and ending.kind in (EndingKind.IMMOVABLE, EndingKind.EMPTY_PATCH):
        advice = RELEASE_ADVICE if ending.kind == EndingKind.IMMOVABLE else ""
        logging.getLogger("ddgcli").warning("%s; the surface stays as it is%s", ending.text, advice)
    last = {name: float(values[-1]) for name, values in series.items() if values.ndim == 1}
    results = {
        "energy": series["energy"].tolist(),
        "energy_convention": convention,
        "area": last["area"],
        "volume": last.get("volume"),
        "reduced_volume": last.get("reduced_volume"),
        "steps": int(last["steps"]),
        "redistributions": int(last["redistributions"]),
        "flips": int(last["flips"]),
        "stopped_because": failure or (ending.text if ending else f"{limit} steps were taken"),
    }
    if times is not None:
        results["times"] = times.tolist()
        results["large_constant_steps"] = int(last["large_constant_steps"])
    if "end_time_by_component" in series:
        results["collapse_times"] = _collapse_times(series, ending)
    if "mean_curvature_spread" in last:
        results["mean_curvature_spread"] = last["mean_curvature_spread"]
    if "remeshes" in last:
        results |= {
            "remeshes": int(last["remeshes"]), "remesh_energy_change": last["remesh_energy_change"]
        }  # fmt: skip
    accuracy = {
        "energy_increases": int(last["energy_increases"]),
        "area_increases": int(last["area_increases"]),
        "constraint_residuals": {
            name: float(np.abs(series[f"{name}_residual"]).max())
            for name in ("area", "volume")
            if f"{name}_residual" in series
        },
        "min_angle_degrees": series["min_angle_degrees"].tolist(),
    }
    if "log_ratio_change_max" in last:
        accuracy["log_ratio_change"] = {name: last[f"log_ratio_change_{name}"] for name in ("max", "mean")}
    return results, accuracy


def _collapse_times(series: Mapping[str, NDArray], ending: Ending | None) -> list[float | None]:
    """Time at which each component of a mean curvature flow ended, with a warning where one did as lines."""
    time, singular = (row_matrix(series[f"{name}_by_component"])[-1] for name in ("end_time", "singular"))
    if ending is not None and ending.kind == EndingKind.SINGULAR:
        logging.getLogger("ddgcli").warning("%s", ending.text)
    elif singular.any():
        first = int(np.argmax(singular))
        logging.getLogger("ddgcli").warning(
            "%s singular, and stays as it was (first: component %d at time %.6g): most of it has "
            "shrunk to lines, or its faces are too slender",
            counted(int(singular.sum()), "component became", "components became"), first, time[first],
        )  # fmt: skip
    return [None if t < 0 else float(t) for t in time]


def warn_of_closed_hole(series: Mapping[str, NDArray], times: NDArray | None, last: TriangleMesh) -> None:
    """Warn where a hole or a neck shrank to less than its faces resolve during mean curvature flow in time.

    No flow of smooth surfaces continues from there. A tube that shrinks to its circle has no such hole: its
    energy grows as its area falls. Spheres are left out: there bad triangles do the same.

    Parameters
    ----------
    series : mapping of str to (T,) ndarray
        Scalars of every frame.
    times : (T,) ndarray or None
        Of the frames of a flow in time.
    last : TriangleMesh
        At the end.
    """
    if times is None or "end_time_by_component" not in series or series["singular_by_component"].any():
        return
    energy, angle, area = (series[name] for name in ("energy", "min_angle_degrees", "area"))
    closed = (energy > CLOSED_HOLE_GROWTH * max(energy[0], 4.0 * np.pi)) & (angle < CLOSED_HOLE_ANGLE)
    closed &= area * CLOSED_HOLE_GROWTH > area[0]
    if is_spheres(last.topology) or not closed.any():
        return
    face, side = divmod(int(np.argmin(last.side_length)), 3)
    place = last.points[last.faces[face, [side, (side + 1) % 3]]].mean(axis=0)
    logging.getLogger("ddgcli").warning(
        "a hole or a neck of the surface has closed by time %.6g (near %s): its faces no longer resolve it, "
        "what follows is not mean curvature flow, and the surface may pass through itself; use a shorter "
        "`duration`",
        times[np.argmax(closed)], " ".join(f"{x:.4g}" for x in place),
    )  # fmt: skip


def component_results(last: TriangleMesh) -> dict[str, list[float]]:
    """Reduced volume of each component at the end, of a closed surface of several.

    Parameters
    ----------
    last : TriangleMesh
        At the end.

    Returns
    -------
    dict of str to list of float
        Empty for other surfaces: the whole has no reduced volume that means a shape.
    """
    if not last.topology.is_closed or last.topology.n_components == 1:
        return {}
    return {"reduced_volumes": reduced_volumes(last).tolist()}


def _finite(value: float) -> float | None:
    """The number; None where an energy is not defined, as `quadratic` of other vertices."""
    return float(value) if np.isfinite(value) else None


def every_energy(series: Mapping[str, NDArray]) -> dict[str, dict[str, Any]]:
    """All energies, one value a frame, with their conventions (`report_energy=all`).

    None, with a warning, in frames where an energy is not defined: `quadratic` of other faces, `gauss-map`
    where the normals around a vertex cancel.

    Parameters
    ----------
    series : mapping of str to (T,) ndarray
        Scalars of the frames.

    Returns
    -------
    dict of str to dict
    """
    for name in ENERGIES:
        undefined = int((~np.isfinite(series[f"energy_{name}"])).sum())
        if undefined:
            logging.getLogger("ddgcli").warning(
                "energy %s could not be computed in %d of %d frames", name, undefined,
                len(series[f"energy_{name}"]),
            )  # fmt: skip
    return {
        name: {
            "start": _finite(series[f"energy_{name}"][0]),
            "end": _finite(series[f"energy_{name}"][-1]),
            "values": [_finite(value) for value in series[f"energy_{name}"]],
            "energy_convention": kind.convention,
        }
        for name, kind in ENERGIES.items()
    }


def failure_reason(
    ending: Ending | None,
    start: TriangleMesh,
    last: TriangleMesh,
    options: FlowOptions,
    *,
    bounded: bool = False,
) -> str:
    """Why the end is neither at rest nor on the flow, with a remedy; or "".

    Parameters
    ----------
    ending : Ending or None
        Why the flow ended before its last step.
    start, last : TriangleMesh
    options : FlowOptions
    bounded : bool
        The caller chose the steps or the duration; else a film that folds has failed before rest too.

    Returns
    -------
    str
    """
    is_end = not bounded if ending is None else ending.kind == EndingKind.AT_REST
    if is_end and is_film(options, start.topology) and folded_faces(last):
        ending = endings.FOLDED
    if ending is None or ending.kind != EndingKind.UNRESOLVED:
        return ""
    message = f"{ending.text}; {_remedy(ending, start, options)}"
    logging.getLogger("ddgcli").error(message)
    return message


def _remedy(ending: Ending, start: TriangleMesh, options: FlowOptions) -> str:
    """What to try after an unresolved end."""
    remedy = "begin with a finer mesh"
    needles = options.remesh is None and _smallest_angle(start) < NEEDLE_ANGLE
    if ending == endings.PINCH:
        remedy = "bring the parts of the boundary closer together, or span each by its own surface"
    elif ending in (endings.THIN_STAR, endings.FOLDED):
        remedy = "use `remesh=mean`"
        topology = start.topology
        if topology.is_closed and topology.euler_characteristic < 2 * topology.n_components:
            remedy = "only spheres have equal curvature, and this surface has handles: use `flow=quadratic`"
    elif ending == endings.NOT_CONFORMAL_REST:
        remedy = "go on from there with `flow=quadratic`"
    elif ending == endings.SLOW_NEWTON:
        remedy = "use `flow=quadratic` with `subdivide=1`"
    elif ending == endings.FALSE_REST:
        remedy = "begin with `subdivide=1`"
        if _can_remesh(options):
            remedy = "use `remesh=mean`, or begin with `subdivide=1`"
    elif options.spontaneous_curvature:
        remedy = "use a smaller `spontaneous_curvature`, or `subdivide=1`"
    elif options.flow == "newton" and (options.fix_area or options.fix_volume):
        remedy = "use `flow=quadratic`, whose vertices slide into better triangles"
    elif chosen_energy(start.topology, options) != "cotan":
        refined = f"the mesh of `refined_mesh={REFINEMENT_ANGLE}`"
        remedy = (
            f"begin with {refined}, or use `energy=cotan`" if needles else f"use `energy=cotan`, or {remedy}"
        )
    elif options.remesh is not None:
        remedy = "use a shorter `remesh`"
    elif _can_remesh(options):
        remedy = "begin with `subdivide=1`, or use `remesh=mean`"  # which does not help where faces are few
    return remedy


def _can_remesh(options: FlowOptions) -> bool:
    """Whether the flow could remesh, and does not yet."""
    return options.flow == "quadratic" and not (options.timed or options.remesh)


def _smallest_angle(mesh: TriangleMesh) -> float:
    """Smallest angle of the faces, in degrees."""
    return float(np.degrees(corner_angle(mesh.side_length).min()))


def warn_of_surfaces(
    first: TriangleMesh,
    last: TriangleMesh,
    options: FlowOptions,
    start_energy: float,
    unfilled: TriangleMesh | None = None,
) -> None:
    """Warn of noise at the start of the flow of a bending energy, of folds, and of slender faces.

    Parameters
    ----------
    first, last : TriangleMesh
        At the start and at the end.
    options : FlowOptions
    start_energy : float
        Of the first surface.
    unfilled : TriangleMesh, optional
        The first one without patches, whose creases along the loops are not noise.
    """
    if options.flow != "mean-curvature":
        from ddgcli.models.willmore.vertex_noise import warn_of_noise

        warn_of_noise(unfilled or first, start_energy, chosen_energy(first.topology, options))
    warn_of_folds(first, last)
    warn_of_disagreement(first, last, options)


def warn_of_disagreement(first: TriangleMesh, last: TriangleMesh, options: FlowOptions) -> None:
    """Warn where a second energy has grown over the first: the mesh does not resolve its surface.

    Parameters
    ----------
    first, last : TriangleMesh
        At the start and at the end.
    options : FlowOptions
    """
    name = chosen_energy(first.topology, options)
    # on open surfaces `gauss-map` leaves the faces at the boundary out, `cotan` the vertices
    if name not in SECOND_ENERGIES or (name == "cotan" and not first.topology.is_closed):
        return
    other = SECOND_ENERGIES[name]
    kinds = [ENERGIES[kind].of for kind in (name, other)]
    values = [[kind(mesh).value(mesh.points) for kind in kinds] for mesh in (first, last)]
    log = logging.getLogger("ddgcli")
    value, second = values[1]
    if value <= FLAT_ENERGY < second:
        log.warning(
            "%s gives the last surface an energy of %.3g, %s %.3g: int H^2 is never negative, and near zero "
            "the first is its own error; use `energy=%s`",
            name, value, other, second, other,
        )  # fmt: skip
        return
    before, after = (max(second, FLAT_ENERGY) / max(value, FLAT_ENERGY) for value, second in values)
    if after <= ENERGY_RATIO_WARNING * max(1.0, before):
        return
    slender = _smallest_angle(last) < SLENDER_ANGLE
    log.warning(
        "%s gives the last surface %.3g times the energy of %s (%.3g times at the start): %s%s",
        other, after, name, before, "its faces are too slender to decide" if slender else
        "it bends more than its faces resolve, as where a handle is pinched to a few of them",
        "; use `remesh=mean`" if _can_remesh(options) else "",
    )  # fmt: skip


def warn_of_folds(first: TriangleMesh, last: TriangleMesh) -> None:
    """Warn where faces have folded over: energies of such a surface mean little.

    Parameters
    ----------
    first, last : TriangleMesh
        At the start and at the end.
    """
    before, after = folded_faces(first), folded_faces(last)
    if after > before:
        logging.getLogger("ddgcli").warning(
            "%s folded over at the end (%d at the start): the energy means little there; begin "
            "with a finer or more even mesh",
            counted(after, "face is", "faces are"),
            before,
        )
