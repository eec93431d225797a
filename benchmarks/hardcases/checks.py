"""What must hold of the summary and the arrays of each command on a hard case."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

SUM_TOLERANCE = 1e-9  # sums over up to 1e5 faces, relative


DISTANCE_TOLERANCE = 1e-9  # of the largest distance


ENERGY_TOLERANCE = 1e-2  # of the largest energy: what a second-order scheme may gain in a few steps


LEAST_EIGENVALUE = 1e-2  # times the squared size of the surface: a smaller one counts as zero


REST_TOLERANCE = 1e-9  # of the size of the body


@dataclass(frozen=True)
class Evidence:
    """What checks look at: the summary, the written arrays, the mesh as built, the truths of the case."""

    summary: dict[str, Any]
    arrays: dict[str, NDArray]
    points: NDArray | None
    faces: NDArray | None
    expected: dict[str, Any]

    @property
    def results(self) -> dict[str, Any]:
        return self.summary.get("results", {})

    @property
    def accuracy(self) -> dict[str, Any]:
        return self.summary.get("accuracy", {})


# a violated check: what is violated, and words one of which a warning must contain
Violation = tuple[str, tuple[str, ...]]


Check = Callable[[Evidence], Iterator[Violation]]


def near(a: float, b: float, relative: float = SUM_TOLERANCE) -> bool:
    """Relative agreement; false for NaN."""
    return abs(a - b) <= relative * max(abs(a), abs(b))


def check_input(evidence: Evidence) -> Iterator[Violation]:
    """Counts of the mesh against the catalogue's own."""
    read, expected = evidence.summary.get("input", {}), evidence.expected
    for name in ("components", "euler_characteristic"):
        if name in expected and read.get(name) != expected[name]:
            yield f"{name} {read.get(name)} instead of {expected[name]}", (name,)


def check_area(evidence: Evidence) -> Iterator[Violation]:
    """Area of `curvature`, `laplacian` and `info` against the sum over the faces."""
    area = evidence.results.get("area", evidence.results.get("size", {}).get("area"))
    truth = evidence.expected.get("area")
    if truth is not None and area is not None and not near(area, truth):
        yield f"area {area:.6g} instead of {truth:.6g}", ("area",)


def check_curvature(evidence: Evidence) -> Iterator[Violation]:
    """Gauss-Bonnet, ordered principal curvatures, vertex areas that sum to the area."""
    results, arrays = evidence.results, evidence.arrays
    residual = evidence.accuracy.get("gauss_bonnet_residual")
    if residual is not None and not residual <= SUM_TOLERANCE:
        yield f"Gauss-Bonnet residual {residual:.1e}", ("Gauss", "angle")
    chi, total = evidence.expected.get("euler_characteristic"), results.get("total_gaussian_curvature")
    if chi is not None and total is not None and evidence.summary["input"].get("manifold"):
        total += results.get("total_geodesic_curvature") or 0.0
        scale = max(1.0, float(np.abs(arrays["angle_defect"]).sum())) if "angle_defect" in arrays else 1.0
        if abs(total - 2 * math.pi * chi) > SUM_TOLERANCE * scale:
            yield f"total curvature {total:.6g} instead of {2 * math.pi * chi:.6g}", ("Gauss", "angle")
    if "vertex_area" in arrays and "area" in results:
        area_sum = float(arrays["vertex_area"].sum())
        if not near(area_sum, results["area"]):
            yield f"vertex areas sum to {area_sum:.6g}", ("area",)
    low, high = arrays.get("principal_curvature_min"), arrays.get("principal_curvature_max")
    if low is not None and high is not None and np.any(low > high):
        yield "principal curvatures out of order", ("principal",)


def check_delaunay(evidence: Evidence) -> Iterator[Violation]:
    """A Delaunay triangulation of the same metric."""
    after, before = evidence.results.get("after", {}), evidence.results.get("before", {})
    if after.get("non_delaunay_edges"):
        yield f"{after['non_delaunay_edges']} edges are not Delaunay", ("Delaunay", "flip")
    for name in ("area_residual", "angle_defect_residual"):
        value = evidence.accuracy.get(name)
        if value is not None and not value <= 1e-6:
            yield f"{name} {value:.1e}", ("area", "angle", "metric", "residual")
    energy, start = after.get("dirichlet_energy"), before.get("dirichlet_energy")
    if energy is not None and start is not None and energy > start * (1 + 1e-6):
        yield "Dirichlet energy grew by flips", ("energy",)


