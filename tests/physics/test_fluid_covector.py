"""Integrator `covector`: what it keeps, its orders, its map over several steps, volumes, and its peer."""

import numpy as np
import pytest

from benchmarks.fluids.integrators import PEER, row
from benchmarks.fluids.runs import run_fluid
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.fluid.covector import MAX_MAP_STEPS, CovectorAdvection
from ddgcli.models.fluid.surface_space import SurfaceSpace
from tests.physics.test_fluid import SURFACES, irregular_annulus
from tests.physics.test_fluid_circulation import needles
from tests.physics.test_fluid_volumes import CELL, run, series

INITIAL_FLOW = 'initial = { vorticity = "sin(3*x + 1)*cos(2*z + 1) + y + x*z" }\n'
MESH_OF_CALL = 'mesh = "given"'
NAMES = ("conservative", "circulation", "covector", PEER)
TIME = 'integrator = "covector"\nduration = {}\nstep = {}\n'


@pytest.mark.parametrize("name", [*SURFACES, "needles"])
def test_covector_raises_neither_energy_nor_enstrophy_and_keeps_the_total(name):
    mesh = needles() if name == "needles" else SURFACES[name]
    count = 2 * (mesh.topology.genus or 0) + max(0, mesh.topology.boundary_loops - 1)
    effects = INITIAL_FLOW + (f"harmonic = {{ coefficients = {[0.3] * count} }}" if count else "")
    shape = 'grid = { size = [6, 6], cells = [10, 10], periodic = "xy" }'
    out = run_fluid(effects, TIME.format(0.2, 0.02), shape if name == "flat torus" else MESH_OF_CALL, mesh)
    for what in ("kinetic_energy", "enstrophy"):
        values = out.series(what)
        assert (np.diff(values) <= 1e-12 * values[0]).all() and values[-1] < values[0]
    assert np.ptp(out.series("total_vorticity")) < 1e-13 * out.series("absolute_vorticity")[0]
    assert out.series("divergence").max() < 1e-13


COLUMNS = ["problem", "faces", "integrator", "step", "error", "velocity", "energy", "enstrophy", "s"]


def column(name):
    return COLUMNS.index(name)


def test_covector_has_half_the_error_of_circulation_and_a_semi_lagrangian_solver_ten_times_it():
    rows = {name: row("wave, icosphere", 3, name, 0.1) for name in NAMES}
    error = {name: values[column("error")] for name, values in rows.items()}
    assert error["covector"] < 0.5 * error["circulation"] and error["covector"] < error["conservative"]
    assert error[PEER] > 5 * error["covector"]
    assert rows[PEER][column("energy")] > 0.1 and 0 < rows["covector"][column("energy")] < 1e-3


def test_the_error_of_covector_and_the_energy_that_it_loses_fall_with_mesh_and_step():
    rows = [row("wave, icosphere", level, "covector", step) for level, step in ((2, 0.2), (3, 0.1))]
    coarse, fine = ([values[column(what)] for what in ("error", "energy")] for values in rows)
    assert coarse[0] / fine[0] > 2 and coarse[1] / fine[1] > 3


@pytest.mark.parametrize("problem", ["wave, icosphere", "wave, irregular sphere"])
def test_the_velocity_by_covector_converges_at_second_order(problem):
    """Its curl on the sphere at an order of 1.2; the covector that is carried is the velocity."""
    coarse, fine = (row(problem, level, "covector", step) for level, step in ((2, 0.2), (3, 0.1)))
    assert coarse[column("velocity")] / fine[column("velocity")] > 3.4
    assert fine[column("velocity")] < 0.4 * fine[column("error")]


def test_steady_cells_on_a_flat_torus_stay_with_second_order():
    error = []
    for n in (8, 16):
        shape = f'grid = {{ size = [{2 * np.pi}, {2 * np.pi}], cells = [{n}, {n}], periodic = "xy" }}'
        start = 'initial = { vorticity = "2*sin(x)*sin(y)" }'
        first, *_, last = run_fluid(start, TIME.format(1.2, 1.2 / n), shape).observations
        apart = np.linalg.norm(last.vertex["vorticity"] - first.vertex["vorticity"])
        error.append(apart / np.linalg.norm(first.vertex["vorticity"]))
    assert error[1] < 0.04 and error[0] / error[1] > 3.5


@pytest.mark.parametrize("name", ["closed", "walls"])
def test_the_order_of_the_faces_in_the_file_changes_nothing(name):
    """Lines from vertices took the slope of the velocity in one of their faces, the last in the file."""
    mesh = shapes.random_sphere(150) if name == "closed" else irregular_annulus()
    rng = np.random.default_rng(2)
    faces = np.array([np.roll(face, rng.integers(3)) for face in mesh.faces])[rng.permutation(mesh.n_faces)]
    dye = 'dye = { amount = "x + y*z" }'
    one, other = (
        run_fluid(INITIAL_FLOW + dye, TIME.format(0.4, 0.1), MESH_OF_CALL, each).observations[-1].vertex
        for each in (mesh, TriangleMesh.from_arrays(mesh.points, faces))
    )
    for what in ("vorticity", "dye"):
        assert np.abs(one[what] - other[what]).max() < 1e-9 * np.abs(one[what]).max()


