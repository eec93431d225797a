"""The search for pairs that may meet: fewer searches, the same contact."""

import numpy as np
import pytest

from ddgcli.mesh.shapes import grid
from ddgcli.models.shell import pair_contact
from ddgcli.models.shell.near_pairs import REACH, NearPairs, largest_relative_move
from ddgcli.models.shell.pair_contact import PairBarrier, PairMesh
from tests.simulate import scalar, shell_run

ipctk = pytest.importorskip("ipctk")
GAP = 0.012

FALLING = """
[time]
duration = 0.12
step = 0.01
integrator = "implicit-euler"
[[object]]
name = "s"
role = "shell"
grid = { size = [0.4, 0.1], cells = [12, 3] }
density = 0.2
thickness = "2 mm"
young = 1e5
poisson = 0.3
position = [0, 0, 0.02]
[[object]]
name = "o"
role = "obstacle"
plane = { point = [0, 0, 0], normal = [0, 0, 1] }
[effects]
stretching = {}
bending = {}
gravity = {}
contact = { self_contact = true, pairs = [["s", "o"]] }
"""


def two_sheets(bend=0.02):
    """Two sheets, one over the other, that are near each other in places."""
    flat = grid(14, 14)
    points, n = np.asarray(flat.points), flat.n_vertices
    upper = points + [0.02, 0.013, 0.012]
    upper[:, 2] += bend * (1 + np.sin(5 * upper[:, 0]))
    x = np.concatenate([points, upper])
    edges = np.concatenate([flat.topology.edges, flat.topology.edges + n])
    faces = np.concatenate([flat.faces, flat.faces + n])
    mesh = PairMesh(np.arange(2 * n), x, edges, faces, [("a", 0, 0), ("b", n, flat.n_faces)])
    return PairBarrier(mesh, GAP, 1e3), x


def moved(x, rng, length):
    """Positions a given distance away, apart from a translation far from there."""
    move = rng.normal(size=x.shape)
    return x + length / largest_relative_move(move) * move + rng.normal(size=3)


def test_pairs_that_are_near_do_not_depend_on_where_they_were_searched():
    barrier, x = two_sheets()
    rng = np.random.default_rng(0)
    for _ in range(10):
        y = x + 1e-3 * rng.normal(size=x.shape)
        pairs = ipctk.NormalCollisions()
        pairs.use_area_weighting = True
        pairs.collision_set_type = ipctk.NormalCollisions.IMPROVED_MAX_APPROX
        whole, mesh = np.asfortranarray(y), barrier.mesh
        pairs.build(mesh.mesh, whole, GAP, 0.0, ipctk.LBVH())
        energy = barrier.potential(pairs, mesh.mesh, whole)
        gradient = barrier.potential.gradient(pairs, mesh.mesh, whole).reshape(-1, 3)
        assert energy > 0
        mesh._near = NearPairs(mesh.mesh, mesh.edges, mesh.faces, moved(y, rng, 0.999 * REACH * GAP), GAP)
        searched = mesh._near
        assert barrier.energy(y) == pytest.approx(energy, rel=1e-12)
        assert np.abs(barrier.gradient(y) - gradient).max() <= 1e-11 * np.abs(gradient).max()
        assert mesh._near is searched
        mesh._near = NearPairs(mesh.mesh, mesh.edges, mesh.faces, moved(y, rng, 1.001 * REACH * GAP), GAP)
        searched = mesh._near
        assert barrier.energy(y.copy()) == pytest.approx(energy, rel=1e-12)
        assert mesh._near is not searched  # too far from there


def test_a_short_move_ends_where_the_search_along_the_way_ends_it():
    barrier, x = two_sheets()
    n, mesh, rng = len(x) // 2, barrier.mesh, np.random.default_rng(1)
    shortened = 0
    for k in range(20):
        before = x.copy()
        before[n:, 2] -= 0.012 - 10.0 ** -(2 + k % 4)  # the sheets are that far apart at the least
        move = np.zeros_like(x)
        move[n:, 2] = -rng.uniform(0, 1.9 * REACH * GAP)
        move += 1e-4 * rng.normal(size=x.shape)
        if largest_relative_move(move) > REACH * GAP:
            continue
        before, after = np.asfortranarray(before), np.asfortranarray(before + move)
        candidates = ipctk.Candidates()
        candidates.build(mesh.mesh, before, after, GAP, ipctk.LBVH())
        ccd = ipctk.AdditiveCCD(conservative_rescaling=pair_contact.CCD_FRACTION)
        least = candidates.compute_collision_free_stepsize(mesh.mesh, before, after, 0.0, ccd)
        mesh.begin_step()
        assert mesh.collision_free_fraction(before, after, GAP) == least
        shortened += least < 1
    assert shortened >= 5


def test_pairs_that_cannot_meet_are_not_kept():
    barrier, x = two_sheets()
    mesh, n = barrier.mesh, len(x) // 2
    apart = x.copy()
    apart[n:, 2] += 4 * GAP
    assert len(NearPairs(mesh.mesh, mesh.edges, mesh.faces, np.asfortranarray(x), GAP).candidates)
    assert not len(NearPairs(mesh.mesh, mesh.edges, mesh.faces, np.asfortranarray(apart), GAP).candidates)
    candidates = ipctk.Candidates()
    candidates.build(mesh.mesh, np.asfortranarray(apart), 1.5 * GAP, ipctk.LBVH())
    assert len(candidates)  # neighbours within a sheet, which a search by boxes alone keeps


def test_a_falling_strip_searches_about_twice_a_step_not_at_each_move(monkeypatch):
    calls = {"search": 0, "value": 0, "step": 0}

    def counted(owner, name, kind):
        method = getattr(owner, name)

        def call(*arguments):
            calls[kind] += 1
            return method(*arguments)

        monkeypatch.setattr(owner, name, call)

    counted(NearPairs, "__init__", "search")
    counted(PairMesh, "near", "value")
    counted(PairMesh, "begin_step", "step")
    run, _, _ = shell_run(FALLING)
    assert scalar(run, "newton_iterations")[-1] > calls["step"] >= 12
    assert calls["search"] <= 2.5 * calls["step"]
    assert calls["value"] >= 2 * calls["search"]
