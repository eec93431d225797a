"""Heat and wave equation in time: exact decay and oscillation of eigenfunctions, kept quantities, output."""

import json

import numpy as np
import pytest

import ddgcli as ddg
from ddgcli.algorithms.laplacian.evolution import evolve_function, solve_evolution
from ddgcli.algorithms.laplacian.evolution_times import EvolutionTimes
from ddgcli.algorithms.laplacian.laplace_operator import laplace_operator
from ddgcli.algorithms.laplacian.spectrum import spectrum
from ddgcli.errors import ParameterError, SolveError
from ddgcli.io.mesh_file import write_mesh
from ddgcli.io.trajectories.trajectory import Trajectory
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from tests.geodesic_cases import beside_a_sphere

OPERATOR = laplace_operator(shapes.icosphere(2))
PAIRS = spectrum(OPERATOR, 9)


def last(equation, start, duration, steps):
    evolution_frames = list(
        evolve_function(OPERATOR, equation, start, EvolutionTimes(duration, steps, steps))
    )
    return evolution_frames[-1]


def test_waves_of_an_eigenfunction_follow_the_exact_solution_with_order_two_in_the_step():
    value, mode = PAIRS.values[6], PAIRS.vectors[:, 6]
    expected = np.cos(np.sqrt(value) * 1.7) * mode
    errors = [np.abs(last("wave", mode, 1.7, steps).values - expected).max() for steps in (20, 40, 80)]
    assert np.log2(np.array(errors[:-1]) / errors[1:]).min() > 1.9
    assert errors[-1] < 1e-3 * np.abs(mode).max()


def exact(operator, equation, start, times):
    """Solutions at times by all eigenfunctions."""
    root = np.sqrt(operator.mass.diagonal())
    values, vectors = np.linalg.eigh(operator.stiffness.toarray() / np.outer(root, root))
    values[values < len(values) * np.finfo(float).eps * values[-1]] = 0.0  # long times multiply rounding
    rates = np.maximum(values, 0.0)
    decay = np.exp(-np.outer(times, rates)) if equation == "heat" else np.cos(np.outer(times, rates**0.5))
    return (decay * (vectors.T @ (root * start))) @ vectors.T / root


def relative_error(operator, equation, result):
    start = result.evolution_frames[0].values
    computed = np.array([evolution_frame.values for evolution_frame in result.evolution_frames])
    expected = exact(operator, equation, start, result.results["times"])
    return np.max(np.abs(computed - expected).max(axis=1) / np.abs(expected).max(axis=1))


@pytest.mark.parametrize(
    "times",
    [
        EvolutionTimes(1.0, 100, 2),
        EvolutionTimes(0.1, 1, 1),
        EvolutionTimes(1e-5, 3, 1),
        EvolutionTimes(2.0, 4000, 100),
        EvolutionTimes(1e3, 2, 1),
    ],
)
@pytest.mark.parametrize("start", ["vertex", "noise", "smooth"])
def test_heat_is_exact_in_time_from_the_first_frame_and_states_its_error(start, times):
    """From a vertex the first frame was wrong by a factor of 4, and one long step left -20."""
    mesh = shapes.random_sphere(600, 3)
    operator = laplace_operator(mesh)
    noise = np.random.default_rng(0).normal(size=600)
    solved = solve_evolution(
        operator, "heat", {"vertex": 5, "noise": noise}.get(start, mesh.points[:, 2]), times
    )
    error, estimate = relative_error(operator, "heat", solved), solved.accuracy["heat_time_error"]
    assert error < 1e-5 and error < 3 * estimate + 1e-9 and estimate < 1e-4
    low, high = solved.results["min"], solved.results["max"]
    assert min(low) > low[0] - 1e-6 * (high[0] - low[0]) and max(high) < high[0] + 1e-6 * (high[0] - low[0])
    if start == "vertex":  # nothing is negative on a Delaunay mesh
        assert (np.array(low) > -1e-6 * np.array(high)).all()


@pytest.mark.parametrize("phase", [0.3, 1.0, 2.0])
def test_a_wave_of_one_step_states_its_error(phase):
    """It stated none: there are no steps of twice the length."""
    frequency, mode = np.sqrt(PAIRS.values[6]), PAIRS.vectors[:, 6]
    solved = solve_evolution(OPERATOR, "wave", mode, EvolutionTimes(phase / frequency, 1, 1))
    error = np.abs(solved.evolution_frames[-1].values - np.cos(phase) * mode).max() / np.abs(mode).max()
    assert 0.4 < solved.accuracy["wave_time_error"] / error < 1.5


