"""What holds exactly on polyhedra: Gauss-Bonnet, Steiner, balances, hand-made values."""

from pathlib import Path

import numpy as np
import pytest

from ddgcli.algorithms.curvature import measures as exact
from ddgcli.algorithms.curvature.ball import normal_cycle_in_balls
from ddgcli.algorithms.curvature.frames import unit_normals
from ddgcli.algorithms.curvature.offset_body import offset_body
from ddgcli.algorithms.curvature.regions import MAX_BALL_PAIRS, check_radius, largest_radius
from ddgcli.algorithms.curvature.surface_curvature import measure_curvature
from ddgcli.algorithms.curvature.unit_surface import prepare_surface
from ddgcli.choices import CURVATURE_SCHEMES
from ddgcli.errors import MeshError, ParameterError
from ddgcli.geometry.extrinsic import enclosed_volume, face_area_vector
from ddgcli.geometry.faces import REMAINING, Faces
from ddgcli.geometry.intrinsic import face_area
from ddgcli.io.mesh_file import read_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import angle_of
from ddgcli.operators.laplacian import uniform_stiffness

CLOSED_MESHES = {
    "sphere": shapes.icosphere(2),
    "irregular": shapes.random_sphere(300),
    "torus": shapes.torus(20, 10),
    "box": shapes.box(2, 1, 3, (1.0, 2.0, 0.5)),
}
OPEN_MESHES = {
    "grid": shapes.grid(5, 4, pattern="alternating"),
    "cylinder": shapes.cylinder(12, 5),
    "catenoid": shapes.catenoid(14, 7),
}
ALL_MESHES = CLOSED_MESHES | OPEN_MESHES


def crumpled(mesh, seed=0):
    """The mesh with every vertex moved by a good part of an edge: no symmetry hides an error."""
    noise = np.random.default_rng(seed).normal(size=mesh.points.shape)
    return mesh.moved(mesh.points + 0.2 * mesh.side_length.mean() * noise)


def test_sums_at_vertices_do_not_depend_on_the_blocks_of_faces(monkeypatch):
    mesh = crumpled(OPEN_MESHES["catenoid"])
    whole = Faces.of(mesh)
    expected = [*exact.star_measures(whole, mesh.topology), whole.doubled_star]
    monkeypatch.setattr("ddgcli.geometry.faces.FACES_PER_BLOCK", 17)
    faces = Faces.of(mesh)
    sums = [*exact.star_measures(faces, mesh.topology), faces.doubled_star]
    for one, other in zip(sums, expected):
        assert one == pytest.approx(other, rel=1e-13, abs=1e-15)
    for name in REMAINING:
        assert name == "normal" or (getattr(faces, name) == getattr(whole, name)).all()


def test_angles_of_sines_and_cosines_are_those_of_the_arctangent():
    ends = np.array([-1e300, -2.0, -1e-300, -0.0, 0.0, 1e-300, 0.5, 1e300])
    sine, cosine = np.repeat(ends, len(ends)), np.tile(ends, len(ends))
    assert angle_of(sine, cosine) == pytest.approx(np.arctan2(sine, cosine), rel=1e-15)


@pytest.mark.parametrize("name", ALL_MESHES)
def test_sums_of_curvature_are_topology(name):
    mesh = crumpled(ALL_MESHES[name])
    euler = mesh.topology.euler_characteristic
    measured = measure_curvature(mesh)
    r, v = measured.results, measured.vertex
    assert v["angle_defect"].sum() == pytest.approx(
        2 * np.pi * euler, abs=1e-12 * np.abs(v["angle_defect"]).sum()
    )
    assert r["total_gaussian_curvature"] + r["total_geodesic_curvature"] == pytest.approx(2 * np.pi * euler)
    assert r["total_combinatorial_curvature"] == pytest.approx(2 * np.pi * euler)
    assert measured.accuracy["gauss_bonnet_residual"] < 1e-14
    interior = v["boundary"] == 0
    if interior.any():
        cotan = measure_curvature(mesh, "cotan").vertex
        product = (cotan["gaussian_curvature"] * cotan["vertex_area"])[interior]
        assert np.allclose(product, v["angle_defect"][interior])
    assert (v["gaussian_curvature"][~interior] == 0).all() and (v["geodesic_curvature"][interior] == 0).all()


