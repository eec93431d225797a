"""Bad input of fluids: refused in one line that names what is wrong, how many, and the first."""

import numpy as np
import pytest

from benchmarks.fluids.runs import run_fluid
from ddgcli.errors import SceneError
from ddgcli.mesh import shapes
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh

SQUARE = "grid = { size = [1, 1], cells = [4, 4] }"
BOX = "box = { size = [1, 1, 1], cells = [2, 2, 2] }"
START = 'initial = { vorticity = "x" }\n'
INFLOW = '{ kind = "inflow", velocity = [1, 0, 0], where = "x < 1e-6" }'
OUTFLOW = '{ kind = "outflow", velocity = [2, 0, 0], where = "x > 1 - 1e-6" }'
TIME = 'integrator = "energy"\nduration = 0.02\nstep = 0.01'


def refusal(effects, shape='mesh = "given"', mesh=None, objects=""):
    with pytest.raises(SceneError) as caught:
        run_fluid(effects, TIME, shape, mesh, objects)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def with_fin(mesh):
    """A mesh and one more triangle at one of its edges."""
    tail, head, _ = mesh.faces[0]
    tip = mesh.points[[tail, head]].mean(axis=0) * 1.5
    return TriangleMesh.from_arrays(
        np.vstack([mesh.points, tip]), np.vstack([mesh.faces, [tail, head, mesh.n_vertices]])
    )


def test_a_surface_with_three_faces_at_an_edge_is_refused():
    assert "manifold" in refusal(START, mesh=with_fin(shapes.icosphere(1)))


def test_a_moebius_band_is_refused():
    angle = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    across = np.array([-0.3, 0.3])
    radius = 1 + across * np.cos(angle / 2)[:, None]
    points = np.stack(
        [
            radius * np.cos(angle)[:, None],
            radius * np.sin(angle)[:, None],
            across * np.sin(angle / 2)[:, None],
        ],
        axis=2,
    ).reshape(-1, 3)
    faces = []
    for k in range(12):
        a, b, c, d = 2 * k, 2 * k + 1, 2 * k + 2, 2 * k + 3
        if k == 11:
            c, d = 1, 0
        faces += [[a, c, b], [b, c, d]]
    assert "orient" in refusal(START, mesh=TriangleMesh.from_arrays(points, np.array(faces)))


def test_faces_without_area_are_counted():
    mesh = shapes.grid(4, 4)
    points = np.array(mesh.points)
    points[mesh.faces[5, 2]] = points[mesh.faces[5, :2]].mean(axis=0)
    assert "have no area (first: face" in refusal(START, mesh=mesh.moved(points))


@pytest.mark.parametrize("what, change", [("are inverted", -1.0), ("have no volume", 0.0)])
def test_inverted_and_flat_tetrahedra_are_counted_and_the_first_is_named(what, change):
    box = shapes.box_tetrahedra(2, 2, 2)
    points, cells = np.array(box.points), np.array(box.tetrahedra)
    if change < 0:
        cells[[7, 9]] = cells[[7, 9]][:, [1, 0, 2, 3]]
        refusal_text = refusal("force = { acceleration = [0, 0, 1] }", mesh=TetMesh(points, cells))
        assert "2 tetrahedra are inverted (first: 7)" in refusal_text
    else:
        points[:, 2] = 0.0
        refusal_text = refusal("force = { acceleration = [0, 0, 1] }", mesh=TetMesh(points, cells))
        assert "48 tetrahedra have no volume (first: 0)" in refusal_text
    assert what in refusal_text


@pytest.mark.parametrize("shape", [SQUARE, BOX], ids=["surface", "volume"])
def test_flux_that_does_not_balance_is_refused_with_the_excess(shape):
    effects = f"viscosity = {{ nu = 1 }}\nboundary = [{INFLOW}, {OUTFLOW}]"
    unit = "m^2/s" if shape == SQUARE else "m^3/s"
    assert f"1 {unit} more" in refusal(effects, shape)


@pytest.mark.parametrize("shape", [SQUARE, BOX], ids=["surface", "volume"])
def test_inflow_without_outflow_is_refused(shape):
    refusal_text = refusal(f"viscosity = {{ nu = 1 }}\nboundary = [{INFLOW}]", shape)
    assert "outflow" in refusal_text


@pytest.mark.parametrize("shape", [SQUARE, BOX], ids=["surface", "volume"])
@pytest.mark.parametrize(
    "effect", ["viscosity = { nu = -1 }", 'buoyancy = { temperature = "x", diffusivity = -1 }']
)
def test_negative_viscosity_and_diffusivity_are_refused(shape, effect):
    assert "greater than or equal to 0" in refusal(effect, shape) or "at least 0" in refusal(effect, shape)


@pytest.mark.parametrize(
    "effect, message",
    [
        ('initial = { vorticity = "x" }', "vorticity is that of surfaces"),
        ('initial = { flow = "rossby-haurwitz" }', "is one of surfaces"),
        ('viscosity = { nu = 1, kind = "bochner" }', "bochner is one of surfaces"),
        ("rotation = { angular_velocity = [0, 0, 1] }", "rotation acts on surfaces"),
        ("harmonic = {}", "harmonic acts on surfaces"),
    ],
)
def test_effects_of_surfaces_are_refused_in_volumes(effect, message):
    assert message in refusal(effect, BOX)


def test_a_flow_of_volumes_is_refused_on_a_surface():
    assert "vortex-ring" in refusal('initial = { flow = "vortex-ring" }', SQUARE)