def test_heat_of_a_bounded_space_of_vectors_states_its_error(monkeypatch, caplog):
    monkeypatch.setattr("ddgcli.linalg.exponential.MAX_VECTORS", 6)
    solved = solve_evolution(OPERATOR, "heat", 5, EvolutionTimes(1.0, 100, 2))
    error, estimate = relative_error(OPERATOR, "heat", solved), solved.accuracy["heat_time_error"]
    assert 0.3 * error < estimate < 10 * error and error > 0.01
    assert any("errs by about" in message for message in caplog.messages)


@pytest.mark.parametrize("mesh", [shapes.icosphere(0), shapes.cylinder(3, 1), shapes.grid(1, 1)])
def test_heat_of_the_whole_space_is_exact_and_says_so(mesh):
    """The last vector was taken for the error: 0.09 where there is none."""
    operator = laplace_operator(mesh)
    solved = solve_evolution(operator, "heat", 0, EvolutionTimes(1.0, 100, 2))
    assert relative_error(operator, "heat", solved) < 1e-12
    assert solved.accuracy["heat_time_error"] == 0.0


@pytest.mark.parametrize("ratio", [1e-3, 1e-7])
def test_heat_of_a_small_component_beside_a_large_one_is_as_accurate_as_alone(ratio):
    mesh = shapes.icosphere(2)
    both, first, _ = beside_a_sphere(mesh, ratio)
    start = np.random.default_rng(0).normal(size=both.n_vertices)
    times = EvolutionTimes(0.3 * ratio**2, 50, 1)
    alone = solve_evolution(OPERATOR, "heat", start[first:], EvolutionTimes(0.3, 50, 1)).evolution_frames
    beside = solve_evolution(laplace_operator(both), "heat", start, times).evolution_frames
    for one, other in zip(alone, beside, strict=True):
        assert np.abs(one.values - other.values[first:]).max() < 1e-5 * np.abs(one.values).max()


@pytest.mark.parametrize("steps, start", [(40, "smooth"), (160, "smooth"), (400, "vertex")])
def test_waves_state_their_error_in_time(steps, start):
    points = shapes.icosphere(2).points
    solved = solve_evolution(
        OPERATOR, "wave", 5 if start == "vertex" else np.exp(points[:, 2]), EvolutionTimes(4.0, steps, 10)
    )
    error, estimate = relative_error(OPERATOR, "wave", solved), solved.accuracy["wave_time_error"]
    assert 0.5 * error < estimate < 2 * error


@pytest.mark.parametrize("duration", [5.0, 20.0, 40.0])
def test_default_steps_keep_the_phase_of_a_wave_at_long_durations(duration, caplog):
    """A hundredth of the duration, whatever the wave: the phase was off by 0.01 to 8 radians."""
    frequency, mode = np.sqrt(PAIRS.values[6]), PAIRS.vectors[:, 6]
    times = EvolutionTimes.of(duration, None, None)
    solved = solve_evolution(OPERATOR, "wave", 1.0 + mode, times)
    errors = [
        np.abs(evolution_frame.values - 1.0 - np.cos(frequency * evolution_frame.time) * mode).max()
        / np.abs(1.0 + mode).max()
        for evolution_frame in solved.evolution_frames
    ]
    assert max(errors) < 0.03 and not caplog.messages
    assert solved.results["steps"] <= 100 * (1 + np.sqrt((frequency * duration) ** 3 / 2400))
    assert np.allclose(solved.results["times"], duration * np.array(times.frame_steps) / times.steps)


def test_default_steps_of_a_wave_from_a_vertex_have_no_warning(caplog):
    solved = solve_evolution(OPERATOR, "wave", 5, EvolutionTimes.of(6.0, None, None))
    assert relative_error(OPERATOR, "wave", solved) < 0.05 and not caplog.messages


@pytest.mark.parametrize("value", [0.0, 1 / 3, -1e100])
def test_a_uniform_function_at_rest_takes_default_steps(value):
    solved = solve_evolution(OPERATOR, "wave", np.full(162, value), EvolutionTimes.of(9.0, None, None))
    assert solved.results["steps"] == 100 and solved.accuracy["wave_time_error"] < 1e-12


