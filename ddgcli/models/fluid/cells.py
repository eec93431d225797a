"""Areas of the vertices' cells, over which vorticity and amounts are integrated."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.operators.laplacian import lumped_vertex_area, voronoi_vertex_area


def cell_area(mesh: SurfaceMesh) -> NDArray[np.float64]:
    """Areas of the vertices' cells: thirds of the faces inside, mixed Voronoi cells along the boundary.

    At a wall the vorticity is the circulation around half a cell over its area. Where neighbours on the wall
    have unequal numbers of triangles (alternating diagonals), only the Voronoi cell is half of the distance
    to the vertices inside, as Thom's formula has it: with thirds the vorticity is of first order there.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh

    Returns
    -------
    (n,) ndarray of float64
        In length^2; the cells along the boundary are scaled to the total of the thirds.
    """
    area = lumped_vertex_area(mesh)
    topology = mesh.topology
    rim = np.flatnonzero(topology.boundary_vertex)
    if not len(rim):
        return area
    cell = voronoi_vertex_area(mesh)[rim]
    label, count = topology.vertex_component[rim], topology.n_components
    thirds, cells = sum_by_index(label, area[rim], count), sum_by_index(label, cell, count)
    scale = np.divide(thirds, cells, out=np.ones(count), where=cells > 0)
    area = np.array(area)
    area[rim] = scale[label] * cell
    return area
