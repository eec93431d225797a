"""Noise of a surface's vertices: its kind, its effect on curvature, and the radius that averages it."""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature.scales import Scales

FITTED_SCHEMES = ("quadric", "normal-voting")  # schemes for which `Scales` are measured

# Root mean square error of the curvature above which the default region is unreliable. The limit is lower for
# rounded coordinates, which are certain; smaller errors of other kinds may be due to details.
MAX_ERROR, MAX_ROUNDED_ERROR = 0.08, 0.04
# Largest error at the proposed radius, over that of the default region.
MAX_REMAINING_ERROR_SHARE = 0.75
# Largest error at the best radius of voxels and rounded coordinates; parts made of blocks, pleats and layers
# have larger errors.
MAX_LATTICE_ERROR = 0.5
# Normal voting is proposed if its error is below this fraction of that of quadratic fits.
MAX_VOTING_SHARE = 0.8


@dataclass(frozen=True, eq=False)
class SizeGroup:
    """Components of similar size: their vertices, and curvature of some of these in balls (see `Noise`)."""

    vertices: NDArray[np.int64]
    scales: Scales
    voting: Scales | None = None

    def scales_of(self, scheme: str) -> Scales:
        """Curvature in balls by normal voting if that is the scheme, else by quadratic fits."""
        return self.voting if scheme == "normal-voting" and self.voting is not None else self.scales


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise of the vertices along the normals.

    Parameters
    ----------
    relative : float or None
        Standard deviation over the mean edge length; None where too few vertices have enough neighbours.
    kind : str
        'voxels' (a staircase), 'rounded' (coordinates), 'grid' (marching cubes of grey values), 'spikes',
        'partial' (in a part of the surface), 'rough' (structure of the size of an edge), 'uneven' (of several
        edges, as smoothed stairs have), 'lattice' (smoothed stairs whose vertices repeat with voxels),
        'noise', or '' for a surface whose residuals are creases or details.
    scales : Scales, optional
        Mean curvature of some vertices by quadratic fits in balls, if the residuals may be noise.
    voting : Scales, optional
        Mean curvature of some vertices by normal voting, if noise dominates.
    groups : tuple of SizeGroup
        Both for components of each size, if noise dominates and the sizes differ.
    """

    relative: float | None
    kind: str = ""
    scales: Scales | None = None
    voting: Scales | None = None
    groups: tuple[SizeGroup, ...] = ()

    @property
    def dominates_curvature(self) -> bool:
        """Whether fits over the default region are unreliable and the proposed radius is clearly better."""
        best = self.scales_of(self.best_scheme)
        if not self.kind or best is None:
            return False
        return self._is_unreliable(
            best.default_rms, best.default_error, best.own_error * best.stated_size / best.size
        )

    def default_error(self, mean: NDArray) -> float | None:
        """Mean error of the mean curvature (n,) at the default region, over its mean size; None if reliable.

        It is the difference to the curvature in balls of the best radius.
        """
        samples = self._samples(self.best_scheme)
        if not self.kind or not samples:
            return None
        size = sum(share * best.size for share, best in samples)
        error = square = remaining = 0.0
        for share, best in samples:
            difference = np.abs(mean[best.vertices] - best.mean)
            error += share * float(np.hypot(difference.mean(), best.error * best.size)) / size
            square += share * float(np.mean(difference**2))
            remaining += share * best.own_error * best.stated_size / size
        unreliable = self._is_unreliable(square**0.5 / size, error, remaining)
        return error * size / self._stated_size if unreliable else None

    def _samples(self, scheme: str) -> list[tuple[float, Scales]]:
        """Curvature in balls of all components or of those of each size, with their share of the vertices."""
        total = sum(len(group.vertices) for group in self.groups)
        if total:
            return [(len(group.vertices) / total, group.scales_of(scheme)) for group in self.groups]
        scales = self.scales_of(scheme)
        return [] if scales is None else [(1.0, scales)]

    def _is_unreliable(self, root_mean_square: float, mean: float, remaining: float) -> bool:
        """Whether errors are large, and those at the best radius clearly less."""
        on_lattice = self.kind in ("voxels", "rounded")
        most = min(MAX_REMAINING_ERROR_SHARE * mean, MAX_LATTICE_ERROR if on_lattice else np.inf)
        return root_mean_square > self.max_error and remaining < most

    @property
    def max_error(self) -> float:
        """Error of the curvature, root mean square, above which the default region is unreliable."""
        return MAX_ROUNDED_ERROR if self.kind == "rounded" else MAX_ERROR

    @property
    def best_scheme(self) -> str:
        """Scheme with the least error in balls."""
        if self.scales is None or self.voting is None:
            return "quadric"
        least = MAX_VOTING_SHARE * self._error("quadric")
        return "normal-voting" if self._error("normal-voting") < least else "quadric"

    def _error(self, scheme: str) -> float:
        """Mean error of the mean curvature in balls of the best radius, in 1/length."""
        samples = self._samples(scheme)
        return sum(share * scales.expected_error * scales.stated_size for share, scales in samples)

    @property
    def _stated_size(self) -> float:
        """Mean size of the mean curvature by the best scheme, which errors of all schemes are relative to."""
        return sum(share * scales.stated_size for share, scales in self._samples(self.best_scheme))

    def scales_of(self, scheme: str) -> Scales | None:
        """Curvature in balls by a scheme, or by the one that is most like it."""
        return self.voting if scheme == "normal-voting" and self.voting is not None else self.scales

    def expected_error(self, scheme: str, mean: NDArray | None = None) -> float | None:
        """Mean error of the mean curvature in balls of the best radius, over its mean size.

        Measures such as normal cycles have a bias at any radius, as stairs have more area than the body:
        their error is the distance of their mean curvature (n,) to that of the best scheme.
        """
        samples = self._samples(self.best_scheme)
        if not samples:
            return None
        if mean is None or scheme in FITTED_SCHEMES:
            return self._error(scheme) / self._stated_size
        distances = [share * np.abs(mean[best.vertices] - best.mean).mean() for share, best in samples]
        return float(np.hypot(sum(distances), self._error(self.best_scheme))) / self._stated_size

    def radius_of(self, scheme: str) -> float:
        """Radius with the least error of a scheme, in length units: that of most vertices."""
        samples = self._samples(scheme)
        return max(samples, key=lambda sample: sample[0])[1].best_radius if samples else 0.0

    def radii_of(self, scheme: str, n_vertices: int) -> float | NDArray[np.float64]:
        """Radius with the least error at each of n vertices; one radius if the components have one size."""
        if len(self.groups) < 2 or scheme not in FITTED_SCHEMES:
            return self.radius_of(scheme)
        radius = np.full(n_vertices, self.radius_of(scheme))
        for group in self.groups:
            radius[group.vertices] = group.scales_of(scheme).best_radius
        return radius


KINDS = {
    "voxels": "is a staircase of voxels",
    "rounded": "has rounded coordinates (noise of {:.2g} of an edge)",
    "grid": "comes from marching cubes of a coarse image (deviations of {:.2g} of an edge, slivers)",
    "spikes": "has spikes (noise of {:.2g} of an edge in a part of it)",
    "partial": "has noise of {:.2g} of an edge in a part of it",
    "rough": "has noise of {:.2g} of an edge (or details of a few edges)",
    "uneven": "is uneven by {:.2g} of an edge over several edges, as smoothed voxels are (or has details)",
    "lattice": "comes from a grid of voxels (it is uneven by {:.2g} of an edge over several edges)",
    "noise": "has noise of {:.2g} of an edge",
}

SMOOTHED_KINDS = ("uneven", "lattice")
DOUBTFUL_KINDS = ("rough", "uneven")  # which details that two rings do not resolve may look like
UNKNOWN_ERROR = " of what the mesh has (what smoothing steps took from the body cannot be known)"


def warn_of_noise(noise: Noise, scheme: str, mean: NDArray, scale: float) -> float | None:
    """Report the error at the default region, and the radius to use, where that region is unreliable.

    Parameters
    ----------
    noise : Noise
    scheme : str
    mean : (n,) ndarray
        Mean curvature at the default region; its error is the difference to that in balls of the best radius.
    scale : float
        Length unit of the input over that of `noise` and `mean`.

    Returns
    -------
    float or None
        The mean error over the mean size, where noise dominates; None elsewhere.
    """
    error = noise.default_error(mean)
    if error is None:
        return None
    # a scheme that measures in balls stays, unless the stairs or the noise suit the averaged normals better
    best = "normal-voting" if scheme == "normal-voting" else noise.best_scheme
    remedy = "use" if best == scheme else f"use `scheme={best}` with"
    radius = f"`radius={noise.radius_of(best) * scale:.3g}` or `radius=auto`"
    if len(noise.groups) > 1:
        radii = [group.scales_of(best).best_radius * scale for group in noise.groups]
        least, most = f"{min(radii):.3g}", f"{max(radii):.3g}"
        if least != most:
            radius = f"`radius=auto` ({least} to {most} by the sizes of the components)"
    logging.getLogger("ddgcli").warning(
        "the surface %s: at the default region the error of the mean curvature is about %.0f %%; "
        "%s %s, where it is about %.0f %%%s",
        KINDS[noise.kind].format(noise.relative),
        100 * error,
        remedy,
        radius,
        100 * (noise.expected_error(best) or 0.0),
        UNKNOWN_ERROR if noise.kind in SMOOTHED_KINDS else "",
    )
    return error


def warn_of_details(noise: Noise, scheme: str, scale: float) -> None:
    """Report that balls of the best radius flatten details, where the noise may be such.

    Parameters
    ----------
    noise : Noise
    scheme : str
    scale : float
        As in `warn_of_noise`.
    """
    if noise.kind in DOUBTFUL_KINDS:
        logging.getLogger("ddgcli").warning(
            "the surface %s: balls of radius %.3g average both; where these are details, use no `radius`",
            KINDS[noise.kind].format(noise.relative),
            noise.radius_of(scheme) * scale,
        )


def warn_of_better_scheme(noise: Noise, scheme: str, error: float) -> None:
    """Report another scheme that has a clearly smaller error in balls of its best radius.

    Parameters
    ----------
    noise : Noise
    scheme : str
    error : float
        Expected one of that scheme.
    """
    best, least = noise.best_scheme, noise.expected_error(noise.best_scheme)
    if best != scheme and least is not None and least < MAX_VOTING_SHARE * error:
        logging.getLogger("ddgcli").warning(
            "the error of the mean curvature is about %.0f %% at this radius; use `scheme=%s` with "
            "`radius=auto`, where it is about %.0f %%",
            100 * error,
            best,
            100 * least,
        )
