"""File names whose bytes are no UTF-8, under a locale of UTF-8: runs succeed, and print the names escaped."""

import json
import os
import shutil
import subprocess
import sys

import pytest

from tests.conftest import ROOT

NAME = os.fsdecode(b"caf\xe9")
CALLS = [
    "info {name}.obj",
    "curvature {name}.obj -o {name}.vtu -o {name}.vtkhdf -o {name}.npz --plot {name}.png",
    "tradeoff delaunay {name}.obj --budget 1 -o {name}.csv",
    "batch {name}.obj -o x{{index}}.vtu --table table.jsonl -- curvature",
    "batch {name}.obj -o y{{index}}.vtu --table table.csv -- curvature",
    "check stored.json --update -- curvature {name}.obj",
    "check stored.json -- curvature {name}.obj",
    "shell-sim {name}.obj --effect gravity --steps 1 --dt 1e-3 -o {name}.run.vtkhdf",
    "frames {name}.run.vtkhdf -o {name}.pvd",
    "view {name}.obj -o {name}.html",
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("names")
    try:
        shutil.copy(ROOT / "sample_meshes" / "cube.obj", folder / f"{NAME}.obj")
    except (OSError, UnicodeEncodeError):
        pytest.skip("the file system takes names in UTF-8 only")
    return folder


@pytest.mark.parametrize("call", CALLS)
def test_a_name_that_is_no_utf8_is_read_written_and_printed(folder, call):
    words = call.format(name=NAME).split()
    options, rest = (
        (words, []) if "--" not in words else (words[: words.index("--")], words[words.index("--") :])
    )
    environment = {**os.environ, "PYTHONIOENCODING": "utf-8:strict", "PYTHONPATH": str(ROOT)}
    result = subprocess.run(
        [sys.executable, "-m", "ddgcli", *options, "--json", *rest],
        cwd=folder, env=environment, capture_output=True,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr.decode()
    summary = json.loads(result.stdout)
    if words[0] == "info":
        assert os.fsencode(summary["input"]["path"]) == b"caf\xe9.obj"
