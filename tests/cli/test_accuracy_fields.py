"""No field of `accuracy` is a constant: an error planted in what it watches moves it, in every command."""

import importlib
import json

import numpy as np
import pytest

from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from tests.planted_errors import (
    bent,
    bent_halfedge,
    bulged,
    crooked,
    crooked_turn,
    eigenvectors,
    first_wrong,
    heavy,
    lopsided,
    mixed,
    motion,
    returned,
    rougher,
    rougher_steps,
    scattered,
    spun,
    stepping,
    surface,
    unequal,
)

FLOW = ("willmore-flow", "ball", "--dt", 1e-4)
FALL = ("--effect", "stretching", "--effect", "gravity acceleration=[0,0,-9.81]")
SHELL = ("--material", "cotton", "--steps", 2, "--dt", 1e-4)
# runs: the summary's `accuracy` of each is what must be shown to move
RUNS = {
    "curvature": ("curvature", "ball"),
    "polyline": ("curvature", "ellipse"),
    "delaunay": ("delaunay", "ball"),
    "overlay": ("delaunay", "egg", "--overlay", "cut", "--transfer", "height"),
    "laplacian": ("laplacian", "cap", "--eigen", 3, "--poisson", "load"),
    "harmonic": ("laplacian", "cap", "--harmonic", "--fix", "1=0", "--fix", "20=1"),
    "flattened": ("laplacian", "cap", "--parameterize", "harmonic"),
    "conformal": ("laplacian", "cap", "--parameterize", "discrete-conformal"),
    "smoothed": ("laplacian", "cap", "--smooth", 1e-2, "--smooth-steps", 2),
    "exact": ("geodesic", "ball", "--source", 1, "--certify"),
    "slack": ("geodesic", "fine ball", "--source", 1, "--tolerance", 1.0),
    "heat": ("geodesic", "ball", "--source", 1, "--method", "heat"),
    "traced": ("geodesic", "ball", "--trace", "5:0.2,0.3,0.5:1,0,0.2:2.5", "--transport"),
    "path": ("geodesic", "ball", "--source", 1, "--path-to", 17),
    "straightened": ("geodesic", "ball", "--straighten", "3,50"),
    "followed": ("geodesic", "ball", "--field", "spin", "--field-time", 1),
    "steps": ("geodesic", "ball", "--field", "spin", "--field-time", 1, "--field-step", 0.1),
    "mapped": ("geodesic", "ball", "--source", 1, "--log-map"),
    "fast-marching map": ("geodesic", "fine ball", "--source", 1, "--log-map", "--method", "fast-marching"),
    "spread": ("geodesic", "ball", "--source", 1, "--spread-vector", "1,0,0"),
    "hodge": ("hodge", "cap", "--field", "wind"),
    "ring": ("hodge", "ring", "--field", "wind"),
    "shell": ("shell-sim", "cap", *FALL[:2], *SHELL),
    "falling": ("shell-sim", "cap", *FALL, *SHELL),
    "fluid": ("fluid-sim", "ball", "--vorticity", "3*z+x*y", "--steps", 3, "--dt", 0.01),
    "willmore": (*FLOW, "--steps", 2, "--fix-area", "--fix-volume"),
    "mean-curvature": (*FLOW, "--steps", 2, "--flow", "mean-curvature", "--energy", "cotan"),
    "tradeoff": ("tradeoff", "willmore-flow", "ball", "--steps", 2, "--tolerance", 0.1, "--repeat", 1),
}  # fmt: skip


