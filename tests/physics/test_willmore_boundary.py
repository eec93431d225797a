"""Willmore flow of surfaces with boundary, and of surfaces at rest."""

import numpy as np
import pytest

from ddgcli.choices import WILLMORE_BOUNDARIES
from ddgcli.mesh import shapes
from ddgcli.models.willmore import report, setup
from ddgcli.models.willmore.setup import FlowOptions
from ddgcli.models.willmore.state import DEFAULT_STOP, Stop
from tests.physics.willmore_runs import assert_falls, bowl, energies, run_flow, saddle


def test_the_default_of_open_surfaces_converges_and_flows():
    """W of the saddle, by Gauss quadrature of H^2 = (x^2 - y^2)^2 / (4 (1 + x^2 + y^2)^3) over the area."""
    t, w = np.polynomial.legendre.leggauss(40)
    x, y = np.meshgrid(t, t)
    truth = float((np.outer(w, w) * (x**2 - y**2) ** 2 / (4 * (1 + x**2 + y**2) ** 2.5)).sum())
    runs = [run_flow(saddle(n), FlowOptions(stop=DEFAULT_STOP)) for n in (10, 20, 40)]
    error = [1 - energies(trajectory_frames)[0] / truth for trajectory_frames, _, _ in runs]
    assert truth == pytest.approx(0.0415, abs=5e-5) and 0 < error[-1] < 0.1
    assert error[0] / error[1] > 1.7 and error[1] / error[2] > 1.7  # of first order: the cells at the rim
    for trajectory_frames, _, shots in runs:
        assert (
            0 < energies(trajectory_frames)[-1] < energies(trajectory_frames)[0]
            and "least" not in shots[-1].stopped
        )


@pytest.mark.parametrize("boundary", WILLMORE_BOUNDARIES)
@pytest.mark.parametrize("energy", setup.ENERGIES)
@pytest.mark.parametrize("mesh", [shapes.grid(6, 6), shapes.icosphere(2)], ids=["flat", "ball"])
def test_at_rest_nothing_fails(mesh, energy, boundary):
    """Rounding of energies near zero rose, and ended as a rejected step."""
    wobble = mesh.moved(mesh.points + 1e-16 * np.random.default_rng(0).normal(size=mesh.points.shape))
    if energy == "gauss-map" and boundary != "clamped" and not mesh.topology.is_closed:
        return
    if energy == "circle-angle" and not mesh.topology.is_closed:
        return  # the diagonals' circles coincide: the energy has a kink there and no gradient
    for time_options in ({"step": 1e-3, "steps": 1}, {"step": 1e-3, "duration": 3e-3}, {"steps": 1}):
        timed = "step" in time_options
        if energy == "quadratic" and mesh.topology.is_closed and not timed:
            continue  # nowhere at rest
        options = FlowOptions(energy, boundary=boundary, timed=timed, stop=Stop() if timed else DEFAULT_STOP)
        observations, _, shots = run_flow(wobble, options, **time_options)
        assert observations[-1].scalar["energy_increases"] == 0 and np.isfinite(energies(observations)).all()
        assert report.failure_reason(shots[-1].ending, mesh, mesh, options) == ""


@pytest.mark.parametrize("boundary", ["clamped", "fixed"])
def test_boundaries_hold_and_a_bump_flattens(boundary):
    mesh = bowl()
    observations, end, _ = run_flow(mesh, FlowOptions(boundary=boundary, stop=DEFAULT_STOP))
    is_fixed = np.array(mesh.topology.boundary_vertex)
    if boundary == "clamped":
        is_fixed[mesh.faces[is_fixed[mesh.faces].any(axis=1)]] = True
    assert np.array_equal(end.points[is_fixed], mesh.points[is_fixed])
    assert energies(observations)[-1] < 0.1 * energies(observations)[0]
    assert_falls(observations)
