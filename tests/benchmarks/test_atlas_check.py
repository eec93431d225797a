"""The accuracy check fails on a planted error and a planted rate, and only then."""

import copy
import json
import sys

import pytest

from benchmarks.atlas import run as accuracy
from benchmarks.atlas.advice import ADVICE, CLAIMS
from benchmarks.atlas.run import ATLAS_FOLDER, PEER_NAMES, cases, summary_of, worse
from benchmarks.atlas.tables import Finest, rates, stored
from benchmarks.atlas.theory import SOURCES, theory
from ddgcli.tradeoff.problems import delaunay


def rows(factor: float = 1.0, rate: float = 2.0) -> list[dict]:
    """Two meshes of one configuration whose error is factor h^rate."""
    head = {"truth": "sphere:1", "mesh_class": "good", "configuration": "exact"}
    return [
        head | {"level": k, "h": h, "max_error": 2 * factor * h**rate, "mean_error": factor * h**rate}
        for k, h in enumerate((0.2, 0.1))
    ]


def test_rates_are_slopes():
    assert rates(rows(rate=1.5)) == {("sphere:1", "good", "exact"): pytest.approx(1.5)}


def test_equal_and_smaller_errors_pass():
    stored = summary_of(rows())
    assert worse(stored, summary_of(rows())) == []
    assert worse(stored, summary_of(rows(factor=0.5))) == []


@pytest.mark.parametrize("planted", [rows(factor=1.2), rows(factor=0.05, rate=0.5), rows()[:1]])
def test_planted_worse_errors_rates_and_missing_rows_are_reported(planted):
    stored = summary_of(rows())
    assert worse(stored, summary_of(copy.deepcopy(planted)))


@pytest.fixture
def check(monkeypatch, tmp_path):
    """`make accuracy-check` of one command, against what the atlas stores or a changed copy of it."""

    def call(change=lambda stored: None):
        stored = json.loads((ATLAS_FOLDER / "check.json").read_text())
        change(stored["delaunay"])
        (tmp_path / "check.json").write_text(json.dumps(stored))
        monkeypatch.setattr(accuracy, "ATLAS_FOLDER", tmp_path)
        monkeypatch.setattr(sys, "argv", ["accuracy", "--check", "delaunay"])
        return accuracy.main()

    return call


def test_the_check_passes_and_fails_if_a_stored_error_or_rate_was_better(check, monkeypatch, capsys):
    rows = accuracy.study("delaunay", accuracy.CHECK_LEVELS, peers=False)
    monkeypatch.setattr(accuracy, "study", lambda *words, **options: rows)
    assert check() == 0

    def error(stored):
        stored["errors"]["sphere:1|good|1|flips"][1] *= 0.9

    def rate(stored):
        stored["rates"]["sphere:1|good|flips"] += 0.2

    for change, what in ((error, "sphere:1|good|1|flips: errors"), (rate, "sphere:1|good|flips: rate")):
        capsys.readouterr()
        assert check(change) == 1 and what in capsys.readouterr().out


def test_the_check_fails_if_a_method_gets_worse(check, monkeypatch, capsys):
    sound = delaunay.lumped_mass
    monkeypatch.setattr(delaunay, "lumped_mass", lambda mesh: 1.02 * sound(mesh))
    monkeypatch.setattr(delaunay, "stiffness", lambda mesh, s=delaunay.stiffness: 1.01 * s(mesh))
    assert check() == 1
    assert "sphere:1|good|1|flips: errors" in capsys.readouterr().out


# ---------------------------------------------------------------- pages in docs/accuracy


def table(command):
    return stored(ATLAS_FOLDER / f"{command}.csv")


@pytest.mark.parametrize("command, sentence, holds", [(c, *claim) for c in CLAIMS for claim in CLAIMS[c]])
def test_every_piece_of_advice_follows_from_the_tables(command, sentence, holds):
    assert sentence in " ".join(ADVICE[command].split())
    assert holds(Finest(table(command)))


@pytest.mark.parametrize("command", ADVICE)
def test_every_study_contains_its_mesh_classes_peers_theory_and_plots(command):
    rows = table(command)
    mesh_classes = {row["mesh_class"] for row in rows}
    assert mesh_classes >= {"stretched", "noisy", "refined"} and mesh_classes & {"good", "right"}
    configurations = {row["configuration"] for row in rows}
    page = (ATLAS_FOLDER / f"{command}.md").read_text()
    for row in rows:
        rate = theory(command, row["mesh_class"], row["configuration"])
        assert rate in ("none", "1, then 0") or float(rate) >= 0
    assert " ".join(SOURCES[command].split()) in " ".join(page.split())
    assert all(accuracy.picture_name(command, case) in page for case in accuracy.drawn(command))
    assert {case.mesh_class for case in cases(command)} == mesh_classes
    if command in PEERS:
        assert {p for p in PEER_NAMES if any(c.startswith(p) for c in configurations)} >= PEERS[command]


PEERS = {
    "curvature": {"libigl", "pymeshlab"},
    "geodesic": {"pygeodesic", "potpourri3d", "pymeshlab"},
    "laplacian": {"robust_laplacian", "libigl"},
    "delaunay": {"robust_laplacian"},
}


def test_a_configuration_has_one_style_in_all_charts_of_its_command(monkeypatch, tmp_path):
    charts = []
    rows = table("curvature")
    monkeypatch.setattr(accuracy, "ATLAS_FOLDER", tmp_path)
    monkeypatch.setattr(
        accuracy, "draw_chart", lambda path, lines, **options: charts.append((lines, options))
    )
    accuracy.write("curvature", rows)
    assert len(charts) == 5 and len({tuple(lines) for lines, _ in charts}) > 1
    styles = charts[0][1]["styles"]
    assert len(set(styles.values())) == len(styles)
    assert all(options["styles"] == styles and styles.keys() >= lines.keys() for lines, options in charts)
