"""Meshes of the benches: irregular, stretched, noisy, sheared and real, by number of faces."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh

SHARED_MESHES = Path(__file__).parents[3] / "shared" / "meshes"
FACES = {"20k": 20_000, "80k": 80_000, "320k": 320_000, "1.3M": 1_310_000}


@cache
def sphere(faces: int, seed: int = 0) -> TriangleMesh:
    """Irregular unit sphere: hull of random points."""
    return shapes.random_sphere(faces // 2 + 2, seed)


@cache
def stretched(faces: int, seed: int = 0) -> TriangleMesh:
    """The irregular sphere scaled 10 : 1 : 0.1; strongly non-Delaunay."""
    mesh = sphere(faces, seed)
    return mesh.moved(mesh.points * np.array([10.0, 1.0, 0.1]))


@cache
def noisy(faces: int, seed: int = 0) -> TriangleMesh:
    """The irregular sphere with radial noise of a tenth of the mean edge length."""
    mesh = sphere(faces, seed)
    noise = 0.1 * mesh.side_length.mean() * np.random.default_rng(seed).normal(size=(mesh.n_vertices, 1))
    return mesh.moved(mesh.points * (1 + noise))


@cache
def sheared_torus(faces: int) -> TriangleMesh:
    """Torus R = 1, r = 0.4 whose grid is sheared by many cells: needles, each edge needs several flips."""
    nv = int(np.sqrt(faces / 4))
    nu = faces // (2 * nv)
    u, v, cells = shapes.wrapped_grid(nu, nv, wrap_u=True, wrap_v=True)
    shear = max(1, int(round(6 * np.sqrt(faces / 20_000))))
    u, v = 2 * np.pi * u, 2 * np.pi * (v + shear * u)
    r = 1 + 0.4 * np.cos(v)
    return TriangleMesh.from_arrays(np.stack([r * np.cos(u), r * np.sin(u), 0.4 * np.sin(v)], axis=1), cells)


@cache
def voxel_sphere(radius: int) -> TriangleMesh:
    """Boundary of the unit cubes whose centres lie within the radius, about the origin."""
    grid = np.indices((2 * radius + 3,) * 3, dtype=np.int32) - radius - 1
    mesh = voxel_boundary((grid**2).sum(axis=0) <= radius**2)
    return mesh.moved(mesh.points - mesh.points.min(axis=0) / 2 - mesh.points.max(axis=0) / 2)


def voxel_boundary(inside: NDArray[np.bool_]) -> TriangleMesh:
    """Boundary of unit cubes about the places that are inside, none of them on the border of the array."""
    quads = []
    for axis in range(3):
        u, v = np.eye(3, dtype=int)[[(axis + 1) % 3, (axis + 2) % 3]]
        step = np.roll(inside, -1, axis=axis)
        for crossing, turned in ((inside & ~step, False), (~inside & step, True)):
            corner = np.argwhere(crossing)
            corner[:, axis] += 1
            quad = np.stack([corner, corner + u, corner + u + v, corner + v], axis=1)
            quads.append(quad[:, ::-1] if turned else quad)
    corners = np.concatenate(quads)
    points, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    quad = index.reshape(-1, 4)
    return TriangleMesh.from_arrays(points - 0.5, np.concatenate([quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]]))


def marching_cubes(inside: NDArray) -> TriangleMesh:
    """Isosurface of VTK at one half, of the places that are inside or of grey values."""
    from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
    from vtkmodules.vtkCommonDataModel import vtkImageData
    from vtkmodules.vtkFiltersCore import vtkMarchingCubes

    image, contour = vtkImageData(), vtkMarchingCubes()
    image.SetDimensions(inside.shape)
    image.GetPointData().SetScalars(numpy_to_vtk(inside.astype(np.float32).ravel(order="F")))
    contour.SetInputData(image)
    contour.SetValue(0, 0.5)
    contour.Update()
    output = contour.GetOutput()
    faces = vtk_to_numpy(output.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    return TriangleMesh.from_arrays(vtk_to_numpy(output.GetPoints().GetData()).astype(float), faces)


@cache
def real(name: str) -> TriangleMesh:
    """A shared real mesh by file name."""
    from ddgcli.io.mesh_file import read_mesh

    return read_mesh(str(SHARED_MESHES / name)).mesh  # type: ignore[return-value]
