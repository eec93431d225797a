"""Checks of Laplacian tasks against a mesh before anything is computed, and the names of their arrays.

The module of a task is imported for that task only: to import the solvers takes a tenth of a second.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.conformal.distortion import DISTORTION_ARRAYS
from ddgcli.algorithms.laplacian.laplace_operator import check_operator
from ddgcli.algorithms.laplacian.tasks import LaplacianTasks
from ddgcli.choices import CONFORMAL_BOUNDARIES
from ddgcli.errors import ParameterError, renamed_parameters
from ddgcli.mesh.components import connected_labels
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh

BOUNDARY_REMEDY = "take their boundary, `boundary_mesh`"


def check_tasks(mesh: TriangleMesh | TetMesh, tasks: LaplacianTasks) -> None:
    """Raise the errors of `solve_laplacian_tasks`, before it computes.

    Parameters
    ----------
    mesh : TriangleMesh or TetMesh
    tasks : LaplacianTasks

    Raises
    ------
    ParameterError, MeshError
    """
    for task in ("smooth", "parameterize") if isinstance(mesh, TetMesh) else ():
        if getattr(tasks, task) is not None:
            raise ParameterError(
                f"needs a surface, and the mesh has tetrahedra; {BOUNDARY_REMEDY}", parameter=task
            )
    check_operator(mesh, tasks.operator, tasks.mass)
    if tasks.eigen is not None:
        from ddgcli.algorithms.laplacian.spectrum import check_pair_count

        with renamed_parameters(k="eigen"):
            check_pair_count(tasks.eigen, int(np.count_nonzero(_is_of_cells(mesh))))
    if tasks.form_eigen:
        from ddgcli.algorithms.laplacian.form_spectrum import check_forms

        with renamed_parameters(k="form_eigen"):
            check_forms(mesh, tasks.form_eigen)
    if tasks.poisson is not None:
        from ddgcli.algorithms.laplacian.poisson import checked_source

        with renamed_parameters(source="poisson"):
            checked_source(tasks.poisson, mesh.n_vertices)
    if tasks.fixed and (tasks.harmonic or tasks.poisson is not None):
        _check_fixed(mesh, tasks.fixed)
    if tasks.parameterize == "discrete-conformal" and isinstance(mesh, TriangleMesh):
        from ddgcli.algorithms.conformal.conformal_map import check_conformal_map

        check_conformal_map(
            mesh, tasks.cones, tasks.boundary or CONFORMAL_BOUNDARIES[0], tasks.boundary_values,
            tasks.operator,
        )  # fmt: skip
    elif tasks.parameterize and isinstance(mesh, TriangleMesh):
        from ddgcli.algorithms.laplacian.parameterize import boundary_loops, require_size_at_boundary

        loops = boundary_loops(mesh, f"a {tasks.parameterize} map")
        require_size_at_boundary(loops, _is_of_cells(mesh))


def check_evolution(
    mesh: TriangleMesh | TetMesh, start: NDArray | int, operator: str | None, mass: str
) -> None:
    """Raise the errors of `solve_evolution` and its operator, before they compute.

    Parameters
    ----------
    mesh : TriangleMesh or TetMesh
    start : (n,) ndarray or int
        As in `solve_evolution`.
    operator : str or None
    mass : str
        As in `laplace_operator`.

    Raises
    ------
    ParameterError, MeshError
    """
    from ddgcli.algorithms.laplacian.evolution import check_start_vertex, checked_start

    check_operator(mesh, operator, mass)
    if isinstance(start, int):
        check_start_vertex(start, mesh.n_vertices, _is_of_cells(mesh))
    else:
        checked_start(start, mesh.n_vertices)


def array_names(mesh: TriangleMesh | TetMesh, tasks: LaplacianTasks) -> dict[str, list[str]]:
    """Names of the vertex and the face arrays of `solve_laplacian_tasks`.

    Parameters
    ----------
    mesh : TriangleMesh or TetMesh
    tasks : LaplacianTasks

    Returns
    -------
    dict
        Lists of names under `vertex` and `face`.
    """
    vertex = ["vertex_volume" if isinstance(mesh, TetMesh) else "vertex_area"]
    vertex += [f"eigenvector_{i:03d}" for i in range(tasks.eigen or 0)]
    vertex += [f"hks_{i:03d}" for i in range(len(tasks.hks))]
    vertex += ["poisson"] * (tasks.poisson is not None) + ["harmonic"] * tasks.harmonic
    vertex += ["displacement"] * (tasks.smooth is not None)
    face = [f"eigenform_vectors_{i:03d}" for i in range(tasks.form_eigen or 0)]
    if tasks.parameterize is not None:
        vertex.append("uv")
        face += DISTORTION_ARRAYS
    if tasks.parameterize == "discrete-conformal":
        vertex += ["log_scale_factor", "angle_sum"]
    return {"vertex": vertex, "face": face}


def _check_fixed(mesh: TriangleMesh | TetMesh, fixed: Mapping[int, float]) -> None:
    """Vertices of the mesh, and one at least on each of its components."""
    from ddgcli.algorithms.laplacian.poisson import check_fixed_vertices, refuse_floating

    check_fixed_vertices(fixed, mesh.n_vertices)
    cells = mesh.tetrahedra if isinstance(mesh, TetMesh) else mesh.faces
    ends = cells[:, :-1].ravel(), cells[:, 1:].ravel()
    refuse_floating(connected_labels(*ends, mesh.n_vertices)[1], np.flatnonzero(_is_of_cells(mesh)), fixed)


def _is_of_cells(mesh: TriangleMesh | TetMesh) -> NDArray[np.bool_]:
    """(n,) whether a cell with a size uses a vertex."""
    if isinstance(mesh, TetMesh):
        cells = mesh.tetrahedra[mesh.signed_volume != 0]
    else:
        cells = mesh.faces
    is_corner = np.zeros(mesh.n_vertices, dtype=bool)
    is_corner[cells.ravel()] = True
    return is_corner