SOLVE = ("ddgcli.linalg.factor:Factor.solve", returned(lambda x: scattered(x, 1e-3 * np.abs(x).max())))
FAINT = (SOLVE[0], returned(lambda x: scattered(x, 1e-6 * np.abs(x).max())))  # below what is refused
WILD = (SOLVE[0], returned(lambda x: scattered(x, np.abs(x).max())))
MEASURE = "ddgcli.algorithms.curvature.surface_curvature:identity_residuals"
HEAT = "ddgcli.algorithms.geodesics.heat:HeatSolver.distance"
EXACT_DISTANCE = "ddgcli.algorithms.geodesics.exact.exact_distance:exact_distance"
OPERATOR = "ddgcli.algorithms.laplacian.solve_tasks:laplace_operator"
TRACE_CHECKED = "ddgcli.algorithms.tracing.trace:Tracer.trace_checked"
HALFEDGE_POINTS = "ddgcli.algorithms.geodesics.halfedge_traces:_points_before_vertices"
STEP = "ddgcli.algorithms.tangent_fields.integral_curves:runge_kutta_step"
EVOLVE = "ddgcli.simulation.recording:evolve"
TRANSPORT_STEP = "ddgcli.models.fluid.conservative:runge_kutta"
SIDE_FLUX = "ddgcli.models.fluid.surface_space:SurfaceSpace.side_flux"
MEAN_STEP = "ddgcli.models.willmore.component_ends:mean_curvature_step"

GROWING = iter(np.linspace(1.0, 9.0, 99))

