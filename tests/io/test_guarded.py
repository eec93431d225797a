"""Readers in confined processes."""

from __future__ import annotations

import os
import subprocess
import sys

from ddgcli.io.mesh_file import write_mesh
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
