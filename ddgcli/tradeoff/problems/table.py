"""Table of the problems of mesh commands; a problem's module is imported on demand."""

from __future__ import annotations

import importlib
from typing import Any

from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.tradeoff.candidates import Problem


def mesh_problem(command: str, mesh: TriangleMesh, **keywords: Any) -> Problem:
    """Problem of a command on a mesh; its module is imported on demand.

    Parameters
    ----------
    command : str
    mesh : TriangleMesh
    **keywords
        Of the `problem` function of the command.

    Returns
    -------
    Problem
    """
    module = importlib.import_module(f"ddgcli.tradeoff.problems.{command.replace('-', '_')}")
    return module.problem(mesh, **keywords)
