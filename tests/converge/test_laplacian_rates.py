"""Spectra and solutions with known truth, and the order at which they are reached."""

import numpy as np
import pytest

from ddgcli.algorithms.laplacian.laplace_operator import laplace_operator
from ddgcli.algorithms.laplacian.parameterize import parameterize_conformal, parameterize_harmonic
from ddgcli.algorithms.laplacian.poisson import harmonic, poisson
from ddgcli.algorithms.laplacian.smooth import smooth
from ddgcli.algorithms.laplacian.spectrum import spectrum
from ddgcli.io.mesh_file import read_mesh
from ddgcli.linalg.eigen import smallest_eigenpairs
from ddgcli.mesh import shapes
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators.laplacian import galerkin_mass, lumped_mass, stiffness


def rates(errors):
    """Observed orders from errors on meshes of halved size."""
    return np.log2(np.array(errors[:-1]) / np.array(errors[1:]))


def disk(rings):
    """Unit disk of concentric rings, 6 i vertices on ring i."""
    points, faces, start = [np.zeros((1, 2))], [], [0]
    for i in range(1, rings + 1):
        start.append(start[-1] + (6 * (i - 1) if i > 1 else 1))
        t = 2 * np.pi * np.arange(6 * i) / (6 * i)
        points.append(i / rings * np.stack([np.cos(t), np.sin(t)], axis=1))
    for i in range(1, rings + 1):
        inner, outer = start[i - 1], start[i]
        n_in, n_out = max(6 * (i - 1), 1), 6 * i
        for sector in range(6):
            for k in range(i):
                a, b = outer + (sector * i + k), outer + (sector * i + k + 1) % n_out
                c = inner + (sector * (i - 1) + k) % n_in
                faces.append([a, b, c])
                if k < i - 1:
                    faces.append([b, inner + (sector * (i - 1) + k + 1) % n_in, c])
    return TriangleMesh.from_arrays(np.concatenate(points), np.array(faces))


def flat_torus(n, width=1.0, height=1.0):
    """A periodic grid given by its edge lengths: there is no flat torus in space."""
    _, _, faces = shapes.wrapped_grid(n, n, wrap_u=True, wrap_v=True)
    a, b = width / n, height / n
    first = np.tile([[a, b, np.hypot(a, b)], [np.hypot(a, b), a, b]], (n * n, 1))
    return IntrinsicMesh(Topology(faces, n * n), first)


@pytest.mark.parametrize("mass", ["lumped", "voronoi", "galerkin"])
def test_sphere_has_l_times_l_plus_one_with_multiplicity(mass):
    degree = np.repeat(np.arange(5), 2 * np.arange(5) + 1)
    truth = degree * (degree + 1.0)
    errors = []
    for subdivisions in (2, 3, 4):
        values = spectrum(laplace_operator(shapes.icosphere(subdivisions), mass=mass), 25).values
        errors.append(np.abs(values - truth)[1:].max())
        for l in range(1, 5):
            assert np.ptp(values[degree == l]) < 0.05 * truth[degree == l][0]
    assert errors[-1] < 0.2
    assert (rates(errors) > 1.8).all()


@pytest.mark.parametrize("mass", [lumped_mass, galerkin_mass])
def test_eigenvalues_of_a_flat_torus_converge_at_second_order(mass):
    truth = np.sort([(2 * np.pi) ** 2 * (i * i + j * j) for i in range(-3, 4) for j in range(-3, 4)])[:13]
    errors = []
    for n in (12, 24, 48):
        mesh = flat_torus(n)
        assert mesh.topology.is_closed and mesh.topology.genus == 1
        values = smallest_eigenpairs(stiffness(mesh), mass(mesh), 13).values
        errors.append((np.abs(values - truth)[1:] / truth[1:]).max())
    assert errors[-1] < 0.02
    assert (rates(errors) > 1.9).all()


