"""Fluids in tetrahedra against known flows: Kelvin's ring, Hill's vortex, the decay of waves in the box.

Rings are a quarter of themselves: free-slip walls through their axis are planes of symmetry. The other walls
mirror them; far away a ring is a dipole of its impulse, whose images slow it down.
"""

import numpy as np
import pytest
from scipy.special import ellipe, ellipk, erfc

from benchmarks.fluids.runs import run_fluid
from ddgcli.mesh.shapes import box_tetrahedra

WIDTH, HEIGHT, PLACE, SPAN = 1.4, 2.0, 0.8, 0.1  # half width and height of the box, height of the ring
RADIUS, CORE = 0.6, 0.2


def rings(vorticity, low, high, across):
    """(3, k) radius, height and circulation of thin rings that fill a vortex, and the width of a cell."""
    h = (high - low) / across
    r, z = np.meshgrid(low + (np.arange(across) + 0.5) * h, (np.arange(across) + 0.5) * h - (high - low) / 2)
    r, z = r[r > 0], z[r > 0]
    return np.stack([r, z, vorticity(r, z) * h**2]), h


def drift(vortex, source, up=0.0, cell=0.0):
    """Speed of the centroid of impulse of coaxial rings in the flow of `source`, `up` above them.

    The sum of g r (r u_z + 2 z u_r) over that of g r^2; with `cell` the source is the vortex itself, and a
    ring moves itself as Kelvin has it, its core a disk as large as the cell.
    """
    r, z, g = vortex[:, :, None]
    radius, height, strength = source
    d = z - height - up
    far, near = (r + radius) ** 2 + d**2, (r - radius) ** 2 + d**2
    same = near == 0
    near = np.where(same, 1.0, near)
    m = np.where(same, 0.0, 4 * r * radius / far)
    k, e = ellipk(m), ellipe(m)
    scale = np.where(same, 0.0, strength / (2 * np.pi * np.sqrt(far)))
    upward = (scale * (k + (radius**2 - r**2 - d**2) / near * e)).sum(axis=1, keepdims=True)
    outward = (scale * d / r * (-k + (radius**2 + r**2 + d**2) / near * e)).sum(axis=1, keepdims=True)
    if cell:
        upward += g / (4 * np.pi * r) * (np.log(8 * r * np.sqrt(np.pi) / cell) - 0.25)
    return float((g * r * (r * upward + 2 * z * outward)).sum() / (g * r**2).sum())


def drift_in_the_box(vortex, alone, copies=4):
    """Speed among the images in the walls: coaxial ones as they are, the others as dipoles."""
    impulse = np.pi * float(vortex[2] @ vortex[0] ** 2)
    mirrored = vortex * [[1], [-1], [-1]]
    steps = np.arange(-copies, copies + 1)
    total = alone + sum(drift(vortex, vortex, 2 * HEIGHT * k) for k in steps if k)
    total += sum(drift(vortex, mirrored, 2 * HEIGHT * k - 2 * PLACE) for k in steps)
    i, j, k = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3).T
    beside = (i != 0) | (j != 0)
    for sign, z in ((1, 2 * HEIGHT * k), (-1, 2 * HEIGHT * k - 2 * PLACE)):
        place = np.stack([2 * WIDTH * i, 2 * WIDTH * j, z], axis=1)[beside]
        d = np.linalg.norm(place, axis=1)
        total += sign * impulse / (4 * np.pi) * np.sum(3 * place[:, 2] ** 2 / d**5 - 1 / d**3)
    return total


def speed_of(jet, cells, tmp_path):
    """Speed of the centroid of impulse of a vortex that is the curl of jet(x) e_z."""
    size = [WIDTH, WIDTH, HEIGHT]
    count = [cells, cells, round(cells * HEIGHT / WIDTH)]
    mesh = box_tetrahedra(*count, size)
    velocity = np.zeros((len(mesh.tetrahedra), 3))
    velocity[:, 2] = jet(np.asarray(mesh.points)[mesh.tetrahedra].mean(axis=1) - [0, 0, PLACE])
    np.save(tmp_path / "v.npy", velocity)
    out = run_fluid(
        f'initial = {{ velocity = "{tmp_path / "v.npy"}" }}',
        f'integrator = "energy"\nduration = {SPAN}\nstep = {SPAN / 2}\nframe_every = {SPAN}',
        f"box = {{ size = {size}, cells = {count} }}",
    )
    x, y, z = np.asarray(out.fluid.context.points).T
    height = []
    for observation in out.observations:
        omega = observation.vertex["vorticity"]
        impulse = out.fluid.space.mass * (x * omega[:, 1] - y * omega[:, 0])
        height.append(impulse @ z / impulse.sum())
    return (height[-1] - height[0]) / SPAN


