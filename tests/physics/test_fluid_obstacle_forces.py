"""Forces on obstacles: the cylinder of Schaefer and Turek (1996), and identities of the weak form."""

import numpy as np
import pytest

import ddgcli as ddg
from benchmarks.fluids.cylinder import DRAG, LIFT, scene, steady
from benchmarks.fluids.steady import SteadyFlow, model_of
from ddgcli.errors import SceneError
from ddgcli.geometry.intrinsic import corner_angle, face_area
from ddgcli.mesh.bisection import bisected
from ddgcli.mesh.shapes import random_sphere
from ddgcli.models.fluid.context import FluidContext
from ddgcli.models.fluid.obstacle_refinement import refined
from ddgcli.scenes.shapes import Grid, grid_mesh


def test_drag_of_the_cylinder_is_the_published_one_where_the_cells_are_fine_at_it():
    coarse, fine = (steady(16, refine) - [DRAG, LIFT] for refine in (0, 3))
    assert abs(fine[0]) < 0.012 * DRAG and abs(coarse[0]) > 0.1 * DRAG
    assert abs(fine[1]) < 0.02 < abs(coarse[1])


@pytest.mark.slow
def test_drag_and_lift_of_the_cylinder_are_those_published():
    drag, lift = steady(20, refine=4)
    assert abs(drag / DRAG - 1) < 5e-3 and abs(lift - LIFT) < 1e-3


def test_refinement_halves_cells_near_the_obstacle_alone_and_takes_arrays_along():
    mesh = grid_mesh(Grid(size=[1, 1], cells=[16, 16]))
    x, y, _ = np.asarray(mesh.points).T
    face = np.arange(mesh.n_faces)
    plain = FluidContext("f", mesh, {"linear": 2 * x - y}, {"number": face}, np.zeros(3), None)
    fine = refined(plain, lambda p: np.linalg.norm(p - [0.1, 0.1, 0], axis=1) - 0.05, 3)
    points = np.asarray(fine.mesh.points)
    assert np.allclose(fine.vertex["linear"], 2 * points[:, 0] - points[:, 1])
    far = np.asarray(fine.mesh.side_length)[points[fine.mesh.faces].mean(axis=1)[:, 0] > 0.95]
    assert far.min() == pytest.approx(1 / 16)
    assert fine.mesh.side_length.min() == pytest.approx(1 / 128)
    area = np.bincount(fine.face["number"], face_area(fine.mesh.side_length))
    assert np.allclose(area, face_area(mesh.side_length))
    assert np.degrees(corner_angle(fine.mesh.side_length).min()) == pytest.approx(45)


@pytest.mark.parametrize("seed", range(3))
def test_bisection_of_any_faces_keeps_the_surface_and_half_of_the_least_angle(seed):
    mesh = random_sphere(60, seed=seed)
    least = corner_angle(mesh.side_length).min()
    children = bisected(mesh, np.random.default_rng(seed).random(mesh.n_faces) < 0.2)
    topology = children.mesh.topology
    assert topology.is_closed and topology.is_manifold and topology.genus == 0
    before, after = (face_area(m.side_length).sum() for m in (mesh, children.mesh))
    assert after == pytest.approx(before, rel=1e-13)
    assert children.mesh.n_faces > mesh.n_faces
    assert corner_angle(children.mesh.side_length).min() > 0.499 * least


def test_refinement_is_refused_where_it_does_not_exist():
    text = scene(12, 0.3, length=0.82, refine=1)
    with pytest.raises(SceneError, match="refine"):
        model_of(text.replace("cells = [24, 12]", 'cells = [24, 12], periodic = "y"'))


def test_forces_without_flow_vanish_and_turn_with_the_flow():
    model = model_of(scene(12, 0.3, length=0.82))
    flow = SteadyFlow(model)
    assert (model.start["vorticity"] == 0).all()
    force = model.observe(flow.state(flow.solve(1e-3))).scalar["force_cylinder"]
    assert force[0] > 5 * abs(force[1]) > 0  # along the stream


def test_only_scenes_with_obstacles_without_slip_have_forces():
    text = scene(12, 0.3, length=0.82).replace('kind = "no-slip"', 'kind = "free-slip"')
    model = model_of(text)
    assert "force_cylinder" not in model.observe(model.start).scalar


def test_a_frozen_flow_has_the_forces_of_the_flow_that_a_force_drives():
    """A force without curl round an obstacle drives what a frozen harmonic flow prescribes."""
    square = {"name": "f", "role": "fluid", "grid": {"size": [1, 1], "cells": [16, 16]}}
    post = {"name": "post", "role": "obstacle", "sphere": {"center": [0.4, 0.5, 0], "radius": 0.2}}
    swirl = {"acceleration": ["-9*(y-0.5)/hypot(x-0.4, y-0.5)^2", "9*(x-0.4)/hypot(x-0.4, y-0.5)^2", 0]}
    walls = {"viscosity": {"nu": 1.0}, "boundary": {"kind": "no-slip"}}
    ends, coefficients = [], None
    for flows in ({"harmonic": {}, "force": swirl}, {"harmonic": {"kind": "frozen"}}):
        if coefficients is not None:
            flows["harmonic"]["coefficients"] = coefficients
        time = {"duration": 1.0, "step": 0.05, "frame_every": 1.0}
        end = ddg.simulate({"time": time, "object": [square, post], "effects": {**walls, **flows}}).finish()
        coefficients = end.results["harmonic_coefficients"]
        ends.append(end.results["forces"]["post"])
    assert np.linalg.norm(ends[0]) > 1e-3
    assert ends[1] == pytest.approx(ends[0], rel=0.01, abs=1e-3 * np.linalg.norm(ends[0]))
