"""The tutorial runs; paths on the architecture page and citations exist; the navigation is complete."""

import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest

from docs import make_pictures
from docs.site_hooks import BIBLIOGRAPHY, CITATION, read_bibliography, short_name

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))


def tutorial_commands() -> list[str]:
    blocks = re.findall(r"^```\n(.*?)^```", (DOCS / "tutorial.md").read_text(encoding="utf-8"), re.M | re.S)
    return [line for block in blocks for line in block.splitlines()]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Folder in which the commands of the tutorial run one after the other."""
    path = tmp_path_factory.mktemp("tutorial")
    shutil.copytree(ROOT / "sample_meshes", path / "sample_meshes")
    return path


@pytest.fixture(scope="module")
def tutorial_summaries(folder):
    """Exit code, text and error of every command of the tutorial, in order."""
    from click.testing import CliRunner

    from ddgcli.cli.main import main

    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        calls = {line: shlex.split(line)[1:] for line in tutorial_commands()}
        return {line: CliRunner().invoke(main, words, prog_name="ddgcli") for line, words in calls.items()}


@pytest.mark.parametrize("line", tutorial_commands())
def test_every_command_of_the_tutorial_succeeds(line, tutorial_summaries):
    result = tutorial_summaries[line]
    assert result.exit_code == 0, result.stderr


def readme_examples() -> list:
    text = (ROOT / "README.md").read_text(encoding="utf-8").split("## Five examples")[1]
    lines = re.findall(r"^ddgcli .*$", text, re.M)
    slow = pytest.mark.slow
    return [pytest.param(line, marks=slow if "shell-sim" in line else ()) for line in lines]


@pytest.mark.parametrize("line", readme_examples())
def test_every_example_of_the_readme_runs(line, folder, run, monkeypatch):
    shutil.copytree(ROOT / "sample_scenes", folder / "sample_scenes", dirs_exist_ok=True)
    monkeypatch.chdir(folder)
    words = shlex.split(line, comments=True)[1:]
    once = ["--repeat", 1, "--budget", 600] if words[0] == "tradeoff" else []  # of a machine under load
    result = run(*words, *once)
    assert result.exit_code == 0, result.stderr


def test_the_readme_has_five_examples_pictures_of_two_scenes_and_of_two_measurements_and_at_most_75_lines():
    assert len(readme_examples()) == 5
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 75
    pictures = re.findall(r"!\[[^]]+\]\(([^)]+)\)", (ROOT / "README.md").read_text(encoding="utf-8"))
    assert len(pictures) == 4 and all((ROOT / path).exists() for path in pictures)
    assert all(sum(f"/{name}-" in path for path in pictures) == 1 for name in ("shell", "fluid"))


@pytest.mark.parametrize(
    "command, number",
    [
        ("info", "faces_above_120_degrees  9216"),
        ("curvature", "min 0.415881, max 1.60668"),
        ("curvature --scheme cotan", "min 0.685509"),
        ("laplacian --eigen 6", "6.18622]"),
        ("laplacian --operator cotan", "6.46097]"),
        ("geodesic --path-to 800", "length 1.43758"),
        ("geodesic --compare exact", "mean_error     0.0121"),
        ("hodge", "[1, 2, 1]"),
        ("willmore-flow", "[21.1497, 14.7756, 13.8487, "),
    ],
)
def test_the_numbers_of_the_tutorial_are_those_of_its_commands(command, number, tutorial_summaries):
    name, *words = command.split(" ", 1)
    lines = [line for line in tutorial_summaries if line.split()[1] == name and all(w in line for w in words)]
    assert number in tutorial_summaries[lines[0]].stdout


def test_the_generators_of_the_tutorial_wind_around_its_torus_as_it_states(folder, tutorial_summaries):
    from ddgcli.io.mesh_file import read_mesh

    curves = read_mesh(str(folder / "generators.vtp"))
    turns = []
    for number in range(2):
        lines = curves.mesh.lines[curves.face["path_id"] == number]
        x, y, z = curves.mesh.points[np.append(lines[:, 0], lines[0, 0])].T
        angles = np.arctan2([y, z], [x, np.hypot(x, y) - 1.0])
        turns.append(np.abs(np.diff(np.unwrap(angles)).sum(axis=1)) / (2 * np.pi))
    np.testing.assert_allclose(turns, [[0, 1], [1, 3]], atol=1e-9)  # around the hole, around the tube


def test_paths_on_the_architecture_page_exist():
    text = (DOCS / "architecture.md").read_text(encoding="utf-8")
    paths = set(re.findall(r"`((?:ddgcli|tests|benchmarks)/[\w/.]+)`", text))
    assert len(paths) > 30
    assert [path for path in sorted(paths) if not (ROOT / path).exists()] == []


def test_every_package_is_on_the_architecture_page():
    text = (DOCS / "architecture.md").read_text(encoding="utf-8")
    packages = {path.parent.name for path in (ROOT / "ddgcli").glob("*/__init__.py")}
    assert {name for name in packages if f"`ddgcli/{name}`" not in text} == set()


def test_every_page_is_in_the_navigation():
    nav = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").split("\nnav:\n")[1]
    listed = set(re.findall(r"[:-]\s*([\w/.-]+\.md)", nav))
    assert {page.relative_to(DOCS).as_posix() for page in PAGES} - listed == set()


def test_every_citation_has_an_entry():
    entries = read_bibliography(BIBLIOGRAPHY.read_text(encoding="utf-8"))
    assert len(entries) == BIBLIOGRAPHY.read_text(encoding="utf-8").count("\n@") + 1
    assert all(entry.keys() >= {"author", "title", "year"} for entry in entries.values())
    cited = {key for page in PAGES for key in CITATION.findall(page.read_text(encoding="utf-8"))}
    assert cited and cited - entries.keys() == set()


def test_no_page_cites_without_an_entry():
    citation = re.compile(r"\[[A-Z][^\]@()]{2,60}(19|20)\d\d\](?!\()")
    plain_ones = {path.name: citation.findall(path.read_text(encoding="utf-8")) for path in PAGES}
    assert {name: texts for name, texts in plain_ones.items() if texts} == {}


def test_citations_show_family_names_and_year():
    one = {"author": "Kimmel, Ron and Sethian, James A.", "year": "1998"}
    many = {"author": "A, B and C, D and E, F", "year": "2001"}
    assert short_name(one) == "Kimmel and Sethian 1998" and short_name(many) == "A et al. 2001"


def test_the_start_page_shows_the_commands_of_its_pictures():
    text = (DOCS / "index.md").read_text(encoding="utf-8")
    commands = re.findall(r"pictures/([\w-]+)\.png\)\n`(.*)`", text)
    assert len(commands) >= 5
    for name, command in commands:
        assert command == make_pictures.command_line(name)
        assert (make_pictures.PICTURES / f"{name}.png").exists()
