"""What a frame of a flow shows of its surface besides the energy."""

from __future__ import annotations

import math

import numpy as np

from ddgcli.geometry.intrinsic import corner_angle
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.willmore.constraints import Constraints, area, volume_inside


def measured(mesh: TriangleMesh, constraints: Constraints, scale: float) -> dict[str, float]:
    """Area, smallest angle, volume and reduced volume of a surface at unit size, in the unit of the input.

    The volume of a closed surface, or of one whose constraints have caps; the reduced volume of a closed one.
    """
    total = area(mesh)
    scalar = {
        "area": total * scale**2,
        "min_angle_degrees": float(np.degrees(corner_angle(mesh.side_length).min())),
    }
    closed = mesh.topology.is_closed
    if closed or constraints.caps is not None:
        volume = volume_inside(mesh, constraints.caps)
        scalar["volume"] = volume * scale**3
        if closed:
            scalar["reduced_volume"] = 6.0 * math.sqrt(math.pi) * abs(volume) / total**1.5
    for name, residual in constraints.residuals(mesh).items():
        scalar[f"{name}_residual"] = residual
    return scalar
