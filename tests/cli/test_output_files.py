"""Outputs never replace an input or each other, and a failed write leaves the old file."""

import os

import numpy as np
import pytest

from ddgcli.errors import OutputError
from ddgcli.io.mesh_file import read_mesh, write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from tests.cli.test_command_group import refused


def test_wrong_outputs_are_refused_before_reading(run, tmp_path):
    nowhere = tmp_path / "nowhere.ply"  # never read: the output is looked at first
    refused(run("info", nowhere, "-o", tmp_path / "a.foo"), "a.foo", ".vtu")
    refused(run("info", nowhere, "-o", tmp_path / "missing" / "a.vtu"), "missing", "create")
    refused(run("info", nowhere, "-o", tmp_path), str(tmp_path))
    refused(run("info", nowhere, "-o", "-"), "--output-format")
    refused(run("info", nowhere, "-o", "-", "--output-format", "ply", "--json"), "--json")
    refused(run("info", nowhere, "--plot", tmp_path / "a.gif"), ".png")
    refused(run("info", nowhere, "-q", "-v"), "-q")
    refused(run("info", nowhere), "no such file")
    refused(run("info", tmp_path), "is a folder")


@pytest.mark.skipif(os.name != "posix", reason="the umask is of POSIX systems")
def test_permissions_are_those_of_the_umask_or_of_the_replaced_file(tmp_path, monkeypatch):
    """To read the umask is to change it: a file of another thread then had all permissions."""
    before = os.umask(0o027)
    try:
        with monkeypatch.context() as patch:
            patch.setattr(os, "umask", lambda mask: pytest.fail("the umask was changed"))
            write_mesh(str(tmp_path / "a.ply"), AnnotatedMesh(shapes.box()))
            os.chmod(tmp_path / "a.ply", 0o604)
            write_mesh(str(tmp_path / "a.ply"), AnnotatedMesh(shapes.box()))
            write_mesh(str(tmp_path / "b.ply"), AnnotatedMesh(shapes.box()))
    finally:
        os.umask(before)
    assert [os.stat(tmp_path / name).st_mode & 0o777 for name in ("a.ply", "b.ply")] == [0o604, 0o640]


def test_two_outputs_with_one_name_are_an_error(run, torus, tmp_path):
    one, same = tmp_path / "a.npz", f"{tmp_path}/./a.npz"
    refused(run("delaunay", torus, "-o", one, "--overlay", same), "a.npz", "two outputs")
    refused(run("laplacian", torus, "--matrix", one, "--mass-matrix", one), "a.npz", "two outputs")
    refused(run("info", torus, "-o", one, "-o", same), "a.npz", "two outputs")
    lines = ("geodesic", torus, "--source", 0, "--isolines", 2)
    refused(run(*lines, "-o", one, "--paths-output", same), "a.npz", "two outputs")
    link = tmp_path / "link.npz"
    link.symlink_to(one)
    refused(run("info", torus, "-o", one, "-o", link), "link.npz", "two outputs")
    assert not one.exists()


def test_the_input_is_never_overwritten(run, torus, tmp_path):
    before = torus.read_bytes()
    refused(run("info", torus, "-o", torus), "input")
    link = tmp_path / "link.ply"
    link.symlink_to(torus)
    refused(run("info", torus, "-o", link), "input")
    for place in (torus, link):  # outputs that are not -o
        refused(run("geodesic", torus, "--source", 0, "--isolines", 2, "--paths-output", place), "input")
        refused(run("delaunay", torus, "--overlay", place), "input")
    assert torus.read_bytes() == before


def test_an_array_that_is_read_is_never_overwritten(run, torus, tmp_path):
    array = tmp_path / "array.npz"
    np.savez(array, np.cross([0, 0, 1.0], read_mesh(str(torus)).mesh.points))
    before = array.read_bytes()
    refused(run("geodesic", torus, "--field", array, "--paths-output", array), "input")
    refused(run("hodge", torus, "--field-file", array, "-o", array), "input")
    refused(run("laplacian", torus, "--poisson", array, "--matrix", array), "input")
    assert array.read_bytes() == before


def test_an_unplanned_output_cannot_overwrite_the_input(run, torus, monkeypatch):
    """A command that does not plan an output cannot write it over the input either."""
    monkeypatch.setattr("ddgcli.cli.run.Run.plan_output", lambda *words: None)
    before = torus.read_bytes()
    refused(run("geodesic", torus, "--source", 0, "--isolines", 2, "--paths-output", torus), "input")
    assert torus.read_bytes() == before


