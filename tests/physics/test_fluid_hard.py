"""Fluids on hard meshes and at the ends of their parameters, on surfaces and in volumes."""

import numpy as np
import pytest

from benchmarks.fluids.energy import plate_with_holes
from benchmarks.fluids.runs import run_fluid
from ddgcli.errors import SceneError
from ddgcli.mesh import shapes
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.models.fluid.scene import TRANSPORTS
from ddgcli.models.fluid.volume_paths import VolumePaths
from ddgcli.models.fluid.volume_space import VolumeSpace

PAIRS = [(name, dimension) for name, modules in TRANSPORTS.items() for dimension in modules]
ON_SURFACES = [name for name, dimension in PAIRS if dimension == 2]
IN_VOLUMES = [name for name, dimension in PAIRS if dimension == 3]
KEEPS_ENERGY = {"conservative": 1e-4, "energy": 1e-10}  # the others may lose any, but gain none
BOX = "box = { size = [3.141592653589793, 3.141592653589793, 3.141592653589793], cells = [3, 3, 3] }"
SWIRL = 'initial = { velocity = ["5*sin(x)*cos(y)*cos(z)", "-5*cos(x)*sin(y)*cos(z)", 0] }\n'


def sheared(mesh, amount):
    """Slivers: `mesh` in [0, 1]^d, whose y (and z) drag x (and y) along."""
    points = np.array(mesh.points)
    points[:, :-1] += amount * points[:, 1:]
    return mesh.moved(points)


HARD = {
    (2, "needles"): lambda: shapes.random_sphere(200).moved(shapes.random_sphere(200).points * [100, 1, 1]),
    (2, "slivers"): lambda: sheared(shapes.grid(8, 8), 5.0),
    (3, "needles"): lambda: shapes.box_tetrahedra(3, 3, 3, (100.0, 1.0, 1.0)),
    (3, "slivers"): lambda: sheared(shapes.box_tetrahedra(3, 3, 3), 5.0),
}
STARTS = {
    (2, "needles"): 'initial = { vorticity = "sin(0.03*x + 1) + y*z + y" }',
    (2, "slivers"): 'initial = { vorticity = "sin(6*(x - 5*y))*cos(5*y)" }',
    (3, "needles"): 'initial = { velocity = ["sin(3*y) + z", "sin(x)", "y"] }',
    (3, "slivers"): 'initial = { velocity = ["sin(3*y) + z", "sin(x)", "y"] }',
}


def check_laws(run, integrator, flows=1e-9):
    """The run's flow is divergence-free, and its energy as its integrator has it."""
    energy = run.series("kinetic_energy")
    assert np.isfinite(energy).all() and energy[0] > 0
    assert run.series("divergence").max() < flows
    assert (np.diff(energy) <= 1e-9 * energy[0]).all() or integrator in KEEPS_ENERGY
    assert abs(energy[-1] / energy[0] - 1) < KEEPS_ENERGY.get(integrator, 1.0 + 1e-9)


@pytest.mark.parametrize("kind", ["needles", "slivers"])
@pytest.mark.parametrize("integrator, dimension", PAIRS)
def test_needles_and_slivers_keep_what_good_cells_keep(integrator, dimension, kind):
    time = f'integrator = "{integrator}"\nduration = 0.2\nstep = 0.1'
    check_laws(run_fluid(STARTS[dimension, kind], time, mesh=HARD[dimension, kind]()), integrator)


def test_lines_that_two_walls_stop_end_after_few_cells(monkeypatch):
    """In slivers some would go to and fro for as many cells as a line may cross (4,000)."""
    visits, paths = [], VolumePaths(VolumeSpace(HARD[3, "slivers"]()))
    at = VolumePaths.barycentric
    monkeypatch.setattr(VolumePaths, "barycentric", lambda *words: visits.append(1) or at(*words))
    cell = np.arange(len(paths.space.cells))
    shift = np.random.default_rng(0).normal(size=(len(cell), 3))
    _, after = paths.moved(cell, paths.space.centre, shift)
    assert np.isfinite(after).all() and len(visits) < 600


@pytest.mark.parametrize("integrator, dimension", PAIRS)
def test_a_step_of_fifty_cells_is_taken_or_divided(integrator, dimension):
    """The start moves by 5 a second, and cells measure 0.3 and 1: one step of 3 s (10 s) crosses fifty."""
    step, shape, mesh, start = 10.0, BOX, None, SWIRL
    if dimension == 2:
        step, shape, mesh = 3.0, 'mesh = "given"', shapes.icosphere(2)
        start = 'initial = { vorticity = "6*(5*z^3-3*z) + 12*x*y*z + 5*x" }'
    run = run_fluid(start, f'integrator = "{integrator}"\nduration = {step}\nstep = {step}', shape, mesh)
    energy = run.series("kinetic_energy")
    assert run.series("divergence").max() < 1e-12
    if integrator == "conservative":  # of fourth order in the step that its stability allows
        assert energy[-1] == pytest.approx(energy[0], rel=1e-2)
    else:
        check_laws(run, integrator)


