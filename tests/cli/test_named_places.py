"""Messages name the file, the section and the times that a user wrote."""

import pytest

import ddgcli as ddg
from ddgcli.errors import SceneError
from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh


def test_the_file_that_is_missing_is_named_not_the_one_before(run, tmp_path):
    ball = tmp_path / "ball.ply"
    write_mesh(str(ball), AnnotatedMesh(shapes.icosphere(1)))
    result = run("view", ball, "nofile.vtu", "-o", tmp_path / "v.html")
    assert result.exit_code == 2 and result.stderr.startswith("Error: nofile.vtu: no such file")


@pytest.mark.parametrize(
    "shape", [{"grid": {"size": [2, 1], "cells": [4, 2]}}, {"box": {"cells": [2, 2, 2]}}]
)
@pytest.mark.parametrize(
    "wall", [{"kind": "no-slip"}, {"kind": "free-slip"}, {"kind": "wall", "velocity": [1, 0, 0]}]
)
def test_a_wall_that_lies_nowhere_is_refused(shape, wall):
    """Once the whole boundary became one without slip."""
    effects = {"boundary": [{**wall, "where": "x > 3"}], "viscosity": {"nu": 0.1}}
    scene = {
        "time": {"duration": 0.1, "step": 0.1},
        "object": [{"role": "fluid", **shape}],
        "effects": effects,
    }
    with pytest.raises(SceneError, match=f"{wall['kind']}: no boundary (side|face) lies where 'x > 3' holds"):
        ddg.simulate(scene).finish()


def test_frames_at_other_times_are_reported(caplog):
    curve = ddg.CurveSet.from_arrays(
        [[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]], [[0, 1], [1, 2], [2, 3], [3, 0]]
    )
    ddg.curve_flow(curve, duration=0.06, step=0.01, frame_every=0.015).finish()
    assert "frame_every 0.015 is not a whole number of steps of 0.01: frames come every 0.02" in caplog.text
    caplog.clear()
    shell = {"role": "shell", "grid": {"size": [1, 1], "cells": [1, 1]}, "material": "felt"}
    time = {"duration": 0.2, "frame_every": 0.15, "tolerance": 1e-2}
    run = ddg.simulate({"time": time, "object": [shell], "effects": {"gravity": {}}})
    assert [round(shot.time, 9) for shot in run] == [0.0, 0.1, 0.2]
    assert "frame_every 0.15 s does not divide the duration of 0.2 s: frames come every 0.1 s" in caplog.text
    caplog.clear()
    time["frame_every"] = 0.1
    list(ddg.simulate({"time": time, "object": [shell], "effects": {"gravity": {}}}))
    assert "frame_every" not in caplog.text


@pytest.mark.parametrize(
    "velocity, message",
    [([0, 0, 1], "points out of the surface"), ([1, 0, 0], "a gradient"), (["x", "y", 0], "a gradient")],
)
def test_a_velocity_that_no_flow_has_is_reported_once(velocity, message, caplog):
    """Once a normal one was dropped without a word, and the rounding of a gradient was called unresolved."""
    scene = {
        "time": {"duration": 0.2, "step": 0.1},
        "object": [{"role": "fluid", "grid": {"size": [1, 1], "cells": [8, 8]}}],
        "effects": {"initial": {"velocity": velocity}},
    }
    ddg.simulate(scene).finish()
    assert message in caplog.text and len(caplog.records) == 1