def test_a_step_of_no_length_changes_the_resolved_flow_little():
    space = SurfaceSpace(shapes.icosphere(3), np.zeros((0, 1920)))
    omega = space.mesh.points[:, 2] * (5 * space.mesh.points[:, 2] ** 2 - 3) * space.mass
    omega -= space.mass * omega.sum() / space.mass.sum()
    flow, carry = (omega, np.zeros(0)), CovectorAdvection(space)
    still = carry.no_map
    plain = carry.pulled_back(still, flow, False)[0]
    sharp = carry.pulled_back(still, carry.sharpened(flow, False), False)[0]
    size = np.linalg.norm(omega)
    assert np.linalg.norm(sharp - omega) < 0.3 * np.linalg.norm(plain - omega) < 0.03 * size


def test_the_map_is_followed_over_several_steps_while_nothing_else_changes_the_flow():
    free = run_fluid(INITIAL_FLOW, TIME.format(0.04, 0.01), mesh=SURFACES["sphere"])
    rubbed = run_fluid(
        INITIAL_FLOW + "viscosity = { nu = 1e-3 }", TIME.format(0.04, 0.01), mesh=SURFACES["sphere"]
    )
    counts = {}
    for name, out in (("free", free), ("rubbed", rubbed)):
        state, counts[name] = out.fluid.start, []
        for k in range(6):
            state = out.fluid.advance(state, 0.01 * k, 0.01)
            counts[name].append(np.count_nonzero(state["map_dt"]))
    assert counts["free"] == [1, 2, 3, 4, 1, 2] and MAX_MAP_STEPS == 4
    assert counts["rubbed"] == [1] * 6


def test_covector_in_volumes_keeps_divergence_and_circulations_and_never_gains_energy():
    model, observed, _ = run(CELL, 6, 1.0, 0.2, "covector")
    energy = series(observed, "kinetic_energy")
    assert np.all(np.diff(energy) <= 1e-14 * energy[0]) and 0.9 * energy[0] < energy[-1] < energy[0]
    assert series(observed, "divergence").max() < 1e-13
    assert series(observed, "total_vorticity").max() < 1e-13 * series(observed, "absolute_vorticity")[0]
    assert series(observed, "lost_energy")[-1] == pytest.approx(energy[0] - energy[-1], rel=1e-9)


def test_the_error_of_covector_in_a_volume_does_not_grow_with_the_number_of_steps():
    """Steady cells, which a step of no length must leave as they are."""
    errors = []
    for step in (0.1, 0.025):
        _, observed, _ = run(CELL, 6, 1.0, step, "covector")
        before, after = (observation.vertex["velocity"] for observation in (observed[0], observed[-1]))
        errors.append(np.linalg.norm(after - before) / np.linalg.norm(before))
        energy = series(observed, "kinetic_energy")
        assert 0 <= 1 - energy[-1] / energy[0] < 2e-3
    assert max(errors) < 0.07 and errors[1] < 1.02 * errors[0]


def test_a_viscous_wave_moves_with_its_flow():
    """A wave of degree 3 turns at 5/6 of the rate of the rigid turn below it.

    Where a face leaves with itself what it has beyond its vertices, a quarter of the wave goes astray.
    """
    wave = 'initial = { vorticity = "2*z + 3*(x*x*x - 3*x*y*y)" }\nviscosity = { nu = 0.01 }'
    out = run_fluid(wave, TIME.format(2, 0.1), "sphere = { subdivisions = 3 }")
    x, y, z = np.array(out.fluid.context.points).T
    turned = (x + 1j * y) * np.exp(-5j / 6 * (1 - np.exp(-0.04)) / 0.02)
    truth = 2 * z * np.exp(-0.04) + 3 * (turned**3).real * np.exp(-0.24)
    error = out.observations[-1].vertex["vorticity"] - truth
    assert np.linalg.norm(error) < 0.06 * np.linalg.norm(truth)


def test_a_map_of_several_steps_that_would_gain_energy_begins_anew_and_no_step_is_divided():
    """On an irregular ring steps were divided, without end, for what the steps before had done."""
    turn = 'initial = { velocity = ["-y*(1 + 0.3*x)", "x*(1 - 0.3*y)", 0] }\nharmonic = {}'
    out = run_fluid(turn, TIME.format(1.0, 0.2), mesh=irregular_annulus())
    assert out.steps == 5
    assert 0.999 < out.series("kinetic_energy")[-1] / out.series("kinetic_energy")[0] <= 1
