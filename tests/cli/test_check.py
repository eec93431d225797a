"""`check` sees what moved, and nothing else."""

import json
import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from ddgcli.algorithms.inspection.compare_arrays import compare_arrays
from ddgcli.algorithms.inspection.compare_summaries import Tolerances, compare
from ddgcli.io.mesh_file import read_mesh, write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh

ROOT = Path(__file__).parents[2]


@pytest.fixture
def stored(tmp_path, run):
    mesh = tmp_path / "torus.ply"
    write_mesh(str(mesh), AnnotatedMesh(shapes.torus(12, 8)))
    expected = tmp_path / "torus.json"
    result = run("check", expected, "--update", "--", "info", mesh)
    assert result.exit_code == 0, result.stderr
    return expected


def edited(path, change):
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))


def test_the_same_run_has_not_moved(stored, summary):
    comparison = summary("check", stored)
    assert comparison["results"]["moved"] == []
    assert comparison["results"]["compared"] > 20


def test_a_stored_file_may_begin_with_a_byte_order_mark(stored, summary):
    stored.write_bytes(b"\xef\xbb\xbf" + stored.read_bytes())
    assert summary("check", stored)["results"]["moved"] == []


def test_a_moved_number_is_named_with_exit_1(stored, run):
    edited(
        stored,
        lambda c: c["summary"]["results"]["size"].update(area=c["summary"]["results"]["size"]["area"] * 1.01),
    )
    result = run("check", stored, "--", "ddgcli", *json.loads(stored.read_text())["run"])
    assert result.exit_code == 1
    assert "results.size.area" in result.stdout
    assert run("check", stored, "--rtol", 0.02).exit_code == 0
    assert run("check", stored, "--ignore", "results.size.*").exit_code == 0
    edited(stored, lambda c: c.update(tolerances={"keys": {"*.area": {"rtol": 0.02}}}))
    assert run("check", stored).exit_code == 0


def test_tolerances_of_zero_compare_exactly(stored, run):
    """Once --rtol 0 and --atol 0 had no effect."""
    edited(
        stored,
        lambda c: c["summary"]["results"]["size"].update(
            area=c["summary"]["results"]["size"]["area"] * (1 + 1e-8)
        ),
    )
    assert run("check", stored).exit_code == 0
    assert run("check", stored, "--rtol", 0, "--atol", 0).exit_code == 1


def test_the_names_of_the_report_are_keys(stored, run):
    """Once the brackets of a list's entry were a set of characters, which matched nothing."""
    edited(stored, lambda c: c["summary"]["results"].update(listed=[1.0]))
    result = run("check", stored)
    assert result.exit_code == 1
    assert "results.listed[0]" in result.stdout
    assert run("check", stored, "--ignore", "results.listed[0]").exit_code == 0


def test_a_tolerance_of_no_value_is_a_warning(stored, run):
    result = run("check", stored, "--tolerance", "results.aera=1e-9")
    assert "results.aera" in result.stderr
    assert not run("check", stored, "--tolerance", "results.size.area=1e-9").stderr


@pytest.mark.parametrize(
    "words", [("--rtol", 0), ("--ignore", "a"), ("--tolerance", "a=1"), ("--arrays", "a", "b")]
)
def test_update_takes_no_options_of_comparisons(stored, run, words):
    """Once they had no effect."""
    before = stored.read_bytes()
    result = run("check", stored, "--update", *words)
    assert result.exit_code == 2
    assert words[0] in result.stderr
    assert stored.read_bytes() == before


def test_update_keeps_the_stated_tolerances(stored, run):
    edited(stored, lambda c: c.update(tolerances={"rtol": 0.5}))
    assert run("check", stored, "--update").exit_code == 0
    assert json.loads(stored.read_text())["tolerances"] == {"rtol": 0.5}


def test_a_plain_summary_is_accepted(stored, run, tmp_path):
    content = json.loads(stored.read_text())
    plain = tmp_path / "plain.json"
    plain.write_text(json.dumps(content["summary"]))
    assert run("check", plain, "--", *content["run"]).exit_code == 0


