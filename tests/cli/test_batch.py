"""`ddgcli batch`: tasks, limits, tables, shards, and batches that are broken and resumed."""

import csv
import json
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path

import pytest

from ddgcli.cli.batch import process
from ddgcli.cli.batch.process import TaskLimits, TaskRow
from ddgcli.cli.batch.run import run_batch
from ddgcli.cli.batch.table import completed_rows
from ddgcli.cli.batch.tasks import Task, make_tasks, parsed_sweeps, shard_of
from ddgcli.errors import MissingExtraError, ParameterError
from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from tests.conftest import ROOT

# a stand-in for the program: what it does depends on the input's name
STUB = """
import json, pathlib, sys, time
words = sys.argv[1:]
name = pathlib.Path(words[1]).name
if "hang" in name:
    time.sleep(60)
if "greedy" in name:
    data = bytearray(400 << 20)
    time.sleep(60)
if "bad" in name:
    sys.exit("Error: bad input")
if "-o" in words:
    pathlib.Path(words[words.index("-o") + 1]).write_text("done")
time.sleep(0.05)
print(json.dumps({"results": {"words": words, "area": len(name)}}))
"""


@pytest.fixture
def stub(monkeypatch):
    monkeypatch.setattr(process, "PROGRAM", (sys.executable, "-c", STUB))


@pytest.fixture
def inputs(tmp_path):
    folder = tmp_path / "in"
    folder.mkdir()
    for name in ("a.ply", "bad.ply", "c.ply", "hang.ply", "greedy.ply"):
        (folder / name).write_text(name)
    return folder


def paths(folder, *names):
    return [str(folder / name) for name in names]


def test_tasks_are_inputs_times_swept_values_in_order():
    tasks = make_tasks(
        ["x/a.ply", "b.obj"], {"radius": ["1", "2"]}, "{stem}.{radius}.vtu", ["curvature", "-q"]
    )
    assert [task.output for task in tasks] == ["a.1.vtu", "a.2.vtu", "b.1.vtu", "b.2.vtu"]
    assert tasks[1].words == ("curvature", "x/a.ply", "-q", "--radius", "2", "-o", "a.2.vtu")
    shards = [shard_of(tasks, f"{i}/3") for i in (1, 2, 3)]
    assert sorted(task.index for shard in shards for task in shard) == [0, 1, 2, 3]


@pytest.mark.parametrize(
    "template, sweeps, text",
    [
        ("{stem}.vtu", {}, "would both be written to a.vtu"),
        ("{stem}.vtu", {}, "add {index}$"),
        ("{name}.vtu", {"radius": ["1", "2"]}, "one path, a.ply.vtu; add {radius} or {index}"),
        ("{radius}.vtu", {}, "unknown field {radius}"),
        ("{stem.vtu", {}, "write a brace"),
    ],
)
def test_templates_that_cannot_name_the_outputs_are_refused(template, sweeps, text):
    with pytest.raises(ParameterError, match=text.replace("{", r"\{")):
        make_tasks(["x/a.ply", "y/a.ply"] if "stem" in template else ["a.ply"], sweeps, template, ["info"])


def test_words_of_the_command_have_the_fields_of_the_outputs():
    """Once every run wrote its picture to {stem}.png, and one that starts with a dash was an option."""
    command = ["frames", "--plot", "p/{stem}.{every}.png", "-o", "{name}_{:04d}.ply", "--to={index}"]
    tasks = make_tasks(["a.vtkhdf", "-b.vtkhdf"], {"every": ["2"]}, None, command)
    assert tasks[0].words[1:6] == ("a.vtkhdf", "--plot", "p/a.2.png", "-o", "a.vtkhdf_{:04d}.ply")
    assert tasks[1].words[1:4] == ("./-b.vtkhdf", "--plot", "p/-b.2.png")
    assert tasks[1].words[6] == "--to=1" and tasks[1].input == "-b.vtkhdf"


