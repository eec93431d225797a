"""Arguments of the library: every kind of number and array that numpy has, or one of our own errors."""

import inspect
from fractions import Fraction

import numpy as np
import pytest

import ddgcli as ddg
from ddgcli.library.arguments import CONVERSIONS, checked_arguments

SQUARE = ddg.grid(3, 3)
X = SQUARE.points[:, 0]
WRONG = {
    "float": (None, "1", 1j, [1.0], float("nan"), 10**400, np.ones(3), {}),
    "int": (None, "1", 1.0, 1.5, [1], np.ones(3), {}, 2**63, np.uint64(2**63)),
    "bool": (None, "yes", 2, [True], np.ones(3)),
    "str": (None, 1, b"x", ["x"], np.ones(3), SQUARE),
    "ArrayLike": ("x", None, [[1, 2], [3]], [1j], {}, ["1"], [None], np.ma.array([1, 2], mask=[0, 1])),
    "Sequence[Sequence[int]]": (1, "ab", None, {0: 1}, ["ab"]),
    "Mapping[int, float]": (1, None, [0.0], {"a": 1.0}, {0.5: 1.0}, {0: "x"}, {0: [1, 2]}, {0: np.nan}),
}
WRONG |= dict.fromkeys(("Path", "str | os.PathLike[str]"), (None, 1, b"x", ["x"], {}, SQUARE))
WRONG["str | os.PathLike[str] | Mapping[str, Any]"] = (None, 1, b"x", ["x"], {1: 2}, SQUARE)
WRONG["Mapping[str, ArrayLike]"] = (None, 1, "x", [1.0], {1: [2.0]}, SQUARE)
WRONG["float | str"] = tuple(value for value in WRONG["float"] if not isinstance(value, str))
WRONG["int | str"] = tuple(value for value in WRONG["int"] if not isinstance(value, str))
named = tuple(value for value in WRONG["ArrayLike"] if not isinstance(value, str))
WRONG |= {"str | ArrayLike": named, "str | tuple[float, float]": (*named, 1.0, [1.0, np.inf])}
WRONG |= dict.fromkeys(set(CONVERSIONS) - set(WRONG), WRONG["ArrayLike"])


@pytest.mark.parametrize("annotation", CONVERSIONS)
def test_values_of_other_types_are_refused_in_one_line(annotation):
    def function(x):
        return x

    function.__annotations__ = {"x": annotation}
    for value in WRONG[annotation]:
        with pytest.raises(ddg.errors.ParameterError) as refusal:
            checked_arguments(function)(value)
        message = str(refusal.value)
        assert "x" in message and "\n" not in message and len(message) < 200


def annotations_of(name):
    return {
        p.annotation.removesuffix(" | None")
        for p in inspect.signature(getattr(ddg, name)).parameters.values()
    }


def test_every_parameter_of_a_number_or_an_array_has_a_check():
    # the last three: two with a text as default, and the ball of `curvature_measures`
    known = {*CONVERSIONS, "Boundary", "Star", "tuple[ArrayLike, float]"}
    others = set()
    for name in set(ddg.__all__) - {"__version__", "errors"}:
        if inspect.isfunction(getattr(ddg, name)):
            others |= {a for a in annotations_of(name) - known if not a.startswith("Literal")}
    assert not [a for a in others if "int" in a.split(" | ") or "float" in a or a.startswith("ArrayLike")]


