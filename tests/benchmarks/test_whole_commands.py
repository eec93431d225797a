"""Benches time whole commands in the default environment, and the calls that they time are valid."""

import importlib
import json
import shlex
from pathlib import Path

import click
import pytest

from benchmarks.common import measure
from ddgcli.cli.main import main
from ddgcli.cli.multi_value import repeat_options
from ddgcli.cli.threads import THREAD_VARIABLES

BENCHES = sorted(p.stem for p in (Path(measure.__file__).parents[1] / "peers").glob("[a-z]*.py"))
SLEEPER = """
import json, os, sys, time
time.sleep(0.3)
with open(sys.argv[3], "w") as file:
    json.dump({"threads": [n for n in os.environ if n in %r], "words": sys.argv[1:]}, file)
sys.exit(3)
"""


@pytest.mark.parametrize("name", BENCHES)
def test_every_bench_times_whole_commands_that_parse(name):
    bench = pytest.importorskip(f"benchmarks.peers.{name}", exc_type=ImportError)
    assert 1 <= len(bench.COMMANDS) <= 2
    source = Path(bench.__file__).read_text(encoding="utf-8")
    assert "print_commands(*COMMANDS)" in source
    for call in bench.COMMANDS:
        command_name, *words = shlex.split(call)
        command = main.get_command(click.Context(main), command_name)
        words = repeat_options(command, [measure.sample_path(word) for word in words])
        command.make_context(command_name, words, parent=click.Context(main))


def test_a_command_is_timed_without_thread_variables_on_cpu_and_wall_clock(monkeypatch, tmp_path):
    """A stand-in for `python -m ddgcli` that sleeps: wall time counts the sleep, CPU time does not."""
    package = tmp_path / "ddgcli"
    package.mkdir()
    (package / "__main__.py").write_text(SLEEPER % (list(THREAD_VARIABLES),))
    (tmp_path / "sample_meshes").mkdir()
    mesh = tmp_path / "sample_meshes" / "dot.ply"
    mesh.write_text("")
    monkeypatch.setattr(measure, "ROOT", tmp_path)
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    out = tmp_path / "seen.json"
    seconds = measure.command_seconds("info", "dot.ply", str(out))
    report = json.loads(out.read_text())
    assert report == {"threads": [], "words": ["info", str(mesh), str(out)]}
    assert seconds.exit_code == 3
    assert seconds.cpu > 0 and seconds.wall >= 0.3


def test_the_benches_are_those_of_the_makefile():
    makefile = Path(measure.__file__).parents[2] / "Makefile"
    assert "benchmarks/peers/[a-z]*.py" in makefile.read_text(encoding="utf-8")
    assert all(importlib.util.find_spec(f"benchmarks.peers.{name}") for name in BENCHES)
