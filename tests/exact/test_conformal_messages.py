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


@pytest.mark.parametrize("size", [1.0, 1e100])
@pytest.mark.parametrize("value", [1000.0, -1000.0])
def test_scale_factors_whose_exponential_overflows_are_refused_with_the_range(size, value):
    """They missed the angle sums by up to nan radians, and the smallest left no face with an area."""
    mesh = flat_disk()
    mesh = mesh.moved(size * mesh.points)
    with pytest.raises(ParameterError, match="is -?1000, .* use -?[0-9]+ to [0-9]+") as refused:
        conformal_map(mesh, boundary="lengths", boundary_values=np.full(mesh.n_vertices, value))
    assert refused.value.parameter == "boundary_values"
    low, high = (float(word) for word in str(refused.value).split("; use ")[1].split(" to "))
    for shift in (low, 60.0 - np.log(size), high):  # at the start only the boundary had the factor
        mapped = conformal_map(mesh, boundary="lengths", boundary_values=np.full(mesh.n_vertices, shift))
        assert mapped.converged


def test_a_line_of_too_many_crossings_is_not_blamed_on_sides_without_length(caplog):
    sphere = shapes.icosphere(2)
    lines = trace(sphere, [0], [[0.3, 0.3, 0.4]], [[1.0, 0.2, 0.0]], [1e3], max_crossings=500)
    assert lines.status[0] != 0
    (record,) = [r for r in caplog.records if "stopped short" in r.getMessage()]
    assert "after 500 crossings; give shorter lengths" in record.getMessage()