# run -> [(what is planted, fields that must move)]
PLANTS = {
    "curvature": [
        (MEASURE, surface(defect=first_wrong), ["gauss_bonnet_residual"]),
        (MEASURE, surface(area=first_wrong), ["vertex_area_residual"]),
        (MEASURE, surface(vector=first_wrong), ["force_balance_residual"]),
        (
            "ddgcli.geometry.extrinsic:angle_of",
            returned(first_wrong),
            ["torque_balance_residual", "area_balance_residual"],
        ),
    ],
    "delaunay": [
        (
            "ddgcli.algorithms.delaunay.intrinsic_delaunay:flip_to_delaunay",
            crooked(mesh=lambda m: type(m)(m.topology, 1.01 * first_wrong(m.side_length), m.points)),
            ["area_residual", "angle_defect_residual"],
        ),
    ],
    "overlay": [
        (
            "ddgcli.algorithms.delaunay.common_subdivision:common_subdivision",
            crooked(mesh=lambda m: m.moved(scattered(m.points))),
            ["overlay_area_residual"],
        ),
        (
            "ddgcli.algorithms.delaunay.intrinsic_delaunay:flip_to_delaunay",
            crooked(mesh=lambda m: type(m)(m.topology, 1.01 * m.side_length, m.points)),
            ["overlay_length_residual"],
        ),
        (*SOLVE, ["transfer_integral_residual"]),
    ],
    "laplacian": [
        (
            OPERATOR,
            crooked(stiffness=lopsided),
            ["symmetry_residual", "row_sum_residual", "negative_weights"],
        ),
        ("ddgcli.linalg.eigen:_with_residuals", eigenvectors, ["eigen_residuals"]),
        (OPERATOR, crooked(mass=heavy), ["poisson_imbalance"]),
        (*SOLVE, ["poisson_residual"]),
    ],
    "harmonic": [(*WILD, ["harmonic_residual", "maximum_principle_violation"])],
    "flattened": [(*SOLVE, ["parameterize_residual"])],
    "conformal": [
        (
            "ddgcli.algorithms.conformal.conformal_map:cone_metric",
            crooked(residual=lambda r: 1.0),
            ["angle_sum_residual"],
        ),
        (
            "ddgcli.algorithms.conformal.cone_metric:corner_angle",
            lambda sound: lambda length: 1.01 * sound(length),
            ["layout_residual"],
        ),
    ],
    "smoothed": [
        (*WILD, ["smooth_residual", "smooth_area_increases", "smooth_box_growth", "smooth_time_error"])
    ],
    "exact": [
        (
            EXACT_DISTANCE,
            crooked(distance=lambda d: 2.0 * d),
            ["violations_edge_distance", "violations_lipschitz", "lipschitz_excess", "certificate_excess"]
            + ["gradient_deviation"],
        ),
        (EXACT_DISTANCE, crooked(distance=lambda d: 0.5 * d), ["violations_straight_line"]),
        (EXACT_DISTANCE, crooked(distance=unequal), ["symmetry_residual"]),
        (EXACT_DISTANCE, crooked(distance=lambda d: d**3), ["triangle_residual"]),
    ],
    "slack": [
        ("ddgcli.algorithms.geodesics.exact.wavefront:Wavefront.run", rougher, ["tolerance_error_estimate"])
    ],
    "traced": [(TRACE_CHECKED, returned(bent), ["trace_angle_defect"])],
    "path": [
        (TRACE_CHECKED, returned(bent), ["path_length_residual"]),
        (EXACT_DISTANCE, crooked(distance=lambda d: 1.001 * d), ["path_length_residual"]),
    ],
    "straightened": [
        (
            "ddgcli.algorithms.geodesics.flipout:PathStraightener.straighten",
            lambda sound: lambda self: True,
            ["path_angle_deficit"],
        ),
        (HALFEDGE_POINTS, returned(bent_halfedge), ["path_angle_deficit"]),
    ],
    "followed": [(STEP, rougher_steps, ["field_error_estimate"])],
    "steps": [(STEP, rougher_steps, ["field_error_estimate"])],
    "mapped": [
        (EXACT_DISTANCE, crooked(departure=lambda d: d + 1e-8), ["log_map_miss"]),
        (EXACT_DISTANCE, crooked(departure=lambda d: d + 1e-3), ["log_map_miss"]),
    ],
    "fast-marching map": [
        (
            "ddgcli.algorithms.tangent_fields.polar_coordinates:_propagate_directions",
            returned(lambda unit: unit * np.exp(1j * np.linspace(0, 30, len(unit)))),
            ["log_map_skew"],
        ),
    ],
    "spread": [(*SOLVE, ["transport_residual"])],
    "polyline": [
        (
            "ddgcli.algorithms.curvature.polyline:_results",
            lambda sound: lambda arrays, *rest: sound(crooked_turn(arrays), *rest),
            ["turning_number_residual"],
        ),
    ],
    "hodge": [
        (*SOLVE, ["reconstruction_residual"]),
        (
            "ddgcli.algorithms.hodge.decomposition:_assembled",
            lambda sound: lambda inner, whole, *rest: sound(inner, whole, mixed(rest[0]), *rest[1:]),
            ["orthogonality"],
        ),
    ],
    "ring": [(*SOLVE, ["harmonic_residual"])],
    "heat": [
        (*FAINT, ["heat_residual", "poisson_residual"]),
        (HEAT, crooked(distance=lambda d: 3.0 * d), ["error_estimate"]),
    ],
    "shell": [(EVOLVE, stepping(motion), ["momentum_drift", "angular_momentum_drift", "max_strain"])],
    "falling": [(EVOLVE, stepping(motion), ["energy_drift", "energy_gain"])],
    "fluid": [
        (
            EVOLVE,
            stepping(spun),
            ["total_vorticity_drift", "energy_drift", "enstrophy_drift", "circulation_drift"],
        ),
        (SIDE_FLUX, returned(first_wrong), ["divergence_max"]),
        (TRANSPORT_STEP, returned(lambda after: (0.99 * after[0], *after[1:])), ["enstrophy_lost_by_scheme"]),
    ],
    "willmore": [(EVOLVE, stepping(bulged), ["constraint_residuals", "min_angle_degrees"])],
    "mean-curvature": [
        (
            MEAN_STEP,
            returned(lambda mesh: mesh.moved(scattered(1.1 * mesh.points))),
            ["area_increases", "energy_increases"],
        ),
    ],
    "tradeoff": [
        (
            "ddgcli.tradeoff.problems.willmore_flow:_answer",
            returned(lambda answer: answer * next(GROWING)),
            ["reference_uncertainty"],
        ),
    ],
}  # fmt: skip