def check_laplacian(evidence: Evidence) -> Iterator[Violation]:
    """Eigenvalues: none negative, and one zero a component."""
    values = evidence.results.get("eigenvalues")
    for name in ("symmetry_residual", "row_sum_residual"):
        residual = evidence.accuracy.get(name)
        if residual is not None and not residual <= SUM_TOLERANCE:
            yield f"{name} {residual:.1e}", ("residual", "symmetric")
    if not values:
        return
    scale, zero = abs(values[-1]), math.inf
    if evidence.points is not None and evidence.faces is not None:
        edge = np.linalg.norm(
            evidence.points[evidence.faces[:, 0]] - evidence.points[evidence.faces[:, 1]], axis=1
        )
        scale = max(scale, 1.0 / edge.mean() ** 2)
        # a long chain has small eigenvalues that are none: about (pi / length)^2
        zero = LEAST_EIGENVALUE / np.sum(np.ptp(evidence.points, axis=0) ** 2)
    elif area := evidence.results.get("area"):
        # of a file only: edges as long as faces are wide, for three zeros have no scale of their own
        scale = max(scale, evidence.summary["input"].get("faces", 1) / area)
    if min(values) < -1e-6 * scale:
        yield f"eigenvalue {min(values):.1e}", ("eigen",)
    components = evidence.expected.get("components")
    if components is not None:
        zeros = sum(abs(value) < min(1e-6 * scale, zero) for value in values)
        if zeros != min(components, len(values)):
            yield f"{zeros} zero eigenvalues, {components} components", ("eigen",)


def check_dec(evidence: Evidence) -> Iterator[Violation]:
    """dd = 0, symmetric Laplacians, counts with the right Euler characteristic."""
    for name in ("derivative_residual", "symmetry_residual", "constant_residual"):
        value = evidence.accuracy.get(name)
        if value is not None and not value <= SUM_TOLERANCE:
            yield f"{name} {value:.1e}", ("residual", "star")


def check_hodge(evidence: Evidence) -> Iterator[Violation]:
    """Betti numbers against the catalogue's, and their alternating sum against the Euler characteristic."""
    betti = (evidence.results.get("betti_numbers") or {}).get("absolute")
    truth, chi = evidence.expected.get("betti_numbers"), evidence.expected.get("euler_characteristic")
    if betti is None:
        return
    if truth is not None and list(truth) != list(betti):
        yield f"Betti numbers {betti} instead of {list(truth)}", ("Betti",)
    if chi is not None and betti[0] - betti[1] + betti[2] != chi:
        yield f"Betti numbers {betti} do not give Euler characteristic {chi}", ("Betti",)


def check_geodesic(evidence: Evidence, tolerance: float = DISTANCE_TOLERANCE) -> Iterator[Violation]:
    """Straight line <= distance <= path along edges from vertex 0, zero there, and closed forms."""
    distance, points, faces = evidence.arrays.get("geodesic_distance"), evidence.points, evidence.faces
    if distance is None or points is None or faces is None:
        return
    if np.isnan(distance).any():
        yield "distance NaN", ()
        return
    sides = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    sides = np.unique(np.sort(sides, axis=1), axis=0)
    size = float(np.abs(points - points[0]).max()) or 1.0
    scaled = (points - points[0]) / size
    length = np.linalg.norm(scaled[sides[:, 0]] - scaled[sides[:, 1]], axis=1)
    graph = coo_array((length, (sides[:, 0], sides[:, 1])), shape=(len(points),) * 2)
    upper = dijkstra(graph, directed=False, indices=0)
    lower = np.where(np.isfinite(upper), np.linalg.norm(scaled, axis=1), np.inf)
    scaled_distance = distance / size
    with np.errstate(invalid="ignore"):
        slack = tolerance * max(1.0, float(upper[np.isfinite(upper)].max()))
        outside = (scaled_distance > upper + slack) | (scaled_distance < lower - slack)
    if outside.any():
        first = int(np.flatnonzero(outside)[0])
        bounds = f"[{lower[first] * size:.6g}, {upper[first] * size:.6g}]"
        yield f"distance {distance[first]:.6g} of vertex {first} outside {bounds}", ("distance", "bound")
    known = evidence.expected.get("known_distance")
    if known and not near(float(distance[known[0]]), known[1], tolerance):
        yield f"distance {distance[known[0]]:.9g} instead of {known[1]:.9g}", ("distance",)


def check_shell(evidence: Evidence) -> Iterator[Violation]:
    """Without a load in the call the body is at rest: it does not move."""
    energies = evidence.results.get("energies", {})
    moved = evidence.arrays.get("points")
    if moved is not None and evidence.points is not None and len(moved) == len(evidence.points):
        size = np.ptp(evidence.points, axis=0).max()
        change = float(np.abs(moved - evidence.points).max())
        if change > REST_TOLERANCE * size + 4e-16 * np.abs(evidence.points).max():
            yield f"a body at rest moved by {change:.1e} of {size:.1e}", ("moved", "rest")
    if "total" not in energies:
        yield "no total energy", ()


def check_energy_falls(evidence: Evidence) -> Iterator[Violation]:
    """The total energy of a conservative or damped run does not grow."""
    energies = evidence.results.get("energies", {})
    scale = max((abs(v) for e in energies.values() for v in e.values()), default=0.0)
    gain = energies["total"]["end"] - energies["total"]["start"]
    if gain > ENERGY_TOLERANCE * scale:
        yield f"total energy grew by {gain / scale:.1e} of the largest energy", ("energy",)


