"""Predicted costs that grow with the shape of the input or as a square of an option."""

import numpy as np
import pytest

from ddgcli.cli.forecast.check_cost import size_of
from ddgcli.cli.forecast.delaunay_kernels import steiner_points
from ddgcli.cli.forecast.kernels import kernels_of
from ddgcli.cli.forecast.mesh_facts import corridor_aspect
from ddgcli.cli.forecast.use import InputSize
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh


@pytest.mark.parametrize("width", [1e-2, 3e-3])
def test_points_of_a_strip_are_its_length_over_its_width(width):
    """84 were predicted where it takes 3,290."""
    grid = shapes.grid(35, 1)
    unit = (grid.points - grid.points.min(axis=0)) / np.maximum(np.ptp(grid.points, axis=0), 1e-9)
    strip = grid.moved(unit * [35.0, width, 0.0])
    size = size_of(strip, {"refine": 25.0})
    points = steiner_points(25.0, None, size.delaunay.angle_deficit, size.delaunay)
    expected = 35.0 / width
    assert 0.6 * expected < points < 1.6 * expected
    narrow = size_of(strip.moved(unit * [35.0, 1e-5, 0.0]), {"refine": 25.0})
    assert steiner_points(25.0, None, 0.0, narrow.delaunay) == 100_000  # where refinement stops


def test_a_sharp_corner_of_the_boundary_is_no_corridor():
    points = [[0, 0, 0], [1, 0, 0], [1, 1e-4, 0], [0.5, 1, 0]]
    wedge = TriangleMesh.from_arrays(np.array(points), [[0, 1, 2]])
    assert corridor_aspect(wedge, 25.0) == 0.0 and corridor_aspect(shapes.grid(4, 4), 25.0) == 0.0


def test_eigenforms_grow_as_the_square_of_their_number():
    """1,000 of a torus of 5,400 edges were predicted as 7 s and took 16."""

    def times(k):
        return kernels_of("laplacian", {"form_eigen": k}, InputSize("surface", 3600))[-1].times

    assert 1.0 < times(40) < 2.0 and 50.0 < times(1000) < 60.0