def test_steps_of_an_option_of_heat_and_of_waves_beyond_resolution_stay():
    mode = PAIRS.vectors[:, 6]
    for equation, times in (
        ("wave", EvolutionTimes.of(20.0, 0.2, None)),
        ("heat", EvolutionTimes.of(20.0, None, None)),
        ("wave", EvolutionTimes.of(1e5, None, None)),
    ):
        assert solve_evolution(OPERATOR, equation, mode, times).results["steps"] == 100


def test_the_error_of_a_standing_wave_is_relative_to_its_amplitude():
    """It was relative to the values of a frame, which are zero at a quarter of the period."""
    frequency, mode = np.sqrt(PAIRS.values[6]), PAIRS.vectors[:, 6]
    duration = 2.5 * np.pi / frequency
    solved = solve_evolution(OPERATOR, "wave", mode, EvolutionTimes(duration, 60, 60))
    error = np.abs(solved.evolution_frames[-1].values - np.cos(frequency * duration) * mode).max()
    assert 0.8 < solved.accuracy["wave_time_error"] / (error / np.abs(mode).max()) < 1.3


def test_waves_of_steps_too_long_for_them_have_a_warning(caplog):
    solved = solve_evolution(OPERATOR, "wave", 5, EvolutionTimes(6.0, 12, 1))
    assert solved.accuracy["wave_time_error"] > 0.2 and relative_error(OPERATOR, "wave", solved) > 0.2
    assert any("time_step" in message for message in caplog.messages)


def test_the_heat_equation_keeps_its_integral_and_ends_at_the_mean_even_in_one_huge_step():
    start = np.random.default_rng(0).normal(size=OPERATOR.stiffness.shape[0])
    result = solve_evolution(OPERATOR, "heat", start, EvolutionTimes(1e4, 2, 1))
    area = OPERATOR.mass @ np.ones(len(start))
    assert result.accuracy["total_drift"] < 1e-10 and result.accuracy["energy_increases"] == 0
    assert np.abs(result.evolution_frames[-1].values - (area @ start) / area.sum()).max() < 1e-4


@pytest.mark.parametrize("duration, steps", [(60.0, 300), (1e6, 40)])
def test_a_uniform_function_has_no_energy_and_its_rounding_is_no_increase(duration, steps):
    start = 1e3 + np.random.default_rng(2).normal(size=OPERATOR.stiffness.shape[0])
    solved = solve_evolution(OPERATOR, "heat", start, EvolutionTimes(duration, steps, 1))
    energy = solved.results["energy"]
    assert solved.accuracy["energy_increases"] == 0
    assert min(energy) >= 0 and energy[-1] < 1e-20 * energy[0]


def test_a_rise_of_the_energy_above_rounding_is_counted(monkeypatch):
    descending = list(evolve_function(OPERATOR, "heat", 1e3 + PAIRS.vectors[:, 6], EvolutionTimes(0.1, 9, 1)))
    name = "ddgcli.algorithms.laplacian.evolution.evolve_function"
    monkeypatch.setattr(name, lambda *_: iter(descending[::-1]))
    solved = solve_evolution(OPERATOR, "heat", descending[0].values, EvolutionTimes(0.1, 9, 1))
    assert solved.accuracy["energy_increases"] == 9


@pytest.mark.parametrize("duration", [1.0, 1e8, 1e13])
def test_heat_of_two_spheres_ends_at_the_mean_of_each_after_any_duration(duration):
    one = shapes.icosphere(1)
    n = one.n_vertices
    points = np.concatenate([one.points, 2 * one.points + [9, 0, 0]])
    operator = laplace_operator(TriangleMesh.from_arrays(points, np.concatenate([one.faces, one.faces + n])))
    start = np.random.default_rng(1).uniform(1, 2, 2 * n)
    solved = solve_evolution(operator, "heat", start, EvolutionTimes(duration, 100, 100))
    assert solved.accuracy["total_drift"] < 1e-13
    size, end = operator.mass @ np.ones(2 * n), solved.evolution_frames[-1].values
    for rows in (slice(0, n), slice(n, 2 * n)):
        mean = (size * start)[rows].sum() / size[rows].sum()
        assert abs((size * end)[rows].sum() / size[rows].sum() - mean) < 1e-13
        if duration > 1e3:
            assert np.abs(end[rows] - mean).max() < 1e-12


