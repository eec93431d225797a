"""Kernels of `curvature`: a scheme, balls of a radius, and the search for noise."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ddgcli.cli.forecast.mesh_facts import CLIPPING_SCHEMES, ball_work, clipping_work
from ddgcli.cli.forecast.use import KNOWN, InputSize, Range, Use

if TYPE_CHECKING:
    from ddgcli.mesh.triangle_mesh import TriangleMesh

__all__ = ["compared_work", "curvature_kernels"]

MAX_RINGS = 1e9  # of a ball, in edge lengths; its square is a number
BALL_SEARCH, VERTICES_PER_SQUARED_RING = 30.0, 4.15  # of a ball on a sphere
CLIPPED_PER_RING, FACES_PER_SQUARED_RING = 15.3, 7.3  # of a ball on a sphere
MEASURED_RINGS = 3.0  # of balls that clip faces
COMPARED_RINGS = (2.0, 4.0)  # of those of a comparison
# kinds of noise over which normals are averaged; the balls of fits grow until they err more than smaller ones
AVERAGED_NOISE = ("voxels", "rounded", "grid", "spikes", "noise")
WIDE_FITS_RANGE: Range = (0.3, 1.6)
UNEVEN_RANGE: Range = (0.3, 5.0)  # what a hundred balls show of smoothed stairs, four hundred confirm
EVEN_RANGE: Range = (0.02, 1.6)  # two balls show most details
MEASURED_PAIRS_OF_WIDEST = 2.0  # in all balls over those in the widest, where each has twice as many
LEAST_OFFSET_SHARE = 7.0  # faces of an offset body: each, and four of each edge at least
NOISY_RANGE: Range = (0.1, 3.0)
AUTO_RINGS = 4.0  # of the radius that balances noise and bias


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
    """Fits in balls around some vertices, and where they show noise averages of normals; in pairs of both."""
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
    """Work of clipping faces by the balls of a comparison over that on a sphere with edges alike."""
    edge = float(mesh.side_length.mean())
    own = sum(ball_work(mesh, rings * edge, CLIPPING_SCHEMES[0]) for rings in COMPARED_RINGS)
    return own / (mesh.n_vertices * sum(map(_work_on_sphere, COMPARED_RINGS)))


def _work_on_sphere(rings: float) -> float:
    """Work of clipping faces by a ball of so many edges on a sphere."""
    return clipping_work(CLIPPED_PER_RING * rings, FACES_PER_SQUARED_RING * rings**2)


def _ball_work(radius: float, size: InputSize) -> float:
    """Pairs of a ball and a vertex in it; unless counted, those of a sphere with edges alike."""
    if size.curvature.ball_work is not None:
        return size.curvature.ball_work
    return 0.5 * size.elements * (BALL_SEARCH + _in_ball(radius, size))


def _clipping_share(radius: float, size: InputSize) -> float:
    """Work of clipping faces by balls over that of balls of three edges on a sphere."""
    measured = _work_on_sphere(MEASURED_RINGS)
    if size.curvature.ball_work is not None:
        return size.curvature.ball_work / (0.5 * measured * max(size.elements, 1))
    rings = min(radius / (size.curvature.edge_length or 1.0), MAX_RINGS)
    clipped = min(CLIPPED_PER_RING * rings, size.elements)
    return clipping_work(clipped, min(FACES_PER_SQUARED_RING * rings**2, size.elements)) / measured


def _in_ball(radius: float, size: InputSize) -> float:
    """Vertices in a ball on a surface with edges alike, no more than it has."""
    rings = min(radius / (size.curvature.edge_length or 1.0), MAX_RINGS)
    return min(VERTICES_PER_SQUARED_RING * rings**2, size.elements)
