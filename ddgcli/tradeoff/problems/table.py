"""Which module asks the question of which command; a module is imported only when it is asked for."""

from __future__ import annotations

import importlib
from typing import Any

from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.tradeoff.candidates import Problem


def mesh_problem(command: str, mesh: TriangleMesh, **asked: Any) -> Problem:
    """The problem of a command on a mesh; `asked` holds the command's own options that were given."""
    module = importlib.import_module(f"ddgcli.tradeoff.problems.{command.replace('-', '_')}")
    return module.problem(mesh, **asked)