@pytest.mark.parametrize("equation", ["heat", "wave"])
def test_a_duration_of_another_unit_is_refused_with_one_that_runs(run, tmp_path, equation):
    path, mesh = tmp_path / "small.npz", shapes.icosphere(2, radius=1e-9)
    write_mesh(str(path), AnnotatedMesh(mesh))
    refused = run("laplacian", path, f"--{equation}", 0, "--duration", 1)
    assert refused.exit_code == 1 and "--duration" in refused.stderr
    longest = refused.stderr.split("give ")[1].split(" or less")[0]
    ended = run("laplacian", path, f"--{equation}", 0, "--duration", longest, "--json")
    assert ended.exit_code == 0, ended.stderr
    # no value exceeds the first peak, whose integral is the total: each of 100 steps rounds some ten times
    rounding = 10 * 100 * mesh.n_vertices * np.finfo(float).eps
    report = json.loads(ended.stdout)
    assert report["accuracy"]["total_drift"] < rounding
    # the default steps resolve a wave up to there; it was off by its amplitude
    assert equation == "heat" or report["accuracy"]["wave_time_error"] < 0.05
    assert not report["warnings"]


def test_the_wave_equation_keeps_energy_and_integral_and_runs_backwards():
    start = np.exp(-8 * (1 - shapes.icosphere(2).points[:, 2]))
    result = solve_evolution(OPERATOR, "wave", start, EvolutionTimes(6.0, 150, 15))
    assert result.accuracy["energy_drift"] < 1e-11 and result.accuracy["total_drift"] < 1e-11
    assert len(result.evolution_frames) == 11 and result.evolution_frames[-1].time == pytest.approx(6.0)
    # a wave from a pole meets at the other one after pi: the speed is 1
    pole = [
        evolution_frame.values[np.argmin(shapes.icosphere(2).points[:, 2])]
        for evolution_frame in result.evolution_frames
    ]
    assert abs(result.evolution_frames[int(np.argmax(np.abs(pole)))].time - np.pi) < 0.7


def test_a_vertex_starts_with_a_function_of_integral_one():
    result = solve_evolution(OPERATOR, "heat", 5, EvolutionTimes(0.01, 4, 2))
    assert result.results["total"] == pytest.approx([1.0] * 3)
    assert np.count_nonzero(result.evolution_frames[0].values) == 1


@pytest.mark.parametrize("equation", ["heat", "wave"])
def test_an_evolution_from_a_vertex_does_not_depend_on_the_size_of_other_components(equation):
    mesh, scale = shapes.icosphere(2), 2.0**-8
    both, first, _ = beside_a_sphere(mesh, scale)
    expected = solve_evolution(OPERATOR, equation, 5, EvolutionTimes(1.0, 20, 20)).evolution_frames
    times = EvolutionTimes(scale if equation == "wave" else scale**2, 20, 20)
    evolution = solve_evolution(laplace_operator(both), equation, first + 5, times).evolution_frames
    for alone, beside in zip(expected, evolution, strict=True):
        assert np.abs(scale**2 * beside.values[first:] - alone.values).max() < 1e-9 * alone.values.max()
        assert np.abs(scale**2 * beside.values[:first]).max() < 1e-9


@pytest.mark.parametrize(
    "step, n_frames, text",
    [
        (0.3, 4, "`time_step=0.3` does not divide the duration of 1: steps take 0.25"),
        (0.1, 7, "`n_frames=7` does not divide 10 steps: frames come every 2 steps, 5 of them"),
        (0.1, 1000, "`n_frames=1000` does not divide 10 steps: frames come each step, 10 of them"),
    ],
)
def test_a_step_and_frames_that_do_not_divide_are_stated(step, n_frames, text, caplog):
    EvolutionTimes.of(1.0, step, n_frames)
    assert caplog.messages == [text]


def test_a_step_and_frames_that_divide_have_no_warning(caplog):
    for step, n_frames in ((None, None), (0.1, 5), (0.1, None), (1 / 3, 3), (0.1, 4), (0.01, 1)):
        EvolutionTimes.of(1.0, step, n_frames)
    assert not caplog.messages


