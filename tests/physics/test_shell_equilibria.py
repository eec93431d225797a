"""Equilibria end where the forces balance, also where energies differ by rounding alone."""

import numpy as np
import pytest

from ddgcli.cli.parameters import with_repair_command
from ddgcli.errors import SolveError
from ddgcli.io.mesh_file import write_mesh
from ddgcli.io.trajectories.trajectory import Trajectory
from ddgcli.mechanics import pieces
from ddgcli.mechanics.equilibrium import Equilibrium
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.models.shell.equilibrium_advice import needle_advice
from ddgcli.simulation.model import StepRejected
from tests.simulate import scalar, shell_run

CANTILEVER = """
[time]
duration = 1
step = 1
integrator = "static"
[[object]]
name = "s"
role = "shell"
grid = {{ size = [1, 0.1], cells = [{cells}, {rows}] }}
young = 2e11
poisson = 0
density = 7.8
thickness = "1 mm"
[effects]
stretching = {{}}
bending = {{ model = "{bending}" }}
pin = {{ box = [[-1, -1, -1], [1e-6, 1, 1]], clamp = true }}
load = {{ box = [[0.999, -1, -1], [2, 1, 1]], force = [0, 0, -1e-3] }}
"""

PLATE_OF_FILE = """
format = "ddgcli-scene/1"
[time]
integrator = "static"
[[object]]
name = "s"
role = "shell"
mesh = "{mesh}"
young = 1e9
poisson = 0.3
density = 1
thickness = 0.01
[effects]
stretching = {{}}
bending = {{ model = "midedge" }}
gravity = {{ acceleration = [0, 0, -0.1] }}
pin = {{ box = [[-1, -1, -1], [1e-3, 2, 1]], clamp = true }}
"""


