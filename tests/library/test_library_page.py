"""The recipes of docs/library.md run, and print what the comments at their lines state."""

from __future__ import annotations

import contextlib
import io
import os
import re
import shutil
from pathlib import Path

import pytest

import ddgcli as ddg

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "library.md").read_text(encoding="utf-8")
RECIPES = dict(
    re.findall(r"^### ([^\n]+)\n(?:(?!^###).)*?^```python\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
)
PRINTED = re.compile(r"^print\(.*\)  # (.*)$", re.MULTILINE)


def printed(code: str) -> list[str]:
    """Lines that a recipe prints."""
    output = io.StringIO()
    with contextlib.redirect_stdout(output):
        exec(compile(code, "docs/library.md", "exec"), {"__name__": "recipe"})
    return output.getvalue().splitlines()


@pytest.fixture
def folder_with_samples(tmp_path, monkeypatch):
    for name in ("sample_meshes", "sample_scenes"):
        shutil.copytree(ROOT / name, tmp_path / name)
    monkeypatch.chdir(tmp_path)


@pytest.mark.slow
def test_type_checkers_accept_the_recipes(tmp_path, monkeypatch):
    api = pytest.importorskip("mypy.api")
    monkeypatch.setenv("MYPYPATH", str(ROOT))
    files = [tmp_path / f"recipe_{number}.py" for number in range(len(RECIPES))]
    for file, code in zip(files, RECIPES.values(), strict=True):
        file.write_text(code)
    words = ["--ignore-missing-imports", "--cache-dir", str(tmp_path), "--config-file", os.devnull]
    report = api.run([*words, *map(str, files)])[0]
    assert [line for line in report.splitlines() if "recipe_" in line] == []


@pytest.mark.parametrize("title", RECIPES)
def test_recipe_prints_what_the_page_shows(title, folder_with_samples):
    code = RECIPES[title]
    if "import igl" in code:
        pytest.importorskip("igl")
    expected = PRINTED.findall(code)
    assert expected and len(expected) == code.count("print(")
    assert printed(code) == expected


def test_page_has_at_least_eight_recipes_and_one_in_libigl():
    assert len(RECIPES) >= 8 and PAGE.count("```python") == len(RECIPES) + 1
    assert sum("import igl" in code for code in RECIPES.values()) == 1


def test_first_example_of_the_page_runs(folder_with_samples):
    assert printed(re.findall(r"^```python\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)[0]) == []
    assert Path("ellipsoid.vtu").is_file()


def test_example_of_the_readme_runs(folder_with_samples):
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert printed(re.findall(r"^```python\n(.*?)^```", readme, re.MULTILINE | re.DOTALL)[0]) == []
    written = ddg.read_mesh("torus.vtu").vertex
    assert written["distance"][0] == 0 and written["H"].min() > 0  # H of this torus is positive everywhere


def test_table_of_functions_names_all_that_is_exported():
    table = PAGE[PAGE.index("## Functions") : PAGE.index("## Options of the commands")]
    assert set(re.findall(r"`(\w+)`", table)) == set(ddg.__all__) - {"__version__"}
