"""One call of a peer library on one mesh: `python -m benchmarks.hardcases.peer_task TASK MESH OUT.npz`.

It runs in a process of its own, for a peer may crash or hang. MESH is `.npz`, or any file for the readers.
OUT.npz holds `distance`, `angle_defect`, `curvature` or `eigenvalues`; of readers `points` and `faces`.
"""

from __future__ import annotations

import contextlib
import importlib
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Answer = dict[str, NDArray]


def potpourri_heat(points: NDArray, faces: NDArray) -> Answer:
    """Heat distance of potpourri3d (geometry-central), its robust Laplacian."""
    import potpourri3d

    return {"distance": potpourri3d.MeshHeatMethodDistanceSolver(points, faces).compute_distance(0)}


def pygeodesic_exact(points: NDArray, faces: NDArray) -> Answer:
    """Exact distance of pygeodesic (Kirsanov's code)."""
    from pygeodesic import geodesic

    algorithm = geodesic.PyGeodesicAlgorithmExact(points, faces)
    return {"distance": algorithm.geodesicDistances(np.array([0]), None)[0]}


def igl_exact(points: NDArray, faces: NDArray) -> Answer:
    """Exact distance of libigl."""
    import igl

    everywhere = np.arange(len(points), dtype=np.int64)
    no_faces = np.zeros(0, dtype=np.int64)
    return {"distance": igl.exact_geodesic(points, faces, np.array([0]), no_faces, everywhere, no_faces)}


def igl_curvature(points: NDArray, faces: NDArray) -> Answer:
    """Angle defect and principal curvatures of libigl."""
    import igl

    answer: Any = igl.principal_curvature(points, faces)
    return {"angle_defect": igl.gaussian_curvature(points, faces), "curvature": np.stack(answer[2:4])}


def trimesh_curvature(points: NDArray, faces: NDArray) -> Answer:
    """Angle defect of trimesh."""
    import trimesh

    mesh = trimesh.Trimesh(points, faces, process=False)
    return {"angle_defect": np.asarray(mesh.vertex_defects)}


def smallest_eigenvalues(stiffness: Any, mass: Any) -> Answer:
    """The three smallest eigenvalues, by the shifted Lanczos method that the libraries' pages show."""
    from scipy.sparse.linalg import eigsh

    count = min(3, stiffness.shape[0] - 1)
    return {"eigenvalues": eigsh(stiffness, count, mass, sigma=-1e-8, return_eigenvectors=False)[::-1]}


def robust_laplacian_spectrum(points: NDArray, faces: NDArray) -> Answer:
    """Spectrum of robust_laplacian's tufted Laplacian."""
    import robust_laplacian

    return smallest_eigenvalues(*robust_laplacian.mesh_laplacian(points, faces))


def igl_spectrum(points: NDArray, faces: NDArray) -> Answer:
    """Spectrum of libigl's cotangent Laplacian."""
    import igl

    return smallest_eigenvalues(
        -igl.cotmatrix(points, faces), igl.massmatrix(points, faces, igl.MASSMATRIX_TYPE_VORONOI)
    )


def _mesh_set(points: NDArray, faces: NDArray) -> Any:
    """A pymeshlab holder of one mesh."""
    import pymeshlab

    holder: Any = pymeshlab.MeshSet()
    holder.add_mesh(pymeshlab.Mesh(points, faces))
    return holder


def pymeshlab_distance(points: NDArray, faces: NDArray) -> Answer:
    """Distance of pymeshlab, along edges and across faces (first order)."""
    import pymeshlab

    holder = _mesh_set(points, faces)
    far = float(np.linalg.norm(points[faces[:, 0]] - points[faces[:, 1]], axis=1).sum())
    holder.compute_scalar_by_geodesic_distance_from_given_point_per_vertex(
        startpoint=points[0], maxdistance=pymeshlab.PureValue(far)
    )
    return {"distance": holder.current_mesh().vertex_scalar_array()}


def pymeshlab_curvature(points: NDArray, faces: NDArray) -> Answer:
    """Discrete Gaussian curvature of pymeshlab, angle defect over area."""
    holder = _mesh_set(points, faces)
    holder.compute_scalar_by_discrete_curvature_per_vertex(curvaturetype="Gaussian Curvature")
    return {"curvature": holder.current_mesh().vertex_scalar_array()}


def pymeshlab_read(path: str) -> Answer:
    """A file read by pymeshlab."""
    import pymeshlab

    holder: Any = pymeshlab.MeshSet()
    holder.load_new_mesh(path)
    return {"points": holder.current_mesh().vertex_matrix(), "faces": holder.current_mesh().face_matrix()}


def trimesh_read(path: str) -> Answer:
    """A file read by trimesh."""
    import trimesh

    mesh: Any = trimesh.load(path, force="mesh", process=False)
    return {"points": np.asarray(mesh.vertices), "faces": np.asarray(mesh.faces)}


def meshio_read(path: str) -> Answer:
    """Triangles of a file read by meshio."""
    import meshio

    mesh = meshio.read(path)
    faces = mesh.cells_dict.get("triangle", np.zeros((0, 3), dtype=int))
    return {"points": np.asarray(mesh.points, dtype=float), "faces": np.asarray(faces, dtype=float)}


def igl_read(path: str) -> Answer:
    """A file read by libigl."""
    import igl

    points, faces = igl.read_triangle_mesh(path)
    return {"points": points, "faces": faces}


READERS: dict[str, Callable[[str], Answer]] = {
    "trimesh reader": trimesh_read,
    "meshio reader": meshio_read,
    "libigl reader": igl_read,
    "pymeshlab reader": pymeshlab_read,
}
TASKS: dict[str, Callable[[NDArray, NDArray], Answer]] = {
    "potpourri3d heat": potpourri_heat,
    "pygeodesic exact": pygeodesic_exact,
    "libigl exact": igl_exact,
    "libigl curvature": igl_curvature,
    "trimesh curvature": trimesh_curvature,
    "robust_laplacian spectrum": robust_laplacian_spectrum,
    "libigl spectrum": igl_spectrum,
    "pymeshlab distance": pymeshlab_distance,
    "pymeshlab curvature": pymeshlab_curvature,
}


def preload() -> None:
    """Import every library, so that forked calls need not."""
    for name in (
        "potpourri3d",
        "pygeodesic.geodesic",
        "igl",
        "trimesh",
        "meshio",
        "robust_laplacian",
        "pymeshlab",
    ):
        with contextlib.suppress(ImportError):
            importlib.import_module(name)
    importlib.import_module("scipy.sparse.linalg")


def main(words: list[str]) -> None:
    """Run one task and write its arrays."""
    task, mesh, output = words
    if task in READERS:
        arrays = READERS[task](mesh)
        if arrays["faces"].dtype.kind == "O":  # trimesh's `None` where it reads no face
            arrays["faces"] = np.zeros((0, 3))
        np.savez(output, **{name: array.astype(float) for name, array in arrays.items()})
        return
    with np.load(mesh) as stored:
        points, faces = stored["points"], stored["faces"]
    answer = TASKS[task](points, faces)
    if any(value is None for value in answer.values()):
        raise RuntimeError("the answer is None")
    np.savez(output, **answer)


if __name__ == "__main__":
    main(sys.argv[1:])
