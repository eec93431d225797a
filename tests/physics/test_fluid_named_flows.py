"""Flows by name, and other effects that take the extent of a fluid: what they must not depend on."""

import numpy as np
import pytest

from ddgcli.errors import SceneError
from ddgcli.io.scene_file import parse_scene
from ddgcli.mesh import shapes
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.fluid.context import FluidContext
from ddgcli.models.fluid.flows import FLOWS, VOLUME_FLOWS
from ddgcli.models.fluid.forces import obstacle_forces
from ddgcli.models.fluid.initial import InitialSection
from ddgcli.models.fluid.model import FluidModel, contexts
from ddgcli.models.fluid.particles import placed_seeds
from ddgcli.models.fluid.scene import KIND
from ddgcli.models.fluid.triangulation import with_triangulation
from ddgcli.scenes.scene import resolve
from ddgcli.simulation.account import Account

FAR = [5.0, 7.0, 3.0]
SQUARE = shapes.grid(12, 12)
CURVED = {"sphere": shapes.random_sphere(300), "torus": shapes.torus(24, 12)}
ON_PLANES = ("taylor-vortices", "vortex-pair", "rotation", "taylor-green", "shear-layer")


def context_of(mesh, vertex=None):
    return FluidContext("a", mesh, vertex or {}, {}, np.zeros(3), lambda path: None)


def vorticity(mesh, flow, **keys):
    return FLOWS[flow].vorticity(context_of(mesh), InitialSection(flow=flow, **keys))


def with_stray_vertex(mesh):
    points = np.vstack([mesh.points, [FAR]])
    if isinstance(mesh, TetMesh):
        return TetMesh.from_arrays(points, mesh.tetrahedra)
    return TriangleMesh.from_arrays(points, mesh.faces)


def turned(mesh, angle, axis):
    """The mesh and the matrix that turned it about a coordinate axis, the others in cyclic order."""
    first, second = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[[first, second], [first, second]] = np.cos(angle)
    matrix[second, first], matrix[first, second] = np.sin(angle), -np.sin(angle)
    return mesh.moved_unchecked(mesh.points @ matrix.T), matrix


def model_of(context, effects):
    text = f"""[time]
duration = 0.1
step = 0.05
[[object]]
name = "a"
role = "fluid"
grid = {{ size = [1, 1], cells = [12, 12] }}
[effects]
{effects}
"""
    return FluidModel(resolve(parse_scene(text), KIND, {}), 0, context, Account())


@pytest.mark.parametrize("flow", FLOWS)
@pytest.mark.parametrize("mesh", [SQUARE, *CURVED.values()], ids=["square", *CURVED])
def test_named_flows_do_not_depend_on_vertices_without_faces(mesh, flow):
    expected = vorticity(mesh, flow)
    assert np.array_equal(vorticity(with_stray_vertex(mesh), flow)[:-1], expected)


def test_a_vortex_ring_does_not_depend_on_vertices_without_cells():
    solid, section = shapes.box_tetrahedra(), InitialSection(flow="vortex-ring")
    here, there = (
        VOLUME_FLOWS["vortex-ring"].velocity(context_of(mesh), section)
        for mesh in (solid, with_stray_vertex(solid))
    )
    assert np.array_equal(here, there)


def test_expressions_and_arrays_need_no_value_at_vertices_without_faces():
    mesh = with_stray_vertex(SQUARE)
    values = np.append(SQUARE.points[:, 0], np.nan)
    context = context_of(mesh, {"warm": values})
    assert np.isfinite(context.scalar("1 / (3 - z)", "vorticity")).all()
    assert np.array_equal(context.scalar("warm", "dye"), np.append(values[:-1], 0.0))
    model = model_of(context, 'dye = { source = "1 / (3 - z)" }')
    after = model.advance(model.start, 0.0, 0.05)
    assert np.allclose(after["dye"][:-1], 0.05 / 3) and after["dye"][-1] == 0.0


def test_fixed_temperatures_and_seeds_do_not_see_vertices_without_faces():
    context = context_of(with_stray_vertex(SQUARE))
    with pytest.raises(SceneError, match="no vertex lies where"):
        model_of(context, 'buoyancy = { fixed = "z > 1" }')
    with pytest.raises(ValueError, match="lies outside"):
        placed_seeds(context, np.array([[0.5, 0.5, 1.0]]))


def test_flipped_triangles_of_a_plane_stay_in_space_beside_a_vertex_without_faces():
    sheared = SQUARE.moved_unchecked(SQUARE.points @ np.array([[1, 0, 0], [2.5, 1, 0], [0, 0, 1.0]]))
    for mesh in (sheared, with_stray_vertex(sheared), turned(sheared, 0.4, 1)[0]):
        context = with_triangulation(context_of(mesh), "delaunay")
        assert context.triangulation["used"] == "delaunay" and isinstance(context.mesh, TriangleMesh)


