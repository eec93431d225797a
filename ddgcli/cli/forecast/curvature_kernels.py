"""Kernels of `curvature`: the scheme, balls of a radius, and the estimate of noise."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ddgcli.cli.forecast.mesh_facts import CLIPPING_SCHEMES, ball_work, clipping_work
from ddgcli.cli.forecast.use import KNOWN, InputSize, Range, Use

if TYPE_CHECKING:
    from ddgcli.mesh.triangle_mesh import TriangleMesh

__all__ = ["compared_work", "curvature_kernels"]

# A "ring" is a radius of a ball in mean edge lengths.
MAX_RINGS = 1e9  # limit whose square does not overflow
# search for a ball (in vertices that cost as much), and vertices per squared ring, on a sphere
BALL_SEARCH, VERTICES_PER_SQUARED_RING = 30.0, 4.15
CLIPPED_PER_RING, FACES_PER_SQUARED_RING = 15.3, 7.3  # faces clipped by a ball and inside it, on a sphere
MEASURED_RINGS = 3.0  # radius of the measured kernel that clips faces
COMPARED_RINGS = (2.0, 4.0)  # radii in a comparison
# Kinds of noise for which normals are averaged. The balls of fits grow until their error exceeds that of
# smaller ones.
AVERAGED_NOISE = ("voxels", "rounded", "grid", "spikes", "noise")
WIDE_FITS_RANGE: Range = (0.3, 1.6)
UNEVEN_RANGE: Range = (0.3, 5.0)  # a result of 100 balls on smoothed stairs is confirmed by 400 balls
EVEN_RANGE: Range = (0.02, 1.6)  # two radii suffice to recognise most details
MEASURED_PAIRS_OF_WIDEST = 2.0  # vertices in balls of all radii over those at the largest, in the measurement
LEAST_OFFSET_SHARE = 7.0  # least number of faces of an offset body per face: one, and four per edge
NOISY_RANGE: Range = (0.1, 3.0)
AUTO_RINGS = 4.0  # assumed radius that balances noise and bias


def curvature_kernels(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    """Kernels of `curvature` for its options."""
    if size.kind == "curve":
        yield Use("curvature")
        if options.get("frames"):
            yield Use("curvature frames")
        return
    scheme, radius, facts = options["scheme"], options.get("radius"), size.curvature
    if options.get("offset"):
        yield Use("curvature offset", elements=facts.offset_faces or LEAST_OFFSET_SHARE * size.elements)
    stated = radius not in (None, "auto")
    yield Use(f"curvature {scheme}")
    if facts.sheared:
        yield Use("curvature sheared", added=1.0)
    noisy = facts.noise in AVERAGED_NOISE
    if stated or (radius == "auto" and noisy):
        length = AUTO_RINGS * (facts.edge_length or 1.0) if radius == "auto" else float(radius or 0.0)
        seconds_range, assumes = (KNOWN, "") if stated else (NOISY_RANGE, "balls of four edges")
        use = Use(f"curvature {scheme} radius", range=seconds_range, assumes=assumes)
        if scheme in CLIPPING_SCHEMES:  # in blocks, whose memory does not grow with them
            yield replace(use, times=_clipping_share(length, size))
        else:
            yield replace(use, elements=_ball_work(length, size), added=1.0)
    if facts.noise and (not stated or scheme == "quadric"):
        yield from _noise_search(scheme, radius, size, averages=noisy and not stated)


def _noise_search(scheme: str, radius: Any, size: InputSize, *, averages: bool) -> Iterator[Use]:
    """Kernels of the noise estimate: fits in balls around some vertices, and averaged normals."""
    from ddgcli.algorithms.curvature import noise_estimate

    n, pairs, noise = 0.5 * size.elements, size.curvature.fitted_pairs, size.curvature.noise
    added = 0.0 if averages else 1.0  # the memory of fits is free when normals are averaged
    assumes, seconds_range = "balls that grow to the widest", WIDE_FITS_RANGE
    if noise == "even":
        assumes, seconds_range = "errors alike everywhere", EVEN_RANGE
    elif noise == "uneven":
        assumes, seconds_range = "no confirmation by more balls", UNEVEN_RANGE
    if pairs:
        times = sum(pairs) / (MEASURED_PAIRS_OF_WIDEST * max(pairs))
        yield Use("curvature wide fits", times, added, max(pairs), seconds_range, assumes, once=True)
    if averages:
        voxels = noise == "voxels" and radius == "auto" and scheme == "normal-voting"
        most = noise_estimate.MAX_VOXEL_PAIRS if voxels else noise_estimate.MAX_VOTING_PAIRS
        yield Use("curvature noise", added=1.0, elements=min(most, n * n))


def compared_work(mesh: TriangleMesh) -> float:
    """Work of clipping faces by the balls of a comparison, over that on a sphere with equal edges."""
    edge = float(mesh.side_length.mean())
    own = sum(ball_work(mesh, rings * edge, CLIPPING_SCHEMES[0]) for rings in COMPARED_RINGS)
    return own / (mesh.n_vertices * sum(map(_work_on_sphere, COMPARED_RINGS)))


def _work_on_sphere(rings: float) -> float:
    """Work of clipping faces by a ball with a radius of `rings` edges on a sphere."""
    return clipping_work(CLIPPED_PER_RING * rings, FACES_PER_SQUARED_RING * rings**2)


def _ball_work(radius: float, size: InputSize) -> float:
    """Number of pairs of a ball and a vertex in it; if not counted, that on a sphere with equal edges."""
    if size.curvature.ball_work is not None:
        return size.curvature.ball_work
    return 0.5 * size.elements * (BALL_SEARCH + _in_ball(radius, size))


def _clipping_share(radius: float, size: InputSize) -> float:
    """Work of clipping faces by balls, over that of balls with a radius of three edges on a sphere."""
    measured = _work_on_sphere(MEASURED_RINGS)
    if size.curvature.ball_work is not None:
        return size.curvature.ball_work / (0.5 * measured * max(size.elements, 1))
    rings = min(radius / (size.curvature.edge_length or 1.0), MAX_RINGS)
    clipped = min(CLIPPED_PER_RING * rings, size.elements)
    return clipping_work(clipped, min(FACES_PER_SQUARED_RING * rings**2, size.elements)) / measured


def _in_ball(radius: float, size: InputSize) -> float:
    """Vertices in a ball on a surface with equal edges, limited to those of the surface."""
    rings = min(radius / (size.curvature.edge_length or 1.0), MAX_RINGS)
    return min(VERTICES_PER_SQUARED_RING * rings**2, size.elements)
