"""One thread of linear algebra by default; more on request; results do not depend on it."""

import json
import os
import subprocess
import sys

import pytest

from ddgcli.cli.threads import THREAD_VARIABLES, requested_threads, set_thread_variables
from tests.conftest import ROOT

SPHERE = str(ROOT / "sample_meshes" / "sphere.ply")
COUNT = """
import os, sys
from ddgcli.cli.main import main
main(sys.argv[1:], standalone_mode=False)
import numpy, scipy.linalg
a = numpy.ones((600, 600)); a @ a
print(len(os.listdir("/proc/self/task")), file=sys.stderr)
"""


def run_process(*words, **exported):
    """Standard output and the thread count at the end of a fresh process."""
    environment = {k: v for k, v in os.environ.items() if k not in THREAD_VARIABLES} | exported
    command = [sys.executable, "-c", COUNT, "laplacian", SPHERE, "--eigen", "4", "--json", *words]
    done = subprocess.run(command, env=environment, cwd=ROOT, capture_output=True, text=True, check=True)
    return json.loads(done.stdout), int(done.stderr.split()[-1])


@pytest.mark.skipif(not os.path.isdir("/proc/self/task"), reason="threads are counted in /proc")
def test_the_default_is_one_thread_and_threads_n_gives_more():
    default, count = run_process()
    assert count == 1
    threaded, more = run_process("--threads", "3")
    assert more > 1
    _, exported = run_process(OMP_NUM_THREADS="3")
    assert exported > 1
    assert threaded["results"]["eigenvalues"] == pytest.approx(default["results"]["eigenvalues"], rel=1e-9)


@pytest.mark.parametrize(
    "words, threads",
    [
        (["curvature", "a.ply"], None),
        (["curvature", "a.ply", "--threads", "4"], 4),
        (["curvature", "--threads=2", "a.ply"], 2),
        (["curvature", "--threads"], None),
        (["curvature", "--threads", "none"], None),
        (["curvature", "--threads", "0"], None),
    ],
)
def test_requested_threads_are_read_from_the_command_line(words, threads):
    assert requested_threads(words) == threads


def test_exported_variables_stay_unless_the_option_threads_is_set():
    exported = {"OMP_NUM_THREADS": "7"}
    set_thread_variables(["info", "a.ply"], exported)
    assert exported == {"OMP_NUM_THREADS": "7"}
    set_thread_variables(["info", "a.ply", "--threads", "2"], exported)
    assert exported == dict.fromkeys(THREAD_VARIABLES, "2")
    empty: dict[str, str] = {}
    set_thread_variables([], empty)
    assert empty == dict.fromkeys(THREAD_VARIABLES, "1")


@pytest.mark.parametrize("value", ["0", "-1", "many"])
def test_a_thread_count_that_is_no_positive_number_is_refused(run, value):
    result = run("info", SPHERE, "--threads", value)
    assert result.exit_code == 2
    assert "--threads" in result.stderr