@pytest.mark.parametrize("name", ALL_MESHES)
def test_areas_and_balances_close(name):
    measured = measure_curvature(crumpled(ALL_MESHES[name]))
    assert measured.vertex["vertex_area"].sum() == pytest.approx(measured.results["area"], rel=1e-14)
    assert (measured.vertex["vertex_area"] > 0).all()
    for residual, value in measured.accuracy.items():
        assert value < 1e-14, residual


def test_a_broken_dihedral_angle_opens_the_balances():
    from ddgcli.algorithms.curvature.balance import RegionBalance
    from ddgcli.geometry.extrinsic import edge_blocks

    mesh = crumpled(shapes.icosphere(2))
    faces = Faces.of(mesh)
    region = mesh.points[mesh.faces].mean(axis=1)[:, 2] > 0.1

    def residuals(factor):
        balance = RegionBalance(faces, mesh.topology, faces.normal, region)
        for block in edge_blocks(faces.points, mesh.topology, faces.normal):
            balance.add(block, factor * block.angle)
        return balance.residuals()

    closed, opened = residuals(1.0), residuals(1.01)
    assert max(closed.values()) < 1e-14
    assert min(opened.values()) > 1e-7


def test_the_unit_cube_has_the_steiner_polynomial_of_the_notes():
    r = measure_curvature(shapes.box(1, 1, 1)).results
    assert r["intrinsic_volumes"] == pytest.approx([1, 3, 3, 1], rel=1e-14)
    assert r["steiner_polynomial"] == pytest.approx([1, 6, 3 * np.pi, 4 * np.pi / 3], rel=1e-14)
    assert r["total_mean_curvature"] == pytest.approx(3 * np.pi, rel=1e-14)


def test_the_steiner_polynomial_is_the_volume_of_the_offset_body():
    # Monte Carlo: the share of a box that lies within eps of a random convex body
    mesh = shapes.random_sphere(12, seed=3)
    eps, rng = 0.4, np.random.default_rng(0)
    c = measure_curvature(mesh).results["steiner_polynomial"]
    samples = rng.uniform(-1.5, 1.5, size=(40_000, 3))
    inside = distance_to_convex(mesh, samples) <= eps
    volume, spread = 27 * inside.mean(), 27 * inside.std() / np.sqrt(len(inside))
    assert sum(k * eps**i for i, k in enumerate(c)) == pytest.approx(volume, abs=4 * spread)


def distance_to_convex(mesh, samples):
    """Distance of points from a convex body: 0 inside, else the least over its faces' triangles."""
    p = mesh.points[mesh.faces]
    normal = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    outside = (np.einsum("sfi,fi->sf", samples[:, None] - p[:, 0], normal) > 0).any(axis=1)
    best = np.where(outside, np.inf, 0.0)
    for a, b, c in p:
        ab, ac, ap = b - a, c - a, samples - a
        g = np.linalg.inv(np.array([[ab @ ab, ab @ ac], [ab @ ac, ac @ ac]]))
        u, v = g @ np.stack([ap @ ab, ap @ ac])
        flat = np.linalg.norm(ap - u[:, None] * ab - v[:, None] * ac, axis=1)
        best = np.minimum(best, np.where((u >= 0) & (v >= 0) & (u + v <= 1), flat, np.inf))
        for s, e in ((a, b), (b, c), (c, a)):
            t = np.clip((samples - s) @ (e - s) / ((e - s) @ (e - s)), 0, 1)
            best = np.minimum(best, np.linalg.norm(samples - s - t[:, None] * (e - s), axis=1))
    return best


def test_hand_computed_values_at_the_corners_of_a_cube():
    v = measure_curvature(shapes.box(1, 1, 1), "cotan").vertex
    assert v["angle_defect"] == pytest.approx(np.full(8, np.pi / 2))
    e = measure_curvature(shapes.box(1, 1, 1), "cotan").edge
    assert np.sort(e["dihedral_angle"])[-12:] == pytest.approx(np.full(12, np.pi / 2))
    assert e["edge_mean_curvature"].sum() == pytest.approx(3 * np.pi)
    assert len(e["edges"]) == 18 and e["edges"].shape[1] == 2


