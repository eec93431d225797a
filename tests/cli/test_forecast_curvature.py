"""Predictions of `curvature`: its kernels are counted by facts of the mesh."""

import math

import numpy as np
import pytest

from ddgcli.algorithms.curvature import noise_estimate, offset_body, surface_curvature
from ddgcli.algorithms.curvature.ball_blocks import ball_blocks
from ddgcli.algorithms.curvature.face_balls import FaceBalls
from ddgcli.choices import CURVATURE_SCHEMES
from ddgcli.cli.forecast.check_cost import size_of
from ddgcli.cli.forecast.facts import CurvatureFacts
from ddgcli.cli.forecast.kernels import kernels_of
from ddgcli.cli.forecast.mesh_facts import (
    SEARCH_OF_BALL,
    ball_work,
    clipping_work,
    has_sheared_fits,
    noise_of_vertices,
)
from ddgcli.cli.forecast.prediction import predict
from ddgcli.cli.forecast.use import InputSize
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh

MIB = 2.0**20


@pytest.mark.parametrize("radius", [None, "auto", 0.3])
@pytest.mark.parametrize("scheme", [s for s in CURVATURE_SCHEMES if s != "cotan"])
def test_every_kernel_of_a_scheme_has_been_measured(scheme, radius):
    facts = CurvatureFacts(0.1, noise="noise", fitted_pairs=(5000.0, 9000.0), sheared=True)
    size = InputSize("surface", 1000, curvature=facts)
    uses = kernels_of("curvature", {"scheme": scheme, "radius": radius}, size)
    kernels = predict(uses, size).kernels
    assert kernels and all(row["seconds"] is not None for row in kernels)


def test_neighbours_of_the_delaunay_triangulation_are_counted_where_most_edges_are_far_from_it():
    even = shapes.torus(40, 20)
    sheared = shapes.random_sphere(400, 0)
    sheared = sheared.moved(sheared.points * [1.0, 0.2, 5.0])
    turned = sheared.faces.copy()
    turned[::3] = turned[::3, ::-1]
    assert has_sheared_fits(sheared) and not has_sheared_fits(even)
    assert has_sheared_fits(TriangleMesh.from_arrays(sheared.points, turned))
    size = InputSize("surface", 400_000)
    plain, flipped = (
        {
            use.kernel
            for use in kernels_of("curvature", {"scheme": "quadric"}, size.with_curvature(sheared=is_sheared))
        }
        for is_sheared in (False, True)
    )
    assert flipped - plain == {"curvature sheared"}


def test_the_search_for_noise_is_counted_where_the_first_fits_of_the_run_show_some():
    smooth = shapes.torus(80, 40)
    edge = smooth.side_length.mean()
    noise = 0.1 * edge * np.random.default_rng(0).standard_normal(smooth.points.shape)
    rough = smooth.moved(smooth.points + noise)
    faint = smooth.moved(smooth.points + 0.3 * noise)  # turns of 0.07: no face looks rough
    waves = smooth.moved(smooth.points + 0.2 * edge * np.sin(2 / edge * smooth.points))
    search, in_balls = {"curvature wide fits", "curvature noise"}, "curvature quadric radius"

    def kernels(mesh, **options):
        options = {"scheme": "quadric", **options}
        noise, pairs = noise_of_vertices(mesh, "quadric")
        size = size_of(mesh, options).with_curvature(noise=noise, fitted_pairs=pairs)
        return {use.kernel for use in kernels_of("curvature", options, size)} & {*search, in_balls}

    assert not kernels(smooth) and not kernels(shapes.icosphere(1)) and not kernels(smooth, radius="auto")
    assert kernels(rough) == kernels(faint) == search
    assert kernels(waves) == {"curvature wide fits"}
    assert kernels(rough, radius="auto") == {*search, in_balls}
    assert kernels(rough, radius=0.1) == {"curvature wide fits", in_balls}
    # balls of a stated radius do not depend on noise
    assert not kernels(rough, radius=0.1, scheme="corrected")
    turned = rough.faces.copy()
    turned[::3] = turned[::3, ::-1]
    assert noise_of_vertices(TriangleMesh.from_arrays(rough.points, turned), "cotan")[0] == "noise"
    assert noise_of_vertices(shapes.grid(3, 3), "cotan") == ("", ())


