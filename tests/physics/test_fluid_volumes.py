"""Fluids in tetrahedral meshes: what is exact, known decays, refusals, files."""

import numpy as np
import pytest

from ddgcli.errors import SceneError
from ddgcli.io.scene_file import parse_scene
from ddgcli.mesh.shapes import box_tetrahedra
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.models.fluid.model import build, contexts
from ddgcli.models.fluid.phases import Step
from ddgcli.models.fluid.scene import KIND
from ddgcli.models.fluid.volume_paths import VolumePaths
from ddgcli.models.fluid.volume_space import VolumeSpace
from ddgcli.scenes.scene import resolve
from ddgcli.simulation.account import Account
from ddgcli.simulation.time_loop import evolve

# a cell of the box [0, pi]^3 that turns about z, without flow through the walls; steady without friction
CELL = 'initial = { velocity = ["sin(x)*cos(y)", "-cos(x)*sin(y)", 0] }\n'
SWIRL = 'initial = { velocity = ["sin(x)*cos(y)*cos(z)", "-cos(x)*sin(y)*cos(z)", 0] }\n'

THROUGH = """
viscosity = { nu = 1 }
boundary = [
  { kind = "inflow", velocity = [1, 0, 0], where = "x < 1e-6" },
  { kind = "outflow", where = "x > 3" },
]
"""


def run(effects, cells=4, duration=0.4, step=0.1, integrator="energy", size=np.pi, objects=""):
    """(fluid model, observations, checkpoint at the end)."""
    text = (
        f'[time]\nduration = {duration}\nstep = {step}\nintegrator = "{integrator}"\n[[object]]\nname = "f"\n'
    )
    text += (
        f'role = "fluid"\nbox = {{ size = [{size}, {size}, {size}], cells = [{cells}, {cells}, {cells}] }}\n'
    )
    scene, account = resolve(parse_scene(f"{text}{objects}[effects]\n{effects}"), KIND, {}), Account()
    fluids = {name: context for name, (context, _) in contexts(scene, None, None).items()}
    models = build(scene, fluids, account)
    snapshots = list(evolve({n: m.model() for n, m in models.items()}, scene.schedule(), account))
    return models["f"], [snapshot.observations["f"] for snapshot in snapshots], snapshots[-1].checkpoint


def series(observed, name):
    return np.array([o.scalar[name] for o in observed])


def irregular():
    mesh = box_tetrahedra(3, 3, 3)
    inside = ((mesh.points > 0) & (mesh.points < 1)).all(axis=1)
    shift = 0.05 * np.random.default_rng(0).normal(size=mesh.points.shape)
    return mesh.moved(mesh.points + np.where(inside[:, None], shift, 0.0))


def test_the_box_is_filled_by_tetrahedra_of_positive_volume():
    mesh = box_tetrahedra(3, 2, 4, (1.5, 1.0, 2.0))
    assert np.allclose(mesh.signed_volume, 3.0 / (6 * 24), rtol=1e-12)
    assert mesh.boundary.topology.is_closed and len(mesh.boundary.faces) == 4 * (6 + 8 + 12)


def test_where_vertices_go_does_not_depend_on_the_order_of_the_cells():
    """At a curved wall a vertex slid along the wall of one of its cells, the last in the file."""
    mesh = irregular()
    x, y, z = 2.0 * mesh.points.T - 1.0
    bulge = 1.0 + 0.1 * (3.0 - x * x - y * y - z * z) * np.array([1.0, 1.1, 1.2])[:, None]
    points, rng = (bulge * [x, y, z]).T, np.random.default_rng(3)
    velocity = np.cross([1.0, 2.0, 3.0], points) + 0.1 * points[:, [1, 2, 0]]
    ends = []
    for order in (np.arange(len(mesh.tetrahedra)), rng.permutation(len(mesh.tetrahedra))):
        paths = VolumePaths(VolumeSpace(TetMesh.from_arrays(points, mesh.tetrahedra[order])))
        ends.append(paths.vertices_carried(velocity, np.arange(len(points)), 0.05)[1])
    assert np.abs(ends[0] - ends[1]).max() < 1e-12 < 1e-3 < np.abs(ends[0] - points).max()


