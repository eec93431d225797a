"""Readers in confined processes."""

from __future__ import annotations

import os
import subprocess
import sys

import h5py

from ddgcli.io.mesh_file import write_mesh
from ddgcli.io.readers import guarded, hdf5_links
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.shapes import icosphere


def test_a_confined_reader_may_import_modules_that_python_has_not_compiled_yet(tmp_path):
    path = tmp_path / "sphere.xdmf"
    write_mesh(str(path), AnnotatedMesh(icosphere(1)))
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    environment["PYTHONPYCACHEPREFIX"] = str(tmp_path / "cache")
    command = [sys.executable, "-m", "ddgcli", "info", str(path), "-q"]
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert (done.returncode, done.stderr) == (0, "")


def test_the_links_of_an_hdf5_file_are_checked_once_not_at_every_access(tmp_path, monkeypatch):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["group/values"] = [1.0]
    checked = []
    monkeypatch.setattr(h5py.File, "__init__", h5py.File.__init__)  # restored at the end
    monkeypatch.setattr(hdf5_links, "refuse_outside", lambda file: checked.append(file.filename))
    guarded._check_hdf5(lambda path: None)
    with h5py.File(tmp_path / "a.h5") as file:
        assert [file.get("group").get("values")[0] for _ in range(3)] == [1.0] * 3
    assert checked == [str(tmp_path / "a.h5")]
