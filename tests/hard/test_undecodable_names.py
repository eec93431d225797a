"""File names whose bytes are not UTF-8: runs read and write such files, and print the names escaped."""

import errno
import json
import os
import re
import shutil
import subprocess
import sys

import pytest

from tests.conftest import ROOT

BYTES = b"caf\xe9"
CALLS = [
    "curvature {name}.obj -o {name}.vtu -o {name}.vtkhdf -o {name}.npz --plot {name}.png",
    "tradeoff delaunay {name}.obj --budget 600 -o {name}.csv",
    "batch {name}.obj -o x{{index}}.vtu --table table.jsonl -- curvature",
    "batch {name}.obj -o y{{index}}.vtu --table table.csv -- curvature",
    "check stored.json --update -- curvature {name}.obj; check stored.json -- curvature {name}.obj",
    "shell-sim {name}.obj --effect gravity --steps 1 --dt 1e-3 -o {name}.run.vtkhdf; "
    "frames {name}.run.vtkhdf -o {name}.pvd",
    "view {name}.obj -o {name}.html",
]


@pytest.fixture
def name(tmp_path, monkeypatch):
    """Name of a mesh, without its suffix, in the current folder."""
    mesh = os.path.join(os.fsencode(tmp_path), BYTES + b".obj")
    try:
        open(mesh, "wb").close()
    except OSError as error:
        if error.errno != errno.EILSEQ:
            raise
        pytest.skip("the file system holds names in UTF-8 only, as that of macOS does")
    shutil.copy(os.fsencode(ROOT / "sample_meshes" / "cube.obj"), mesh)
    monkeypatch.chdir(tmp_path)
    return os.fsdecode(BYTES)


@pytest.mark.parametrize("calls", CALLS)
def test_a_name_that_is_no_utf8_is_read_written_and_printed(name, run, calls):
    for call in calls.format(name=name).split("; "):
        options, separator, inner = call.partition(" -- ")
        result = run(*options.split(), "--json", *(separator + inner).split())
        assert result.exit_code == 0, result.stderr
        outputs = re.findall(rf"(?:-o|--plot) ({name}\S+)", options)
        assert set(outputs) <= set(json.loads(result.stdout)["outputs"])
        assert all(os.path.isfile(path) for path in outputs)


def test_a_process_under_a_locale_of_utf8_prints_a_name_that_json_readers_turn_back(name):
    environment = {**os.environ, "PYTHONIOENCODING": "utf-8:strict", "PYTHONPATH": str(ROOT)}
    words = [sys.executable, "-m", "ddgcli", "info", f"{name}.obj", "--json"]
    result = subprocess.run(words, env=environment, capture_output=True)
    assert result.returncode == 0, result.stderr.decode()
    assert os.fsencode(json.loads(result.stdout)["input"]["path"]) == BYTES + b".obj"