@pytest.mark.parametrize(
    "call",
    [
        lambda: ddg.heat_equation(SQUARE, X, "soon"),
        lambda: ddg.heat_equation(SQUARE, X, 1.0, time_step=0),
        lambda: ddg.heat_equation(SQUARE, X, float("inf")),
        lambda: ddg.wave_equation(SQUARE, X, 1.0, time_step=1e-300),
        lambda: ddg.curvature_measures(SQUARE, ball=3),
        lambda: ddg.stiffness((SQUARE.points * 1j, SQUARE.faces)),
        lambda: ddg.stiffness((SQUARE.points.astype(str), SQUARE.faces)),
        lambda: ddg.HeatSolver(SQUARE, heat_time=[1, 2]),
        lambda: ddg.geodesic_distance(SQUARE, 0, tolerance=10**400),
        lambda: ddg.DistanceSolver(SQUARE).distance("0"),
        lambda: ddg.icosphere(2.0),
        lambda: ddg.simulate({}, duration="1"),
        lambda: ddg.curve_flow(ddg.CurveSet.from_arrays([[0, 0], [1, 0]], [[0, 1]]), steps=0),
        lambda: ddg.conformal_map(SQUARE, [0.1]),
        lambda: ddg.parallel_transport(SQUARE, [0], [1.0, 0.0]),
        lambda: ddg.hodge_decomposition(SQUARE, 1.0),
        lambda: ddg.integral_curves(SQUARE, 1.0, [5]),
        lambda: ddg.straighten_paths(SQUARE, np.array(3)),
        lambda: ddg.sharp(SQUARE, X),
        lambda: ddg.flat(SQUARE, X),
        lambda: ddg.wedge(SQUARE, X[:3], X),
        lambda: ddg.interior_product(SQUARE, [[1, 0, 0]] * 18, X),
        lambda: ddg.eigenforms(SQUARE, 1000),
        lambda: ddg.delaunay_refinement(SQUARE, 25.0, max_points=-1),
        lambda: ddg.delaunay_refinement(SQUARE, seed=-1),
        lambda: ddg.simulate(None),
        lambda: ddg.simulate({1: 2}),
        lambda: ddg.read_mesh(b""),
        lambda: ddg.read_mesh("a.ply", 1),
        lambda: ddg.read_trajectory(None),
        lambda: ddg.write_mesh(None, SQUARE),
        lambda: ddg.write_mesh("a.ply", SQUARE, vertex=X),
        lambda: ddg.write_mesh("a.ply", SQUARE, vertex={"x": np.ma.masked_greater(X, 0.5)}),
        lambda: ddg.write_picture(None, SQUARE),
        lambda: ddg.trace(SQUARE, 1.5, [0.4, 0.3, 0.3], [1, 0, 0], 0.1),
        lambda: ddg.geodesic_distance(SQUARE, np.uint64(2**63)),
        lambda: ddg.curvature_measures(SQUARE, [1e30] * 18),
        lambda: ddg.straighten_paths(SQUARE, np.array("x")),
        lambda: ddg.as_mesh((np.ma.masked_greater(SQUARE.points, 0.9), SQUARE.faces)),
        lambda: ddg.as_mesh((SQUARE.points, np.ma.masked_greater(SQUARE.faces, 14))),
        lambda: ddg.grid(0, 3),
        lambda: ddg.grid(pattern="x"),
        lambda: ddg.grid(10**7, 10**7),
        lambda: ddg.icosphere(-1),
        lambda: ddg.icosphere(40),
    ],
)
def test_wrong_calls_end_in_errors_of_the_library(call):
    with pytest.raises(ddg.errors.InputError):
        call()


@pytest.mark.parametrize("one", [1, 1.0, np.float32(1), np.int8(1), np.array(1), np.array(1.0), Fraction(1)])
def test_any_number_is_a_number(one):
    flow = ddg.heat_equation(SQUARE, X, one, n_frames=2)
    np.testing.assert_array_equal(
        flow.evolution_frames[-1].values,
        ddg.heat_equation(SQUARE, X, 1.0, n_frames=2).evolution_frames[-1].values,
    )


@pytest.mark.parametrize("vertex", [3, np.uint8(3), np.array(3)])
def test_a_heat_source_may_be_a_vertex(vertex):
    start = ddg.heat_equation(SQUARE, vertex, 1.0).evolution_frames[0].values
    assert np.flatnonzero(start).tolist() == [3]


TETRAHEDRON = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])


@pytest.mark.parametrize("cells", [[[0, 1, 2], [0, 2, 3]], [[0, 1, 2, 3]], [[0, 1], [1, 2]]])
def test_arrays_of_the_caller_stay_writeable_and_are_not_those_of_the_mesh(cells):
    points, corners = TETRAHEDRON.copy(), np.array(cells)
    mesh = ddg.as_mesh((points, corners))
    points[:], corners[:] = 7.0, 0
    np.testing.assert_array_equal(mesh.points, TETRAHEDRON)
    assert not mesh.points.flags.writeable


def test_corners_of_tetrahedra_are_integers():
    with pytest.raises(ddg.errors.MeshError, match="must be whole numbers"):
        ddg.TetMesh.from_arrays(TETRAHEDRON, [[0.0, 1.0, 2.0, 3.5]])


def test_keys_of_fixed_values_may_be_floats_that_are_whole():
    expected = ddg.harmonic_interpolation(SQUARE, {0: 1.0, 5: 0.0}).values
    for cast in (float, np.float32, np.int16):
        fixed = {cast(0): 1.0, cast(5): 0.0}
        assert np.array_equal(ddg.harmonic_interpolation(SQUARE, fixed).values, expected)
    for key in (0.5, float("nan"), float("inf"), "0", True):
        with pytest.raises(ddg.errors.ParameterError, match="whole number"):
            ddg.harmonic_interpolation(SQUARE, {key: 1.0})


@pytest.mark.parametrize("call", [ddg.stiffness, ddg.betti_numbers, ddg.inspect_mesh])
def test_a_mesh_that_its_constructor_made_of_arrays_is_refused_with_the_function_that_makes_one(call):
    with pytest.raises(ddg.errors.MeshError, match="ddg.as_mesh.*ddg.TriangleMesh.from_arrays"):
        call(ddg.TriangleMesh(SQUARE.points, SQUARE.faces))


def test_an_array_without_columns_is_no_right_hand_side():
    with pytest.raises(ddg.errors.ParameterError, match="holds no function"):
        ddg.poisson(SQUARE, np.zeros((SQUARE.n_vertices, 0)))