@pytest.mark.parametrize("flow", ON_PLANES)
@pytest.mark.parametrize("change", ["noise", "small tilt", "tilt", "vertical", "offset"])
def test_flows_of_planes_are_those_of_the_plane_wherever_it_lies(flow, change):
    noise = 1e-9 * np.random.default_rng(0).normal(size=SQUARE.n_vertices)
    mesh = {
        "noise": SQUARE.moved_unchecked(SQUARE.points + noise[:, None] * [0, 0, 1]),
        "small tilt": turned(SQUARE, 1e-6, 1)[0],
        "tilt": turned(SQUARE, 0.5, 1)[0],
        "vertical": SQUARE.moved_unchecked(SQUARE.points[:, [2, 0, 1]]),
        "offset": SQUARE.moved_unchecked(SQUARE.points + FAR),
    }[change]
    expected = vorticity(SQUARE, flow)
    assert np.abs(vorticity(mesh, flow) - expected).max() < 1e-6 * np.abs(expected).max()


def test_vortices_on_a_plane_take_center_and_direction_as_projected_to_it():
    mesh, matrix = turned(SQUARE, 0.5, 0)
    keys = {"center": [0.4, 0.5, 0.0], "direction": [0.6, 0.8, 0.0], "separation": 0.3}
    expected = vorticity(SQUARE, "vortex-pair", **keys)
    lifted = [0.4, 0.5, 0.7], [0.6, 0.8, -0.5]
    center, direction = (list(matrix @ vector) for vector in lifted)
    projected = vorticity(mesh, "vortex-pair", center=center, direction=direction, separation=0.3)
    assert np.allclose(projected, expected, atol=1e-12 * np.abs(expected).max())
    with pytest.raises(ValueError, match="across the plane"):
        vorticity(mesh, "vortex-pair", direction=list(matrix @ [0, 0, 1.0]))


@pytest.mark.parametrize("flow", ["jet", "rossby-haurwitz"])
def test_waves_of_spheres_are_none_on_any_plane(flow):
    for mesh in (SQUARE, turned(SQUARE, 0.5, 1)[0]):
        assert not vorticity(mesh, flow).any()


@pytest.mark.parametrize("mesh", CURVED.values(), ids=CURVED)
@pytest.mark.parametrize(("flow", "angle"), [("rotation", 0.7), ("jet", 72.0), ("rossby-haurwitz", 120.0)])
def test_flows_around_the_z_axis_turn_with_the_surface(mesh, flow, angle):
    """By any angle for a flow that is zonal, by a period of the others."""
    angle = angle if angle < 1 else np.radians(angle)
    mesh = mesh.moved_unchecked(mesh.points * [1.0, 1.1, 1.0]) if flow == "rotation" else mesh
    expected = vorticity(mesh, flow)
    there = vorticity(turned(mesh, angle, 2)[0], flow)
    assert np.abs(there - expected).max() < 1e-12 * np.abs(expected).max()


def test_rotation_is_the_rigid_turn_of_irregular_spheres_and_parts_of_them():
    whole = CURVED["sphere"]
    north = TriangleMesh.from_arrays(whole.points, whole.faces[whole.points[whole.faces][..., 2].min(1) > 0])
    for mesh in (whole, north):
        mesh = mesh.moved_unchecked(3.0 * mesh.points + FAR)
        used = context_of(mesh).used
        assert np.allclose(vorticity(mesh, "rotation")[used], 2 / 3 * whole.points[used, 2], atol=1e-13)


def test_rotation_of_a_plane_has_its_strength_at_the_vertex_farthest_from_the_centroid():
    square = shapes.grid(12, 12, pattern="left")
    low = square.points[square.faces].sum(axis=2).max(axis=1) < 1.01
    half = TriangleMesh.from_arrays(square.points, square.faces[low])
    assert np.allclose(vorticity(half, "rotation"), 2 / (np.sqrt(5) / 3))  # centroid (1/3, 1/3)


def test_a_plane_that_rounding_bends_has_fitted_obstacles_and_forces_on_them():
    text = """[time]
duration = 0.1
step = 0.05
[[object]]
name = "a"
role = "fluid"
mesh = "a.obj"
[[object]]
name = "post"
role = "obstacle"
sphere = { center = [0.5, 0.5, 0], radius = 0.2 }
[effects]
viscosity = { nu = 0.01 }
boundary = { kind = "no-slip" }
harmonic = {}
"""
    scene = resolve(parse_scene(text), KIND, {})

    class Source:
        notes, vertex, face, sha256 = (), {}, {}, ""
        mesh = SQUARE.moved_unchecked(SQUARE.points + 1e-9 * np.sin(9 * SQUARE.points[:, [0]]) * [0, 0, 1])

    context = contexts(scene, lambda path: Source, lambda path: None)["a"][0]
    model = FluidModel(scene, 0, context, Account())
    rim = context.points[context.obstacles["post"] & context.mesh.topology.boundary_vertex]
    assert np.allclose(np.linalg.norm(rim - [0.5, 0.5, 0], axis=1), 0.2, atol=1e-3)
    assert obstacle_forces(model.setting, model.sources.friction.scheme) is not None


def test_a_periodic_grid_is_not_turned():
    text = """[time]
duration = 0.1
step = 0.05
[[object]]
name = "a"
role = "fluid"
grid = { size = [1, 1], cells = [8, 8], periodic = "xy" }
rotation = { axis = [1, 0, 0], degrees = 90 }
"""
    with pytest.raises(SceneError, match="rotation"):
        contexts(resolve(parse_scene(text), KIND, {}), lambda path: None, lambda path: None)
