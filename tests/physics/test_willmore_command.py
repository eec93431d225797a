"""`willmore-flow` as users run it: summaries, refusals, resume, remedies."""

import json

import numpy as np
import pytest

from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from tests.physics.willmore_runs import bowl, ellipsoid


def follow_remedies(run, path, words, folder):
    """The summaries of a run and of those that its advice leads to."""
    summaries = []
    while len(summaries) < 4:
        result = run("willmore-flow", path, *words, "-o", folder / "end.vtu", "--json")
        summaries.append(json.loads(result.stdout))
        assert result.exit_code in (0, 1) and (folder / "end.vtu").exists()
        if result.exit_code == 0:
            return summaries
        advice = summaries[-1]["results"], summaries[-1]["warnings"][0]
        assert advice[0]["converged"] is False
        if f"delaunay {path} --refine 25 -o finer.npz" in advice[1]:
            assert run("delaunay", path, "--refine", 25, "-o", folder / "finer.npz").exit_code == 0
            path = folder / "finer.npz"
        else:
            assert "--energy cotan" in advice[1] and "cotan" not in words
            words = [*words, "--energy", "cotan"]
    return summaries


@pytest.mark.parametrize(
    "mesh, words",
    [
        (shapes.torus(40, 5, pattern="alternating"), []),
        (shapes.torus(60, 3, pattern="alternating"), []),
        (shapes.torus(40, 30, minor=0.9), []),
        (shapes.torus(20, 8, pattern="alternating"), ["--tolerance", 1e-3, "--duration", 0.1]),
    ],
    ids=["uneven", "three vertices around", "narrow hole", "crumpling"],
)
def test_every_remedy_that_is_printed_works(run, tmp_path, mesh, words):
    path = tmp_path / "ring.ply"
    write_mesh(str(path), AnnotatedMesh(mesh))
    summaries = follow_remedies(run, path, words, tmp_path)
    assert len(summaries) <= 3 and "converged" not in summaries[-1]["results"]
    assert not any("another surface" in warning for s in summaries for warning in s["warnings"])
    if not words:
        assert summaries[-1]["results"]["energy"][-1] == pytest.approx(2 * np.pi**2, rel=0.1)


def test_on_open_surfaces_the_default_is_cotan(summary, run, tmp_path):
    path = tmp_path / "bowl.ply"
    write_mesh(str(path), AnnotatedMesh(bowl()))
    for boundary in ("fixed", "clamped"):
        results = summary("willmore-flow", path, "--boundary", boundary, "--steps", 2)["results"]
        assert "mixed Voronoi" in results["energy_convention"] and min(results["energy"]) > 0
    refused = run("willmore-flow", path, "--boundary", "fixed", "--energy", "gauss-map")
    assert refused.exit_code == 2 and "--energy cotan" in refused.stderr
    assert run("willmore-flow", path, "--boundary", "fixed", "--energy", "cotan").exit_code == 0


def test_a_run_at_rest_stays_at_rest_after_resume(run, ellipsoid_file, tmp_path, monkeypatch):
    """Killed between its last frame and the renaming of its file, it started from the beginning."""
    from ddgcli.io.trajectories.trajectory import Trajectory
    from ddgcli.io.trajectories.writer import TrajectoryWriter

    out = tmp_path / "run.vtkhdf"
    close = TrajectoryWriter.close
    monkeypatch.setattr(TrajectoryWriter, "close", lambda self, status, *_: close(self, "running"))
    whole = json.loads(run("willmore-flow", ellipsoid_file, "-o", out, "--json").stdout)["results"]
    assert whole["stopped_because"] != "1000 steps were taken" and not out.exists()
    monkeypatch.setattr(TrajectoryWriter, "close", close)
    resumed = run("willmore-flow", ellipsoid_file, "--resume", f"{out}.part", "--json")
    assert resumed.exit_code == 0, resumed.stderr
    assert json.loads(resumed.stdout)["results"] == whole
    with Trajectory(str(out)) as trajectory:
        assert trajectory.n_frames == len(whole["energy"])


def test_time_options_state_their_unit(run):
    text = " ".join(run("willmore-flow", "--help").stdout.split())
    assert text.count("[length^4; mean-curvature: length^2]") == 3 and "[s]" not in text
    assert "[s]" in run("shell-sim", "--help").stdout


@pytest.fixture
def ellipsoid_file(tmp_path):
    path = tmp_path / "ellipsoid.ply"
    write_mesh(str(path), AnnotatedMesh(ellipsoid(3)))
    return path


