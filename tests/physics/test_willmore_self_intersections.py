"""Flows that pass through themselves are reported: a flat spheroid grows round over a small ball above it."""

import logging

import numpy as np
import pytest

import ddgcli as ddg
from ddgcli.models.willmore.self_intersections import STEPS_PER_CHECK
from tests.triangle_pairs import meshes_intersect

BALL = 0.1  # radius of the small ball
WORDS = "passes through itself"


def spheroid_and_ball(height):
    """A flat spheroid about the origin, and a small ball at a height above it."""
    large, small = ddg.icosphere(2), ddg.icosphere(1)
    points = np.concatenate([large.points * [1, 1, 0.3], BALL * small.points + [0, 0, height]])
    return ddg.TriangleMesh.from_arrays(points, np.concatenate([large.faces, small.faces + 162]))


def end_of(flow):
    """The end of a flow, the radius of its large sphere, and whether its two spheres cross."""
    end = flow.finish()
    points, faces = np.asarray(end.mesh.points), np.asarray(end.mesh.faces)
    large = faces.max(axis=1) < 162
    radius = np.linalg.norm(points[:162], axis=1).mean()
    return end, radius, meshes_intersect(points, faces[large], points, faces[~large])


@pytest.mark.parametrize(("height", "crosses"), [(0.84, True), (1.1, False)])
def test_a_sphere_that_grows_into_a_ball_crosses_it_at_the_end(height, crosses, caplog):
    with caplog.at_level(logging.WARNING, "ddgcli"):
        end, radius, cross = end_of(ddg.willmore_flow(spheroid_and_ball(height)))
    assert (abs(radius - height) < BALL) == crosses == cross  # a circle in common, by the radii and by faces
    counts = end.results["self_intersections"]
    assert counts["start"] == 0
    assert (counts["end"] > 0) == crosses
    assert (WORDS in caplog.text) == crosses
    assert "seen at time" not in caplog.text  # steps to rest have no time
    if crosses:
        first = int(caplog.text.split("first seen at step ")[1].split(")")[0])
        assert 0 < first <= end.results["steps"]


def test_a_ball_that_is_swallowed_crosses_on_the_way_alone_and_the_time_is_named(caplog):
    step = 1.2e-3
    with caplog.at_level(logging.WARNING, "ddgcli"):
        end, radius, cross = end_of(ddg.willmore_flow(spheroid_and_ball(0.45), duration=0.072, step=step))
    assert radius > 0.45 + BALL and not cross
    counts = end.results["self_intersections"]
    assert counts["start"] == counts["end"] == 0 < counts["most"]
    first = float(caplog.text.split("first seen at time ")[1].split(")")[0])
    steps = first / step
    assert abs(steps - round(steps)) < 1e-6 and 0 < round(steps) <= 60
    assert round(steps) % STEPS_PER_CHECK == 0


def test_an_input_that_crosses_itself_and_stays_is_counted_without_a_warning(caplog):
    ball = ddg.icosphere(2)
    points = np.concatenate([ball.points, ball.points + [0.9, 0.3, 0.1]])
    both = ddg.TriangleMesh.from_arrays(points, np.concatenate([ball.faces, ball.faces + ball.n_vertices]))
    with caplog.at_level(logging.WARNING, "ddgcli"):
        counts = ddg.willmore_flow(both).finish().results["self_intersections"]
    assert counts["start"] > 0
    assert counts["most"] == counts["start"]
    assert WORDS not in caplog.text


def test_where_too_many_faces_lie_side_by_side_the_number_is_unknown(monkeypatch):
    from ddgcli.geometry import intersections

    monkeypatch.setattr(intersections, "RUN_PAIRS_PER_FACE", 1e-3)
    counts = ddg.willmore_flow(ddg.icosphere(2), steps=12).finish().results["self_intersections"]
    assert counts == {"start": None, "end": None, "most": None}