def test_the_flow_of_coaxial_rings_is_that_of_kelvin_and_of_hill():
    """The oracle of the tests below: a thin Gaussian ring, and Hill's vortex of speed 1."""
    core = 0.02
    vortex, cell = rings(gaussian(core), RADIUS - 3 * core, RADIUS + 3 * core, 24)
    kelvin = (np.log(8 * RADIUS / core) - 0.558) / (4 * np.pi * RADIUS)
    assert drift(vortex, vortex, cell=cell) == pytest.approx(kelvin, rel=3 * (core / RADIUS) ** 2)
    vortex, cell = rings(hill, -RADIUS, RADIUS, 48)
    assert drift(vortex, vortex, cell=cell) == pytest.approx(1.0, rel=0.01)


def gaussian(core):
    return lambda r, z: np.exp(-((r - RADIUS) ** 2 + z**2) / core**2) / (np.pi * core**2)


def hill(r, z):
    return 7.5 / RADIUS**2 * r * (r**2 + z**2 < RADIUS**2)


def gaussian_jet(x):
    rho = np.hypot(x[:, 0], x[:, 1])
    return np.exp(-((x[:, 2] / CORE) ** 2)) * erfc((rho - RADIUS) / CORE) / (2 * CORE * np.sqrt(np.pi))


def hill_jet(x):
    return 3.75 / RADIUS**2 * np.maximum(RADIUS**2 - (x**2).sum(axis=1), 0)


@pytest.mark.parametrize(
    "jet, vorticity, reach",
    [
        (gaussian_jet, gaussian(CORE), (RADIUS - 3 * CORE, RADIUS + 3 * CORE)),
        (hill_jet, hill, (-RADIUS, RADIUS)),
    ],
    ids=["Kelvin", "Hill"],
)
def test_a_ring_and_a_spherical_vortex_travel_at_their_speed(jet, vorticity, reach, tmp_path):
    """Coarse cells are as wide as the core: 20 to 30 % of the speed is missing; with half of their width a
    third of that, and their limit (second order) is within 5 %."""
    vortex, cell = rings(vorticity, *reach, 16)
    exact = drift_in_the_box(vortex, 1.0 if jet is hill_jet else drift(vortex, vortex, cell=cell))
    coarse, fine = (speed_of(jet, cells, tmp_path) for cells in (6, 12))
    assert 0.5 * exact < coarse < fine < exact
    assert (exact - coarse) / (exact - fine) > 2.5
    assert fine + (fine - coarse) / 3 == pytest.approx(exact, rel=0.05)


def test_a_wave_in_the_box_decays_at_its_rate_with_second_order():
    """Small amplitude, three wave numbers of 1: the velocity decays at 3 nu, its energy at 6 nu."""
    wave = '"1e-6*sin(x)*cos(y)*cos(z)", "-2e-6*cos(x)*sin(y)*cos(z)", "1e-6*cos(x)*cos(y)*sin(z)"'
    effects, error = f"initial = {{ velocity = [{wave}] }}\nviscosity = {{ nu = 0.1 }}", []
    for cells in (4, 8):
        shape = f"box = {{ size = {[np.pi] * 3}, cells = {[cells] * 3} }}"
        energy = run_fluid(effects, 'integrator = "energy"\nduration = 0.5\nstep = 0.025', shape)
        energy = energy.series("kinetic_energy")
        error.append(-np.log(energy[-1] / energy[0]) / 0.5 / 0.6 - 1.0)
    assert abs(error[1]) < 0.01 and error[0] / error[1] > 3.5
