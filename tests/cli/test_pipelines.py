"""The snippet of docs/pipelines.md turns a folder into results, and does again only what changed."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh

ROOT = Path(__file__).parents[2]


@pytest.fixture
def folder(tmp_path):
    if shutil.which("make") is None:
        pytest.skip("make is not installed")
    text = (ROOT / "docs" / "pipelines.md").read_text(encoding="utf-8")
    (snippet,) = re.findall(r"```make\n(MESHES = .*?)```", text, flags=re.DOTALL)
    (tmp_path / "Makefile").write_text(snippet)
    (tmp_path / "meshes").mkdir()
    write_mesh(str(tmp_path / "meshes" / "a.ply"), AnnotatedMesh(shapes.icosphere(1)))
    write_mesh(str(tmp_path / "meshes" / "b.obj"), AnnotatedMesh(shapes.torus(8, 6)))
    return tmp_path


# a stand-in for the program: writes what -o and --plot name, in a hundredth of the time
STAND_IN = """#!/bin/sh
while [ $# -gt 0 ]; do
  case "$1" in -o|--plot) shift; echo done > "$1";; esac
  shift
done
"""


def make(folder: Path, program: str | None = None) -> str:
    done = subprocess.run(
        ["make", "-j2", f"DDGCLI={program or f'{sys.executable} -m ddgcli'}"],
        cwd=folder, env={"PYTHONPATH": str(ROOT), "PATH": "/usr/bin:/bin", "HOME": str(folder)},
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_only_what_changed_is_done_again(folder):
    later = (folder / "meshes" / "b.obj").rename(folder / "b.obj")
    make(folder)
    assert sorted(p.name for p in (folder / "build").iterdir()) == ["a.curvature.png", "a.curvature.vtu"]
    (folder / "stand-in").write_text(STAND_IN)
    (folder / "stand-in").chmod(0o755)
    later.rename(folder / "meshes" / "b.obj")
    added = make(folder, "./stand-in")
    assert "b.obj" in added and "a.ply" not in added
    built = sorted(p.name for p in (folder / "build").iterdir())
    assert built == ["a.curvature.png", "a.curvature.vtu", "b.curvature.png", "b.curvature.vtu"]
    assert " curvature " not in make(folder, "./stand-in")
    newer = (folder / "build" / "a.curvature.vtu").stat().st_mtime + 10
    os.utime(folder / "meshes" / "a.ply", (newer, newer))
    again = make(folder, "./stand-in")
    assert "a.ply" in again and "b.obj" not in again


def test_every_readable_extension_in_any_case_is_taken_and_the_rest_is_named(folder):
    meshes = folder / "meshes"
    shutil.copy(meshes / "a.ply", meshes / "C.PLY")
    shutil.copy(meshes / "b.obj", meshes / "a.Obj")  # the same stem as a.ply
    write_mesh(str(meshes / "d.vtkhdf"), AnnotatedMesh(shapes.icosphere(0)))
    (meshes / "notes.md").write_text("no mesh")
    shutil.copy(meshes / "a.ply", meshes / "two words.ply")
    (folder / "stand-in").write_text(STAND_IN)
    (folder / "stand-in").chmod(0o755)
    text = make(folder, "./stand-in")
    built = {p.name for p in (folder / "build").glob("*.vtu")}
    assert built == {f"{name}.curvature.vtu" for name in ("a.ply", "a.Obj", "b", "C", "d")}
    (line,) = [x for x in text.splitlines() if x.startswith("skipped")]
    assert "notes.md" in line and "two words.ply" in line and "C.PLY" not in line


@pytest.mark.parametrize("file", ["Makefile", "docs/pipelines.md"])
def test_the_recipes_know_every_readable_extension(file):
    from ddgcli.io.mesh_file import READERS
    from ddgcli.io.readers import foreign

    text = (ROOT / file).read_text("utf-8").replace("\\\n", " ")
    (listed,) = re.findall(r"^EXTENSIONS = (.*)$", text, re.M)
    assert {f".{word}" for word in listed.split()} == {*READERS, *foreign.suffixes()}


SWING = """format = "ddgcli-scene/1"
[[object]]
name = "sheet"
role = "shell"
mesh = "sheet.ply"
material = "cotton"
[effects]
gravity = {}
"""


def test_a_scene_and_the_mesh_of_the_quick_form_come_from_standard_input(tmp_path, monkeypatch, run):
    monkeypatch.chdir(tmp_path)
    write_mesh("sheet.ply", AnnotatedMesh(shapes.grid(2, 2)))
    words = ("--steps", 2, "--dt", 0.01, "--json")

    def energies(*call, **stdin):
        result = run("shell-sim", *call, *words, **stdin)
        assert result.exit_code == 0, result.stderr
        return json.loads(result.stdout)["results"]["energies"]

    (tmp_path / "swing.toml").write_text(SWING)
    from_file = energies("swing.toml")
    assert energies("-", "--input-format", "toml", input=SWING) == from_file
    mesh = (tmp_path / "sheet.ply").read_bytes()
    quick = ("--material", "cotton", "--effect", "gravity")
    assert energies("-", "--input-format", "ply", *quick, input=mesh) == from_file
    refused = run("shell-sim", "-", *words, input=SWING)
    assert refused.exit_code == 2 and "--input-format toml" in refused.stderr
