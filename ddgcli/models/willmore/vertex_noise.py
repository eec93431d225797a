"""How much of a surface's bending energy the noise of its vertices makes."""

from __future__ import annotations

import logging

import numpy as np

from ddgcli.algorithms.curvature.deviation import vertex_deviation
from ddgcli.geometry.extrinsic import dihedral_angle, face_normal
from ddgcli.geometry.faces import Faces
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators.laplacian import lumped_vertex_area, stiffness

NOISE_ROUNDING = 1e-12  # mean edge lengths, up to which noise is that of the arithmetic
SHARE_WARNING = 0.2  # of the energy at the start, from which a warning is due
# of the estimate, which noise adds at least: where there is less, it is not noise. The estimate is that of
# `cotan`, but for its own error; other energies have down to 0.3 of it
LEAST_ENERGY_SHARE = {"cotan": 0.7}
LEAST_OTHER_SHARE = 0.3


def noise_energy(mesh: TriangleMesh) -> tuple[float, float]:
    """Noise of the vertices, in mean edge lengths, and the bending energy that it makes.

    Parameters
    ----------
    mesh : TriangleMesh

    Returns
    -------
    tuple of float
        Zeros where residuals are creases, details or stairs, or too few vertices have enough neighbours.

    Notes
    -----
    Independent heights of variance s^2 along the normals add s^2 trace(L M^-1 L) / 4 to the sum of
    |L x|^2 / (4 M): 4 n (s / edge)^2 on n vertices with equilateral triangles, and up to twenty times as much
    on irregular ones. That is what they add to `cotan`; to the other energies, 0.3 to 1.9 times as much.
    """
    noise = vertex_deviation(mesh, Faces.of(mesh), dihedral_angle(mesh, face_normal(mesh)))
    if noise is None or noise.doubtful or noise.kind == "voxels":
        return 0.0, 0.0
    deviation = noise.relative * float(mesh.side_length.mean())
    area = lumped_vertex_area(mesh)
    inverse = np.divide(1.0, area, out=np.zeros_like(area), where=area > 0)
    return noise.relative, 0.25 * deviation**2 * float((stiffness(mesh).power(2) @ inverse).sum())


def warn_of_noise(mesh: TriangleMesh, energy: float, name: str) -> None:
    """Warn where noise of the vertices makes a large share of an energy at the start.

    Parameters
    ----------
    mesh : TriangleMesh
    energy : float
        At the start: at least what the noise adds.
    name : str
        Of that energy.
    """
    relative, energy_of_noise = noise_energy(mesh)
    possible = LEAST_ENERGY_SHARE.get(name, LEAST_OTHER_SHARE) * energy_of_noise <= abs(energy)
    if possible and relative > NOISE_ROUNDING and energy_of_noise > SHARE_WARNING * abs(energy):
        logging.getLogger("ddgcli").warning(
            "the vertices have noise of %.2g of an edge, which makes %s of the energy %.4g at the "
            "start, whichever energy: only values after the first steps, which smooth it, are of the surface",
            relative, f"about {energy_of_noise:.2g}" if energy_of_noise < abs(energy) else "most", energy,
        )  # fmt: skip
