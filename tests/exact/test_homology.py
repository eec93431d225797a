"""Betti numbers against ranks, cochains closed, generators independent."""

from itertools import permutations

import numpy as np
import pytest

import ddgcli as ddg
from ddgcli.algorithms.hodge.harmonic import solid_cochains
from ddgcli.algorithms.hodge.homology import (
    betti_numbers,
    closed_cochains,
    generator_loops,
)
from ddgcli.algorithms.hodge.solid_homology import solid_generator_loops
from ddgcli.errors import MeshError
from ddgcli.io.mesh_file import read_mesh
from ddgcli.mesh import shapes, tet_mesh
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators.dec import complex_of
from tests.exact.test_dec import jittered_tets


def moebius(n: int = 12) -> TriangleMesh:
    """Band of n quads with a half turn."""
    i = np.arange(n)
    low, high = i, i + n
    next_low, next_high = np.where(i < n - 1, i + 1, n), np.where(i < n - 1, i + 1 + n, 0)
    faces = np.concatenate([np.stack([low, next_low, high], 1), np.stack([high, next_low, next_high], 1)])
    return TriangleMesh.from_arrays(np.random.default_rng(0).normal(size=(2 * n, 3)), faces)


def klein(n: int = 8) -> TriangleMesh:
    """n x n grid, one pair of sides glued straight, the other turned over."""
    i, j = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")

    def number(a, b):
        b = b % n
        return (a % n) * n + np.where(a >= n, (-b) % n, b)

    p = [number(i + a, j + b).ravel() for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
    faces = np.concatenate([np.stack([p[0], p[1], p[2]], 1), np.stack([p[0], p[2], p[3]], 1)])
    return TriangleMesh.from_arrays(np.random.default_rng(0).normal(size=(n * n, 3)), faces)


def hollow_tets() -> TetMesh:
    """A 3x3x3 block of cubes without its middle one: a cavity."""
    block = jittered_tets(3)
    middle = (np.abs(block.points[block.tetrahedra].mean(axis=1) - 0.5) < 1 / 6).all(axis=1)
    return TetMesh.from_arrays(block.points, block.tetrahedra[~middle])


def ring_tets() -> TetMesh:
    """A 3x3x3 block of cubes without its middle column: a solid torus."""
    block = jittered_tets(3)
    middle = (np.abs(block.points[block.tetrahedra].mean(axis=1)[:, :2] - 0.5) < 1 / 6).all(axis=1)
    return TetMesh.from_arrays(block.points, block.tetrahedra[~middle])


def two_tori() -> TriangleMesh:
    a = shapes.torus(8, 6)
    points = np.concatenate([a.points, a.points + 5])
    return TriangleMesh.from_arrays(points, np.concatenate([a.faces, a.faces + a.n_vertices]))


WITH_BETTI_NUMBERS = [
    "1002_tray_bottom.STL", "P1.msh", "beam-tet.vtk", "blub_triangulated.obj", "boot.obj", "box.STL",
    "cloth_ball92.ply", "counter.unitsmm.STL", "cubes_v41.msh", "demosthenes-low-res.obj",
    "fairing-cross.off", "featuretype.STL", "goathead.obj", "hand_lowres.obj", "hemisphere.off", "koala.obj",
    "koala_loop1.ply",
    "lego.ply", "mat40x40.msh", "menger_sponge3.off", "nefertiti-lowres.obj", "penguin_control_mesh.obj",
    "pizza.obj", "plane_holes.obj", "plate_holes.STL", "self_intersectA.obj", "spot.obj",
    "spot_control_mesh.obj", "st_helens_terrain.ply", "tet_sphere.mesh", "wingnut.obj",
]  # fmt: skip

MESHES = {
    "sphere": (shapes.icosphere(1), (1, 0, 1)),
    "torus": (shapes.torus(8, 6), (1, 2, 1)),
    "two tori": (two_tori(), (2, 4, 2)),
    "disk": (shapes.grid(3, 3), (1, 0, 0)),
    "annulus": (shapes.cylinder(6, 2), (1, 1, 0)),
    "moebius": (moebius(), (1, 1, 0)),
    "klein": (klein(), (1, 1, 0)),
    "ball": (jittered_tets(2), (1, 0, 0, 0)),
    "shell": (hollow_tets(), (1, 0, 1, 0)),
    "ring": (ring_tets(), (1, 1, 0, 0)),
}


def ranks(mesh, relative: bool) -> tuple[int, ...]:
    """Betti numbers by the ranks of dense matrices."""
    c = complex_of(mesh)
    free = [np.ones(count, dtype=bool) for count in c.counts]
    if relative:
        free[0], free[1] = ~c.boundary_vertex, ~c.boundary_edge
        free[c.dimension - 1][c.boundary_faces] = False
    matrices = [d.toarray()[free[k + 1]][:, free[k]] for k, d in enumerate(c.derivatives)]
    if not relative:
        matrices[0] = matrices[0][:, np.abs(matrices[0]).any(axis=0)]
    dimensions = [m.shape[1] for m in matrices] + [matrices[-1].shape[0]]
    rank = [0, *map(rank_of, matrices), 0]
    return tuple(int(dimensions[k] - rank[k] - rank[k + 1]) for k in range(len(dimensions)))


@pytest.mark.parametrize("name", MESHES)
def test_betti_numbers_are_the_ranks(name):
    mesh, expected = MESHES[name]
    betti = betti_numbers(mesh)
    assert betti.absolute == expected == ranks(mesh, relative=False)
    assert betti.relative == ranks(mesh, relative=True)


def test_the_simplices_of_a_solid_are_sorted_once_as_rows_are(monkeypatch):
    """Betti numbers sorted all of them in each of five calls: 2.5 s of `hodge --basis` for 0.9."""
    rng = np.random.default_rng(0)
    cells = rng.integers(0, 50, (300, 6, 3))
    rows, number = np.unique(np.sort(cells.reshape(-1, 3), axis=1), axis=0, return_inverse=True)
    far = cells * 10**6 + 7  # three of these do not fit into one number
    for corners, expected in ((cells, rows), (far, rows * 10**6 + 7)):
        distinct, number_of = tet_mesh._numbered(corners)
        assert np.array_equal(distinct, expected) and np.array_equal(number_of.ravel(), number.ravel())
    ball = jittered_tets()
    expected = betti_numbers(ball)
    monkeypatch.setattr(tet_mesh, "_numbered", None)
    monkeypatch.setattr(np, "sort", None)
    assert betti_numbers(ball) == expected


@pytest.mark.parametrize("boundary", ["tangential", "normal"])
@pytest.mark.parametrize("name", ["sphere", "torus", "two tori", "disk", "annulus", "shell", "ring"])
def test_cochains_are_closed_and_span_the_cohomology(name, boundary):
    mesh, _ = MESHES[name]
    c = complex_of(mesh)
    betti = betti_numbers(mesh)
    count = (betti.absolute if boundary == "tangential" else betti.relative)[1]
    solid = isinstance(mesh, TetMesh)
    forms = (solid_cochains(c, count, boundary) if solid else closed_cochains(mesh, boundary)).toarray()
    assert forms.shape == (c.counts[1], count)
    assert np.abs(c.derivatives[1] @ forms).max(initial=0) < (1e-10 if solid else 1e-300)
    if boundary == "normal":
        assert np.abs(forms[c.boundary_edge]).max(initial=0) == 0
    free = c.derivatives[0].toarray().astype(float)
    if boundary == "normal":
        free = free[:, ~c.boundary_vertex]
    both = np.concatenate([free, forms], axis=1)
    assert rank_of(both) == rank_of(free) + count


def rank_of(matrix):
    """0 for an empty matrix, which numpy before 2.3 refuses."""
    return int(np.linalg.matrix_rank(matrix)) if matrix.size else 0


def periods(mesh, loops, forms):
    """Matrix of the integrals of forms (e, b) along vertex loops, edge by edge."""
    number = {tuple(e): k for k, e in enumerate(complex_of(mesh).edges.tolist())}
    rows = []
    for loop in loops:
        total = np.zeros(forms.shape[1])
        for a, b in zip(loop, np.roll(loop, -1)):
            total += forms[number[a, b]] if (a, b) in number else -forms[number[b, a]]
        rows.append(total)
    return np.array(rows).reshape(len(loops), forms.shape[1])


@pytest.mark.parametrize("name", ["sphere", "torus", "two tori", "annulus"])
def test_generators_pair_with_cochains_by_a_unimodular_matrix(name):
    mesh, expected = MESHES[name]
    loops = generator_loops(mesh)
    assert len(loops) == expected[1]
    matrix = periods(mesh, loops, closed_cochains(mesh).toarray())
    if expected[1]:
        assert abs(np.linalg.det(matrix)) == pytest.approx(1.0)


def test_generator_of_a_solid_ring_goes_round_it():
    mesh = MESHES["ring"][0]
    (loop,) = solid_generator_loops(mesh)
    around = np.arctan2(*(mesh.points[loop][:, :2] - 0.5).T)
    turns = np.diff(np.unwrap(np.append(around, around[0])))
    assert abs(turns.sum()) == pytest.approx(2 * np.pi)
    assert solid_generator_loops(MESHES["ball"][0]) == []


@pytest.mark.parametrize(
    "name, genus, loops", [("boot.obj", 12, 0), ("plane_holes.obj", 0, 27), ("spot.obj", 0, 0)]
)
def test_betti_numbers_and_generators_of_real_surfaces_are_right(shared_meshes, name, genus, loops):
    mesh = read_mesh(str(shared_meshes / name)).mesh
    b1 = 2 * genus + max(loops - 1, 0)
    betti = betti_numbers(mesh)
    assert betti.absolute == (1, b1, int(loops == 0))
    cochains = closed_cochains(mesh)
    assert np.abs(complex_of(mesh).derivatives[1] @ cochains).max() == 0 if b1 else cochains.shape[1] == 0
    generators = generator_loops(mesh)
    assert len(generators) == b1
    if b1:
        matrix = periods(mesh, generators, cochains.toarray())
        assert abs(np.linalg.det(matrix)) == pytest.approx(1.0, rel=1e-6)


def rank_mod_2(matrix) -> int:
    """Rank over the field of two elements, column by column; without torsion the rank over the rationals."""
    matrix = matrix.tocsc()
    pivot: dict[int, set[int]] = {}
    for start, end in zip(matrix.indptr[:-1].tolist(), matrix.indptr[1:].tolist(), strict=True):
        column = set(matrix.indices[start:end].tolist())
        while column:
            lowest = max(column)
            if lowest not in pivot:
                pivot[lowest] = column
                break
            column = column ^ pivot[lowest]
    return len(pivot)


def shuffled(matrix):
    """Rows in random order: the chains of columns with two entries stay short."""
    return matrix.tocsr()[np.random.default_rng(0).permutation(matrix.shape[0])]


@pytest.mark.slow
@pytest.mark.parametrize("name", WITH_BETTI_NUMBERS)
def test_betti_numbers_of_every_shared_mesh_are_the_ranks(shared_meshes, name):
    mesh = read_mesh(str(shared_meshes / name)).mesh
    c = complex_of(mesh)
    # columns with few entries: an edge has two ends, a side of a cell at most two cells
    first, *between, last = c.derivatives
    ranks = [rank_mod_2(shuffled(first.T)), *(rank_mod_2(d.T) for d in between), rank_mod_2(shuffled(last))]
    counts = [len(np.unique(c.corners)), *c.counts[1:]]
    padded = [0, *ranks, 0]
    expected = tuple(counts[k] - padded[k] - padded[k + 1] for k in range(len(counts)))
    assert betti_numbers(mesh).absolute == expected


def three_torus(n: int = 3) -> TetMesh:
    """Periodic grid of n x n x n cubes in tetrahedra, at random points: it has no place in space."""
    cube = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    tets = []
    for order in permutations(range(3)):
        corners = np.cumsum([np.zeros(3, dtype=int), *np.eye(3, dtype=int)[list(order)]], axis=0)
        tets.append((cube[:, None] + corners) % n @ [n * n, n, 1])
    return TetMesh.from_arrays(np.random.default_rng(0).normal(size=(n**3, 3)), np.concatenate(tets))


def test_betti_numbers_of_tetrahedra_that_fold_over_each_other_have_a_warning(caplog):
    torus = three_torus()
    opened = TetMesh.from_arrays(torus.points, torus.tetrahedra[1:])
    assert ranks(opened, relative=False) == (1, 3, 3, 0)
    ddg.betti_numbers(opened)
    assert "both tetrahedra on one side (first: vertices" in caplog.text
    caplog.clear()
    for name in ("ball", "shell", "ring"):
        ddg.betti_numbers(MESHES[name][0])
    assert not caplog.text


def test_tetrahedra_without_boundary_are_refused_as_no_body_in_space():
    with pytest.raises(
        MeshError, match="the tetrahedra have no boundary, which is impossible for a body in space"
    ):
        ddg.betti_numbers(three_torus())
