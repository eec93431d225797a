"""Changes of meshes: noise, rounding, spikes, smoothing, decimation and holes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array

from benchmarks.common.submesh import submesh
from ddgcli.mesh.triangle_mesh import TriangleMesh


def smoothed(times: int, mesh: TriangleMesh) -> TriangleMesh:
    """Means of neighbours, as programs smooth segmentations."""
    return _relaxed(mesh, (0.5,) * times)


def taubin(times: int, mesh: TriangleMesh) -> TriangleMesh:
    """Means of neighbours and steps back, which keep the volume, as programs smooth segmentations."""
    return _relaxed(mesh, (0.5, -0.53) * times)


def _relaxed(mesh: TriangleMesh, steps: tuple[float, ...]) -> TriangleMesh:
    """Steps towards the means of neighbours, as shares of the way."""
    edges, n = mesh.topology.edges, mesh.n_vertices
    near = csr_array((np.ones(2 * len(edges)), (edges.T.ravel(), edges.T[::-1].ravel())), shape=(n, n))
    mean = diags_array(1 / np.maximum(near.sum(axis=1), 1)) @ near
    points = mesh.points
    for share in steps:
        points = points + share * (mean @ points - points)
    return mesh.moved(points)


def decimated(share: float, mesh: TriangleMesh) -> TriangleMesh:
    """Collapse of edges by quadrics to a share of the faces (VTK)."""
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray, vtk_to_numpy
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
    from vtkmodules.vtkFiltersCore import vtkQuadricDecimation

    points, cells, data = vtkPoints(), vtkCellArray(), vtkPolyData()
    points.SetData(numpy_to_vtk(mesh.points, deep=True))
    triples = np.column_stack([np.full(mesh.n_faces, 3), mesh.faces]).astype(np.int64)
    cells.SetCells(mesh.n_faces, numpy_to_vtkIdTypeArray(triples.ravel(), deep=True))
    data.SetPoints(points)
    data.SetPolys(cells)
    decimation = vtkQuadricDecimation()
    decimation.SetInputData(data)
    decimation.SetTargetReduction(1 - share)
    decimation.Update()
    small = decimation.GetOutput()
    faces = vtk_to_numpy(small.GetPolys().GetData()).reshape(-1, 4)[:, 1:]
    used, index = np.unique(faces, return_inverse=True)
    return TriangleMesh.from_arrays(vtk_to_numpy(small.GetPoints().GetData())[used], index.reshape(-1, 3))


def _edge(mesh: TriangleMesh) -> float:
    return float(mesh.side_length.mean())


def vertex_normals(mesh: TriangleMesh) -> NDArray:
    """(n, 3) unit normals, averaged by areas."""
    corner = mesh.points[mesh.faces]
    doubled = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    total = np.zeros_like(mesh.points)
    np.add.at(total, mesh.faces.ravel(), np.repeat(doubled, 3, axis=0))
    return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-300)


def normal_noise(share: float, mesh: TriangleMesh) -> TriangleMesh:
    """Independent normal displacements along the normals."""
    heights = np.random.default_rng(1).standard_normal((mesh.n_vertices, 1))
    return mesh.moved(mesh.points + share * _edge(mesh) * heights * vertex_normals(mesh))


def half_noise(share: float, mesh: TriangleMesh) -> TriangleMesh:
    """Normal displacements along the normals on one half of the surface."""
    heights = np.random.default_rng(8).standard_normal((mesh.n_vertices, 1))
    half = mesh.points[:, :1] > np.median(mesh.points[:, 0])
    return mesh.moved(mesh.points + share * _edge(mesh) * half * heights * vertex_normals(mesh))


def layers(share: float, mesh: TriangleMesh) -> TriangleMesh:
    """The third coordinate alone in whole multiples of a share of an edge, as in layers of a printer."""
    step = share * _edge(mesh)
    third = step * np.rint(mesh.points[:, 2] / step)
    return mesh.moved(np.column_stack([mesh.points[:, :2], third]))


def isotropic_noise(share: float, mesh: TriangleMesh) -> TriangleMesh:
    """Independent normal displacements of all coordinates."""
    return mesh.moved(
        mesh.points + share * _edge(mesh) * np.random.default_rng(2).standard_normal(mesh.points.shape)
    )


def correlated_noise(share: float, times: int, mesh: TriangleMesh) -> TriangleMesh:
    """Displacements along the normals, averaged over neighbours so many times and scaled up again."""
    heights = np.random.default_rng(3).standard_normal((mesh.n_vertices, 3))
    heights = smoothed(times, mesh.moved(heights)).points[:, :1]
    return mesh.moved(mesh.points + share * _edge(mesh) * heights / heights.std() * vertex_normals(mesh))


def line_noise(share: float, mesh: TriangleMesh) -> TriangleMesh:
    """Each scan line, a band of the width of half an edge in y, at a height of its own."""
    edge = _edge(mesh)
    line = np.rint(mesh.points[:, 1] / (0.5 * edge)).astype(int)
    heights = np.random.default_rng(4).standard_normal(np.ptp(line) + 1)[line - line.min()]
    return mesh.moved(mesh.points + share * edge * heights[:, None] * vertex_normals(mesh))


def rounded(share: float, mesh: TriangleMesh) -> TriangleMesh:
    """Coordinates in whole multiples of a share of an edge."""
    step = share * _edge(mesh)
    return mesh.moved(step * np.rint(mesh.points / step))


def far_in_single_precision(share: float, mesh: TriangleMesh) -> TriangleMesh:
    """Single precision so far from the origin that its spacing is a share of an edge."""
    offset = 2.0 ** np.rint(np.log2(share * _edge(mesh) * 2**23))
    return mesh.moved((mesh.points + 1.5 * offset).astype(np.float32).astype(np.float64) - 1.5 * offset)


def spikes(share: float, height: float, mesh: TriangleMesh) -> TriangleMesh:
    """A share of the vertices, moved along the normal by a height in edges, outward or inward."""
    rng = np.random.default_rng(5)
    moved = rng.random(mesh.n_vertices) < share
    size = height * _edge(mesh) * rng.choice([-1.0, 1.0], mesh.n_vertices)
    return mesh.moved(mesh.points + (moved * size)[:, None] * vertex_normals(mesh))


def holes(share: float, mesh: TriangleMesh) -> TriangleMesh:
    """Without a share of the faces."""
    return submesh(mesh, mesh.faces[np.random.default_rng(6).random(mesh.n_faces) >= share])
