"""Mean curvature by scheme and radius, against a known truth or a second scheme."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature.surface_curvature import ProposedBalls, measure_curvature, proposed_balls
from ddgcli.errors import MeshError, ParameterError
from ddgcli.geometry.component_sides import component_extents
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.tradeoff.candidates import (
    NO_OPTIONS,
    Candidate,
    CommandOptions,
    Problem,
    Reference,
    relative_to_rms,
)
from ddgcli.tradeoff.truths import Truth

# radii in mean edge lengths, cheap ones first; None is the scheme's own region
RADII: dict[str, tuple[float | None, ...]] = {
    "cotan": (None,),
    "normal-cycle": (None, 2.0, 4.0),
    "normal-voting": (4.0,),
    "corrected": (None, 2.0, 4.0),
    "quadric": (None, 3.0),
}

Radius = float | Literal["auto"] | None  # in length units; None is the scheme's own region
TimedReference = tuple[float, Callable[[], Reference]]  # with the estimated seconds
DETAIL_KINDS = ("rough", "uneven", "partial")  # of noise, which bodies with details of a few edges have too

# fits in balls of so many edges err 1 (details, noise) to 17 times (spheres of like edges) as much as those
# in two rings; at the least half as much in the mean, and a quarter at the worst vertex (slivers, rounding)
WIDE_RADIUS, WIDE_SHARE = 3.0, 0.5
# of a fit in two rings: deviation of the mean curvature times the edge, over that of the vertices in edges
NOISE_GAIN = 0.45
MAX_NOISE_DEVIATIONS = 4.0  # of the largest error among some thousand vertices


def problem(
    mesh: TriangleMesh, *, truth: Truth | None = None, options: CommandOptions = NO_OPTIONS
) -> Problem:
    """Mean curvature at the inner vertices; `options` may contain `scheme` and `radius`."""
    if truth is not None and truth.mean_curvature is None:
        raise ParameterError(
            f"no mean curvature is known of the {truth.name}; leave it out", parameter="truth"
        )
    inside = mesh.topology.referenced_vertex & ~mesh.topology.boundary_vertex
    edge = float(mesh.side_length.mean()) if mesh.n_faces else 0.0
    if not inside.any() or edge == 0.0:
        why = "every vertex is on the boundary" if edge else "there is no triangle of any size"
        raise MeshError(f"{why}: no mean curvature to compare")
    # in mean edges: larger balls hold every component whole
    most = float(component_extents(mesh).max()) / 2 / edge
    proposal = proposed_balls(mesh)
    rows = _rows(options, proposal, edge)
    fits = [
        options.get("radius") is not None or not isinstance(radius, float) or radius < most * edge
        for _, radius in rows
    ]
    left_out = [
        (f"{s} radius={_label(r, edge)}", "its balls hold the mesh whole")
        for (s, r), fit in zip(rows, fits)
        if not fit
    ]
    if options.get("radius") is not None:
        left_out.append(("cotan with a radius", "it has none"))
    if truth is not None and truth.mean_curvature is not None:
        values = np.where(inside, truth.mean_curvature(mesh.points), np.nan)
        truth_reference = Reference.from_truth(truth.name, values)
        references: list[TimedReference] = [(0.0, lambda: truth_reference)]
    elif proposal is None and most <= 2 and rows:
        raise ParameterError(
            "the mesh is too coarse to compare with: a ball of two mean edges holds it whole; state its "
            "`truth`, or give a finer mesh"
        )
    else:
        references = _references(mesh, inside, edge, most, proposal)
    return Problem(
        candidates=[_candidate(mesh, *row, edge) for row, fit in zip(rows, fits) if fit],
        references=references,
        error=relative_to_rms,
        error_scale="the root mean square of the reference's mean curvature",
        query="mesh",
        left_out=tuple(left_out),
    )


def _rows(options: CommandOptions, proposal: ProposedBalls | None, edge: float) -> list[tuple[str, Radius]]:
    """Schemes and radii that are compared."""
    radius_option = options.get("radius")
    if isinstance(radius_option, str) and radius_option != "auto":
        raise ParameterError(f"must be a length or 'auto', not {radius_option!r}", parameter="radius")
    rows: list[tuple[str, Radius]] = [
        (scheme, radius)
        for scheme, radii in RADII.items()
        if options.get("scheme", scheme) == scheme
        for radius in ([r and r * edge for r in radii] if radius_option is None else (radius_option,))
        if scheme != "cotan" or radius is None
    ]
    proposed_row = proposal and (proposal.scheme, proposal.radius)
    if proposed_row and radius_option is None and options.get("scheme") in (None, proposed_row[0]):
        rows.insert(1, proposed_row)  # early, so that the time budget covers it
    return rows


def _references(
    mesh: TriangleMesh, inside: NDArray, edge: float, most: float, proposal: ProposedBalls | None
) -> list[TimedReference]:
    """References without a truth, the best first: proposed balls, or fits and balls of up to `most` edges."""
    work = _work(mesh, None)
    if proposal is not None:
        radii = (proposal.radius, proposal.other_radius)
        work += sum(_work(mesh, radius, edge) for radius in radii)
        return [(work, partial(_compared_balls, mesh, inside, proposal))]
    return [
        (
            work + sum(_work(mesh, radius) for radius in (2.0, WIDE_RADIUS, 4.0)),
            lambda: _compared(mesh, inside, edge, (2.0, 4.0)),
        ),
        (work + _work(mesh, 2.0), lambda: _compared(mesh, inside, edge, (2.0,))),
    ][most <= 4 :]


def mean_curvature(mesh: TriangleMesh, scheme: str, radius: Radius) -> NDArray[np.float64]:
    """(n,) mean curvature by a scheme."""
    return measure_curvature(mesh, scheme, radius, full=False).vertex["mean_curvature"]


def _candidate(mesh: TriangleMesh, scheme: str, radius: Radius, edge: float) -> Candidate:
    text = radius if isinstance(radius, str) else repr(radius)
    return Candidate(
        scheme,
        {"radius": _label(radius, edge)},
        lambda: None,
        lambda _: mean_curvature(mesh, scheme, radius),
        {"scheme": scheme} | ({"radius": text} if radius is not None else {}),
        _work(mesh, radius, edge),
    )


def _label(radius: Radius, edge: float) -> str:
    if isinstance(radius, str):
        return radius
    return "own" if radius is None else f"{radius / edge:.3g} edges"


def _work(mesh: TriangleMesh, radius: Radius, unit: float = 1.0) -> float:
    """Estimated seconds; the number of faces in a ball grows with the square of its radius in mean edges.

    Without a radius the noise is estimated, with 'auto' that of wider balls too.
    """
    if radius is None or isinstance(radius, str):
        return 2e-2 + mesh.n_faces * (3e-5 if radius is None else 1e-4)
    return 2e-2 + mesh.n_faces * (1e-5 + 2e-6 * (radius / unit) ** 2)


def _compared_balls(mesh: TriangleMesh, inside: NDArray, proposal: ProposedBalls) -> Reference:
    """Reference where noise dominates: the proposed scheme in balls of the proposed radius.

    Its uncertainty is the difference from another scheme in balls of that scheme's best radius, and the
    expected error. Where the noise may be details, which balls average away, the difference from fits over
    the default region counts too.
    """
    best, other = (
        np.where(inside, mean_curvature(mesh, scheme, radius), np.nan)
        for scheme, radius in (
            (proposal.scheme, proposal.radius), (proposal.other_scheme, proposal.other_radius),
        )
    )  # fmt: skip
    gap = relative_to_rms(other, best)
    name = (
        f"{proposal.scheme} in balls that average the noise (uncertainty from {proposal.other_scheme} in such"
    )
    if proposal.kind in DETAIL_KINDS:
        gap += relative_to_rms(mean_curvature(mesh, "quadric", None), best)
        name += ", from quadric fits without, as the noise may be details"
    gap *= 1.0 + proposal.expected_error / (gap[inside].mean() or 1.0)
    return Reference.from_agreement(f"{name}, and from noise)", best, gap)


def _compared(mesh: TriangleMesh, inside: NDArray, edge: float, radii: tuple[float, ...]) -> Reference:
    """Reference by quadric fits; its uncertainty is the difference from other measures, and the noise.

    A polyhedron has no pointwise curvature. The error of corrected measures is of second order in the radius,
    so two radii give their limit; the distance of the limit from the smaller ball, pointwise or on average,
    bounds its own error. Measures of one ring err less where the curvature varies within two edges, and more
    on irregular triangles: the smaller difference counts. Both follow noise, which is added.

    Fits converge faster than corrected measures. Twice the difference from fits in wider balls, which err
    more, counts where it is smaller in the mean.
    """
    fit = measure_curvature(mesh, "quadric", None, full=False)
    fitted = np.where(inside, fit.vertex["mean_curvature"], np.nan)
    scale = float(np.sqrt(np.nanmean(fitted**2))) or 1.0
    balls = [mean_curvature(mesh, "corrected", radius * edge) for radius in radii]
    if len(balls) == 1:
        name, limit = f"balls of {radii[0]:g} edges", balls[0]
        moved = relative_to_rms(limit, fitted)[inside]
    else:
        limit = balls[0] + (balls[0] - balls[1]) / ((radii[1] / radii[0]) ** 2 - 1)
        name = f"balls of {radii[0]:g} and {radii[1]:g} edges, extrapolated to radius 0"
        moved = np.abs(limit - balls[0])[inside] / scale
    gap = relative_to_rms(limit, fitted)
    gap[inside] += np.maximum(moved, moved.mean()) if len(balls) > 1 else moved.mean()
    noise = fit.results["noise_estimate"]
    if noise is not None:
        gap = np.minimum(gap, relative_to_rms(mean_curvature(mesh, "corrected", None), fitted))
    largest = gap.max(initial=0.0)
    if len(balls) > 1:
        wide = mean_curvature(mesh, "quadric", WIDE_RADIUS * edge)
        of_fits = relative_to_rms(wide, fitted) / WIDE_SHARE
        if of_fits.mean() < gap.mean():
            gap, name = of_fits, f"{name}, wider fits"
            largest = min(largest, 2.0 * of_fits.max())
    reference = Reference.from_agreement(
        f"quadric fits (uncertainty from corrected measures in one ring and {name}, and from noise)",
        fitted,
        gap,
    )
    by_noise = NOISE_GAIN * (noise or 0.0) / (edge * scale)
    return replace(
        reference,
        uncertainty=max(largest, reference.uncertainty) + MAX_NOISE_DEVIATIONS * by_noise,
        mean_uncertainty=reference.error_bound("mean") + by_noise,
    )