@pytest.mark.parametrize("equation", ["heat", "wave"])
def test_vertices_of_no_face_hold_zero_and_change_nothing(equation):
    mesh = shapes.icosphere(1)
    loose = TriangleMesh.from_arrays(np.vstack((np.full(3, 9.0), mesh.points)), mesh.faces + 1)
    times = EvolutionTimes(0.1, 4, 4)
    expected = solve_evolution(laplace_operator(mesh), equation, 5, times).evolution_frames[-1].values
    values = solve_evolution(laplace_operator(loose), equation, 6, times).evolution_frames[-1].values
    assert values[0] == 0.0 and np.abs(values[1:] - expected).max() < 1e-12


def test_evolutions_that_do_not_exist_are_refused():
    times = EvolutionTimes(1.0, 2, 1)
    with pytest.raises(ParameterError, match="shape"):
        solve_evolution(OPERATOR, "heat", np.zeros(3), times)
    with pytest.raises(ParameterError, match="not finite at vertex 1"):
        solve_evolution(OPERATOR, "wave", np.r_[0, np.nan, np.zeros(160)], times)
    with pytest.raises(ParameterError, match="vertex 999 is outside"):
        solve_evolution(OPERATOR, "heat", 999, times)
    with pytest.raises(ParameterError, match="not one of"):
        solve_evolution(OPERATOR, "diffusion", 0, times)
    with pytest.raises(ParameterError, match="steps are more than"):
        EvolutionTimes.of(1.0, 1e-9, None)
    with pytest.raises(ParameterError, match="2 is longer than the duration of 1; give 1 or less"):
        EvolutionTimes.of(1.0, 2.0, None)


@pytest.fixture
def sphere(tmp_path):
    mesh = shapes.icosphere(2)
    path = tmp_path / "sphere.vtu"
    write_mesh(str(path), AnnotatedMesh(mesh, vertex={"bump": np.exp(-8 * (1 - mesh.points[:, 2]))}))
    return path


def test_the_command_writes_all_frames_to_a_trajectory_and_the_last_to_a_mesh(sphere, summary, tmp_path):
    out, mesh = tmp_path / "wave.vtkhdf", tmp_path / "last.npz"
    words = ("--duration", 1.0, "--dt", 0.05, "--frames", 5)
    report = summary("laplacian", sphere, "--wave", "bump", *words, "-o", out, "-o", mesh)
    assert report["results"]["steps"] == 20 and len(report["results"]["times"]) == 6
    assert report["accuracy"]["energy_drift"] < 1e-12
    with Trajectory(str(out)) as trajectory:
        assert trajectory.n_frames == 6 and trajectory.times[-1] == pytest.approx(1.0)
        final = trajectory.vertex(5)
    arrays = np.load(mesh)
    assert np.array_equal(final["wave"], arrays["wave"]) and "wave_velocity" in arrays
    heat = summary("laplacian", sphere, "--heat", 3, "--duration", 0.1)
    assert heat["results"]["steps"] == 100 and heat["results"]["total"][-1] == pytest.approx(1.0)


@pytest.mark.parametrize(
    "words, text",
    [
        (("--heat", "bump"), "--heat: needs --duration"),
        (("--duration", 1), "--duration: belongs to --heat or --wave"),
        (("--dt", 1), "--dt: belongs to --heat or --wave"),
        (("--frames", 3), "--frames: belongs to --heat or --wave"),
        (("--heat", "bump", "--wave", "bump", "--duration", 1), "--heat: and --wave exclude"),
        (("--heat", "bump", "--duration", 1, "--eigen", 3), "--heat: is a run of its own"),
        (("--heat", "bump", "--duration", 1, "--matrix", "L.npz"), "--heat: is a run of its own"),
        (("--heat", "nothing", "--duration", 1), "--heat: no array 'nothing'"),
        (
            ("--heat", 3, "--duration", 1, "--dt", 2),
            "--dt: 2 is longer than the duration of 1; give 1 or less",
        ),
        (("--wave", 99999, "--duration", 1), "--wave: vertex 99999 is outside"),
    ],
)
def test_wrong_calls_of_an_evolution_end_in_one_line(sphere, run, words, text):
    result = run("laplacian", sphere, *words)
    assert result.exit_code == 2 and text in result.stderr and len(result.stderr.strip().split("\n")) == 1


@pytest.mark.parametrize("duration", [1e20, 1e300])
def test_a_wave_of_a_duration_beyond_rounding_is_refused_also_where_its_square_overflows(duration):
    mesh = shapes.icosphere(1)
    with pytest.raises(SolveError, match="too long for a mesh of this size"):
        ddg.wave_equation(mesh, 0, duration)