def test_the_search_for_noise_is_counted_by_the_vertices_of_its_balls(monkeypatch):
    """Vertices crowd on mechanical parts, whose balls hold many times those of a scan."""
    sphere = shapes.random_sphere(1500, 0)
    noise = 1 + 0.004 * np.random.default_rng(0).standard_normal(len(sphere.points))
    crowded = sphere.moved(sphere.points * noise[:, None] * [1.0, 1.0, 0.2])
    counted: list[float] = []
    fits = noise_estimate.fits_in_balls

    def counting(points, grid, normal, few, radius):
        counted.append(len(grid.balls(few, radius).member) / len(few))
        return fits(points, grid, normal, few, radius)

    monkeypatch.setattr(noise_estimate, "fits_in_balls", counting)
    for mesh in (sphere.moved(sphere.points * noise[:, None]), crowded):
        counted.clear()
        surface_curvature.measure_curvature(mesh, "cotan")
        pairs = noise_of_vertices(mesh, "cotan")[1]
        assert 2 < len(counted) <= len(pairs)
        expected = np.array(counted) * noise_estimate.BENDING_SAMPLE_SIZE
        assert np.allclose(pairs[: len(counted)], expected, rtol=0.4)


def test_offset_bodies_are_counted_by_the_steps_of_their_arcs():
    box = shapes.icosphere(0)
    for angle in (3.0, 30.0):
        arcs = offset_body.check_offset(box, 0.1, angle)
        points, faces, _ = offset_body._assemble(box, arcs, 0.1)
        size = size_of(box, {"offset": 0.1, "offset_angle": angle})
        assert (arcs.n_points, arcs.n_faces) == (len(points), len(faces))
        of_smooth = round(len(points) / 2.1)  # faces of a smooth surface's offset with as many points
        assert size.curvature.offset_faces == of_smooth
        options = {"scheme": "cotan", "offset": 0.1}
        assert kernels_of("curvature", options, size)[0].elements == of_smooth
    assert size_of(shapes.grid(2, 2), {"offset": 0.1}).curvature.offset_faces is None  # the run refuses it


def test_balls_are_counted_where_the_vertices_lie():
    """On graded meshes as many pairs as a search finds, not as the mean edge suggests."""
    square, radius = shapes.grid(60, 60), 0.1
    graded = square.moved(square.points**3)
    for mesh in (square, graded):
        distance = np.linalg.norm(mesh.points[:, None, :2] - mesh.points[None, ::7, :2], axis=2)
        count = float((distance <= radius).sum(axis=0).mean())
        work = ball_work(mesh, radius, "quadric") / mesh.n_vertices
        assert math.isclose(work - SEARCH_OF_BALL, count, rel_tol=0.15)

    def elements(mesh):
        work = ball_work(mesh, radius, "quadric")
        size = InputSize("surface", mesh.n_faces, curvature=CurvatureFacts(ball_work=work))
        return kernels_of("curvature", {"scheme": "quadric", "radius": radius}, size)[1].elements

    assert elements(graded) > 2 * elements(square)
    # measured: clipping balls of eight edges take 2.2 times as long as balls of three
    size = InputSize("surface", 9000, curvature=CurvatureFacts(edge_length=1.0))
    three, eight = (
        kernels_of("curvature", {"scheme": "corrected", "radius": rings}, size) for rings in (3.0, 8.0)
    )
    assert three[1].times == pytest.approx(1.0) and 1.9 < eight[1].times < 2.5


def test_clipped_faces_are_counted_as_the_run_clips_them():
    """Stretched faces are clipped again each time that a ball grows over one of their corners."""
    sphere = shapes.icosphere(3)
    stretched = sphere.moved(sphere.points * [1.0, 1.0, 25.0])
    for mesh in (sphere, stretched):
        balls = FaceBalls(mesh, 0.6)
        for vertex, near in ball_blocks(balls.tree, 0.6):
            balls.around(vertex, near)
        n = mesh.n_vertices
        work = n * clipping_work(balls.n_clipped / n, balls.n_inside / n)
        assert 0.5 * work < ball_work(mesh, 0.6, "corrected") < 1.5 * work
    assert ball_work(stretched, 0.6, "corrected") > 3 * ball_work(stretched, 0.6, "quadric")