def test_flat_torus_eigenvalues_are_those_of_the_five_point_star():
    n = 16
    mesh = flat_torus(n)
    values = smallest_eigenpairs(stiffness(mesh), lumped_mass(mesh), 60).values
    wave = 4 * n * n * np.sin(np.pi * np.arange(n) / n) ** 2
    truth = np.sort((wave[:, None] + wave[None, :]).ravel())[:60]
    assert np.abs(values - truth).max() < 1e-9 * truth[-1]


def test_eigenvalues_of_a_free_square_converge_at_second_order():
    truth = np.sort([np.pi**2 * (i * i + j * j) for i in range(6) for j in range(6)])[:10]
    errors = []
    for n in (8, 16, 32):
        values = spectrum(laplace_operator(shapes.grid(n, n)), 10).values
        errors.append((np.abs(values - truth)[1:] / truth[1:]).max())
    assert errors[-1] < 0.02 and (rates(errors) > 1.8).all()


def test_eigenvalues_of_a_free_disk_converge_at_second_order():
    # squares of the zeros of J_m' for m = 1, 2, 0, 3, 4 (Abramowitz and Stegun, table 9.5)
    zero = np.array([1.841183781, 1.841183781, 3.054236928, 3.054236928, 3.831705970,
                     4.201188941, 4.201188941, 5.317553126, 5.317553126])  # fmt: skip
    errors = []
    for rings in (8, 16, 32):
        values = spectrum(laplace_operator(disk(rings)), 10).values[1:]
        errors.append((np.abs(values - zero**2) / zero**2).max())
    assert errors[-1] < 0.01 and (rates(errors) > 1.8).all()


@pytest.mark.parametrize("operator", ["cotan", "intrinsic-delaunay", "tufted"])
def test_poisson_on_the_sphere_is_second_order(operator):
    errors = []
    for subdivisions in (2, 3, 4):
        mesh = shapes.icosphere(subdivisions)
        x, y, z = mesh.points.T
        truth = x * y + z  # -Laplacian: 6 x y + 2 z
        solution = poisson(laplace_operator(mesh, operator), 6 * x * y + 2 * z)
        assert solution.residual < 1e-11
        errors.append(np.abs(solution.values - truth).max())
    assert (rates(errors) > 1.8).all()


def test_poisson_with_fixed_values_is_second_order():
    errors = []
    for n in (8, 16, 32):
        mesh = shapes.grid(n, n, pattern="alternating")
        x, y = mesh.points[:, 0], mesh.points[:, 1]
        truth = np.sin(np.pi * x) * np.sin(2 * np.pi * y) + x * x - y * y
        fixed = {int(v): float(truth[v]) for v in np.flatnonzero(mesh.topology.boundary_vertex)}
        source = 5 * np.pi**2 * np.sin(np.pi * x) * np.sin(2 * np.pi * y)
        errors.append(np.abs(poisson(laplace_operator(mesh), source, fixed).values - truth).max())
    assert (rates(errors) > 1.8).all()


def test_harmonic_function_on_an_annulus():
    mesh = shapes.cylinder(48, 24)
    z = mesh.points[:, 2]
    ends = np.flatnonzero(mesh.topology.boundary_vertex)
    solution = harmonic(laplace_operator(mesh), {int(v): float(z[v]) for v in ends})
    assert np.abs(solution.values - z).max() < 1e-13


def test_conformal_map_of_a_plane_region_is_a_similarity():
    for mesh in (disk(8), shapes.grid(9, 5, 2.0, 1.0, pattern="alternating")):
        flat = parameterize_conformal(mesh, laplace_operator(mesh))
        # congruent: the result is scaled to the area of the surface
        ours = TriangleMesh.from_arrays(flat.uv, mesh.faces).side_length
        assert np.abs(ours / mesh.side_length - 1).max() < 1e-6
        assert flat.flipped == flat.flipped_input == 0
        assert flat.distortion_max < 1 + 1e-6