def test_the_projection_takes_gradients_off_and_nothing_else():
    """Flux through walls and divergence vanish; circulations around all inner edges stay."""
    space = VolumeSpace(irregular())
    velocity = np.random.default_rng(1).normal(size=(len(space.cells), 3))
    flux = space.projected(velocity)
    cell, i = space.boundary
    assert np.abs(flux[space.cell_face[cell, i]]).max() < 1e-13
    assert np.abs((flux[space.cell_face] * space.sign).sum(axis=1)).max() < 1e-13
    nearest = space.velocity(flux)
    inner = ~space.complex.boundary_edge
    apart = space.edge_circulation(velocity) - space.edge_circulation(nearest)
    assert np.abs(apart[inner]).max() < 1e-13 and np.abs(apart[~inner]).max() > 1e-2
    assert np.allclose(space.projected(nearest), flux, rtol=0, atol=1e-13)


def test_points_are_carried_to_where_a_uniform_flow_brings_them_from():
    space = VolumeSpace(irregular())
    paths = VolumePaths(space)
    cells = np.arange(len(space.cells))
    uniform = np.tile([0.1, -0.2, 0.15], (space.n, 1))
    cell, end = paths.carried(uniform, cells, space.centre, 0.3)
    exact = np.clip(space.centre - 0.3 * uniform[0], 0.0, 1.0)  # along walls, where they are met
    assert np.abs(end - exact).max() < 1e-12
    assert paths.barycentric(cell, end).min() > -1e-10


def test_energy_is_kept_to_round_off_and_time_turns_back():
    model, observed, state = run(SWIRL, 4, 2.0, 0.1)
    energy = series(observed, "kinetic_energy")
    assert np.ptp(energy) < 1e-12 * energy[0]
    assert series(observed, "divergence").max() < 1e-13
    start = model.start
    back = model.unpack({"flux": -state["f/flux"]})
    for _ in range(20):
        back = model.advance(back, 0.0, 0.1)
    scale = np.abs(start["flux"]).max()
    assert np.abs(state["f/flux"] - start["flux"]).max() > 1e-2 * scale
    assert np.abs(back["flux"] + start["flux"]).max() < 1e-10 * scale


def test_circulation_keeps_divergence_and_total_circulation_and_never_gains_energy():
    model, observed, _ = run(SWIRL, 4, 1.0, 0.1, "circulation")
    energy = series(observed, "kinetic_energy")
    assert np.all(np.diff(energy) <= 1e-14 * energy[0])
    assert energy[-1] > 0.9 * energy[0]
    assert series(observed, "divergence").max() < 1e-13
    assert series(observed, "total_vorticity").max() < 1e-13 * series(observed, "absolute_vorticity")[0]


def test_a_step_of_length_zero_is_the_identity_of_circulation():
    model, *_ = run(SWIRL, 3, 0.1, 0.1, "circulation")
    after = model.transport.advance(Step(0.0, 1e-9, model.start), model.start)
    assert np.abs(after["flux"] - model.start["flux"]).max() < 1e-8 * np.abs(model.start["flux"]).max()


@pytest.mark.parametrize("integrator", ["energy", "circulation"])
def test_a_steady_cell_stays_with_the_order_of_the_mesh(integrator):
    error = []
    for cells in (4, 8):
        model, observed, state = run(CELL, cells, 0.5, 0.125, integrator)
        change = model.space.velocity(state["f/flux"] - model.start["flux"])
        error.append(np.sqrt(model.space.kinetic_energy(change) / observed[0].scalar["kinetic_energy"]))
    # the velocity is constant in a cell: first order
    assert error[1] < 0.04 and error[0] / error[1] > 1.5


def test_viscosity_decays_a_cell_at_its_rate():
    """The velocity decays at 2 nu (free slip), its energy at 4 nu; of second order in mesh and step."""
    small = CELL.replace('"sin', '"1e-6*sin').replace('"-cos', '"-1e-6*cos') + "viscosity = { nu = 0.1 }"

    def rate(cells, step):
        energy = series(run(small, cells, 0.8, step)[1], "kinetic_energy")
        return -np.log(energy[-1] / energy[0]) / 0.8

    coarse, fine = rate(4, 0.05), rate(8, 0.05)
    assert fine == pytest.approx(0.4, rel=2e-3) and abs(coarse - 0.4) > 2.5 * abs(fine - 0.4)
    rates = [rate(4, step) for step in (0.8, 0.4, 0.2)]
    assert (rates[0] - rates[1]) / (rates[1] - rates[2]) > 3