@pytest.mark.parametrize(
    "content, message",
    [
        (None, "--update"),
        ("{", "JSON"),
        ("[]", "summary"),
        ('{"summary": {}, "tolerances": {"rtl": 1}}', "rtl"),
        ('{"summary": {}, "tolerances": {"rtol": "a"}}', "tolerance 'rtol' is"),
        ('{"summary": {}, "tolerances": {"rtol": null}}', "tolerance 'rtol' is"),
        ('{"summary": {}, "tolerances": {"atol": -1}}', "tolerance 'atol' is"),
        ('{"summary": {}, "tolerances": {"atol": NaN}}', "tolerance 'atol' is"),
        ('{"summary": {}, "tolerances": []}', "'tolerances' is not a table"),
        ('{"summary": {}, "tolerances": 3}', "'tolerances' is not a table"),
        ('{"summary": {}, "tolerances": {"ignore": 3}}', "tolerance 'ignore' is"),
        ('{"summary": {}, "tolerances": {"ignore": [3]}}', "tolerance 'ignore' is"),
        ('{"summary": {}, "tolerances": {"keys": {"a": 3}}}', "tolerance 'keys' is"),
        ('{"summary": {}, "tolerances": {"keys": {"a": {"rtol": "b"}}}}', "tolerance 'keys' is"),
        ('{"summary": [1]}', "'summary' is not a table"),
        ('{"summary": {}, "run": 3}', "'run' is not a list of words"),
        ('{"summary": {}, "run": [1]}', "'run' is not a list of words"),
        ('{"summary": {}, "run": ["a\\u0000b"]}', "'run' is not a list of words"),
        ("[" * 100000, "JSON"),
        ('{"summary": {"a": ' + "[" * 900 + "]" * 900 + "}}", ""),
    ],
)
def test_a_bad_file_is_refused(tmp_path, run, content, message):
    path = tmp_path / "e.json"
    if content is not None:
        path.write_text(content)
    result = run("check", path, "--", "info", "x.ply")
    assert result.exit_code == 2
    assert message in result.stderr and len(result.stderr.splitlines()) == 1


def test_a_refused_command_is_exit_2(stored, run):
    result = run("check", stored, "--", "info", "nowhere.ply")
    assert result.exit_code == 2
    assert "nowhere.ply" in result.stderr and len(result.stderr.splitlines()) == 1


def test_every_moved_number_and_text_is_a_difference():
    moved, compared = compare(
        {
            "results": {"a": 1.0, "b": [1, 2], "c": True, "d": None},
            "seconds": {"total": 1},
            "accuracy": {"r": 1e-16},
        },
        {
            "results": {"a": 1.0 + 1e-7, "b": [1, 3], "c": 1, "e": 2},
            "seconds": {"total": 9},
            "accuracy": {"r": 5e-15},
        },
        Tolerances(),
    )
    assert [m["key"] for m in moved] == ["results.b[1]", "results.c", "results.d", "results.e"]
    assert moved[0]["difference"] == 1
    assert compared == 7


def test_a_list_that_gains_entries_is_reported_with_their_number():
    moved, _ = compare({"warnings": []}, {"warnings": ["a", {"b": 1, "c": 2}]}, Tolerances())
    assert moved[0] == {"key": "warnings", "expected": "0 entries", "found": "2 entries"}
    assert [e["key"] for e in moved[1:]] == ["warnings[0]", "warnings[1].b", "warnings[1].c"]
    moved, _ = compare({"rows": ["a"]}, {"rows": []}, Tolerances())
    assert {"key": "rows", "expected": "1 entry", "found": "0 entries"} in moved


def test_warnings_about_output_formats_are_not_compared():
    of_format, other = ".vtu holds no arrays on edges", "2 faces are degenerate"
    assert compare({"warnings": []}, {"warnings": [of_format]}, Tolerances())[0] == []
    assert compare({"warnings": [other]}, {"warnings": [of_format, other]}, Tolerances())[0] == []
    assert compare({"warnings": []}, {"warnings": [of_format, other]}, Tolerances())[0] != []


def test_the_examples_of_the_page_agree_with_what_they_store(tmp_path, run, monkeypatch):
    (tmp_path / "sample_meshes").symlink_to(ROOT / "sample_meshes")
    monkeypatch.chdir(tmp_path)
    block = re.findall(r"^```sh\n(.*?)^```", (ROOT / "docs/check.md").read_text("utf-8"), re.M | re.S)[0]
    lines = [shlex.split(line, comments=True)[1:] for line in block.splitlines()]
    assert len(lines) == 5
    for words in lines:
        result = run(*words)
        assert result.exit_code == 0, (words, result.stdout)


def test_nothing_but_json_is_stored_over(run, tmp_path):
    mesh = tmp_path / "a.obj"
    mesh.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    before = mesh.read_bytes()
    for words in (["--update"], []):
        result = run("check", mesh, *words, "--", "info", mesh)
        assert result.exit_code == 2 and ".json" in result.stderr
    assert mesh.read_bytes() == before