def test_a_square_s_corners_turn_by_right_angles():
    v = measure_curvature(shapes.grid(2, 2)).vertex
    assert v["boundary"].sum() == 8 and v["angle_defect"].sum() == pytest.approx(2 * np.pi)
    assert np.sort(v["angle_defect"]) == pytest.approx([0] * 5 + [np.pi / 2] * 4, abs=1e-14)
    assert np.sort(v["geodesic_curvature"])[-4:] == pytest.approx(np.full(4, np.pi))  # pi/2 over 1/2
    assert np.abs(v["mean_curvature_normal"]).max() < 1e-14 and np.abs(v["mean_curvature"]).max() < 1e-12


@pytest.mark.parametrize("name", ALL_MESHES)
def test_the_mean_curvature_vector_is_minus_half_the_area_gradient(name):
    mesh = crumpled(ALL_MESHES[name])
    vector = exact.curvature_vector(mesh)
    inside = np.flatnonzero(~mesh.topology.boundary_vertex)[:2]
    assert len(inside) == 2
    for v in inside:
        for i in range(3):
            step = np.zeros_like(mesh.points)
            step[v, i] = 1e-5
            area = [Faces.of(mesh.moved(mesh.points + s * step)).area.sum() for s in (1, -1)]
            assert vector[v, i] == pytest.approx(-0.5 * (area[0] - area[1]) / 2e-5, abs=1e-8)


def test_signs_and_lengths_of_the_mean_curvature():
    mesh = shapes.icosphere(3, radius=2.0)
    v = measure_curvature(mesh, "cotan").vertex
    assert v["mean_curvature"] == pytest.approx(np.full(mesh.n_vertices, 0.5), rel=0.02)
    assert np.linalg.norm(v["mean_curvature_normal"], axis=1) == pytest.approx(np.abs(v["mean_curvature"]))
    assert (np.einsum("ij,ij->i", v["mean_curvature_normal"], mesh.points) < 0).all(), "inward where convex"
    turned = TriangleMesh.from_arrays(mesh.points, mesh.faces[:, ::-1])
    for scheme in CURVATURE_SCHEMES:
        out, back = measure_curvature(mesh, scheme).vertex, measure_curvature(turned, scheme).vertex
        assert back["mean_curvature"] == pytest.approx(-out["mean_curvature"])
        assert back["gaussian_curvature"] == pytest.approx(out["gaussian_curvature"])


@pytest.mark.parametrize("scheme", CURVATURE_SCHEMES)
def test_every_scheme_keeps_its_conventions(scheme):
    mesh = crumpled(shapes.torus(24, 16))
    v = measure_curvature(mesh, scheme).vertex
    low, high = v["principal_curvature_min"], v["principal_curvature_max"]
    assert (low <= high).all()
    assert v["mean_curvature"] == pytest.approx((low + high) / 2, abs=1e-12)
    one, two = v["principal_direction_min"], v["principal_direction_max"]
    assert np.linalg.norm(one, axis=1) == pytest.approx(np.ones(len(one)))
    assert np.linalg.norm(two, axis=1) == pytest.approx(np.ones(len(two)))
    assert np.abs(np.einsum("ij,ij->i", one, two)).max() < 1e-12


def test_willmore_energies_of_spheres_tori_and_round_polyhedra():
    sphere = measure_curvature(shapes.icosphere(4)).results
    assert sphere["willmore_energy"] == pytest.approx(4 * np.pi, rel=2e-3)
    names = {"cotan", "sullivan", "hinge", "circle-angle", "cotan-minus-gauss"}
    assert set(sphere["willmore_energies"]) == names
    for name in ("cotan", "sullivan"):
        assert sphere["willmore_energies"][name] == pytest.approx(4 * np.pi, rel=5e-3)
    assert (
        abs(measure_curvature(shapes.random_sphere(100)).results["willmore_energies"]["circle-angle"]) < 1e-10
    )
    torus = shapes.torus(96, 64, 1.0, 1 / np.sqrt(2))
    clifford = measure_curvature(torus).results
    assert clifford["willmore_energy"] == pytest.approx(2 * np.pi**2, rel=4e-3)  # the area alone is 2e-3 off
    assert clifford["willmore_energies"]["sullivan"] == pytest.approx(2 * np.pi**2, rel=2e-2)
    assert clifford["willmore_energies"]["circle-angle"] == pytest.approx(2 * np.pi**2, rel=1e-2)