def cantilever(bending, cells):
    """Deflection of the tip and force at the clamp, across a strip of steel."""
    run, *_ = shell_run(CANTILEVER.format(bending=bending, cells=cells, rows=cells // 10))
    end = run[-1].observations["s"]
    return end.points[:, 2].min(), np.asarray(end.scalar["reaction_force_pin"])[2]


@pytest.mark.parametrize("cells", [20, 40])
@pytest.mark.parametrize("bending", ["cubic", "quadratic"])
def test_models_of_hinges_agree_where_deflections_are_small(bending, cells):
    """They are one energy there; moves that rounding of the energies cut ended 4e-4 away."""
    tip, force = cantilever(bending, cells)
    assert tip == pytest.approx(cantilever("hinge", cells)[0], rel=1e-6)
    assert force == pytest.approx(1e-3, rel=1e-6)


PLATE = """
[time]
duration = 1
step = 1
integrator = "static"
[[object]]
name = "s"
role = "shell"
grid = {{ size = [1, 1], cells = [8, 8] }}
young = 1e9
poisson = 0.3
density = 1
thickness = {thickness}
[effects]
stretching = {{}}
bending = {{ model = "{bending}" }}
pin = {{ box = [[-1, -1, -1], [1e-9, 2, 1]], clamp = true }}
load = {{ box = [[-1, -1, -1], [2, 2, 2]], traction = [0, 0, {traction}] }}
"""


def plate(bending, thickness, traction):
    """Deflection of a clamped plate over traction / thickness^3, and the clamp's force over the load's."""
    run, *_ = shell_run(PLATE.format(bending=bending, thickness=thickness, traction=-traction))
    end = run[-1].observations["s"]
    force = np.asarray(end.scalar["reaction_force_pin"])[2]
    return -end.points[:, 2].min() * thickness**3 / traction, force / traction


@pytest.mark.parametrize("thickness, traction", [(1e-5, 1e-12), (1e-3, 1e-12), (1e-3, 1e-9), (1e-2, 1e-6)])
@pytest.mark.parametrize("bending", ["midedge", "cubic"])
def test_small_loads_bend_in_proportion(bending, thickness, traction):
    """The first moves of the iteration are short because it is damped, not because the forces balance."""
    flexibility, force = plate(bending, thickness, traction)
    assert force == pytest.approx(1, rel=1e-6)
    assert flexibility == pytest.approx(plate(bending, 1e-2, 1e-4)[0], rel=1e-5)


def shape_and_iterations(text):
    """Positions at the equilibrium, its energy, and Newton's iterations."""
    run, *_ = shell_run(text)
    end = run[-1].observations["s"]
    return end.points, scalar(run, "energy")[-1], scalar(run, "newton_iterations")[-1]


@pytest.mark.parametrize(
    "alpha, drop, reach", [(3, 0.60325, 0.74558), (10, 0.81061, 0.44500)], ids=["moderate", "large"]
)
def test_a_thin_strip_comes_to_the_elastica_in_one_load_step_of_few_moves(alpha, drop, reach):
    """Bisshopp and Drucker's cantilever. Turns stretch it to second order, which cut moves short: 270."""
    rigidity = 2e11 * 1e-9 / 12  # per width
    text = CANTILEVER.format(bending="midedge", cells=20, rows=2)
    points, _, iterations = shape_and_iterations(text.replace("-1e-3", str(-0.1 * alpha * rigidity)))
    assert np.abs(points[-1, [0, 2]] - [reach, -drop]).max() < 0.004
    assert iterations < 60


STRIP = CANTILEVER.format(bending="hinge", cells=10, rows=1).replace("-1e-3", "-160")


def test_a_strip_beside_one_that_is_attached_takes_as_many_moves_as_alone():
    """The moves through large rotations were left out in a group: 148 in place of 30."""
    points, _, count = shape_and_iterations(STRIP)
    objects, effects = STRIP.index("[[object]]"), STRIP.index("[effects]")
    other = STRIP[objects:effects].replace('"s"', '"other"') + "position = [0, 0.2, 0]\n"
    lines = STRIP[effects:].splitlines()
    group = STRIP[:effects] + other + "\n".join(lines[:3])
    for line in lines[3:]:
        effect, keys = line.rstrip(" }").split(" = {")
        keys = keys.replace(", clamp", "\nclamp").replace(", force", "\nforce")
        for name in ("s", "other"):
            group += f'\n[[effects.{effect}]]\nobject = "{name}"\n{keys}\n'
    group += '[[effects.attach]]\nobject = "s"\nto = "other"\nvertices = [21]\nto_vertices = [21]\n'
    in_group, _, iterations = shape_and_iterations(group + "stiffness = 1\n")
    assert points[-1, 2] < -0.5 and np.abs(in_group - points).max() < 1e-6
    assert iterations <= count + 3


def test_a_strip_in_pieces_bends_through_large_rotations(monkeypatch):
    """The linearised stress of the whole met the pattern of the pieces, and the run failed."""
    points, _, count = shape_and_iterations(STRIP)
    monkeypatch.setattr(pieces, "MIN_PIECE", 3)
    in_pieces, _, iterations = shape_and_iterations(STRIP)
    assert np.abs(in_pieces - points).max() < 1e-6 and abs(iterations - count) <= 1


def test_a_free_strip_turns_into_the_direction_of_balanced_forces():
    """Its energy there: -F L and that of the tension, -F^2 L / 2 E t b."""
    force = "[[effects.load]]\nbox = [[{0}, 0, 0], [{0}, 1, 0]]\nforce = [0, 0, {1}]\n"
    text = CANTILEVER.format(bending="hinge", cells=8, rows=2)
    text = text[: text.index("pin =")].replace("2e11", "1e8") + force.format(0, -0.01) + force.format(1, 0.01)
    points, energy, iterations = shape_and_iterations(text)
    assert np.ptp(points[:, 2]) == pytest.approx(1 + 1e-6, rel=1e-7)
    assert energy == pytest.approx(-0.01 * (1 + 0.5e-6), rel=1e-8)
    assert iterations < 60


PLATE_DEFLECTION = 1 * 0.1 / (8 * 1e9 * 0.01**3 / 12)  # q L^4 / 8 E I of a strip; the plate is stiffer by 2 %


def deflection(run, path, scene, mesh):
    """Lowest point of the plate of a file at rest, and what was printed; None where none was found."""
    scene.write_text(PLATE_OF_FILE.format(mesh=mesh))
    result = run("shell-sim", scene, "-o", path)
    if result.exit_code:
        return None, result.stderr
    with Trajectory(str(path)) as trajectory:
        return float(trajectory.points(trajectory.n_frames - 1)[:, 2].min()), result.stderr


@pytest.mark.parametrize("width", [1e-6, 1e-7, 1e-8])
def test_needles_that_round_off_the_load_are_named_and_the_repair_helps(run, tmp_path, width):
    """It was advised pins, which it has, and smaller loads, which need smaller forces still.

    Whether their forces end the search depends on the rounding of the processor. Where they do not, they are
    above the loads, and a deflection that was a quarter of the right one came with a warning alone.
    """
    plate = shapes.grid(8, 8, pattern="alternating")
    x = plate.points.copy()
    x[36:45, 0] = x[27, 0] + width
    plate = plate.moved(x)
    path, scene, fixed, end = (tmp_path / name for name in ("plate.npz", "s.toml", "fixed.npz", "r.vtkhdf"))
    write_mesh(str(path), AnnotatedMesh(plate))
    lowest, printed = deflection(run, end, scene, path)
    advice = with_repair_command(needle_advice([plate]), [str(path)])
    assert lowest is None and "16 faces have sides (first: face 48)" in advice and advice in printed
    words = advice.split(f"ddgcli repair {path} ")[1].split(" -o ")[0].split()
    assert run("repair", path, *words, "-o", fixed).exit_code == 0
    end.unlink(missing_ok=True)
    repaired, printed = deflection(run, end, scene, fixed)
    assert repaired == pytest.approx(-PLATE_DEFLECTION, rel=0.05) and "Warning" not in printed


FREE = """
[time]
duration = 1
step = 1
integrator = "static"
[[object]]
name = "s"
role = "shell"
grid = {{ size = [0.7, 0.3], cells = [5, 3] }}
position = [0.1, 0.2, 0.3]
young = 1e5
poisson = 0.4
density = 1
thickness = "2 mm"
[effects]
stretching = {{}}
bending = {{ model = "quadratic" }}
{load}
"""


def test_forces_by_rounding_of_the_positions_are_balanced(monkeypatch):
    """Of a free shell at rest: on some processors no direction descends from them."""

    def no_direction(*_):
        raise StepRejected("no descent")

    monkeypatch.setattr(Equilibrium, "_direction", no_direction)
    run, *_ = shell_run(FREE.format(load=""))
    assert np.array_equal(run[-1].observations["s"].points, run[0].observations["s"].points)
    with pytest.raises(SolveError, match="no descent"):
        shell_run(FREE.format(load="load = { vertices = [0], force = [1e-9, 0, 0] }"))


def test_a_vertex_without_faces_supports_nothing(run, tmp_path):
    """It cannot move; so the message was that supports leave rotations about it free."""
    mesh = tmp_path / "t.obj"
    for loose in ("", "v 5 0 0\n"):
        mesh.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n" + loose + "f 1 2 3\n")
        words = ("--material", "rubber", "--effect", "stretching", "--effect", "gravity")
        result = run("shell-sim", mesh, *words, "--integrator", "static")
        assert result.exit_code == 1 and "; nothing holds the shell): hold the shell by pins" in result.stderr