def test_conformal_map_of_a_hemisphere_is_stereographic():
    flat_disk = disk(24)
    radius, angle = np.linalg.norm(flat_disk.points, axis=1), np.arctan2(*flat_disk.points.T[1::-1])
    polar = 0.5 * np.pi * radius
    half = flat_disk.moved(
        np.stack([np.sin(polar) * np.cos(angle), np.sin(polar) * np.sin(angle), np.cos(polar)], axis=1)
    )
    flat = parameterize_conformal(half, laplace_operator(half))
    assert flat.converged and flat.flipped_input == 0
    assert flat.distortion_mean < 1.03
    x, y, z = half.points.T
    stereographic = (x + 1j * y) / (1 + z)
    uv = flat.uv[:, 0] + 1j * flat.uv[:, 1]
    factor = np.vdot(stereographic, uv) / np.vdot(stereographic, stereographic)
    assert np.abs(uv - factor * stereographic).max() < 0.02 * np.abs(uv).max()


@pytest.mark.parametrize("seed", range(3))
def test_delaunay_harmonic_map_flips_nothing_where_cotan_does(seed):
    rng = np.random.default_rng(seed)
    flat = shapes.grid(14, 14)
    points = flat.points.copy()
    points[:, 0] -= 5 * points[:, 1]  # obtuse triangles everywhere
    points[:, 1] += 0.025 * rng.normal(size=len(points)) * ~flat.topology.boundary_vertex
    points[:, 2] = 0.15 * rng.normal(size=len(points))
    mesh = flat.moved(points)
    good = parameterize_harmonic(mesh, laplace_operator(mesh, "intrinsic-delaunay"))
    assert good.flipped == 0
    assert parameterize_harmonic(mesh, laplace_operator(mesh, "cotan")).flipped > 0


def test_delaunay_harmonic_map_of_a_region_with_holes_flips_nothing(shared_meshes):
    mesh = read_mesh(str(shared_meshes / "plane_holes.obj")).mesh
    flat = parameterize_harmonic(mesh, laplace_operator(mesh))
    assert flat.flipped == 0 and flat.residual < 1e-12


def test_mean_curvature_flow_of_a_sphere_is_first_order_in_time():
    mesh = shapes.icosphere(3)
    errors = []
    for steps in (4, 8, 16):
        radius = np.linalg.norm(smooth(mesh, 0.1, steps=steps).mesh.points, axis=1).mean()
        errors.append(abs(radius - np.sqrt(1 - 0.4)))
    assert (rates(errors) > 0.85).all()
    flowed = smooth(mesh, 0.1, steps=8)
    assert (np.diff(flowed.area) < 0).all() and flowed.residual < 1e-12


def test_mean_curvature_flow_keeps_the_boundary():
    mesh = shapes.catenoid(24, 12)
    result = smooth(mesh, 0.01, steps=3)
    boundary = mesh.topology.boundary_vertex
    assert np.array_equal(result.mesh.points[boundary], mesh.points[boundary])
    # a catenoid is minimal already
    assert np.abs(result.mesh.points - mesh.points).max() < 0.01


@pytest.mark.parametrize("flatten", [parameterize_harmonic, parameterize_conformal])
@pytest.mark.parametrize("shape", ["square", "long", "upright", "bump"])
def test_flat_maps_do_not_depend_on_the_numbers_of_vertices_and_faces(flatten, shape):
    """The first vertex of the boundary turned the disk, and the first far one chose the sign."""
    mesh = shapes.grid(6, 6)
    x, y, z = mesh.points.T
    points = {
        "square": [x, y, z],
        "long": [2 * x, y, z],
        "upright": [z, y, x + y**2],
        "bump": [x, y, x * y * y],
    }
    mesh = mesh.moved(np.stack(points[shape], axis=1))
    uv, rng = flatten(mesh, laplace_operator(mesh)).uv, np.random.default_rng(0)
    if shape != "upright":
        assert ((uv[:, 0] - uv[:, 0].mean()) * (x - 0.5)).sum() > 0
    for _ in range(3):
        vertices, faces = rng.permutation(mesh.n_vertices), rng.permutation(mesh.n_faces)
        number = np.argsort(vertices)
        other = TriangleMesh.from_arrays(mesh.points[vertices], number[mesh.faces[faces]])
        assert np.abs(flatten(other, laplace_operator(other)).uv[number] - uv).max() < 1e-8