def test_non_conformality_is_zero_for_conformal_maps_only():
    mesh = crumpled(shapes.grid(8, 8))
    for image in (
        mesh.points,
        3 * mesh.points @ np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0],
    ):
        r = measure_curvature(mesh, image=image).results
        assert abs(r["nonconformality"]) < 1e-12 * r["map_area"]
    flat = shapes.grid(6, 6)
    stretched = measure_curvature(flat, image=flat.points[:, :2] * [2.0, 1.0]).results
    assert stretched["nonconformality"] == pytest.approx(0.5 * (4 + 1) - 2)
    with pytest.raises(ParameterError, match="shape"):
        measure_curvature(flat, image=np.zeros((3, 2)))


def test_angles_of_an_intrinsic_mesh_are_those_of_its_surface():
    mesh = crumpled(shapes.random_sphere(100))
    intrinsic = IntrinsicMesh(mesh.topology, mesh.side_length)
    assert exact.angle_defect(intrinsic) == pytest.approx(exact.angle_defect(mesh), abs=1e-12)
    assert exact.vertex_area(intrinsic) == pytest.approx(exact.vertex_area(mesh), rel=1e-10)


def test_needles_and_caps_keep_their_angles():
    # a sphere with one face of an area of rounding size, and one edge of no length
    mesh = shapes.icosphere(2)
    points = mesh.points.copy()
    a, b, c = mesh.faces[0]
    points[a] = (points[b] + points[c]) / 2
    points[mesh.faces[200, 0]] = points[mesh.faces[200, 1]]
    measured = measure_curvature(mesh.moved(points))
    assert measured.accuracy["gauss_bonnet_residual"] < 1e-14
    assert measured.accuracy["force_balance_residual"] < 1e-13
    for name, values in measured.vertex.items():
        assert np.isfinite(values).all(), name


def test_a_ball_that_holds_all_measures_everything():
    mesh = shapes.random_sphere(60)
    surface = prepare_surface(mesh, "normal-cycle")  # at unit size
    normal = unit_normals(surface.faces)
    measured = normal_cycle_in_balls(surface.mesh, normal, surface.defect, surface.dihedral, 3.0)
    assert measured.gaussian == pytest.approx(np.full(60, 4 * np.pi / surface.area.sum()))


def test_refusals_name_a_remedy():
    mesh = shapes.icosphere(1)
    with pytest.raises(ParameterError, match="quadric"):
        measure_curvature(mesh, "fancy")
    with pytest.raises(ParameterError, match="takes no radius"):
        measure_curvature(mesh, "cotan", 0.1)
    with pytest.raises(ParameterError, match="radius below"):
        measure_curvature(shapes.icosphere(6), "corrected", 10.0)
    with pytest.raises(MeshError, match="face 0 is a flat sheet, which encloses nothing; extrude it"):
        offset_body(shapes.grid(3, 3), 0.1)  # filled, it would be refused again
    with pytest.raises(MeshError, match="same place"):
        measure_curvature(mesh.moved(np.zeros_like(mesh.points)))
    with pytest.raises(MeshError, match="no face has area"):
        measure_curvature(mesh.moved(mesh.points * [1.0, 0, 0]))
    with pytest.raises(MeshError, match="rescale"):
        measure_curvature(mesh.moved(mesh.points * 1e200))


def circle_angle(mesh):
    return measure_curvature(mesh).results["willmore_energies"]["circle-angle"]


