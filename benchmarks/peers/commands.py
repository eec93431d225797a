"""Whole commands on scans beside their kernel and a peer's library call: CPU seconds and ratios.

python -m benchmarks.peers.commands [NAME OF A CASE ...]

The kernel is the library function that computes the arrays of the command, from arrays of points and faces;
the command reads a file besides, reports facts of the input, and certifies. Aim: at most 1.5 times the
kernel. The same command on a cube takes the time of the start-up alone. Each row is measured in turn in one
run, one thread; the least of the repetitions. Seconds are of the program; those of the operating system stand
in a column of their own: they are nearly all the first touch of pages of memory, which costs a virtual
machine whose host takes idle pages back up to 0.1 ms a page, and belong to the machine. A second table has
the seconds of the parts of each command with an output file, in a profile and beyond those on a cube.
"""

from __future__ import annotations

import resource
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import igl
import numpy as np
import potpourri3d
from scipy.sparse.linalg import eigsh

from benchmarks.common import measure
from benchmarks.common.function_seconds import TOTAL, function_seconds
from benchmarks.common.mesh_sequences import SHARED_MESHES, real
from ddgcli.algorithms.curvature import measures
from ddgcli.algorithms.curvature.frames import area_normals, unit_normals
from ddgcli.algorithms.curvature.quadric import quadric
from ddgcli.algorithms.curvature.star import cotan
from ddgcli.algorithms.geodesics.fast_marching import fast_marching_distance, fast_marching_stencils
from ddgcli.algorithms.laplacian.laplace_operator import laplace_operator
from ddgcli.algorithms.laplacian.spectrum import spectrum
from ddgcli.geometry.faces import Faces
from ddgcli.mesh.triangle_mesh import TriangleMesh

SCANS = ("koala_loop1.ply", "st_helens_terrain.ply")
N_PAIRS = 8
MAX_REPEAT, SECONDS_OF_A_ROW = 6, 30.0
COMMON_GROUPS = {"reading": ("io/mesh_file:read_mesh",), "checks": ("cli/input_facts:input_facts",)}
WRITING = ("io/mesh_file:write_mesh",)
OF_CURVATURE = (
    (
        "algorithms/curvature/unit_surface:prepare_surface",
        "algorithms/curvature/surface_curvature:_pointwise",
    ),
    (
        "algorithms/curvature/curvature_results:identity_residuals",
        "algorithms/curvature/noise_estimate:estimate_noise",
        "algorithms/curvature/curvature_results:further_integrals",
    ),
)  # fmt: skip
OF_LAPLACIAN = (
    ("algorithms/laplacian/laplace_operator:laplace_operator", "algorithms/laplacian/spectrum:spectrum"),
    (
        "algorithms/laplacian/laplace_operator:negative_weights",
        "algorithms/laplacian/laplace_operator:symmetry_residual",
    ),
)
OF_FAST_MARCHING = (
    (
        "algorithms/geodesics/fast_marching:fast_marching_stencils",
        "algorithms/geodesics/fast_marching:fast_marching_distance",
    ),
    ("algorithms/geodesics/certificate:certificate",),
)


@dataclass(frozen=True)
class Case:
    """A command, the library function of its kernel, and a peer's call with the peer's name.

    `groups`: the functions of the command that compute its arrays, and those of its totals and accuracy.
    """

    words: str
    kernel: Callable[[TriangleMesh], Any]
    peer_name: str
    peer: Callable[[np.ndarray, np.ndarray], Any]
    groups: tuple[tuple[str, ...], tuple[str, ...]]


def cotan_kernel(mesh: TriangleMesh) -> Any:
    """Curvatures and directions of the scheme `cotan`."""
    faces = Faces.of(mesh)
    area, defect, vector = measures.star_measures(faces, mesh.topology)
    return cotan(faces, mesh.topology, unit_normals(faces), area, defect, vector)


def quadric_kernel(mesh: TriangleMesh) -> Any:
    """Curvatures and directions of the scheme `quadric`."""
    faces = Faces.of(mesh)
    return quadric(mesh, faces, area_normals(faces))


def fast_marching_kernel(mesh: TriangleMesh) -> Any:
    """Distances by fast marching."""
    return fast_marching_distance(mesh, 0, stencils=fast_marching_stencils(mesh))


def igl_cotan(points: np.ndarray, faces: np.ndarray) -> Any:
    """Mean curvature vectors and angle defects."""
    mass = igl.massmatrix(points, faces, igl.MASSMATRIX_TYPE_VORONOI)
    return (igl.cotmatrix(points, faces) @ points) / mass.diagonal()[:, None], igl.gaussian_curvature(
        points, faces
    )


def scipy_eigen(points: np.ndarray, faces: np.ndarray) -> Any:
    """Eigenpairs of libigl's matrices by ARPACK with scipy's default factorisation."""
    stiffness = -igl.cotmatrix(points, faces).tocsc()
    mass = igl.massmatrix(points, faces, igl.MASSMATRIX_TYPE_BARYCENTRIC).tocsc()
    return eigsh(stiffness, N_PAIRS, mass, sigma=-1e-8)