def test_no_run_writes_the_input_of_another_or_the_table(run, tmp_path, monkeypatch):
    """Once a run replaced the input of the next, which then computed with it (exit code 0)."""
    monkeypatch.chdir(tmp_path)
    for name in ("x.ply", "0.vtu", "linked.ply"):
        write_mesh(name, AnnotatedMesh(shapes.icosphere(0)))
    Path("link.ply").symlink_to("x.ply")
    before = Path("0.vtu").read_bytes()
    for words, message in (
        (
            ["x.ply", "0.vtu", "-o", "{index}.vtu", "--"],
            "0.vtu: is the input of another run, and that of x.ply",
        ),
        (["x.ply", "-o", "x.{suffix}", "--"], "x.ply: is the input itself"),
        (["0.vtu", "x.ply", "-o", "{index}.vtp", "--", "--plot", "p.png"], "would both be written"),
        (["0.vtu", "link.ply", "-o", "x.ply", "--shard", "2/2", "--"], "would both be written"),
        (["linked.ply", "link.ply", "-o", "{index}.ply", "--"], None),
        (["link.ply", "-o", "x.ply", "--"], "x.ply: is the input itself"),
        (["x.ply", "-o", "t.csv", "--table", "t.csv", "--"], "t.csv: is the table of the batch too"),
    ):
        command = words[: words.index("--") + 1] + ["info"] + words[words.index("--") + 1 :]
        result = run("batch", *command)
        assert result.exit_code == (0 if message is None else 2), command
        assert message is None or message in result.stderr
    assert Path("0.vtu").read_bytes() == before