# fields that count how much was looked at, or flags beside a number that is planted above
COUNTS = {"sampled_pairs", "eigen_complete"}


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fields")
    ball = shapes.random_sphere(60)
    cap = shapes.grid(5, 5, pattern="alternating")
    cap = cap.moved(cap.points + np.stack([0 * cap.points[:, 0]] * 2 + [cap.points[:, 0] ** 2], axis=1))
    wind = np.cross(cap.points[cap.faces].mean(axis=1), [0.3, 0.2, 1.0])
    paths = {name: str(folder / f"{name}.npz") for name in ("ball", "cap", "egg", "cut")}
    spin = np.cross([0.0, 0.0, 1.0], ball.points)
    write_mesh(paths["ball"], AnnotatedMesh(ball, vertex={"spin": spin}))
    write_mesh(
        paths["egg"],
        AnnotatedMesh(ball.moved(ball.points * [5, 1, 0.2]), vertex={"height": ball.points[:, 2]}),
    )
    paths["fine ball"] = str(folder / "fine.npz")
    write_mesh(paths["fine ball"], AnnotatedMesh(shapes.random_sphere(4000)))
    load = cap.points[:, 0] - cap.points[:, 0].mean()
    write_mesh(paths["cap"], AnnotatedMesh(cap, vertex={"load": load}, face={"wind": wind}))
    ring = shapes.torus(12, 6, 2.0, 1.0)
    around = np.cross([0.0, 0.0, 1.0], ring.points[ring.faces].mean(axis=1))
    paths["ring"] = str(folder / "ring.npz")
    write_mesh(paths["ring"], AnnotatedMesh(ring, face={"wind": around}))
    turn = np.linspace(0, 2 * np.pi, 25)
    np.savetxt(folder / "ellipse.csv", np.stack([2 * np.cos(turn), np.sin(turn)], axis=1), delimiter=",")
    return paths | {"ellipse": str(folder / "ellipse.csv")}


@pytest.fixture(scope="module")
def sound_accuracy(inputs):
    cache = {}

    def call(summary, name):
        if name not in cache:
            cache[name] = accuracy_of(summary, inputs, name)
        return cache[name]

    return call


@pytest.fixture(autouse=True)
def short_references(monkeypatch):
    monkeypatch.setattr("ddgcli.tradeoff.problems.willmore_flow.REFERENCE_STEPS", (16,))


def accuracy_of(summary, inputs, name):
    return summary(*[inputs.get(word, word) for word in RUNS[name]])["accuracy"]


def test_every_field_has_its_plant(summary, sound_accuracy):
    for name in RUNS:
        planted = {field for *_, fields in PLANTS[name] for field in fields}
        assert set(sound_accuracy(summary, name)) - planted - shared(name) <= COUNTS, name


def shared(name):
    """Fields that another run of the same command plants."""
    command = RUNS[name][0]
    others = [n for n, words in RUNS.items() if words[0] == command and n != name]
    return {field for other in others for *_, fields in PLANTS[other] for field in fields}


@pytest.mark.parametrize("name, plant", [(n, p) for n, plants in PLANTS.items() for p in plants])
def test_a_planted_error_moves_the_field(name, plant, summary, inputs, sound_accuracy, monkeypatch, run):
    where, make, fields = plant
    before = sound_accuracy(summary, name)
    module, _, attribute = where.partition(":")
    owner = importlib.import_module(module)
    *classes, function = attribute.split(".")
    for mesh_class in classes:
        owner = getattr(owner, mesh_class)
    monkeypatch.setattr(owner, function, make(getattr(owner, function)))
    result = run(*[inputs.get(word, word) for word in RUNS[name]], "--json")
    assert result.exit_code in (0, 1), result.output + result.stderr

    after = json.loads(result.stdout)["accuracy"]
    assert [f for f in fields if size(after[f]) <= 2 * size(before[f]) + 1e-9] == []


def size(value):
    """How large a field is: the largest of its numbers; a smallest angle counts by how far it is from 60."""
    if isinstance(value, dict):
        return max((size(v) for v in value.values()), default=0.0)
    if isinstance(value, list):
        return max((size(v) for v in value), default=0.0)
    return abs(float(value or 0.0))
