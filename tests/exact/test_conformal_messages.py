"""Distortions to rounding, and messages of conformal maps and of lines that are cut short."""

import numpy as np
import pytest

from ddgcli.algorithms.conformal.conformal_map import conformal_map
from ddgcli.algorithms.conformal.distortion import angle_distortion
from ddgcli.algorithms.tracing.trace import trace
from ddgcli.errors import ParameterError
from ddgcli.mesh import shapes
from tests.exact.test_conformal_maps import flat_disk


def test_distortions_are_ratios_of_singular_values_to_rounding():
    mesh = flat_disk()
    corners = mesh.points[mesh.faces][..., :2]
    for stretch, ratio in ((np.eye(2), 1.0), (np.diag([3.0, 1.0]), 3.0), (np.diag([1.0, -1.0]), 1.0),
                           (np.array([[1.0, 1e-7], [0.0, 1.0]]), 1.0 + 1e-7)):  # fmt: skip
        assert angle_distortion(mesh, corners @ stretch.T) == pytest.approx(ratio, abs=1e-13)


def test_a_map_of_given_scale_warns_of_no_degenerate_faces_of_its_iterates(caplog):
    mesh = flat_disk()
    scale = np.full(mesh.n_vertices, 1.5)
    mapped = conformal_map(mesh, boundary="lengths", boundary_values=scale)
    assert not caplog.records
    assert mapped.summary["conformal_distortion"]["max"] == pytest.approx(1.0, abs=1e-11)


def test_angles_that_contradict_gauss_bonnet_are_those_of_the_option_that_was_given():
    mesh = shapes.grid(4, 4)
    angles = np.full(mesh.n_vertices, 180.0)
    with pytest.raises(ParameterError, match="change the angles of `boundary_values`") as refused:
        conformal_map(mesh, boundary="angles", boundary_values=angles)
    assert refused.value.parameter == "boundary_values"


def test_a_line_of_too_many_crossings_is_not_blamed_on_sides_without_length(caplog):
    sphere = shapes.icosphere(2)
    lines = trace(sphere, [0], [[0.3, 0.3, 0.4]], [[1.0, 0.2, 0.0]], [1e3], max_crossings=500)
    assert lines.status[0] != 0
    (record,) = [r for r in caplog.records if "stopped short" in r.getMessage()]
    assert "after 500 crossings; give shorter lengths" in record.getMessage()
