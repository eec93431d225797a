"""Classification of deviations of the vertices: noise and stairs, or details and creases of the surface.

Noise and stairs have creases of both signs, coordinates on grids, or curvature that converges with the radius
in the same way all over the surface.
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

# The thresholds below were measured on scans, mechanical parts, modelled surfaces, smooth test surfaces with
# noise, and voxelised bodies. "Ratio" is the error of the default region over that at the best radius,
# "error" the latter over the larger principal curvature, "median share" the median of the difference between
# the two regions over its mean, and "fall" the first change of the curvature with the radius over the second
# one; all four are defined in `Scales`. The "detail ratio" is the residual of cubic fits over that of quartic
# ones.

# Limits of the detail ratio for the kinds 'rough' and 'uneven'. Stairs that were averaged or cut have ratios
# of 1.2 to 1.7, details of six edges have 1.8, and smoothed segmentations up to 2.2. Where the ratio of
# details is lower, the error of the default region is 6 % or more.
MAX_ROUGH_DETAIL_RATIO, MAX_UNEVEN_DETAIL_RATIO = 1.75, 2.2
# Limit of the detail ratio of residuals that are certainly noise. Scans have 1.2, in some samples 1.13.
MAX_NOISE_DETAIL_RATIO = 1.1
# Limits of the cancellation of creases within two rings (`staircase.cancellation`): the signed sum of the
# creases over the sum of their sizes. Noise of more than a twentieth of an edge has 0.05 to 0.8, and less the
# larger the noise is; scans have 0.2 to 0.6, and mechanical parts 0.4 to 0.9.
MAX_CANCELLATION, MAX_ROUGH_CANCELLATION = 0.8, 0.28
# Limit of the cancellation times the noise in edges: the limit is lower for larger noise.
MAX_CANCELLATION_OF_NOISE = 0.055
# Least median share for the kind 'grid'. The creases of a mechanical part concentrate the difference in a few
# places, which gives a lower share.
MIN_MEDIAN_SHARE = 0.1
# Curvature that slightly larger balls do not repeat, all over the surface. The correlation between the
# default region and the first balls is 0.72 or more for details that the mesh resolves, and 0.6 or more for
# scans. The ratio is 2.4 or less where the default region is reliable. Scans and parts with less correlation
# have an error of 0.4 or more at the best radius; parts have a lower median share and a higher kurtosis.
MAX_CORRELATION, MIN_UNREPEATED_RATIO, MAX_UNREPEATED_ERROR = 0.55, 3.5, 0.37
MIN_UNREPEATED_MEDIAN_SHARE, MAX_UNREPEATED_KURTOSIS = 0.5, 6.0
# Slivers with noise have errors of very different sizes. Balls repeat none of them, and reduce the error to a
# tenth or less.
MAX_UNRELATED_CORRELATION, MIN_UNRELATED_RATIO = 0.3, 9.0
MIN_UNRELATED_MEDIAN_SHARE, MAX_UNRELATED_KURTOSIS = 0.35, 20.0
# Smoothed stairs, and noise over several edges: largest error, least ratio and least median share. Scans and
# modelled surfaces have errors of 0.15 to 0.9, smooth surfaces whose balls are biased have ratios of 1.1 to
# 1.9, and details that two rings resolve have errors of 0.13 or more.
MAX_UNEVEN_ERROR, MIN_UNEVEN_ERROR_RATIO, MIN_UNEVEN_MEDIAN_SHARE = 0.12, 2.3, 0.4
# Where the first balls repeat the curvature of the default region (correlation above the first number), the
# error must also be below the second: smoothed stairs have 0.06 or less, subdivided scans 0.10 or more.
MIN_REPEATED_CORRELATION, MAX_REPEATED_ERROR = 0.85, 0.08
# Larger errors are accepted with a steep fall, as for bodies with rims. Stairs (also smoothed) and surface
# nets have a fall of 3.6 to 13; scans and modelled surfaces with errors below 0.2 have 1.2 to 2.7.
MAX_STEEP_ERROR, MIN_STEEP_FALL = 0.18, 3.2
# Stairs on cylinders and planes are the same along a line, and quartic fits follow the five rows of two rings
# exactly. Their cubic residuals are 0.005 to 0.09 of an edge; those of smooth fine meshes of flat quadrangles
# are smaller.
MIN_RULED_FLAT_SHARE, MIN_RULED_RESIDUAL, MIN_RULED_FALL = 0.3, 0.004, 4.0
# Errors of the default region that are the same everywhere, as for noise and stairs: median share and
# kurtosis, which is 3 for normal noise. Scans and parts have errors in places: a kurtosis of 4.7 or more, or
# a median share below 0.6. Waves, threads and corrugated sheets have a kurtosis of 1.5 to 1.8, and stairs
# without flat faces 1.9 or more.
MIN_EVEN_MEDIAN_SHARE, MIN_KURTOSIS, MIN_EVEN_KURTOSIS, MAX_EVEN_KURTOSIS = 0.68, 1.75, 2.0, 4.6
# Limits of the ratio and the error for such surfaces. Surfaces that the default fits resolve have ratios of
# 0.5 to 2.5; above the second limit, balls of the best radius leave little of the noise.
MIN_EVEN_ERROR_RATIO, MAX_EVEN_ERROR_RATIO, MAX_EVEN_ERROR, MAX_FLAT_EVEN_ERROR = 3.5, 15, 0.3, 0.2
# Limits of the detail ratio for such surfaces. Where details of one size have a detail ratio below the first,
# the error of the default region is 6 % or more; where bumps have one below the second, the ratio is above
# 15.
MAX_EVEN_DETAIL_RATIO, MAX_WIDE_DETAIL_RATIO = 2.3, 2.8
# Surfaces whose coordinates repeat with voxels: least ratio, largest error and least median share. Mechanical
# parts on such a grid have errors of 0.31 or more, in places.
MIN_LATTICE_ERROR_RATIO, MAX_LATTICE_ERROR, MIN_LATTICE_MEDIAN_SHARE = 2.2, 0.3, 0.35
# A side is short if it is below this fraction of the mean length, and slivers are present if the share of
# short sides is above the second number. Marching cubes of 20 bodies give 1.4 to 9.8 % of short sides;
# regular grids with noise of a fifth of an edge along their normals give 0.01 %.
SHORT_SIDE, MIN_SHORT_SHARE = 0.3, 0.005
# Rows of a scanner, each at its own height, of which quartic fits follow five: least residuals in edges, and
# least fall. The fall is 8 to 30 for rows, and at most 6 for waves.
MIN_ROWS_RESIDUAL, MIN_SMALL_ROWS_RESIDUAL, MIN_ROWS_FALL = 0.03, 0.02, 8.0
# Number of radii from which the error at the best one may be below a quarter of that of the default region.
MIN_RADII = 3
# Waves that fits over two rings do not follow exactly: least error of the default region, and largest fall,
# which is 0.5 to 1.5 for waves; noise and stairs with such errors have 1.8 or more.
MIN_WAVE_ERROR, MAX_WAVE_FALL = 0.5, 1.7


def noise_kind(
    mesh: TriangleMesh, faces: Faces, dihedral: NDArray, deviation: Deviation
) -> tuple[str, Deviation]:
    """Kind of the noise according to residuals and creases; '' if these belong to the surface.

    Parameters
    ----------
    mesh : TriangleMesh
    faces : Faces
        Faces of the mesh.
    dihedral : (e,) ndarray
        Dihedral angles of the edges in radians, positive where convex.
    deviation : Deviation

    Returns
    -------
    kind : str
        A kind of `Noise`, or 'ruled' or 'even', which `settles` may confirm as 'uneven'.
    deviation : Deviation
        Deviation of the regions with this noise.
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
    """Whether some sides are short, as in meshes from marching cubes; regular grids have no short sides."""
    length = np.sqrt((sampled_sides(faces) ** 2).sum(axis=0))
    return bool((length < SHORT_SIDE * faces.mean_length).mean() > MIN_SHORT_SHARE)