def check_fluid(evidence: Evidence) -> Iterator[Violation]:
    """A still fluid stays still; vorticity keeps its integral."""
    start, end = (evidence.results.get(f"kinetic_energy{at}") for at in ("_start", ""))
    if start == 0 and end != 0:
        yield f"a still fluid gained {end:.1e} J", ("energy",)
    drift = evidence.accuracy.get("total_vorticity_drift")
    if drift is not None and not drift <= SUM_TOLERANCE:
        yield f"total vorticity drifts by {drift:.1e}", ("vorticity",)


def check_kinetic_energy_falls(evidence: Evidence) -> Iterator[Violation]:
    """Viscosity takes kinetic energy and never gives any."""
    start, end = evidence.results["kinetic_energy_start"], evidence.results["kinetic_energy"]
    if not 0 <= end <= start * (1 + 1e-3):
        yield f"kinetic energy went from {start:.3g} to {end:.3g}", ("energy",)


def check_willmore(evidence: Evidence) -> Iterator[Violation]:
    """The energy never grows but by remeshing, and is never negative but for a volume with a minus.

    Of a spontaneous curvature it is a sum of three integrals, negative on coarse surfaces; with int K it is
    negative on open ones.
    """
    energy = evidence.results.get("energy") or []
    remeshing = max(evidence.results.get("remesh_energy_change") or 0.0, 0.0)
    # of flat surfaces the energy is rounding: 1e-12 is that of 4 pi
    if any(b > a + 1e-9 * abs(a) + remeshing + 1e-12 for a, b in zip(energy, energy[1:])):
        yield "the energy grew", ("energy",)
    convention = str(evidence.results.get("energy_convention", ""))
    is_signed = convention.startswith(("minus ", "int (H - H0)^2"))
    is_signed |= "; int K + " in convention and evidence.summary["input"]["boundary_loops"] > 0
    if energy and min(energy) < 0 and not is_signed:
        yield f"energy {min(energy):.1e} below zero", ("energy",)


def check_constant_two(evidence: Evidence) -> Iterator[Violation]:
    """Harmonic functions obey the maximum principle: constant data, constant function."""
    values = next((v for k, v in evidence.arrays.items() if k.startswith("harmonic")), None)
    if values is None or np.abs(values - 2).max() > 1e-9:
        yield "the harmonic function of constant values is not constant", ()


def check_points_unchanged(evidence: Evidence) -> Iterator[Violation]:
    """A vanishing time moves nothing."""
    moved = evidence.arrays.get("points")
    if moved is None or np.abs(moved - evidence.points).max() > 1e-9:
        yield "the points moved", ()


def check_box_does_not_grow(evidence: Evidence) -> Iterator[Violation]:
    """Mean curvature flow stays in the bounding box of its start."""
    moved, points = evidence.arrays.get("points"), evidence.points
    if moved is None or points is None:
        yield "no smoothed points", ()
        return
    slack = 1e-9 * np.ptp(points, axis=0).max() + 2.0**-23 * np.abs(points).max()  # of .stl and .glb
    if (moved.min(axis=0) < points.min(axis=0) - slack).any() or (
        moved.max(axis=0) > points.max(axis=0) + slack
    ).any():
        yield "the bounding box grew", ("box",)


CHECKS: dict[str, tuple[Check, ...]] = {
    "info": (check_input, check_area),
    "repair": (check_input,),
    "curvature": (check_input, check_area, check_curvature),
    "delaunay": (check_input, check_delaunay),
    "laplacian": (check_input, check_area, check_laplacian),
    "dec": (check_input, check_dec),
    "hodge": (check_input, check_hodge),
    "geodesic": (check_input, check_geodesic),
    "shell-sim": (check_shell,),
    "fluid-sim": (check_fluid,),
    "willmore-flow": (check_input, check_willmore),
}


def check_resumed_as_whole(evidence: Evidence) -> Iterator[Violation]:
    """The trajectory `run`, which was interrupted, has the bits of the trajectory `whole`."""
    names = [name.removesuffix(" of whole") for name in evidence.arrays if name.endswith(" of whole")]
    if not names:
        yield "no unbroken trajectory", ("trajectory",)
    for name in names:
        resumed = evidence.arrays.get(f"{name} of run")
        if resumed is None or not np.array_equal(resumed, evidence.arrays[f"{name} of whole"]):
            yield f"{name} differs from that of the unbroken run", (name,)


FURTHER_CHECKS: dict[str, Check] = {
    "energy_falls": check_energy_falls,
    "kinetic_energy_falls": check_kinetic_energy_falls,
    "constant_two": check_constant_two,
    "points_unchanged": check_points_unchanged,
    "box_does_not_grow": check_box_does_not_grow,
    "resumed_as_whole": check_resumed_as_whole,
}
