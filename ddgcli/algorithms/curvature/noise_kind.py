"""Whether deviations of the vertices are noise, judged by residuals, creases and curvature in balls.

Creases of both signs, coordinates on grids, and curvature that settles with the radius in the same way all
over the surface distinguish noise and stairs from details and creases.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature.deviation import MIN_CREASED_FLAT_SHARE, Deviation
from ddgcli.algorithms.curvature.grid_coordinates import on_grid_edges
from ddgcli.algorithms.curvature.regions import listed
from ddgcli.algorithms.curvature.scales import Scales
from ddgcli.algorithms.curvature.staircase import cancellation, sampled_sides
from ddgcli.geometry.faces import Faces
from ddgcli.mesh.triangle_mesh import TriangleMesh

# residual of cubic fits over that of quartic ones: stairs that were averaged or cut have 1.2 to 1.7, details
# of six edges 1.8; smoothed segmentations have up to 2.2, and of details with less the default is 6 % off and
# more
MAX_ROUGH_DETAIL_RATIO, MAX_UNEVEN_DETAIL_RATIO = 1.75, 2.2
MAX_NOISE_DETAIL_RATIO = 1.1  # of residuals that are surely noise; scans have 1.2, in some samples 1.13
# creases of both signs within two rings: their sum over that of their sizes. Noise of more than a twentieth
# of an edge has 0.05 to 0.8, and less the larger it is; scans have 0.2 to 0.6, mechanical parts 0.4 to 0.9
MAX_CANCELLATION, MAX_ROUGH_CANCELLATION = 0.8, 0.28
MAX_CANCELLATION_OF_NOISE = 0.055  # times one over the noise in edges
MIN_MEDIAN_SHARE = 0.1  # median error of grids of voxels over the mean one, which creases of a part exceed
# curvature that balls little larger than the default region do not repeat, all over the surface: its
# correlation with that in the first balls, 0.72 and more of details that the mesh resolves, 0.6 and more of
# scans; its error over that at the best radius (2.4 and less where it is right), the latter (of scans and
# parts with less correlation 0.4 and more), median share and kurtosis (parts have less, and more)
MAX_CORRELATION, MIN_UNREPEATED_RATIO, MAX_UNREPEATED_ERROR = 0.55, 3.5, 0.37
MIN_UNREPEATED_MEDIAN_SHARE, MAX_UNREPEATED_KURTOSIS = 0.5, 6.0
# slivers with noise have errors of many sizes, of which balls repeat nothing and leave a tenth or less
MAX_UNRELATED_CORRELATION, MIN_UNRELATED_RATIO = 0.3, 9.0
MIN_UNRELATED_MEDIAN_SHARE, MAX_UNRELATED_KURTOSIS = 0.35, 20.0
# smoothed stairs and noise over several edges: the error at the best radius over the larger curvature, that
# of the default region over it, and the median over the mean of the latter. Scans and modelled surfaces have
# errors of 0.15 to 0.9, smooth ones with a bias in balls ratios of 1.1 to 1.9, and details that two rings
# resolve errors of 0.13 and more
MAX_UNEVEN_ERROR, MIN_UNEVEN_ERROR_RATIO, MIN_UNEVEN_MEDIAN_SHARE = 0.12, 2.3, 0.4
# curvature that balls repeat: its correlation, and a limit of that error: smoothed stairs have 0.06 and less,
# subdivided scans 0.10 and more
MIN_REPEATED_CORRELATION, MAX_REPEATED_ERROR = 0.85, 0.08
# larger errors, of bodies with rims: the first change of the curvature over the second one. Stairs, also
# smoothed, and surface nets have 3.6 to 13, scans and modelled surfaces with errors below 0.2 have 1.2 to 2.7
MAX_STEEP_ERROR, MIN_STEEP_FALL = 0.18, 3.2
# stairs of cylinders and planes are alike along a line: five rows of two rings, which quartics fit exactly.
# Their residuals are 0.005 to 0.09 of an edge, those of smooth fine meshes of flat quadrangles less
MIN_RULED_FLAT_SHARE, MIN_RULED_RESIDUAL, MIN_RULED_FALL = 0.3, 0.004, 4.0
# errors of the default region that are alike everywhere, as those of noise and of stairs: the median over the
# mean, and the kurtosis (3 of normal noise). Scans and parts have errors in places: a kurtosis of 4.7 and
# more, or a median share below 0.6; waves, threads and corrugated sheets have a kurtosis of 1.5 to 1.8, and
# stairs without flat faces 1.9 and more
MIN_EVEN_MEDIAN_SHARE, MIN_KURTOSIS, MIN_EVEN_KURTOSIS, MAX_EVEN_KURTOSIS = 0.68, 1.75, 2.0, 4.6
# then the error of the default region over that at the best radius, and limits of the latter (over the larger
# curvature): surfaces that default fits resolve have ratios of 0.5 to 2.5; above the second ratio the best
# radius of noise leaves little
MIN_EVEN_ERROR_RATIO, MAX_EVEN_ERROR_RATIO, MAX_EVEN_ERROR, MAX_FLAT_EVEN_ERROR = 3.5, 15, 0.3, 0.2
# residual of cubic over that of quartic fits, of errors alike everywhere: below the first, details
# of one size have default errors of 6 % and more, below the second, bumps have ratios of errors above 15
MAX_EVEN_DETAIL_RATIO, MAX_WIDE_DETAIL_RATIO = 2.3, 2.8
# surfaces whose coordinates repeat with voxels: the error of the default region over that at the best radius,
# the latter, and the median share. Mechanical parts on such a grid have errors of 0.31 and more in places
MIN_LATTICE_ERROR_RATIO, MAX_LATTICE_ERROR, MIN_LATTICE_MEDIAN_SHARE = 2.2, 0.3, 0.35
# of a mean edge: marching cubes of 20 bodies have 1.4 to 9.8 % of shorter sides, regular grids with noise of
# a fifth of an edge along their normals 0.01 %
SHORT_SIDE, MIN_SHORT_SHARE = 0.3, 0.005
# rows of a scanner, each at a height of its own: quartics follow five of them. Their errors fall by 8 to 30
# from the first change to the second, those of waves by up to 6
MIN_ROWS_RESIDUAL, MIN_SMALL_ROWS_RESIDUAL, MIN_ROWS_FALL = 0.03, 0.02, 8.0
# radii from which the error at the best one may be less than a quarter of that of the default region
MIN_RADII = 3
# waves that fits over two rings do not follow exactly: the error of the default region, and the first change
# of the curvature over the second one: 0.5 to 1.5; noise and stairs with such errors have 1.8 and more
MIN_WAVE_ERROR, MAX_WAVE_FALL = 0.5, 1.7


def noise_kind(
    mesh: TriangleMesh, faces: Faces, dihedral: NDArray, deviation: Deviation
) -> tuple[str, Deviation]:
    """Kind of the noise as far as residuals and creases show it, '' where they are those of a surface.

    Parameters
    ----------
    mesh : TriangleMesh
    faces : Faces
        Of the mesh.
    dihedral : (e,) ndarray
        Dihedral angles of the edges in radians, positive where convex.
    deviation : Deviation

    Returns
    -------
    kind : str
        Of `Noise`, or 'ruled' and 'even', which `settles` may confirm as 'uneven'.
    deviation : Deviation
        Of the regions that have it.
    """

    def share_of(of_regions: Deviation) -> float:
        noisy = listed(of_regions.regions, np.flatnonzero(of_regions.noisy))
        return cancellation(mesh, faces, dihedral, noisy)

    if deviation.kind not in ("noise", "partial"):
        return deviation.kind, deviation
    if on_grid_edges(faces.points, faces.sorted_coordinates, faces.mean_length) and _has_slivers(faces):
        return "grid", deviation
    kind, bent = _kind_by_creases(deviation, share_of(deviation)), deviation.of_bent
    doubtful = kind in ("", "uneven", "ruled", "even")
    if doubtful and bent is not None and _kind_by_creases(bent, share_of(bent)) == "rough":
        return "rough", bent
    return kind, deviation


def _has_slivers(faces: Faces) -> bool:
    """Whether some sides are short, as those of marching cubes: faces of regular grids have none."""
    length = np.sqrt((sampled_sides(faces) ** 2).sum(axis=0))
    return bool((length < SHORT_SIDE * faces.mean_length).mean() > MIN_SHORT_SHARE)


def _kind_by_creases(deviation: Deviation, share: float) -> str:
    """Kind by residuals of fits and the share of creases that do not cancel.

    'ruled' and 'even' are not kinds of noise yet: the errors in balls decide whether they are 'uneven'.
    """
    of_noise = min(MAX_CANCELLATION, MAX_CANCELLATION_OF_NOISE / max(deviation.relative, 1e-300))
    if deviation.kind == "partial" and (share <= of_noise or not deviation.doubtful):
        return "partial"
    if not deviation.doubtful:
        return "noise" if share <= of_noise else ""
    if share <= MAX_ROUGH_CANCELLATION and deviation.detail_ratio <= MAX_ROUGH_DETAIL_RATIO:
        return "rough"
    if deviation.detail_ratio <= MAX_UNEVEN_DETAIL_RATIO:
        return "uneven"
    has_flats = deviation.flat_share > MIN_CREASED_FLAT_SHARE and deviation.relative > MIN_RULED_RESIDUAL
    if has_flats and deviation.flat_share > MIN_RULED_FLAT_SHARE:
        return "ruled"
    wide = deviation.detail_ratio <= MAX_WIDE_DETAIL_RATIO
    return "even" if has_flats or wide or deviation.relative > MIN_ROWS_RESIDUAL else ""


def settles(kind: str, deviation: Deviation, scales: Scales) -> bool:
    """Whether the curvature settles with the radius, where the kind may also be creases or details.

    Parameters
    ----------
    kind : str
    deviation : Deviation
        Both of `noise_kind`.
    scales : Scales
        Curvature of some vertices in balls by quadratic fits.

    Returns
    -------
    bool
    """
    if kind in ("even", "uneven") and _is_rows_of_small_scan(deviation, scales):
        return True
    if kind in ("rough", "uneven", "ruled", "even"):
        if scales.kurtosis < (MIN_KURTOSIS if kind in ("rough", "uneven") else MIN_EVEN_KURTOSIS):
            return False  # a wave
        if _is_repeated_wave(scales):
            return False
        if _errs_evenly(deviation, scales) or _is_not_repeated(scales):
            return True
    ratio = scales.default_error / scales.error
    if kind == "lattice":
        return (
            ratio > MIN_LATTICE_ERROR_RATIO
            and scales.bending_error < MAX_LATTICE_ERROR
            and scales.median_share > MIN_LATTICE_MEDIAN_SHARE
        )
    everywhere = scales.median_share > MIN_UNEVEN_MEDIAN_SHARE
    clear = scales.bending_error < MAX_UNEVEN_ERROR and ratio > MIN_UNEVEN_ERROR_RATIO
    least_fall = MIN_RULED_FALL if kind == "ruled" else MIN_STEEP_FALL
    steep = everywhere and scales.bending_error < MAX_STEEP_ERROR and scales.fall > least_fall
    if kind == "uneven":
        repeated = scales.correlation > MIN_REPEATED_CORRELATION
        return clear and everywhere and not (repeated and scales.bending_error > MAX_REPEATED_ERROR)
    if kind in ("ruled", "even"):
        return steep and kind == "ruled"
    if kind == "rough":
        return steep or (clear and everywhere)
    detailed = kind == "noise" and deviation.detail_ratio > MAX_NOISE_DETAIL_RATIO
    if detailed or (kind == "partial" and deviation.doubtful):
        return clear or steep or _errs_evenly(deviation, scales)
    return kind != "grid" or scales.median_share >= MIN_MEDIAN_SHARE  # creases of a part


def may_err_evenly(scales: Scales) -> bool:
    """Whether curvature in the first two balls allows errors that are alike everywhere, or not repeated.

    Parameters
    ----------
    scales : Scales
        Of two radii or more.

    Returns
    -------
    bool
    """
    even = scales.median_share > 0.8 * MIN_EVEN_MEDIAN_SHARE and scales.kurtosis < 2 * MAX_EVEN_KURTOSIS
    return even or (scales.correlation < MAX_UNRELATED_CORRELATION and _is_spread(scales))


def _errs_evenly(deviation: Deviation, scales: Scales) -> bool:
    """Whether the default region errs alike everywhere and the curvature settles with the radius.

    Noise and stairs, also smoothed, are the same all over a surface, so that their errors are distributed
    nearly normally; details and creases have theirs in places.
    """
    error, ratio = scales.bending_error, scales.default_error / scales.error
    normal = MIN_EVEN_KURTOSIS < scales.kurtosis < MAX_EVEN_KURTOSIS
    if scales.median_share < MIN_EVEN_MEDIAN_SHARE or error > MAX_EVEN_ERROR or ratio < MIN_EVEN_ERROR_RATIO:
        return False
    if scales.fall > MIN_ROWS_FALL and ratio > MAX_EVEN_ERROR_RATIO and (normal or error < MAX_UNEVEN_ERROR):
        return True
    if not normal:
        return False
    small, apart = error < MAX_UNEVEN_ERROR, ratio < MAX_EVEN_ERROR_RATIO
    if deviation.detail_ratio <= MAX_EVEN_DETAIL_RATIO and (small or apart):
        return True
    if deviation.detail_ratio <= MAX_WIDE_DETAIL_RATIO and small and apart:
        return True
    has_flats = deviation.flat_share > MIN_CREASED_FLAT_SHARE and deviation.relative > MIN_RULED_RESIDUAL
    return has_flats and error < MAX_FLAT_EVEN_ERROR


def _is_repeated_wave(scales: Scales) -> bool:
    """Whether the first balls repeat curvature from which wider balls differ: they flatten waves.

    Noise of such an error leaves less correlation, and falls with the radius.
    """
    return (
        scales.correlation > MIN_REPEATED_CORRELATION
        and scales.default_error > MIN_WAVE_ERROR
        and scales.fall < MAX_WAVE_FALL
    )


def _is_rows_of_small_scan(deviation: Deviation, scales: Scales) -> bool:
    """Whether the surface errs as rows of a scanner do, where no more than two balls hold a part of it."""
    return (
        len(scales.radius) < MIN_RADII
        and deviation.relative > MIN_SMALL_ROWS_RESIDUAL
        and MIN_ROWS_FALL < scales.fall < np.inf  # no change of balls that hold all of a component
        and scales.correlation < MAX_CORRELATION
        and scales.median_share > MIN_EVEN_MEDIAN_SHARE
        and MIN_KURTOSIS < scales.kurtosis < MAX_EVEN_KURTOSIS
    )


def _is_not_repeated(scales: Scales) -> bool:
    """Whether balls do not repeat the curvature of the default region, and settle all over the surface."""
    ratio = scales.default_error / scales.error
    if scales.correlation > MAX_CORRELATION or scales.error > MAX_UNREPEATED_ERROR:
        return False
    if scales.correlation < MAX_UNRELATED_CORRELATION and ratio > MIN_UNRELATED_RATIO:
        return _is_spread(scales)
    return (
        ratio > MIN_UNREPEATED_RATIO
        and scales.median_share > MIN_UNREPEATED_MEDIAN_SHARE
        and scales.kurtosis < MAX_UNREPEATED_KURTOSIS
    )


def _is_spread(scales: Scales) -> bool:
    """Whether the default region errs all over the surface, though more in places."""
    return scales.median_share > MIN_UNRELATED_MEDIAN_SHARE and scales.kurtosis < MAX_UNRELATED_KURTOSIS
