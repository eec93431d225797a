"""Predictions of lines on surfaces: the edges that they cross."""

import math

import numpy as np
import pytest

from ddgcli.algorithms.geodesics.sources import check_sources
from ddgcli.algorithms.geodesics.surface_curves import trace_curves
from ddgcli.algorithms.tangent_fields.fan import geodesic_fan
from ddgcli.cli.forecast.check_cost import size_of
from ddgcli.cli.forecast.kernels import kernels_of
from ddgcli.cli.forecast.mesh_facts import crossings_per_length, mean_chord
from ddgcli.cli.forecast.use import InputSize
from ddgcli.mesh import shapes


def test_crossings_of_straight_lines_are_counted_by_the_formula_of_crofton():
    # lines on tori do not pass everywhere
    for mesh, tolerance in ((shapes.random_sphere(500, 0), 0.07), (shapes.torus(40, 20), 0.3)):
        traces = trace_curves(
            mesh, np.array([0, 9]), np.full((2, 3), 1 / 3), [[1, 0.3, 0], [0, 1, 1]], [30.0, 30.0]
        )
        n_edges = sum(entry["crossings"] for entry in traces.entries)
        assert math.isclose(60 * crossings_per_length(mesh), n_edges, rel_tol=tolerance)
    use = kernels_of(
        "geodesic",
        {"trace": [[0, [1, 0, 0], [1, 0, 0], 30.0]] * 2},
        InputSize("surface", 9, crossings_per_length=5.0),
    )[-1]
    assert use.kernel == "geodesic crossings" and use.elements == 300.0


def test_curves_of_a_geodesic_run_are_counted():
    options = {"isolines": 40, "voronoi": True, "trace": [[0, [1, 0, 0], [1, 0, 0], 1.0]]}
    uses = {use.kernel: use.times for use in kernels_of("geodesic", options, InputSize("surface", 10_000))}
    counts = {"trace": 1, "crossings": 1, "isolines": 2, "voronoi": 1}
    assert uses == {f"geodesic {name}": times for name, times in counts.items()}


def test_the_rays_of_a_fan_are_counted_by_the_edges_that_they_cross():
    """Their number alone was counted: 0.09 of the seconds of 1,000 long rays, 0.15 of their memory."""

    def counts(mesh, length):
        options = {"fan": 40, "fan_length": length}
        uses = {use.kernel: use for use in kernels_of("geodesic", options, size_of(mesh, options))}
        fan = geodesic_fan(mesh, check_sources(mesh, [len(mesh.points) // 2]), 40, length)
        n_points = int(fan.paths.start[40])
        return uses["geodesic fan crossings"].elements / n_points, uses["geodesic fan levels"].elements / 40

    sphere, square = shapes.random_sphere(500, 0), shapes.grid(30, 30)
    assert counts(sphere, 6.0)[0] == pytest.approx(1.0, rel=0.1)
    assert counts(square, 0.3)[0] == pytest.approx(1.0, rel=0.2)
    assert 0.7 < counts(square, 100.0)[0] < 1.8  # rays stop at the boundary, which they start far from
    assert counts(square, 100.0)[1] == 1024 and counts(square, 0.1)[1] == 64


def test_lines_between_boundaries_have_the_mean_length_of_santalo():
    assert mean_chord(shapes.grid(9, 9, 2.0, 2.0)) == pytest.approx(math.pi / 2)  # pi area / perimeter
    assert mean_chord(shapes.icosphere(1)) == math.inf