def test_folders_are_made_for_every_file_of_a_run(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_mesh("a.ply", AnnotatedMesh(shapes.icosphere(0)))
    words = ["batch", "a.ply", "-o", "out/{stem}.vtu", "--", "info", "--plot=pictures/{stem}.png"]
    assert run("batch", "--dry-run", *words[1:]).exit_code == 0 and not Path("pictures").exists()
    assert run(*words).exit_code == 0 and Path("pictures/a.png").exists() and Path("out/a.vtu").exists()


@pytest.mark.parametrize("words", [["--plot", "p.png"], ["--plot=p.png"], ["-o", "p.png"]])
def test_runs_that_would_write_one_file_are_refused(words, run, tmp_path):
    """Once the last run's file replaced the others."""
    for name in ("a", "b"):
        write_mesh(str(tmp_path / f"{name}.ply"), AnnotatedMesh(shapes.icosphere(0)))
    result = run("batch", tmp_path / "a.ply", tmp_path / "b.ply", "--", "info", *words)
    assert result.exit_code == 2
    assert "would both be written to p.png; add {stem} or {name} or {index}" in result.stderr


@pytest.mark.parametrize(("system", "is_refused"), [("win32", True), ("darwin", True), ("linux", False)])
def test_outputs_that_differ_in_case_alone_are_one_file_where_the_system_ignores_case(
    system, is_refused, monkeypatch
):
    monkeypatch.setattr(sys, "platform", system)
    inputs = ["x/Part.ply", "y/part.ply"]
    if not is_refused:
        assert len(make_tasks(inputs, {}, "{stem}.vtu", ["info"])) == 2
        return
    with pytest.raises(ParameterError, match=r"would both be written to part.vtu; add \{index\}$"):
        make_tasks(inputs, {}, "{stem}.vtu", ["info"])


def test_the_message_of_a_run_that_is_done_is_its_last_warning(inputs, monkeypatch):
    code = "import sys; print('Warning: first', file=sys.stderr); print('Warning: last', file=sys.stderr)"
    monkeypatch.setattr(process, "PROGRAM", (sys.executable, "-c", code))
    row = process.run_task(make_tasks(paths(inputs, "a.ply"), {}, None, ["info"])[0], TaskLimits())
    assert (row.status, row.message) == ("done", "Warning: last")


def test_a_run_stopped_at_a_limit_leaves_no_temporary_file_where_exit_codes_are_positive(
    tmp_path, monkeypatch
):
    """Windows gives a process that it ends the exit code 1."""
    code = (
        "import sys, time\n"
        "from ddgcli.io.output_file import atomic_output\n"
        "with atomic_output(sys.argv[-3]):\n"
        "    open(sys.argv[-3] + '.began', 'w').close()\n"
        "    time.sleep(60)\n"
    )
    monkeypatch.setattr(process, "PROGRAM", (sys.executable, "-c", code))
    began = tmp_path / "a.vtu.began"

    def stop_by_code_1(child):
        child.kill()
        child.wait()
        child.returncode = 1

    monkeypatch.setattr(process, "_kill", stop_by_code_1)
    stop = threading.Event()
    (tmp_path / "a.ply").write_text("a")
    task = make_tasks([str(tmp_path / "a.ply")], {}, str(tmp_path / "{stem}.vtu"), ["info"])[0]
    with ThreadPoolExecutor() as pool:
        row = pool.submit(process.run_task, task, TaskLimits(seconds=60.0), stop=stop)
        while not (began.exists() or row.done()):
            time.sleep(0.02)
        stop.set()
    assert (row.result().status, row.result().exit_code) == ("killed", None)
    assert {path.name for path in tmp_path.iterdir()} == {"a.ply", began.name}


def test_a_value_that_is_swept_twice_is_refused():
    with pytest.raises(ParameterError, match="a value twice"):
        parsed_sweeps(["radius=1,2,1"])


@pytest.mark.parametrize("sweep", ["radius", "=1", "radius=", "radius=1,,2"])
def test_sweeps_need_a_name_and_values(sweep):
    with pytest.raises(ParameterError, match="NAME=V1,V2"):
        parsed_sweeps([sweep])


def test_one_hanging_greedy_or_failing_run_does_not_stop_the_rest(stub, inputs):
    names = ("a.ply", "bad.ply", "hang.ply", "greedy.ply", "c.ply")
    tasks = make_tasks(paths(inputs, *names), {}, None, ["info"])
    rows = run_batch(
        tasks, TaskLimits(seconds=6.0, mebibytes=200.0), jobs=3, collect=["results.area", "results.no"]
    )
    assert [row.status for row in rows] == ["done", "failed", "timeout", "memory", "done"]
    assert rows[0].collected == {"results.area": 5, "results.no": None}
    assert rows[1].message == "Error: bad input" and rows[1].exit_code == 1
    assert rows[2].seconds < 60  # its own end
    assert len({row.sha256 for row in rows}) == 5


def test_a_resumed_batch_runs_only_what_is_missing(stub, inputs, tmp_path):
    table = str(tmp_path / "t.jsonl")
    outputs = str(tmp_path / "{stem}.out")
    tasks = make_tasks(paths(inputs, "a.ply", "bad.ply", "c.ply"), {}, outputs, ["info"])
    first = run_batch(tasks, TaskLimits(), table=table)
    journal = tmp_path / "t.jsonl.part"
    lines = journal.read_text().splitlines()
    assert len(lines) == 3
    journal.write_text(lines[0] + "\n" + lines[2][:40])  # torn
    started = []
    resumed = run_batch(
        tasks, TaskLimits(), table=table, resume=True, progress=lambda done, total: started.append(done)
    )
    assert len(started) == 2
    assert [(r.status, r.output, r.sha256) for r in resumed] == [
        (r.status, r.output, r.sha256) for r in first
    ]
    (inputs / "a.ply").write_text("changed")
    started.clear()
    run_batch(
        tasks, TaskLimits(), table=table, resume=True, progress=lambda done, total: started.append(done)
    )
    assert len(started) == 2  # the changed input, and the one that failed


def test_an_entry_of_a_journal_with_values_of_other_types_does_not_end_a_batch(tmp_path):
    task = Task(0, "a.ply", {}, None, ("info", "a.ply"))
    row = TaskRow(0, "a.ply", task.command, {}, None, "done", 0, 1.0, 1.0, "0" * 64, "", {"area": 1})
    entries = [asdict(row) | {"input": {}}, asdict(row) | {"collected": 7}, asdict(row) | {"status": []}]
    for entry, complete in zip(entries, (True, False, False), strict=True):
        (tmp_path / "t.jsonl").write_text(json.dumps(entry))
        rows = completed_rows(str(tmp_path / "t.jsonl"), [task], {"a.ply": "0" * 64}, ["area"])
        assert [r.input for r in rows.values()] == ["a.ply"] * complete


@pytest.mark.parametrize("suffix", [".csv", ".jsonl"])
def test_a_batch_with_failures_leaves_its_table_alone_and_resumes_from_it(
    stub, inputs, run, tmp_path, suffix
):
    table, ran = tmp_path / f"t{suffix}", tmp_path / "out"
    words = ("batch", *paths(inputs, "a.ply", "bad.ply", "c.ply"), "--table", table, "--collect", "results")
    words = (*words, "--collect", "results.area", "--sweep", "show=1,2", "-o", ran / "{stem}.{show}.out")
    assert run(*words, "--", "info").exit_code == 1
    assert {path.name for path in tmp_path.iterdir()} == {"in", "out", table.name}
    first, written = table.read_bytes(), {path: path.stat().st_mtime_ns for path in ran.iterdir()}
    assert len(written) == 4
    assert run(*words, "--resume", "--", "info").exit_code == 1
    assert {path: path.stat().st_mtime_ns for path in ran.iterdir()} == written
    rows = [line for line in first.splitlines() if b"bad.ply" not in line]
    assert [line for line in table.read_bytes().splitlines() if b"bad.ply" not in line] == rows
    assert run(*words, "--resume", "--", "info", "--full").exit_code == 1  # another command: all again
    assert all(path.stat().st_mtime_ns > written[path] for path in ran.iterdir())
    assert not table.with_name(table.name + ".part").exists()


def test_a_killed_run_leaves_no_temporary_file(monkeypatch, tmp_path):
    code = """
import pathlib, sys, time
from ddgcli.io.output_file import atomic_output
plot = sys.argv[sys.argv.index("--plot") + 1]
with atomic_output(sys.argv[-3]) as partial, atomic_output(plot) as picture:
    open(partial, "w").write("half")
    open(picture, "w").write("half")
    pathlib.Path(sys.argv[-3] + ".began").touch()
    time.sleep(60)
"""
    monkeypatch.setattr(process, "PROGRAM", (sys.executable, "-c", code))
    (tmp_path / "a.ply").write_text("a")
    other = tmp_path / ".a-x.vtu"
    other.write_text("of another user")
    command = ["info", "--plot", str(tmp_path / "pictures" / "{stem}.png")]
    options = ("-o", "--plot")
    tasks = make_tasks([str(tmp_path / "a.ply")], {}, str(tmp_path / "{stem}.vtu"), command, options)
    stop, began = threading.Event(), tmp_path / "a.vtu.began"
    with ThreadPoolExecutor() as pool:
        row = pool.submit(process.run_task, tasks[0], TaskLimits(seconds=60.0), stop=stop)
        while not (began.exists() or row.done()):
            time.sleep(0.02)
        partial = [path.name for path in tmp_path.rglob(".a-*")]
        stop.set()
    assert row.result().status == "killed" and len(partial) == 3
    left = {path.name for path in tmp_path.rglob("*")}
    assert left == {"a.ply", other.name, began.name, "pictures"}


def test_an_interrupted_batch_leaves_no_process(inputs, tmp_path):
    """SIGINT to the batch ends its running tasks too."""
    code = (  # a shell without job control starts background jobs, and what they start, with SIGINT ignored
        "import signal, sys\nsignal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from ddgcli.cli.batch import process\n"
        f"process.PROGRAM = (sys.executable, '-c', {STUB!r})\n"
        "from ddgcli.cli.main import main\nmain()\n"
    )
    words = ["batch", str(inputs / "hang.ply"), "--", "info"]
    running = subprocess.Popen([sys.executable, "-c", code, *words], cwd=ROOT, stderr=subprocess.PIPE)
    marker = str(inputs / "hang.ply").encode()

    def tasks():
        pids = []
        for pid in filter(str.isdigit, os.listdir("/proc")):
            try:
                line = Path(f"/proc/{pid}/cmdline").read_bytes()
            except OSError:
                continue
            pids += [pid] if marker in line and int(pid) != running.pid else []
        return pids

    for _ in range(600):
        if tasks():
            break
        time.sleep(0.05)
    assert tasks()
    running.send_signal(signal.SIGINT)
    assert running.wait(timeout=30) == 130
    assert not tasks()


def test_an_error_between_two_runs_ends_the_running_tasks(stub, inputs):
    """The caller's loop fails while a task hangs: the batch returns at once and leaves no process."""
    tasks = make_tasks(paths(inputs, "a.ply", "hang.ply"), {}, None, ["info"])

    def fail(done, total):
        raise KeyboardInterrupt

    began = time.perf_counter()
    with pytest.raises(KeyboardInterrupt):
        run_batch(tasks, TaskLimits(), jobs=2, progress=fail)
    assert time.perf_counter() - began < 60  # the end of the task that hangs


def test_a_cluster_without_an_address_is_refused_in_one_line(run, inputs):
    pytest.importorskip("distributed")
    result = run("batch", inputs / "a.ply", "--cluster", "nonsense", "--", "info")
    assert result.exit_code == 2 and "--cluster: 'nonsense' cannot be reached" in result.stderr
    assert len(result.stderr.splitlines()) == 1


def test_a_cluster_without_its_package_is_an_error_with_the_install_line(stub, inputs, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'ddgcli\[cluster\]'"):
        run_batch(make_tasks(paths(inputs, "a.ply"), {}, None, ["info"]), TaskLimits(), cluster="tcp://x:1")


def test_the_command_writes_outputs_and_a_table(run, tmp_path):
    for index, mesh in enumerate((shapes.icosphere(1), shapes.torus(9, 7))):
        write_mesh(str(tmp_path / f"m{index}.ply"), AnnotatedMesh(mesh))
    (tmp_path / "m2.ply").write_text("ply\nnonsense")
    table = tmp_path / "table.csv"
    words = ("--sweep", "scheme=cotan,corrected", "-o", tmp_path / "out" / "{stem}.{scheme}.npz")
    words += ("--table", table, "--collect", "results.area", "--jobs", "2")
    done = run("batch", "--json", str(tmp_path / "m*.ply"), *words, "--", "curvature")
    assert done.exit_code == 1
    assert json.loads(done.stdout)["results"]["status"] == {"done": 4, "failed": 2}
    rows = list(csv.DictReader(table.open()))
    assert [row["scheme"] for row in rows] == ["cotan", "corrected"] * 3
    assert float(rows[0]["results.area"]) == float(rows[1]["results.area"]) > 0
    names = {f"m{i}.{scheme}.npz" for i in (0, 1) for scheme in ("corrected", "cotan")}
    assert {path.name for path in (tmp_path / "out").iterdir()} == names
    assert rows[4]["status"] == "failed" and "m2.ply" in rows[4]["message"]


def test_json_lines_hold_whole_rows(stub, inputs, run, tmp_path):
    table = tmp_path / "t.jsonl"
    words = (inputs / "a.ply", inputs / "c.ply", "--table", table, "--", "info")
    assert run("batch", *words).exit_code == 0
    rows = [json.loads(line) for line in table.read_text().splitlines()]
    assert [row["input"] for row in rows] == paths(inputs, "a.ply", "c.ply")
    assert not (tmp_path / "t.jsonl.part").exists()


def test_a_local_dask_cluster_gives_the_same_rows(stub, inputs):
    distributed = pytest.importorskip("distributed")
    tasks = make_tasks(paths(inputs, "a.ply", "bad.ply"), {}, None, ["info"])
    with distributed.LocalCluster(n_workers=1, processes=False, dashboard_address=None) as cluster:
        rows = run_batch(tasks, TaskLimits(), cluster=cluster.scheduler_address)
    assert [row.status for row in rows] == ["done", "failed"]


def test_a_lost_connection_and_a_lost_worker_do_not_end_a_batch_on_a_cluster(stub, inputs, monkeypatch):
    distributed = pytest.importorskip("distributed")
    real, submitted = distributed.Client, []

    class Client(real):  # the first connection is lost after a task; the first try of c.ply loses its worker
        def submit(self, function, task, *words, **options):
            submitted.append(task.input)
            if len(submitted) < 3:
                return super().submit(function, task, *words, **options)
            future = super().submit(time.sleep, 60, pure=False) if len(submitted) == 3 else None
            if future is not None:
                future.cancel()
                return future
            fails = task.input.endswith("c.ply")
            return super().submit(lost_worker if fails else function, task, *words, **options)

    monkeypatch.setattr(distributed, "Client", Client)
    tasks = make_tasks(paths(inputs, "a.ply", "bad.ply", "c.ply"), {}, None, ["info"])
    with distributed.LocalCluster(n_workers=1, processes=False, dashboard_address=None) as cluster:
        rows = run_batch(tasks, TaskLimits(), cluster=cluster.scheduler_address)
    assert [row.status for row in rows] == ["done", "failed", "killed"]
    assert "the worker died" in rows[2].message and len(submitted) > 3


def lost_worker(*words):
    raise RuntimeError("the worker died")


@pytest.mark.parametrize(
    "words, text",
    [
        (("a.ply",), "put it after --"),
        (("--", "info"), "no inputs"),
        (("a.ply", "--", "check"), "no command 'check' for a batch"),
        (("a.ply", "--sweep", "radios=1", "--", "curvature"), "curvature has no option --radios"),
        (
            ("a.ply", "--sweep", "scheme=cotan", "--", "curvature", "--scheme=corrected"),
            "--sweep: scheme is swept, and --scheme is also an option after --; leave one out",
        ),
        (("a.ply", "--sweep", "threads=1,2", "--", "info", "--threads", "2"), "leave one out"),
        (("nothing*.ply", "--", "info"), "no file matches"),
        (("a.ply", "--resume", "--", "info"), "needs --table"),
        (("a.ply", "--shard", "3/2", "--", "info"), "is not I/N"),
        (("a.ply", "--table", "t.txt", "--", "info"), "unknown format .txt"),
    ],
)
def test_wrong_calls_are_refused_in_one_line(run, words, text):
    result = run("batch", *words)
    assert result.exit_code == 2 and text in result.stderr, result.stderr
    assert len(result.stderr.splitlines()) == 1


def test_a_collected_name_that_no_summary_has_is_reported(run, tmp_path):
    write_mesh(str(tmp_path / "a.ply"), AnnotatedMesh(shapes.icosphere(1)))
    words = ["batch", tmp_path / "a.ply", "--collect", "results.area", "--collect", "results.aera"]
    done = run(*words, "--", "curvature")
    assert done.exit_code == 0
    assert "no run has results.aera" in done.stderr and "results.area," not in done.stderr