@pytest.mark.parametrize("boundary", ["stream", "closed"])
def test_noise_between_walls_with_friction_decays_at_short_steps_too(boundary):
    """A stream past walls that move along with it, Reynolds number 10, and a box of no-slip walls."""
    noise = "initial = { velocity = " + '["sin(91*x+57*y)", "sin(83*y+71*z)", "sin(97*z+61*x)"] }\n'
    effects = noise + "viscosity = { nu = 0.1 }\n"
    base = np.zeros(3)
    if boundary == "stream":
        base = np.array([1.0, 0.0, 0.0])
        for kind, where in (("inflow", "x < 1e-9"), ("outflow", "x > 1 - 1e-9"), ("wall", "1")):
            velocity = "" if kind == "outflow" else "velocity = [1, 0, 0]\n"
            effects += f'[[effects.boundary]]\nkind = "{kind}"\n{velocity}where = "{where}"\n'
    else:
        effects += 'boundary = { kind = "no-slip" }\n'
    model, observed, _ = run(effects, 3, 0.4, 0.01, size=1.0)
    noise = [np.abs(o.vertex["velocity"] - base).max() for o in observed]
    assert noise[-1] < 0.2 * noise[0]


def test_a_stream_between_no_slip_walls_keeps_its_profile():
    profile = 'velocity = ["4*y*(1-y)", 0, 0]\n'
    effects = "viscosity = { nu = 0.1 }\n"
    effects += f'[[effects.boundary]]\nkind = "inflow"\n{profile}where = "x < 1e-9"\n'
    effects += '[[effects.boundary]]\nkind = "outflow"\nwhere = "x > 1 - 1e-9"\n'
    effects += '[[effects.boundary]]\nkind = "free-slip"\nwhere = "abs(z - 0.5) > 0.499"\n'
    effects += '[[effects.boundary]]\nkind = "no-slip"\n'
    error = []
    for cells in (3, 6):
        model, observed, _ = run(effects, cells, 1.0, 0.2, size=1.0)
        y = model.context.points[:, 1]
        apart = observed[-1].vertex["velocity"] - np.outer(4 * y * (1 - y), [1, 0, 0])
        error.append(np.sqrt(np.average(apart**2, weights=model.space.mass, axis=0).sum()))
    assert error[1] < 0.12 and error[1] < 0.5 * error[0], error


def test_dye_keeps_its_amount_and_bounds():
    _, observed, _ = run(CELL + 'dye = { amount = "where(x < 1, 1, 0)" }', 5, 1.0, 0.1, "circulation")
    total = series(observed, "total_dye")
    assert np.ptp(total) < 1e-12 * total[0]
    dye = observed[-1].vertex["dye"]
    assert dye.min() >= 0 and dye.max() <= 1 and np.abs(dye - observed[0].vertex["dye"]).max() > 0.1


def test_an_inflow_leaves_through_the_natural_outflow():
    """A uniform stream through a box of free-slip walls stays uniform."""
    effects = 'viscosity = { nu = 0.1 }\n[[effects.boundary]]\nkind = "inflow"\nvelocity = [1, 0, 0]\n'
    effects += 'where = "x < 1e-9"\n[[effects.boundary]]\nkind = "outflow"\nwhere = "x > 1 - 1e-9"\n'
    effects += '[[effects.boundary]]\nkind = "free-slip"\n'
    _, observed, _ = run(effects, 3, 0.3, 0.1, size=1.0)
    assert np.abs(observed[-1].vertex["velocity"] - [1, 0, 0]).max() < 1e-12
    with pytest.raises(SceneError, match="inflow without outflow"):
        run(effects.replace('"outflow"', '"no-slip"'), 2, size=1.0)
    with pytest.raises(SceneError, match="0.5 m\\^3/s more flow in than out"):
        run(effects.replace('"outflow"', '"outflow"\nflux = 0.5'), 2, size=1.0)