def _kind_by_creases(deviation: Deviation, share: float) -> str:
    """Kind according to the residuals of fits and the cancellation of creases.

    'ruled' and 'even' are preliminary: the errors in balls decide whether they become 'uneven'.
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
    """Whether the curvature converges with the radius, which confirms kinds that may be creases or details.

    Parameters
    ----------
    kind : str
    deviation : Deviation
        Results of `noise_kind`.
    scales : Scales
        Curvature of some vertices by quadratic fits in balls.

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
    """Whether curvature in the first two balls is compatible with even errors, or with unrepeated ones.

    Parameters
    ----------
    scales : Scales
        Curvature at two radii or more.

    Returns
    -------
    bool
    """
    even = scales.median_share > 0.8 * MIN_EVEN_MEDIAN_SHARE and scales.kurtosis < 2 * MAX_EVEN_KURTOSIS
    return even or (scales.correlation < MAX_UNRELATED_CORRELATION and _is_spread(scales))


def _errs_evenly(deviation: Deviation, scales: Scales) -> bool:
    """Whether the default region has similar errors everywhere, and the curvature converges with the radius.

    Noise and stairs, also smoothed ones, are the same all over a surface, so their errors are nearly normally
    distributed; details and creases cause errors in a few places.
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
    """Whether the first balls repeat the curvature and wider ones do not: wider balls flatten waves.

    Noise with such an error has less correlation, and its error falls with the radius.
    """
    return (
        scales.correlation > MIN_REPEATED_CORRELATION
        and scales.default_error > MIN_WAVE_ERROR
        and scales.fall < MAX_WAVE_FALL
    )


def _is_rows_of_small_scan(deviation: Deviation, scales: Scales) -> bool:
    """Whether a surface too small for three radii has the errors of rows of a scanner."""
    return (
        len(scales.radius) < MIN_RADII
        and deviation.relative > MIN_SMALL_ROWS_RESIDUAL
        and MIN_ROWS_FALL < scales.fall < np.inf  # inf: both balls contain a whole component
        and scales.correlation < MAX_CORRELATION
        and scales.median_share > MIN_EVEN_MEDIAN_SHARE
        and MIN_KURTOSIS < scales.kurtosis < MAX_EVEN_KURTOSIS
    )


def _is_not_repeated(scales: Scales) -> bool:
    """Whether balls do not repeat the curvature of the default region, and converge all over the surface."""
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
    """Whether the errors of the default region are all over the surface, though larger in some places."""
    return scales.median_share > MIN_UNRELATED_MEDIAN_SHARE and scales.kurtosis < MAX_UNRELATED_KURTOSIS
