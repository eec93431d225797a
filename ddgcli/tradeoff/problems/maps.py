"""Maps of a surface to the plane, compared by their conformal distortion."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.conformal.conformal_map import OPERATORS, conformal_map
from ddgcli.algorithms.laplacian.laplace_operator import LaplaceOperator, laplace_operator
from ddgcli.algorithms.laplacian.parameterize import (
    boundary_loops,
    parameterize_conformal,
    parameterize_harmonic,
)
from ddgcli.choices import PARAMETERIZATIONS
from ddgcli.errors import ParameterError, SolveError
from ddgcli.mesh.shapes import midpoint_subdivided
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.tradeoff.candidates import NO_OPTIONS, Candidate, CommandOptions, Problem, Reference

FLATTEN = {"harmonic": parameterize_harmonic, "conformal": parameterize_conformal}
# seconds of a vertex, relative to each other: one solve, an inverse iteration, Newton steps with flips
WORK = {"harmonic": 1e-5, "conformal": 5e-5, "discrete-conformal": 3e-4}


def problem(mesh: TriangleMesh, *, options: CommandOptions = NO_OPTIONS) -> Problem:
    """Ratio of the singular values of maps to the plane on the faces of the input, 1 where conformal.

    `options` may contain `operator` and `subdivide`. The reference is the conformal map itself, whose ratio
    is known without the map.
    """
    operator = options.get("operator")
    if operator is not None and operator not in OPERATORS:
        raise ParameterError(
            f"{operator} defines no map; compare {' and '.join(OPERATORS)}", parameter="operator"
        )
    boundary_loops(mesh, "a comparison of maps")
    one = Reference.from_truth("a conformal map has the ratio 1", np.ones(mesh.n_faces))
    levels = (0, 1) if "subdivide" not in options else (options["subdivide"],)
    return Problem(
        candidates=[
            _candidate(mesh, method, name, level)
            for level in levels
            for method in PARAMETERIZATIONS
            for name in OPERATORS
            if name == (operator or name)
        ],
        references=[(0.0, lambda: one)],
        error=lambda answer, truth: np.nan_to_num(answer - truth, nan=np.inf),
        error_scale="1, the ratio of the singular values of a conformal map, on the faces of the input",
        place="face",
        query="map",
    )


def _candidate(mesh: TriangleMesh, method: str, operator: str, level: int) -> Candidate:
    def setup() -> tuple[TriangleMesh, LaplaceOperator | None]:
        finer = midpoint_subdivided(mesh, level)
        return finer, None if method not in FLATTEN else laplace_operator(finer, operator)

    return Candidate(
        method,
        {"operator": operator} | ({"subdivide": level} if level else {}),
        setup,
        lambda start: face_means(distortion(start[0], method, operator, start[1]), mesh.n_faces),
        {"parameterize": method, "operator": operator} | ({"subdivide": str(level)} if level else {}),
        1e-2 + WORK[method] * mesh.n_vertices * 4**level,
    )


def distortion(
    mesh: TriangleMesh, method: str, operator: str, laplacian: LaplaceOperator | None
) -> NDArray[np.float64]:
    """(m,) ratio of the singular values of a map on the faces of a mesh."""
    if laplacian is not None:
        flat = FLATTEN[method](mesh, laplacian)
        converged, arrays = flat.converged, flat.distortion
    else:
        conformal = conformal_map(mesh, operator=operator)
        converged, arrays = conformal.converged, conformal.distortion()
    if not arrays:
        raise SolveError("the map is cut open along seams; no distortion on the faces of the input")
    if not converged:
        raise SolveError("the map did not converge")
    return arrays["conformal_distortion"]


def face_means(values: NDArray, n_faces: int) -> NDArray[np.float64]:
    """(m,) means over the faces of a mesh from values on the equal pieces of its midpoint subdivision."""
    while len(values) > n_faces:
        values = values.reshape(4, -1).mean(axis=0)
    return values
