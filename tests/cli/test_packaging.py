"""One version for pip, the program, the docs and the conda recipe; the extras that messages name exist."""

import importlib.util
import re
import sys
import tomllib
from pathlib import Path

from click.testing import CliRunner

import ddgcli
from ddgcli.cli.main import main

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))


def test_the_version_stands_in_one_place():
    assert PROJECT["project"]["dynamic"] == ["version"]
    assert PROJECT["tool"]["setuptools"]["dynamic"]["version"] == {"attr": "ddgcli.__version__"}
    assert CliRunner().invoke(main, ["--version"]).stdout.split()[-1] == ddgcli.__version__
    recipe = (ROOT / "packaging" / "conda" / "meta.yaml").read_text("utf-8")
    (pattern,) = re.findall(r"regex_pattern='(.+)', from", recipe)
    text = (ROOT / "ddgcli" / "__init__.py").read_text("utf-8")
    assert re.findall(pattern, text) == [ddgcli.__version__]
    spec = importlib.util.spec_from_file_location("site_hooks", ROOT / "docs" / "site_hooks.py")
    hooks = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(hooks)
    assert hooks.on_config({})["copyright"] == f"ddgcli {ddgcli.__version__}"


def test_the_conda_recipe_needs_what_pip_needs():
    recipe = (ROOT / "packaging" / "conda" / "meta.yaml").read_text("utf-8")
    run = recipe.split("  run:")[1].split("  run_constrained:")[0]
    requirements = {line.strip("- ").replace(" ", "") for line in run.splitlines() if line.strip()}
    assert requirements - {"python>=3.11"} == set(PROJECT["project"]["dependencies"])


def test_every_extra_that_a_message_names_exists_and_the_page_on_installing_lists_it():
    named = set()
    for path in (ROOT / "ddgcli").rglob("*.py"):
        named |= set(re.findall(r"ddgcli\[(\w+)\]", path.read_text("utf-8")))
    extras = PROJECT["project"]["optional-dependencies"]
    assert named and named <= set(extras)
    page = (ROOT / "docs" / "install.md").read_text("utf-8")
    users = set(extras) - {"test", "docs"}
    assert [name for name in sorted(users) if f"ddgcli[{name}]" not in page] == []


def test_the_python_of_the_package_is_supported():
    classifiers = PROJECT["project"]["classifiers"]
    assert (
        f"Programming Language :: Python :: {sys.version_info.major}.{sys.version_info.minor}" in classifiers
    )
