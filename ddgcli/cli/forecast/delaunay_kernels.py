"""Kernels of intrinsic triangulations: flips, Steiner points, common subdivisions, transfer."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from ddgcli.choices import MAX_REFINEMENT_DEGREES
from ddgcli.cli.forecast.facts import DelaunayFacts
from ddgcli.cli.forecast.use import InputSize, Use

__all__ = ["DEFICIT_OF_MEASURED_FACE", "MEASURED_REFINEMENT_DEGREES", "delaunay_kernels", "needs_overlay"]

MEASURED_REFINEMENT_DEGREES = 25.0
# Steiner points at 25 degrees, of the angle deficit and the angle contrast of `DelaunayFacts`: faces with
# equal small angles, as of mechanical parts, share points; between faces with different ones the points grade
# from one size to the other. They grow as exp(degrees / 12). A point takes three flips, and the input four
# for its deficit
POINTS_PER_DEFICIT, POINTS_PER_CONTRAST = 1.2, 1.55
POINTS_PER_ASPECT = 0.43  # of the corridor aspect: strips have two faces a length
STEINER_RANGE, STEINER_DEGREES = (0.4, 2.5), 12.0
NEEDLE_SHARE, NEEDLE_RANGE = 0.6, (0.4, 12.0)  # most faces are needles, whose rows flip one by one
STEINER_POINTS_OF_MEASURED_FACE = 0.78
DEFICIT_OF_MEASURED_FACE, CONTRAST_OF_MEASURED_FACE = 0.12, 0.43
FLIPS_PER_POINT, FLIPS_PER_DEFICIT = 3.0, 4.0
# of the estimate by Cauchy and Crofton, as some new edges lie in those of the input
CROSSINGS_WITH_STEINER_POINTS = 0.85
# seconds of the longest lines over those of equal ones, by the square of the crossings of an edge: on strips
# of an aspect of 100, 1000 and 10,000, with 6, 12 and 20 of them, 4, 5 and 45 times those of even meshes
LONG_LINES = 8.0


def delaunay_kernels(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    yield Use("delaunay")
    points, facts = 0.0, size.delaunay
    if options.get("refine"):
        yield Use("delaunay", added=1.0)  # the input, in which the points are inserted too
        deficit = DEFICIT_OF_MEASURED_FACE * size.elements
        deficit = deficit if facts.angle_deficit is None else facts.angle_deficit
        points = steiner_points(float(options["refine"]), options.get("max_points"), deficit, facts)
        yield _refinement(points, deficit, size)
    transfer = bool(options.get("transfer"))
    if needs_overlay(options):
        yield Use("delaunay overlay")
        if further := further_overlay_faces(points, size):
            yield _overlay_faces(further, points, size, added=1.0 if transfer else 0.0)
    for name in ("dual", "condition"):
        if options.get(name):
            yield Use(f"delaunay {name}")
    if transfer:
        yield Use("delaunay transfer", elements=size.elements + 2.0 * points if points else None)


def needs_overlay(options: Mapping[str, Any]) -> bool:
    """Whether `delaunay` computes the overlay of both triangulations."""
    return bool(options.get("overlay") or options.get("transfer"))


def steiner_points(degrees: float, most: int | None, deficit: float, facts: DelaunayFacts) -> float:
    """Number of Steiner points, at most `most`, by the angles of the Delaunay triangulation."""
    contrast = facts.angle_contrast
    if contrast is None:
        contrast = deficit * CONTRAST_OF_MEASURED_FACE / DEFICIT_OF_MEASURED_FACE
    growth = math.exp((min(degrees, MAX_REFINEMENT_DEGREES) - MEASURED_REFINEMENT_DEGREES) / STEINER_DEGREES)
    graded = POINTS_PER_DEFICIT * deficit + POINTS_PER_CONTRAST * contrast
    points = growth * (graded + POINTS_PER_ASPECT * facts.corridor_aspect)
    return min(points, facts.most_points if most is None else most)


def further_overlay_faces(points: float, size: InputSize) -> float:
    """Faces of the common subdivision beyond those of the input, with Steiner points."""
    if not points:
        return size.delaunay.further_overlay_faces
    faces = size.elements + 2.0 * points
    share = 2.0 * points / faces  # of the triangulation that is made of new edges
    crossings = CROSSINGS_WITH_STEINER_POINTS * size.delaunay.crossings_per_root_face * math.sqrt(faces)
    return 2.0 * points + (1.0 - share) * size.delaunay.further_overlay_faces + 2.0 * share * crossings


def _overlay_faces(further: float, points: float, size: InputSize, added: float) -> Use:
    """Faces of the common subdivision; with Steiner points, lines of very different numbers of crossings.

    The seconds grow with the longest line: lines over strips are laid out crossing by crossing.
    """
    if not points:
        return Use("delaunay further faces", added=added, elements=further)
    crossings_of_edge = further / (3.0 * (size.elements + 2.0 * points))
    return Use(
        "delaunay refined faces",
        added=added,
        elements=further,
        range=(0.3, 1.5 + crossings_of_edge**2 / LONG_LINES),
        assumes="crossings that all lines share",
    )


def _refinement(points: float, deficit: float, size: InputSize) -> Use:
    """The insertion of Steiner points."""
    measured_flips = (
        FLIPS_PER_POINT + FLIPS_PER_DEFICIT * DEFICIT_OF_MEASURED_FACE / STEINER_POINTS_OF_MEASURED_FACE
    )
    flips = FLIPS_PER_POINT * points + FLIPS_PER_DEFICIT * deficit
    return Use(
        "delaunay refine",
        flips / (measured_flips * max(points, 1.0)),
        elements=points / STEINER_POINTS_OF_MEASURED_FACE,
        range=NEEDLE_RANGE if deficit > NEEDLE_SHARE * size.elements else STEINER_RANGE,
        assumes=f"{points:.2g} Steiner points",
        once=True,
    )