def test_seconds_of_a_simulation_are_not_compared(run, tmp_path):
    mesh = tmp_path / "grid.ply"
    write_mesh(str(mesh), AnnotatedMesh(shapes.grid(4, 4)))
    words = (
        "shell-sim",
        mesh,
        "--effect",
        "stretching",
        "--effect",
        "gravity",
        "--steps",
        "2",
        "--dt",
        "1e-4",
    )
    stored = tmp_path / "stored.json"
    assert run("check", stored, "--update", "--", *words).exit_code == 0
    changed = json.loads(stored.read_text())
    seconds_by_part = changed["summary"]["results"]["seconds_by_part"]
    changed["summary"]["results"]["seconds_by_part"] = {
        name: value + 1 for name, value in seconds_by_part.items()
    }
    stored.write_text(json.dumps(changed))
    assert run("check", stored).exit_code == 0


@pytest.mark.parametrize("words", [["check"], ["ddgcli", "check"], ["--debug", "check"]])
def test_a_stored_command_that_is_check_itself_is_refused(tmp_path, run, words):
    path = tmp_path / "e.json"
    path.write_text(json.dumps({"summary": {}, "run": [*words, str(path)]}))
    result = run("check", path)
    assert result.exit_code == 2
    assert "check cannot run itself" in result.stderr and len(result.stderr.splitlines()) == 1


def test_integers_beyond_doubles_are_compared(tmp_path):
    moved, _ = compare({"results": {"a": 10**400, "b": 1}}, {"results": {"a": 1, "b": 10**400}}, Tolerances())
    assert [m["key"] for m in moved] == ["results.a", "results.b"]


@pytest.fixture
def two_files(tmp_path, run):
    """A stored mesh with arrays, and a function that writes another with changed arrays."""
    mesh = shapes.torus(12, 8)
    vertex = {"height": mesh.points[:, 2], "position": mesh.points}
    face = {"number": np.arange(mesh.n_faces) * 1.0}
    write_mesh(str(tmp_path / "a.vtu"), AnnotatedMesh(mesh, vertex, face))

    def compared(*words, mesh=mesh, **arrays):
        changed = {name: arrays.get(name, values) for name, values in vertex.items()}
        write_mesh(str(tmp_path / "b.vtu"), AnnotatedMesh(mesh, changed, face))
        return run("check", "--arrays", tmp_path / "a.vtu", tmp_path / "b.vtu", "--json", *words)

    return mesh, vertex, compared


def moved_of(result):
    return json.loads(result.stdout)["results"]["moved"]


def test_equal_arrays_have_not_moved(two_files):
    _, vertex, compared = two_files
    result = compared(height=vertex["height"] * (1 + 1e-9))
    assert result.exit_code == 0 and moved_of(result) == []
    assert json.loads(result.stdout)["results"]["compared"] == 5


def test_a_permuted_field_fails_although_least_largest_and_mean_are_the_same(two_files):
    _, vertex, compared = two_files
    result = compared(height=np.roll(vertex["height"], 1))
    assert result.exit_code == 1
    (entry,) = moved_of(result)
    step = np.abs(np.roll(vertex["height"], 1) - vertex["height"])
    assert entry["key"] == "arrays.height" and entry["largest"] == step.max() and entry["at"] == step.argmax()
    assert entry["elements"] == (step > 1e-6).sum()


@pytest.mark.parametrize("name", ["star1_data", "laplacian1_data", "d0_indices"])
def test_matrices_and_other_arrays_of_the_whole_mesh_are_compared(tmp_path, run, name):
    write_mesh(tmp_path / "sphere.ply", AnnotatedMesh(shapes.icosphere(1)))
    assert run("dec", tmp_path / "sphere.ply", "-o", tmp_path / "a.npz").exit_code == 0
    with np.load(tmp_path / "a.npz") as arrays:
        np.savez(tmp_path / "b.npz", **{**arrays, name: arrays[name][::-1] + 1})
    same = run("check", "--arrays", tmp_path / "a.npz", tmp_path / "a.npz", "--json")
    other = run("check", "--arrays", tmp_path / "a.npz", tmp_path / "b.npz", "--json")
    assert same.exit_code == 0 and json.loads(same.stdout)["results"]["compared"] > 20
    assert other.exit_code == 1
    assert [moved["key"] for moved in json.loads(other.stdout)["results"]["moved"]] == [f"arrays.{name}"]


