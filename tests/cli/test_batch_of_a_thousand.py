"""A batch of a thousand runs, on one machine and on a cluster."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from ddgcli.cli.batch import process
from tests.conftest import ROOT

SCALE = """
import json, pathlib, sys, time
name = pathlib.Path(sys.argv[2]).stem
kind = int(name[1:]) % 50
if kind == 7:
    time.sleep(600) if int(name[1:]) % 100 == 7 else bytearray(400 << 20) and time.sleep(600)
print(json.dumps({"results": {"area": len(name)}}))
"""


SCALE_PROGRAM = (sys.executable, "-S", "-c", SCALE)


def table_without_times(path):
    rows = [json.loads(line) for line in Path(path).read_text().splitlines()]
    return [{k: v for k, v in row.items() if k not in ("seconds", "peak_mib")} for row in rows]


@pytest.fixture
def thousand(tmp_path):
    """Batch of 1,000 runs of which 20 hang or eat memory.

    `thousand(table, *words, seconds)` runs it and gives its exit code; it is killed after `seconds`.
    """
    folder = tmp_path / "in"
    folder.mkdir()
    for k in range(1000):
        (folder / f"m{k:04d}.ply").write_text(str(k))
    code = (
        f"import sys\nfrom ddgcli.cli.batch import process\nprocess.PROGRAM = {SCALE_PROGRAM!r}\n"
        "from ddgcli.cli.main import main\nmain()\n"
    )
    limits = ("--jobs", "8", "--timeout", "15", "--memory", "200", "--collect", "results.area", "-q")

    def batch(table, *words, seconds=None):
        words = ("batch", str(folder / "*.ply"), "--table", str(table), *limits, *words, "--", "info")
        running = subprocess.Popen([sys.executable, "-c", code, *words], cwd=ROOT)
        try:
            return running.wait(timeout=seconds)
        except subprocess.TimeoutExpired:
            running.kill()
            running.wait()
            return None

    return batch


@pytest.mark.slow
@pytest.mark.timeout(2400)
def test_a_thousand_runs_of_which_twenty_hang_or_eat_memory_survive_twenty_kills(thousand, tmp_path):
    """Killed at 20 random moments and resumed, in one piece and in four shards: the same table."""
    import random

    whole, broken = tmp_path / "whole.jsonl", tmp_path / "broken.jsonl"
    assert thousand(whole) == 1
    rows = table_without_times(whole)
    statuses = [row["status"] for row in rows]
    assert statuses.count("done") == 980 and statuses.count("timeout") + statuses.count("memory") == 20
    moments = random.Random(0)
    for _ in range(20):
        thousand(broken, "--resume", seconds=moments.uniform(0.5, 6.0))
    assert thousand(broken, "--resume") == 1
    assert table_without_times(broken) == rows
    shards = []
    for k in range(1, 5):
        thousand(tmp_path / f"shard{k}.jsonl", "--shard", f"{k}/4")
        shards += table_without_times(tmp_path / f"shard{k}.jsonl")
    assert sorted(shards, key=lambda row: row["index"]) == rows
    assert not list(tmp_path.glob("*.part"))


@pytest.mark.slow
@pytest.mark.timeout(2400)
def test_a_thousand_runs_on_a_dask_cluster_give_the_table_of_one_machine(thousand, tmp_path, monkeypatch):
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(process, "PROGRAM", SCALE_PROGRAM)  # of the workers, threads of this process
    workers = {"n_workers": 1, "threads_per_worker": 8, "processes": False, "dashboard_address": None}
    with distributed.LocalCluster(**workers, protocol="tcp", host="127.0.0.1") as cluster:
        assert thousand(tmp_path / "cluster.jsonl", "--cluster", cluster.scheduler_address) == 1
    assert thousand(tmp_path / "here.jsonl") == 1
    assert table_without_times(tmp_path / "cluster.jsonl") == table_without_times(tmp_path / "here.jsonl")
