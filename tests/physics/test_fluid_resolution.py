"""Warning of vorticity at the start that the mesh does not resolve."""

import numpy as np
import pytest

from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.shapes import grid
from ddgcli.models.fluid.surface_space import SurfaceSpace
from ddgcli.models.fluid.vorticity_resolution import vorticity_length
from tests.converge.test_hodge import annulus
from tests.geodesic_cases import jittered
from tests.physics.test_shell_midedge import border, square

PAIR = """format = "ddgcli-scene/1"
[time]
duration = 0.02
step = 0.01
[[object]]
name = "plane"
role = "fluid"
grid = {{ size = [4, 3], cells = [{nx}, {ny}] }}
[effects]
initial = {{ flow = "vortex-pair", core = 0.15, separation = 1.0, center = [2, 1.5, 0] }}
"""


def space_of(mesh):
    return SurfaceSpace(mesh, np.zeros((0, mesh.topology.n_edges)))


def length_of(mesh, density):
    space = space_of(mesh)
    return vorticity_length(space, density * space.mass)


@pytest.mark.parametrize("pattern", ["right", "alternating", "irregular"])
def test_the_length_of_a_gaussian_vortex_is_its_core_over_root_two(pattern):
    """In edges, by their root mean square; differences over an edge see it a little longer."""
    mesh = square(40, pattern)
    x = np.asarray(mesh.points)
    space = space_of(mesh)
    edge = np.sqrt(np.average(np.mean(mesh.side_length**2, axis=1), weights=space.area))
    core = 4 * edge
    vortex = np.exp(-((x[:, :2] - 0.5) ** 2).sum(axis=1) / core**2)
    length = length_of(mesh, vortex)
    assert length == pytest.approx(core / edge / np.sqrt(2), rel=0.06)
    vortex[border(mesh)] = 1.0  # a layer at a wall
    assert length_of(mesh, vortex) == length


@pytest.mark.parametrize("cells", [6, 12, 24])
def test_the_length_of_a_wave_is_the_inverse_wave_number(cells):
    """Two of the three sides of a face cross a cell along the wave: its differences are 2 sin(k h / 2)."""
    mesh = grid(96, 48, 1, 0.5, "right")
    k = 96 * 2 * np.pi / cells
    truth = np.sqrt(3) / 4 / np.sin(np.pi / cells)  # sqrt(3) / 2 / (k h), edges of sqrt(4/3) h
    assert length_of(mesh, np.sin(k * np.asarray(mesh.points)[:, 0])) == pytest.approx(truth, rel=0.02)


def test_narrow_vortices_are_reported_and_wide_ones_are_not(tmp_path, summary):
    scene = tmp_path / "pair.toml"
    for cells, narrow in ((6, True), (16, False)):
        scene.write_text(PAIR.format(nx=4 * cells, ny=3 * cells))
        warnings = [w for w in summary("fluid-sim", scene)["warnings"] if "varies over" in w]
        assert len(warnings) == narrow


def test_errors_of_the_mesh_in_a_flow_round_a_hole_are_not_reported(tmp_path, summary):
    scene = tmp_path / "flow.toml"
    text = PAIR.format(nx=24, ny=18)
    text = text[: text.index("initial")]
    rod = "cylinder = { start = [2, 1.5, -1], end = [2, 1.5, 1], radius = 0.5 }"
    obstacle = f'[[object]]\nname = "rod"\nrole = "obstacle"\n{rod}\n[effects]\nharmonic = {{}}'
    hole = text.replace("[effects]", obstacle)
    swirl = ["-(y-1.5)/((x-2)^2+(y-1.5)^2)", "(x-2)/((x-2)^2+(y-1.5)^2)", "0"]
    scene.write_text(hole + f"\ninitial = {{ velocity = {swirl} }}\n".replace("'", '"'))
    assert not any("varies over" in w for w in summary("fluid-sim", scene)["warnings"])


@pytest.mark.parametrize("vorticity", [0.0, 0.2])
def test_what_is_lost_of_the_errors_of_a_mesh_in_a_potential_flow_is_no_loss(tmp_path, summary, vorticity):
    """`circulation` smooths three quarters of them, 1e-5 of the enstrophy that a turn of this speed has.

    With vorticity of the flow's own drifts are relative to the start.
    """
    mesh = jittered(annulus(8), 0.02)
    write_mesh(str(tmp_path / "ring.npz"), AnnotatedMesh(mesh))
    turn = f"1/(x^2+y^2) + {vorticity}/2"
    (tmp_path / "ring.toml").write_text(
        'format = "ddgcli-scene/1"\n[time]\nduration = 2\nstep = 0.05\nintegrator = "circulation"\n'
        '[[object]]\nname = "ring"\nrole = "fluid"\nmesh = "ring.npz"\n[effects]\nharmonic = {}\n'
        f'initial = {{ velocity = ["-y*({turn})", "x*({turn})", 0] }}\n'
    )
    report = summary("fluid-sim", tmp_path / "ring.toml")
    assert not [w for w in report["warnings"] if "lost" in w or "circulation" in w]
    results, accuracy = report["results"], report["accuracy"]
    change = abs(results["enstrophy"] - results["enstrophy_start"])
    share = change / results["enstrophy_start"]
    if vorticity:
        assert accuracy["enstrophy_drift"] == pytest.approx(share, rel=0.1)
    else:
        assert share > 0.3 and accuracy["enstrophy_drift"] < 0.01
