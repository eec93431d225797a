"""Curves on a mesh that is moved far away by a translation without rounding: the same curves.

Coordinates are multiples of 2^-12 and the offset is 2^40, so that both meshes have the same side vectors.
"""

import numpy as np
import pytest

from ddgcli.algorithms.geodesics.darboux import add_darboux_frames
from ddgcli.algorithms.geodesics.surface_curves import trace_curves
from ddgcli.algorithms.tangent_fields.field_curves import field_curves
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.mesh import shapes

TORUS = shapes.torus(24, 16)
NEAR = TORUS.moved(np.round(TORUS.points * 2**12) / 2**12)
FAR = NEAR.moved(NEAR.points + [2.0**40, -(2.0**39), 0.0])
VECTORS = np.stack([-NEAR.points[:, 1], NEAR.points[:, 0], NEAR.points[:, 2] + 0.3], axis=1)


@pytest.mark.parametrize("order", [1, 4])
def test_integral_curves_and_their_error_do_not_depend_on_the_place(order):
    starts = SurfacePoints([3, 200], [[0.2, 0.3, 0.5], [0.3, 0.3, 0.4]])
    near, far = (field_curves(mesh, VECTORS, starts, 1.0, order=order) for mesh in (NEAR, FAR))
    assert near.accuracy["field_error_estimate"] > 1e-6
    assert far.accuracy == near.accuracy
    np.testing.assert_array_equal(far.paths.barycentric, near.paths.barycentric)


def test_darboux_frames_do_not_depend_on_the_place():
    near, far = (
        add_darboux_frames(mesh, trace_curves(mesh, [7], [[0.3, 0.3, 0.4]], [[1, 0.3, 0.2]], [5.0]))
        for mesh in (NEAR, FAR)
    )
    assert np.ptp(near.arrays["normal_curvature"]) > 0.1
    for name in ("normal_curvature", "geodesic_torsion", "darboux_tangent"):
        np.testing.assert_array_equal(far.arrays[name], near.arrays[name])
