"""Shells that pass through themselves or each other are reported, with the contact that prevents it."""

import logging

import numpy as np
import pytest

import ddgcli as ddg
from tests.triangle_pairs import meshes_intersect

WORDS = "pass through"


def square(name, **place):
    grid = {"size": [0.2, 0.2], "cells": [4, 4]}
    solid = {"density": 1.0, "thickness": 2e-3, "young": 1e6, "poisson": 0.3}
    return {"name": name, "role": "shell", "grid": grid, **solid, **place}


def scene(*objects, duration, **effects):
    time = {"duration": duration, "step": 5e-3, "integrator": "implicit-euler"}
    return {"time": time, "object": list(objects), "effects": {"stretching": {}, "bending": {}, **effects}}


def standing_strip(self_contact):
    """A limp strip that falls from upright on a floor, and on itself."""
    strip = {"name": "cloth", "role": "shell", "material": "silk"}
    strip["grid"] = {"size": [0.08, 0.4], "cells": [1, 12]}
    strip |= {"rotation": {"axis": [1, 0, 0], "degrees": 85}, "position": [0, 0, 0.01]}
    floor = {"name": "floor", "role": "obstacle", "plane": {"point": [0, 0, 0], "normal": [0, 0, 1]}}
    contact = {"pairs": [["cloth", "floor"]], "gap": 2e-3, **self_contact}
    return scene(strip, floor, duration=0.25, gravity={}, contact=contact, damping={"mass": 1})


def two_sheets(**effects):
    """A sheet that falls through another one, which is held at its boundary."""
    upper = square("upper", position=[0.013, 0.007, 0.02], rotation={"axis": [1, 2, 0], "degrees": 6})
    border = {"object": "lower", "vertices": [0, 4, 20, 24]}
    return scene(square("lower"), upper, duration=0.075, gravity={}, pin=border, **effects)


def end_of(document, caplog):
    with caplog.at_level(logging.WARNING, "ddgcli"):
        end = ddg.simulate(document).finish()
    lines = [record.getMessage() for record in caplog.records if WORDS in record.getMessage()]
    caplog.clear()
    return end, lines


def test_a_cloth_that_falls_on_itself_is_reported_and_self_contact_is_the_remedy(caplog):
    pytest.importorskip("ipctk")
    for contact in ({}, {"self_contact": ["cloth"]}):
        end, lines = end_of(standing_strip(contact), caplog)
        points, faces = np.asarray(end.mesh.points), np.asarray(end.mesh.faces)
        crossing = meshes_intersect(points, faces, points, faces)
        assert bool(crossing) == bool(lines) == (not contact)
        if lines:
            count = end.results["self_intersections"]
            assert f"cloth with itself {count} (0)" in lines[0] and count > 0
            assert 'add to contact: self_contact = ["cloth"]' in lines[0]
        else:
            assert "self_intersections" not in end.results


def test_shells_that_fall_through_each_other_are_reported_and_a_pair_is_the_remedy(caplog):
    pytest.importorskip("ipctk")
    for contact in ({}, {"contact": {"pairs": [["lower", "upper"]]}}):
        end, lines = end_of(two_sheets(**contact), caplog)
        points, faces = np.asarray(end.mesh.points), np.asarray(end.mesh.faces)
        crossing = meshes_intersect(points, faces[:32], points, faces[32:])
        assert bool(crossing) == bool(lines) == (not contact)
        if lines:
            assert f"lower with upper {end.results['self_intersections']} (0)" in lines[0]
            assert 'write contact = { pairs = [["lower", "upper"]] }' in lines[0]


def test_what_crosses_from_the_start_and_stays_is_counted_without_a_warning(caplog):
    across = square("b", position=[0.05, 0.03, -0.04], rotation={"axis": [1, 0, 0], "degrees": 40})
    end, lines = end_of(scene(square("a"), across, duration=0.02, gravity={}), caplog)
    assert end.results["self_intersections"] > 0
    assert not lines


def test_shells_that_touch_and_fall_together_do_not_cross_by_rounding(caplog):
    standing = square("b", position=[0.093, 0, 0], rotation={"axis": [0, 1, 0], "degrees": -77})
    end, lines = end_of(scene(square("a"), standing, duration=0.1, gravity={}), caplog)
    assert end.results["self_intersections"] == 0
    assert not lines


def test_a_seam_of_ties_is_no_crossing_and_faces_away_from_it_are(caplog):
    half = square("right", position=[0.2, 0, 0])
    seam = [4, 9, 14, 19, 24]
    attach = {"object": "left", "to": "right", "vertices": seam, "to_vertices": [0, 5, 10, 15, 20]}
    pin = [{"object": "left", "vertices": [0, 20]}, {"object": "right", "vertices": [4, 24]}]
    seam_scene = scene(square("left"), half, duration=0.1, gravity={}, pin=pin, attach=attach)
    assert end_of(seam_scene, caplog)[1] == []
    sheets = two_sheets(attach={"object": "upper", "to": "lower", "vertices": [0]})
    assert len(end_of(sheets, caplog)[1]) == 1


def test_where_too_many_faces_lie_side_by_side_a_warning_states_that(monkeypatch, caplog):
    from ddgcli.geometry import intersections

    monkeypatch.setattr(intersections, "RUN_PAIRS_PER_FACE", 1e-3)
    with caplog.at_level(logging.WARNING, "ddgcli"):
        end = ddg.simulate(two_sheets()).finish()
    assert end.results["self_intersections"] is None
    assert "whether shells cross is unknown" in caplog.text


def test_equilibria_and_modes_are_not_checked():
    document = two_sheets()
    assert "self_intersections" not in ddg.simulate(document, modes=1).finish().results
    document["time"] = {"integrator": "static"}
    document["effects"]["pin"] = [{"object": name, "vertices": [0, 4, 20]} for name in ("lower", "upper")]
    assert "self_intersections" not in ddg.simulate(document).finish().results