@pytest.mark.parametrize("kind", ["hodge", "bochner", "deformation"])
@pytest.mark.parametrize("nu", [0.0, 1e6, 1e9])
def test_no_viscosity_and_a_huge_one_of_every_kind_run(nu, kind):
    """On a sphere, where bochner and deformation subtract the curvature."""
    effects = f'initial = {{ vorticity = "x*y" }}\nviscosity = {{ nu = {nu}, kind = "{kind}" }}'
    run = run_fluid(effects, "duration = 0.2\nstep = 0.1", mesh=shapes.icosphere(2))
    energy, total = run.series("kinetic_energy"), run.series("total_vorticity")
    assert energy[-1] == pytest.approx(energy[0], rel=1e-6) if nu == 0 else energy[-1] < 1e-12 * energy[0]
    assert np.abs(total).max() <= 1e-13 * np.sqrt(4 * np.pi * run.series("enstrophy")[0])


@pytest.mark.parametrize("walls", ["", 'boundary = { kind = "no-slip" }\n'], ids=["slip", "no-slip"])
@pytest.mark.parametrize(
    "shape", ["grid = { size = [3, 3], cells = [6, 6] }", BOX], ids=["surface", "volume"]
)
def test_a_huge_viscosity_stops_a_flow_between_walls_and_none_leaves_it(shape, walls):
    start = 'initial = { velocity = ["sin(x)*cos(y)", "-cos(x)*sin(y)", 0] }\n' + walls
    time = 'integrator = "energy"\nduration = 0.2\nstep = 0.1'
    still = run_fluid(f"{start}viscosity = {{ nu = 1e6 }}", time, shape).series("kinetic_energy")
    assert still[-1] < 1e-9 * still[0]
    if walls:
        with pytest.raises(SceneError, match="nu > 0"):
            run_fluid(f"{start}viscosity = {{ nu = 0 }}", time, shape)
    else:
        check_laws(run_fluid(f"{start}viscosity = {{ nu = 0 }}", time, shape), "energy")


@pytest.mark.parametrize("integrator", ON_SURFACES)
def test_a_channel_one_triangle_wide_runs_at_scales_of_1e_6(integrator):
    for size in (1.0, 1e-6, 1e6):
        shape = f'grid = {{ size = [{8 * size}, {size}], cells = [8, 1], periodic = "x" }}'
        effects = f"harmonic = {{ coefficients = [{size**2}] }}\nviscosity = {{ nu = {1e-3 * size**2} }}"
        out = run_fluid(effects, f'integrator = "{integrator}"\nduration = 0.1\nstep = 0.05', shape)
        energy = out.series("kinetic_energy")
        assert energy[-1] == pytest.approx(energy[0], rel=1e-9) == pytest.approx(0.5 * size**4)


@pytest.mark.parametrize("integrator", IN_VOLUMES)
def test_a_duct_one_cell_wide_has_the_same_flow_at_scales_of_1e_6(integrator):
    energies = []
    for size in (1.0, 1e-6, 1e6):
        u = f'"{size}*sin({np.pi / 8}*x/{size})*cos({np.pi}*y/{size})"'
        v = f'"-{size / 8}*cos({np.pi / 8}*x/{size})*sin({np.pi}*y/{size})"'
        out = run_fluid(
            f"initial = {{ velocity = [{u}, {v}, 0] }}\nviscosity = {{ nu = {1e-3 * size**2} }}",
            f'integrator = "{integrator}"\nduration = 0.1\nstep = 0.05',
            f"box = {{ size = [{8 * size}, {size}, {size}], cells = [8, 1, 1] }}",
        )
        assert out.series("divergence").max() < 1e-12
        energies.append(out.series("kinetic_energy") / size**5)
    assert 0 < energies[0][-1] < energies[0][0]
    assert energies[1] == pytest.approx(energies[0], rel=1e-8)
    assert energies[2] == pytest.approx(energies[0], rel=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("integrator", ON_SURFACES)
def test_genus_fifty_with_all_its_harmonic_flows_keeps_energy(integrator):
    mesh = plate_with_holes(50)
    assert mesh.topology.genus == 50
    effects = 'initial = { vorticity = "sin(x) + y" }\nharmonic = { coefficients = [%s] }'
    effects %= ", ".join(["0.1"] * 100)
    out = run_fluid(effects, f'integrator = "{integrator}"\nduration = 0.1\nstep = 0.02', mesh=mesh)
    energy = out.series("kinetic_energy")
    if integrator in KEEPS_ENERGY:
        assert energy[-1] == pytest.approx(energy[0], rel=1e-12 if integrator == "energy" else 1e-5)
    else:
        assert (np.diff(energy) <= 1e-12 * energy[0]).all()


@pytest.mark.slow
@pytest.mark.parametrize("integrator", IN_VOLUMES)
def test_a_solid_of_genus_fifty_holds_the_flows_round_its_holes(integrator):
    """A plate of cubes with fifty holes; the flow turns round each of them."""
    block = shapes.box_tetrahedra(101, 3, 1, (101.0, 3.0, 1.0))
    x, y, _ = block.points[block.tetrahedra].mean(axis=1).T
    hole = (np.floor(x).astype(int) % 2 == 1) & (np.floor(y).astype(int) == 1)
    vertices, cells = np.unique(block.tetrahedra[~hole], return_inverse=True)
    mesh = TetMesh(block.points[vertices], cells.reshape(-1, 4))
    assert mesh.boundary.topology.genus == 50
    effects = f'initial = {{ velocity = ["-cos({np.pi / 3}*y)", "sin({np.pi}*x)", 0] }}'
    run = run_fluid(effects, f'integrator = "{integrator}"\nduration = 0.04\nstep = 0.02', mesh=mesh)
    check_laws(run, integrator, flows=1e-11)
