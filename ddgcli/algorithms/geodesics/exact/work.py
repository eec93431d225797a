"""Work of an exact run, predicted from the vertices nearest to the sources."""

from __future__ import annotations

import numpy as np

from ddgcli.algorithms.geodesics.exact.start import start_wavefront
from ddgcli.algorithms.geodesics.exact.tables import window_tables
from ddgcli.algorithms.geodesics.exact.tolerance import NearestVertices
from ddgcli.algorithms.geodesics.sources import Sources
from ddgcli.errors import SolveError
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh

MOST_NEAR_VERTICES = 20_000
WINDOWS_PER_VERTEX, ROUNDS_PER_VERTEX = 1000.0, 2.0  # of the near ones: beyond, faces are degenerate


def predicted_windows(mesh: SurfaceMesh, sources: Sources, reachable: int) -> float | None:
    """Windows of a run from vertices and points, by those that the nearest tenth of the vertices takes.

    Rough surfaces stop windows soon, flat and stretched ones do not: no count of faces or of edge paths
    shows that.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    sources : Sources
    reachable : int
        Vertices that a path joins to a source.

    Returns
    -------
    float or None
        None where the faces are degenerate.
    """
    tables, most = window_tables(mesh), min(mesh.n_vertices, MOST_NEAR_VERTICES)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        wavefront, _ = start_wavefront(
            mesh, sources, SurfacePoints.none(), tables, 10, False,
            slack=0.0, max_rounds=1000.0 + ROUNDS_PER_VERTEX * most,
        )  # fmt: skip
        try:
            near = NearestVertices.measure(wavefront, 1e6 + WINDOWS_PER_VERTEX * most, MOST_NEAR_VERTICES)
        except SolveError:
            return None
    return near.windows + near.further_work(reachable)