def test_the_summary_of_a_relaxed_ellipsoid_is_that_of_a_sphere(summary, ellipsoid_file, tmp_path):
    out = summary("willmore-flow", ellipsoid_file, "-o", tmp_path / "end.ply", "--report-energy", "all")
    results, accuracy = out["results"], out["accuracy"]
    assert results["energy"][-1] == pytest.approx(4 * np.pi, rel=0.01)
    assert "H = (k1 + k2)/2" in results["energy_convention"]
    assert results["energies"]["cotan"]["end"] == pytest.approx(4 * np.pi, rel=0.01)
    assert accuracy["energy_increases"] == 0
    assert len(accuracy["min_angle_degrees"]) == len(results["energy"]) == results["steps"] + 1
    assert (tmp_path / "end.ply").exists()


def test_resume_has_the_same_bits(run, ellipsoid_file, tmp_path, monkeypatch):
    from ddgcli.io.trajectories.trajectory import Trajectory

    whole = tmp_path / "whole.vtkhdf"
    words = ("--steps", 6)
    assert run("willmore-flow", ellipsoid_file, *words, "-o", whole).exit_code == 0
    from ddgcli.models.willmore.flow import Flow

    calls, advance = [], Flow.advance

    def cut(self, state, time, dt):
        calls.append(time)
        if len(calls) == 4:
            raise KeyboardInterrupt
        return advance(self, state, time, dt)

    monkeypatch.setattr(Flow, "advance", cut)
    cut_run = tmp_path / "cut.vtkhdf"
    assert run("willmore-flow", ellipsoid_file, *words, "-o", cut_run).exit_code == 130
    monkeypatch.setattr(Flow, "advance", advance)
    resumed = run("willmore-flow", ellipsoid_file, *words, "--resume", f"{cut_run}.part")
    assert resumed.exit_code == 0, resumed.output + resumed.stderr
    with Trajectory(str(whole)) as a, Trajectory(str(cut_run)) as b:
        assert a.n_frames == b.n_frames == 7
        for k in range(7):
            assert np.array_equal(a.read_frame(k).points, b.read_frame(k).points)
            assert a.read_frame(k).time == b.read_frame(k).time


@pytest.mark.parametrize(
    "words, message",
    [
        (("--energy", "helfrich"), "sullivan"),
        (("--flow", "ricci"), "mean-curvature"),
        (("--boundary", "loose"), "clamped"),
        (("--region", "x"), "no array"),
        (("--integrator", "semi-implicit"), "--dt"),
        (("--integrator", "verlet", "--dt", "1e-3"), "rosenbrock or semi-implicit"),
        (("--integrator", "rosenbrock", "--flow", "mean-curvature"), "choose semi-implicit"),
        (("--flow", "mean-curvature", "--fix-area", "--fix-volume"), "quadratic"),
        (("--frame-every", "1"), "--dt"),
        (("--tolerance", "1e-3"), "--duration"),
    ],
)
def test_refusals_name_what_there_is(run, ellipsoid_file, words, message):
    result = run("willmore-flow", ellipsoid_file, *words, "--json")
    assert result.exit_code == 2 and result.stdout == ""
    assert message in result.stderr and len(result.stderr.strip().splitlines()) == 1
    assert result.stderr.startswith("Error: ")


def test_sphere_json_is_strict(run, tmp_path):
    path = tmp_path / "s.ply"
    write_mesh(str(path), AnnotatedMesh(shapes.icosphere(2)))
    result = run("willmore-flow", path, "--json", "--dt", "1e-3", "--steps", "3")
    summary = json.loads(result.stdout, parse_constant=lambda c: pytest.fail(c))
    assert result.exit_code == 0 and len(summary["results"]["energy"]) == 4


def test_a_flow_that_ends_before_rest_says_so_and_more_steps_lead_to_rest(run, ellipsoid_file, monkeypatch):
    from ddgcli.models.willmore import setup

    monkeypatch.setattr(setup, "MAX_STEPS", 4)
    early = run("willmore-flow", ellipsoid_file)
    assert early.exit_code == 0 and "not at rest after 4 steps" in early.stderr
    assert "--steps 20 leads further" in early.stderr
    same = run("willmore-flow", ellipsoid_file, "--steps", 4)
    assert same.exit_code == 0 and "not at rest" not in same.stderr
    later = run("willmore-flow", ellipsoid_file, "--steps", 20)
    assert later.exit_code == 0 and "not at rest" not in later.stderr
    assert "steps were taken" not in later.stdout