@pytest.mark.parametrize("centre", [(0.2, 0.1, 0.9), (5.0, -3.0, 2.0)])
def test_circle_angle_is_moebius_invariant(centre):
    """To rounding: the arccosine lost half the digits where circles nearly touch or coincide."""
    torus = read_mesh(str(Path(__file__).parents[2] / "sample_meshes" / "torus.ply")).surface
    moved = torus.points - np.array(centre)
    inverted = torus.moved(moved / np.sum(moved**2, axis=1)[:, None])
    assert circle_angle(inverted) == pytest.approx(circle_angle(torus), abs=1e-10)
    nearly_flat = shapes.grid(8, 8, pattern="right")  # squares: both circles of a diagonal coincide
    assert abs(circle_angle(nearly_flat)) < 1e-12


def test_circle_angle_counts_edges_that_are_not_delaunay():
    """A flat quad with its longer diagonal inside: each end sees the other circle from within."""
    grid = shapes.grid(6, 6, pattern="right")
    sheared = grid.moved(grid.points @ np.array([[1.0, 0, 0], [0.6, 1.0, 0], [0, 0, 1]]))
    good, bad = (measure_curvature(m).results for m in (grid, sheared))
    assert good["non_delaunay_edges"] == 0 and bad["non_delaunay_edges"] > 0
    assert bad["willmore_energies"]["circle-angle"] > 1


def test_hinge_means_the_same_in_curvature_and_in_flows():
    from ddgcli.models.willmore.energies import ENERGIES

    for mesh in (shapes.torus(48, 24, 1.0, 0.4), crumpled(shapes.grid(8, 8)), shapes.icosphere(3)):
        energies = measure_curvature(mesh).results["willmore_energies"]
        for name in ("hinge", "cotan", "sullivan"):
            if name == "hinge" or mesh.topology.is_closed:
                flow = ENERGIES[name].of(mesh).value(mesh.points)
                assert energies[name] == pytest.approx(flow, rel=1e-11), name


@pytest.mark.parametrize("mesh", [shapes.icosphere(2), shapes.torus(24, 12)])
def test_normals_of_faces_that_run_counter_clockwise_seen_from_outside_point_outward(mesh):
    """The cones from the origin over the faces fill the body: a third of position times normal times area."""
    corner = mesh.points[mesh.faces]
    area_vector = face_area_vector(mesh)
    assert np.vdot(corner.mean(axis=1), area_vector) / 3.0 == pytest.approx(enclosed_volume(mesh), rel=1e-12)
    assert enclosed_volume(mesh) > 0
    assert np.linalg.norm(area_vector, axis=1) == pytest.approx(face_area(mesh.side_length), rel=1e-12)


@pytest.mark.parametrize(
    "scheme, radius, region, rings",
    [("cotan", None, "star", 1), ("quadric", None, "two rings", 2), ("quadric", 0.5, "ball", 4)],
)
def test_values_depend_on_the_region_that_the_results_state(scheme, radius, region, rings):
    mesh = shapes.icosphere(3)
    points = mesh.points.copy()
    points[500] *= 1.01
    before, after = (measure_curvature(m, scheme, radius) for m in (mesh, mesh.moved(points)))
    assert before.results["region"] == region and before.results["radius"] == radius
    change = np.abs(after.vertex["mean_curvature"] - before.vertex["mean_curvature"])
    adjacency = uniform_stiffness(mesh) != 0
    near = np.eye(mesh.n_vertices)[500]
    for _ in range(rings):
        near = adjacency @ near
    assert (change[near > 0] > 1e-9).mean() > 0.5 and change[near == 0].max() < 1e-9


@pytest.mark.parametrize("scheme", list(MAX_BALL_PAIRS))
def test_the_largest_radius_of_a_refusal_is_accepted(scheme):
    """It depended on the refused radius: the next was refused again."""
    mesh = shapes.icosphere(6)  # only its counts are read
    area = 1e-4
    largest = largest_radius(mesh, area, scheme)
    for radius in (2 * largest, 1e9):
        with pytest.raises(ParameterError, match=f"below {7 * largest:.3g},"):
            check_radius(mesh, area, radius, 7.0, scheme)
    check_radius(mesh, area, 0.999 * largest, 7.0, scheme)
