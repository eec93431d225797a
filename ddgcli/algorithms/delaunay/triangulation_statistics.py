"""Counts, angles and energy of a triangulation, and residuals of a metric after flips."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.delaunay.triangulation import (
    length_scale,
    negative_cotan_edges,
    non_delaunay_edges,
)
from ddgcli.geometry.extrinsic import face_area_vector
from ddgcli.geometry.intrinsic import BLOCK_FACES, corner_angle, corner_cotan, face_area
from ddgcli.geometry.unfolding import face_corner_angle
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import NEXT, PREVIOUS
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import row_matrix, vector_length
from ddgcli.operators.mollify import mollify_mesh


def triangulation_statistics(
    mesh: SurfaceMesh, mollified: SurfaceMesh | None = None, *, condition: bool = False
) -> dict[str, Any]:
    """Counts and angles of one triangulation.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    mollified : TriangleMesh or IntrinsicMesh, optional
        The same mesh without degenerate faces, for the matrix.
    condition : bool

    Returns
    -------
    dict
        `non_delaunay_edges` (interior, opposite angles above pi + 1e-9), `negative_cotan_edges` (boundary
        edges included), `min_angle_degrees`, `max_angle_degrees`, `self_edges`, `multi_edges` (edges that
        share both ends with another one), `dirichlet_energy` of the positions (None where there are none),
        and `laplacian_condition` if `condition` is True.
    """
    angle = np.degrees(corner_angle(mesh.side_length))
    least_angle, greatest_angle = float(angle.min()), float(angle.max())
    del angle
    edges = np.sort(mesh.topology.edges, axis=1)
    loop = edges[:, 0] == edges[:, 1]
    proper = mollify_mesh(mollified or mesh)[0]  # the flips have warned of degenerate faces
    statistics = {
        "non_delaunay_edges": int(non_delaunay_edges(mesh).sum()),
        "negative_cotan_edges": negative_cotan_edges(mesh),
        "min_angle_degrees": least_angle,
        "max_angle_degrees": greatest_angle,
        "self_edges": int(loop.sum()),
        "multi_edges": _repeated(edges[~loop], mesh.n_vertices),
        "dirichlet_energy": None if mesh.points is None else dirichlet_energy(proper, mesh.points),
    }
    if condition:
        from ddgcli.linalg.condition import condition_number
        from ddgcli.operators.laplacian import stiffness

        statistics["laplacian_condition"] = condition_number(stiffness(proper))
    return statistics


def _repeated(edges: NDArray, n_vertices: int) -> int:
    """Number of edges whose two ends are those of another edge."""
    key = np.sort(edges[:, 0] * np.int64(n_vertices) + edges[:, 1])
    same = key[1:] == key[:-1]
    return int((np.append(same, False) | np.append(False, same)).sum())


def dirichlet_energy(mesh: SurfaceMesh, values: NDArray) -> float:
    """Half the Dirichlet integral of the interpolants of vertex values (n,) or (n, k), summed over columns.

    For the positions on the input triangulation it is the area; every Delaunay flip lowers it (Rippa 1990).
    A sum over sides: the product with the matrix would cancel where cotangents are large (needles).
    """
    values, energy = row_matrix(values), 0.0
    for begin in range(0, mesh.n_faces, BLOCK_FACES):
        block = slice(begin, begin + BLOCK_FACES)
        corner = values[mesh.faces[block]]
        difference = corner[:, NEXT] - corner
        cotan = corner_cotan(mesh.side_length[block])[:, PREVIOUS]  # side j is opposite corner j + 2
        energy += 0.25 * float(np.einsum("fj,fjk,fjk->", cotan, difference, difference))
    return energy


def metric_residuals(before: SurfaceMesh, after: SurfaceMesh) -> dict[str, float]:
    """Residuals of the metric after flips and insertions, which preserve it in exact arithmetic.

    Parameters
    ----------
    before, after : TriangleMesh or IntrinsicMesh

    Returns
    -------
    dict
        `area_residual`: change of the area relative to it; `angle_defect_residual`: largest change of an
        angle defect (inserted vertices must have none) relative to a full turn.
    """
    scale = length_scale(before.side_length)  # areas of tiny and huge surfaces leave the range of float64
    area0, area1 = _area(before, scale), _area(after, scale)
    change = _defect(after)
    change[: before.n_vertices] -= _defect(before)
    return {
        "area_residual": float(abs(area1 - area0) / area0) if area0 > 0 else float("nan"),
        "angle_defect_residual": float(np.abs(change).max(initial=0.0) / (2 * np.pi)),
    }


def _area(mesh: SurfaceMesh, scale: float) -> float:
    """Area over scale squared, from positions if the mesh has them: lengths lose the heights of caps."""
    if isinstance(mesh, TriangleMesh):
        return float(vector_length(face_area_vector(mesh.moved_unchecked(mesh.points / scale))).sum())
    return float(face_area(mesh.side_length / scale).sum())


def _defect(mesh: SurfaceMesh) -> NDArray[np.float64]:
    """(n,) angle defects, from positions if the mesh has them."""
    topology = mesh.topology
    total = sum_by_index(mesh.faces, face_corner_angle(mesh), mesh.n_vertices)
    full = np.where(topology.boundary_vertex, np.pi, 2 * np.pi)
    return np.where(topology.referenced_vertex, full - total, 0.0)