def pp3d_fast_marching(points: np.ndarray, faces: np.ndarray) -> Any:
    """Distances by potpourri3d's fast marching."""
    solver = potpourri3d.MeshFastMarchingDistanceSolver(points, faces)
    return solver.compute_distance([[(0, [])]])


CASES = {
    "cotan": Case("curvature MESH --scheme cotan", cotan_kernel, "libigl", igl_cotan, OF_CURVATURE),
    "quadric": Case(
        "curvature MESH",
        quadric_kernel,
        "libigl",
        lambda p, f: igl.principal_curvature(p, f, radius=2),
        OF_CURVATURE,
    ),
    "delaunay": Case(
        "laplacian MESH --operator intrinsic-delaunay",
        lambda mesh: laplace_operator(mesh, "intrinsic-delaunay"),
        "libigl",
        igl.intrinsic_delaunay_cotmatrix,
        OF_LAPLACIAN,
    ),
    "fast-marching": Case(
        "geodesic MESH --source 0 --method fast-marching",
        fast_marching_kernel,
        "potpourri3d",
        pp3d_fast_marching,
        OF_FAST_MARCHING,
    ),
    "eigen": Case(
        f"laplacian MESH --eigen {N_PAIRS}",
        lambda mesh: spectrum(laplace_operator(mesh), N_PAIRS),
        "eigsh",
        scipy_eigen,
        OF_LAPLACIAN,
    ),
}  # fmt: skip


def on_new_mesh(kernel: Callable[[TriangleMesh], Any], points: np.ndarray, faces: np.ndarray) -> Any:
    """Result of a kernel on a mesh with nothing cached."""
    return kernel(TriangleMesh.from_arrays(points, faces))


def seconds(call: Callable[..., Any], *arguments: Any) -> float:
    """CPU seconds of a call, without those of the operating system."""
    began = resource.getrusage(resource.RUSAGE_SELF).ru_utime
    call(*arguments)
    return resource.getrusage(resource.RUSAGE_SELF).ru_utime - began


def bench(names: list[str]) -> None:
    """Print CPU seconds of each command, of its kernel and of the peer's call."""
    rows: list[list[Any]] = []
    for scan in SCANS:
        path, mesh = str(SHARED_MESHES / scan), real(scan)
        points, faces = np.array(mesh.points), np.array(mesh.faces)
        for name in names:
            case = CASES[name]
            whole: list[float] = []
            system, start, kernel, peer = list(whole), list(whole), list(whole), list(whole)
            while len(whole) < 2 or (
                sum(whole + kernel + peer) < SECONDS_OF_A_ROW and len(whole) < MAX_REPEAT
            ):
                start.append(measure.command_seconds(*case.words.replace("MESH", "cube.obj").split()).user)
                run = measure.command_seconds(*case.words.replace("MESH", path).split())
                whole.append(run.user)
                system.append(run.system)
                kernel.append(seconds(on_new_mesh, case.kernel, points, faces))
                peer.append(seconds(case.peer, points, faces))
            a, on_cube, b, c = min(whole), min(start), min(kernel), min(peer)
            words, ratios = case.words.replace("MESH", scan), [a / b, (a - on_cube) / b]
            row = [f"`{words}`", len(faces), a, min(system), on_cube, b, *ratios, 1.5]
            rows.append([*row, case.peer_name, c, a / c])
    header = ["command", "faces", "command s", "system s", "on a cube s", "kernel s", "command / kernel"]
    header += ["without start-up", "aim", "peer", "peer s"]
    measure.print_table("Commands on scans", [*header, "command / peer"], rows)


def bench_groups(names: list[str]) -> None:
    """Print CPU seconds of the parts of each command that writes its arrays to a binary PLY file."""
    rows: list[list[Any]] = []
    for scan in SCANS:
        for name in names:
            case = CASES[name]
            words = f"{case.words} -o out.ply"
            on_cube = function_seconds(*words.replace("MESH", measure.sample_path("cube.obj")).split())
            on_scan = function_seconds(*words.replace("MESH", str(SHARED_MESHES / scan)).split())
            beyond = {key: value - on_cube.get(key, 0.0) for key, value in on_scan.items()}
            kernel, accuracy = case.groups
            groups = [*COMMON_GROUPS.values(), kernel, accuracy, WRITING]
            group_seconds = [sum(beyond.get(key, 0.0) for key in group) for group in groups]
            other = beyond[TOTAL] - sum(group_seconds)
            start = min(
                measure.command_seconds(*words.replace("MESH", "cube.obj").split()).user for _ in range(3)
            )
            rows.append([f"`{words.replace('MESH', scan)}`", start, *group_seconds, other])
    header = ["command", "start-up", *COMMON_GROUPS, "kernel", "totals and accuracy", "writing", "other"]
    measure.print_table("Stages, seconds", header, rows)


# whole commands, timed as a user starts them
COMMANDS = ("curvature sphere.ply --scheme cotan", "geodesic sphere.ply --source 0 --method fast-marching")


if __name__ == "__main__":
    bench(sys.argv[1:] or list(CASES))
    bench_groups(sys.argv[1:] or list(CASES))
    measure.print_commands(*COMMANDS)