def test_two_outputs_are_written_and_replaced(summary, torus, tmp_path):
    paths = [tmp_path / "a.vtu", tmp_path / "b.npz"]
    for _ in range(2):
        document = summary("info", torus, "-o", paths[0], "-o", paths[1])
        assert document["outputs"] == [str(p) for p in paths]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.vtu", "b.npz", "torus.ply"]


def test_a_failed_write_leaves_the_old_file(run, torus, tmp_path, monkeypatch):
    output = tmp_path / "a.vtu"
    output.write_text("old")

    def full(source, target):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", full)
    refused(run("info", torus, "-o", output), "No space left")
    assert output.read_text() == "old"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.vtu", "torus.ply"]


def test_an_error_in_a_later_output_leaves_none(run, torus, tmp_path):
    before = sorted(tmp_path.iterdir())
    wrong = ("-o", tmp_path / "a.ply", "--colors", "missing")  # known when this output is written
    refused(run("laplacian", torus, "--mass-matrix", tmp_path / "m.mtx", *wrong), "missing")
    refused(run("geodesic", torus, "--source", 0, "-o", tmp_path / "b.npz", *wrong), "missing")
    refused(run("shell-sim", torus, "--effect", "gravity", "--steps", 1, "--dt", 1e-3,
                "-o", tmp_path / "c.vtkhdf", *wrong), "missing")  # fmt: skip
    refused(
        run("laplacian", torus, "--heat", 0, "--duration", 1, "-o", tmp_path / "d.vtkhdf", *wrong), "missing"
    )
    assert sorted(tmp_path.iterdir()) == before


def test_a_trajectory_takes_its_place_with_the_other_outputs(run, torus, tmp_path, monkeypatch):
    """It was in place before the mesh of the last frame failed; now the whole run stays, to be resumed."""
    from ddgcli.cli.simulation import simulate

    target = tmp_path / "run.vtkhdf"
    target.write_text("old")
    call = ("shell-sim", torus, "--effect", "gravity", "--steps", 1, "--dt", 1e-3)
    outputs = ("-o", target, "-o", tmp_path / "last.ply")
    with monkeypatch.context() as patch:

        def full(*args):
            raise OutputError("last.ply: cannot be written (No space left)")

        patch.setattr(simulate, "_write_last", full)
        refused(run(*call, *outputs), "No space left")
    assert target.read_text() == "old" and not (tmp_path / "last.ply").exists()
    whole = tmp_path / "run.vtkhdf.part"
    assert whole.exists()
    assert run("shell-sim", "--resume", whole, *outputs).exit_code == 0
    assert not whole.exists() and target.stat().st_size > 1000 and (tmp_path / "last.ply").exists()


def test_outputs_of_a_run_that_did_not_converge_are_written(run, torus, tmp_path):
    call = ("delaunay", torus, "--refine", 30, "--max-points", 1)
    result = run(*call, "-o", tmp_path / "a.npz", "--overlay", tmp_path / "b.vtu")
    assert result.exit_code == 1
    assert {"a.npz", "b.vtu"} <= {path.name for path in tmp_path.iterdir()}


def test_a_folder_for_outputs_that_are_refused_is_removed(tmp_path):
    from ddgcli.io.output_file import write_atomically
    from ddgcli.io.temporary import StagedOutputs

    staged, old = StagedOutputs(), tmp_path / "old"
    old.mkdir()
    staged.make_folder(tmp_path / "new" / "inner")
    for path in (tmp_path / "new" / "inner" / "a", old / "a"):
        write_atomically(str(path), b"1", staged=staged)
    staged.discard()
    assert [*tmp_path.rglob("*")] == [old]
    write_atomically(str(old / "a"), b"2", staged=staged)
    assert not (old / "a").exists()
    staged.commit()
    assert [path.read_bytes() for path in old.iterdir()] == [b"2"]


def test_the_same_run_writes_the_same_bytes(run, torus, tmp_path):
    output, written = tmp_path / "a.vtu", []
    for _ in range(2):
        assert run("info", torus, "-o", output, "--units-note", "mm").exit_code == 0
        written.append(output.read_bytes())
    assert written[0] == written[1]
    for word in (b"ddgcli info", b"input_sha256", b"units_note", b"converged"):
        assert word in written[0]