def test_an_array_that_is_of_vertices_in_one_file_alone_is_not_missing(tmp_path):
    mesh = shapes.icosphere(1)
    one = AnnotatedMesh(mesh, {"star0_data": np.ones(mesh.n_vertices)})
    two = AnnotatedMesh(mesh, whole={"star0_data": np.ones(3), "note": np.array(["a", "b"])})
    moved = compare_arrays(one, two, Tolerances()).moved
    assert {m["key"]: (m["expected"], m["found"]) for m in moved} == {
        "arrays.star0_data": ([mesh.n_vertices], [3]), "arrays.note": ("missing", [2]),
    }  # fmt: skip
    texts = AnnotatedMesh(mesh, whole=two.whole | {"note": np.array(["a", "c"])})
    assert [m["elements"] for m in compare_arrays(two, texts, Tolerances()).moved] == [1]


def test_a_moved_point_a_missing_array_and_other_cells_fail(two_files, tmp_path, run):
    mesh, vertex, compared = two_files
    points = mesh.points.copy()
    points[7] += 1e-3
    (entry,) = moved_of(compared(mesh=mesh.moved(points)))
    assert entry["key"] == "points" and entry["first"] == entry["at"] == 7 and entry["elements"] == 1
    write_mesh(str(tmp_path / "c.vtu"), AnnotatedMesh(mesh, {"height": vertex["height"]}))
    result = run("check", "--arrays", tmp_path / "a.vtu", tmp_path / "c.vtu", "--json")
    assert [(e["key"], e["found"]) for e in moved_of(result)] == [
        ("arrays.position", "missing"),
        ("arrays.number", "missing"),
    ]
    write_mesh(str(tmp_path / "c.vtu"), AnnotatedMesh(shapes.torus(8, 12), {}))
    assert [
        e["key"] for e in moved_of(run("check", "--arrays", tmp_path / "a.vtu", tmp_path / "c.vtu", "--json"))
    ] == ["cells"]


def test_a_comparison_of_nothing_is_refused(stored, run):
    """It would pass whatever the run does."""
    refused = run("check", stored, "--ignore", "*")
    assert refused.exit_code == 2 and "--ignore: leaves out every value" in refused.stderr


def test_tolerances_hold_by_array(two_files):
    _, vertex, compared = two_files
    noise = 1e-4 * np.cos(np.arange(len(vertex["height"])))
    assert compared(height=vertex["height"] + noise).exit_code == 1
    assert compared("--tolerance", "arrays.height=1e-3", height=vertex["height"] + noise).exit_code == 0
    assert compared("--tolerance", "arrays.pos*=1e-3", height=vertex["height"] + noise).exit_code == 1
    assert compared("--atol", 1e-3, height=vertex["height"] + noise).exit_code == 0
    assert compared("--ignore", "arrays.height", height=vertex["height"] + noise).exit_code == 0
    assert compared("--tolerance", "height").exit_code == 2


def test_the_difference_mesh_shows_where(two_files, tmp_path):
    _, vertex, compared = two_files
    changed = vertex["position"].copy()
    changed[[3, 20]] += [0, 3e-2, 4e-2]
    assert compared("-o", tmp_path / "d.vtu", position=changed).exit_code == 1
    arrays = read_mesh(str(tmp_path / "d.vtu")).vertex
    np.testing.assert_array_equal(np.flatnonzero(arrays["position_moved"]), [3, 20])
    np.testing.assert_allclose(arrays["position_difference"][[3, 20, 4]], [0.05, 0.05, 0.0], atol=1e-12)
    assert not arrays["height_moved"].any()


def test_a_command_and_its_output_are_checked_together(stored, tmp_path, run):
    words = ["--", "info", tmp_path / "torus.ply", "-o", tmp_path / "new.vtu"]
    assert run("info", tmp_path / "torus.ply", "-o", tmp_path / "old.vtu").exit_code == 0
    pair = ["--arrays", tmp_path / "old.vtu", tmp_path / "new.vtu"]
    ignored = ["--ignore", "options*", "--ignore", "warnings*"]
    assert run("check", stored, *pair, *ignored, *words).exit_code == 0
    old = read_mesh(str(tmp_path / "old.vtu"))
    component = old.vertex | {"component": old.vertex["component"] + 1}
    write_mesh(str(tmp_path / "old.vtu"), AnnotatedMesh(old.mesh, component, old.face))
    result = run("check", stored, *pair, *ignored, "--json", *words)
    assert result.exit_code == 1 and [e["key"] for e in moved_of(result)] == ["arrays.component"]
    assert run("check").exit_code == 2 and run("check", stored, "-o", tmp_path / "x.vtu").exit_code == 2
