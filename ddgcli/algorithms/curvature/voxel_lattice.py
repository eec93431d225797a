"""Coordinates that repeat with the edge of voxels, also after the surface was smoothed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.faces import Faces

MAX_SAMPLE_SIZE = 20_000  # vertices
BINS_PER_EDGE = 8
MAX_BINS = 1 << 16  # along the longest extent
# wavelengths in mean edges: surfaces of voxels have 0.91 to 1.14 (0.88 without smoothing), regular height
# fields, boxes and subdivided spheres 0.85 to 0.89; and the range in which it must be the strongest
MIN_WAVELENGTH, MAX_WAVELENGTH = 0.9, 1.16
SHORTEST_WAVELENGTH, LONGEST_WAVELENGTH = 0.75, 1.4
# share of the vertices in phase along every axis: stairs after five steps of smoothing have 0.1 to 0.5, after
# twenty 0.04 to 0.17; scans have 0.01 to 0.04, irregular meshes up to 0.06
MIN_IN_PHASE = 0.09
MIN_CHANCES = 3.0  # of that share over the one that places at random have by chance


def repeats_with_voxels(faces: Faces) -> bool:
    """Whether the coordinates of all three axes repeat with one wavelength of about an edge.

    Smoothing moves the vertices by a part of a voxel, after which the Fourier coefficient of their density at
    the wavelength of the voxels is still far above that of other surfaces. Regular height fields lack it
    along the third axis, mechanical parts have different wavelengths.

    Parameters
    ----------
    faces : Faces

    Returns
    -------
    bool
    """
    points, edge = _as_large_as_voxels(faces)
    some = points[:, :: max(1, points.shape[1] // MAX_SAMPLE_SIZE)]
    low = some.min(axis=1, keepdims=True)
    extent = float((some - low).max())
    n_bins = min(int(extent / edge * BINS_PER_EDGE) + 1, MAX_BINS)
    n_padded = 1 << (2 * n_bins).bit_length()
    place = ((some - low) * (n_bins / extent)).astype(np.int64)
    # of the coefficients of the padded density: n_padded / n_bins * extent is the longest wavelength
    longest = extent * n_padded / n_bins / edge
    first, last = int(longest / LONGEST_WAVELENGTH) + 1, int(longest / SHORTEST_WAVELENGTH)
    if last >= n_padded // 2 or first > last:
        return False
    in_phase = [
        np.abs(np.fft.rfft(np.bincount(axis), n_padded)[first : last + 1]) / some.shape[1] for axis in place
    ]
    along_all = np.min(in_phase, axis=0)
    strongest = int(along_all.argmax())
    least = max(MIN_IN_PHASE, MIN_CHANCES / some.shape[1] ** 0.5)
    of_voxels = MIN_WAVELENGTH < longest / (first + strongest) < MAX_WAVELENGTH
    return of_voxels and float(along_all[strongest]) > least


def _as_large_as_voxels(faces: Faces) -> tuple[NDArray[np.float64], float]:
    """Vertices with edges of a bin or more, and the mean edge there.

    A component or a region with far smaller edges is one place of many vertices, in phase with any wave.
    """
    edge = faces.mean_length
    squared, count = faces.stars(
        np.stack([faces.squared_length.mean(axis=0), np.ones(faces.corner.shape[1])])
    )
    is_large = squared > count * (edge / BINS_PER_EDGE) ** 2
    if is_large.all():
        return faces.points, edge
    around = Faces(faces.corner[:, is_large[faces.corner].any(axis=0)], faces.points)
    return faces.points[:, is_large], around.mean_length