def test_no_slip_walls_slow_a_stream_near_them():
    free = 'initial = { velocity = ["sin(x)*cos(y)", "-cos(x)*sin(y)", 0] }\nviscosity = { nu = 0.05 }\n'
    _, slip, _ = run(free, 4)
    _, rough, _ = run(free + 'boundary = { kind = "no-slip" }', 4)
    assert series(rough, "kinetic_energy")[-1] < 0.9 * series(slip, "kinetic_energy")[-1]


@pytest.mark.parametrize(
    "effects, integrator, message",
    [
        (CELL, "conservative", "conservative does not exist in 3-D; take circulation or covector or energy"),
        (CELL + "rotation = { angular_velocity = [0, 0, 1] }", "energy", "rotation acts on surfaces"),
        (CELL + "harmonic = {}", "energy", "harmonic acts on surfaces"),
        ('initial = { vorticity = "z" }', "energy", "vorticity is that of surfaces"),
        ('initial = { flow = "rotation" }', "energy", "is one of surfaces; volumes have vortex-ring"),
        (CELL + 'viscosity = { nu = 1, kind = "bochner" }', "energy", "is one of surfaces"),
        (THROUGH, "covector", "no inflow and outflow; take energy$"),
    ],
)
def test_what_a_volume_does_not_have_is_refused(effects, integrator, message):
    with pytest.raises(SceneError, match=message):
        run(effects, 2, integrator=integrator)


def test_a_vortex_ring_moves_along_its_axis():
    ring = 'initial = { flow = "vortex-ring", center = [1.57, 1.57, 1.2], separation = 1.2, core = 0.3 }\n'
    model, observed, _ = run(ring, 8, 1.0, 0.25)

    def height(o):
        weight = model.space.mass * np.einsum("ia,ia->i", o.vertex["vorticity"], o.vertex["vorticity"])
        return weight @ model.context.points[:, 2] / weight.sum()

    assert height(observed[-1]) - height(observed[0]) > 0.05


def test_a_trajectory_of_tetrahedra_opens_in_vtk(summary, tmp_path):
    vtk = pytest.importorskip("vtk")
    scene = '[time]\nduration = 0.2\nstep = 0.1\nintegrator = "energy"\n[[object]]\nrole = "fluid"\n'
    scene += f"box = {{ size = [3.14, 3.14, 3.14], cells = [2, 2, 2] }}\n[effects]\n{CELL}"
    (tmp_path / "s.toml").write_text(scene)
    out = summary("fluid-sim", tmp_path / "s.toml", "-o", tmp_path / "run.vtkhdf", "-o", tmp_path / "end.vtu")
    assert out["warnings"] == [] and out["accuracy"]["energy_drift"] < 1e-12
    reader = vtk.vtkHDFReader()
    reader.SetFileName(str(tmp_path / "run.vtkhdf"))
    reader.UpdateInformation()
    reader.SetStep(2)
    reader.Update()
    grid = reader.GetOutput()
    assert grid.GetNumberOfCells() == 48 and grid.GetCellType(0) == vtk.VTK_TETRA
    assert grid.GetNumberOfPoints() == 27 and reader.GetNumberOfSteps() == 3
    assert grid.GetPointData().GetArray("velocity").GetNumberOfComponents() == 3


@pytest.mark.parametrize(
    "shape, size",
    [
        ("sphere = { center = [1.5, 1.5, 1.5], radius = 0.8 }", 4 / 3 * np.pi * 0.8**3),
        ("cylinder = { start = [1.5, 1.5, -1], end = [1.5, 1.5, 5], radius = 0.8 }", np.pi * 0.64 * np.pi),
        ("box = { corner = [1, 1, 1], size = [1.2, 1.2, 1.2] }", 1.2**3),
    ],
)
def test_obstacles_are_cut_out_of_a_volume_and_the_flow_goes_round_them(shape, size):
    post = f'[[object]]\nname = "post"\nrole = "obstacle"\n{shape}\n'
    model, observed, _ = run(CELL, 8, 0.2, 0.1, objects=post)
    assert np.pi**3 - model.space.volume.sum() == pytest.approx(size, rel=0.2)
    energy = series(observed, "kinetic_energy")
    assert energy[-1] == pytest.approx(energy[0], rel=1e-12) and energy[0] > 1
    assert series(observed, "divergence").max() < 1e-13
