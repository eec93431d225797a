"""Random valid calls of every command, on generated meshes, the samples and a folder of meshes.

A call is a template whose words name files, vertices, lengths and times of its mesh; templates of a kind of
cells are drawn evenly by command, meshes by size.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

from ddgcli.errors import InputError
from ddgcli.io.mesh_file import read_mesh, write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.fields import AnnotatedMesh

SURFACE, SOLID, CURVE = "surface", "tetrahedra", "curve"
SHELL = "--effect stretching --effect gravity --effect bending --material felt --set thickness={millimetre}"
SIZES = (1_000, 3_000, 10_000, 30_000, 100_000, 400_000)
LARGEST = {"small": 12_000, "medium": 60_000, "any": 500_000}  # elements of a template's meshes
# (largest mesh, words): {mesh} and {out} are files, {v}, {w} vertices, {edge} and {size} lengths
TEMPLATES: dict[str, list[tuple[str, str]]] = {
    SURFACE: [
        ("any", "info {mesh}"),
        ("any", "info {mesh} -o {out}.vtu"),
        ("any", "info {mesh} --self-intersections"),
        ("any", "info {mesh} -o {out}.obj"),
        ("any", "info {mesh} --plot {out}.png"),
        ("any", "repair {mesh} --for curvature -o {out}.ply"),
        ("any", "repair {mesh} --weld --drop-degenerate --orient --split-fans -o {out}.npz"),
        ("any", "repair {mesh} --fill-holes 60 -o {out}.ply"),
        ("medium", "repair {mesh} --cut-to-disk -o {out}.ply"),
        ("any", "curvature {mesh}"),
        ("any", "curvature {mesh} -o {out}.vtu"),
        ("any", "curvature {mesh} --scheme cotan"),
        ("any", "curvature {mesh} --scheme normal-cycle"),
        ("any", "curvature {mesh} --scheme corrected -o {out}.npz"),
        ("any", "curvature {mesh} --scheme quadric --full"),
        ("any", "curvature {mesh} --scheme normal-voting -o {out}.ply"),
        ("medium", "curvature {mesh} --radius {ball}"),
        ("medium", "curvature {mesh} --scheme quadric --radius {ball}"),
        ("medium", "curvature {mesh} --scheme normal-cycle --radius {ball}"),
        ("medium", "curvature {mesh} --radius auto"),
        ("medium", "curvature {mesh} --scheme cotan --offset {edge}"),
        ("any", "curvature {mesh} --vertex-vectors -o {out}.npz"),
        ("any", "curvature {mesh} --plot {out}.png"),
        ("any", "delaunay {mesh} -o {out}.npz"),
        ("medium", "delaunay {mesh} --refine {angle}"),
        ("any", "delaunay {mesh} --overlay {out}.ply"),
        ("any", "delaunay {mesh} --dual {out}.npz"),
        ("any", "delaunay {mesh} --condition"),
        ("any", "delaunay {mesh} --transfer f --overlay {out}.npz"),
        ("small", "delaunay {mesh} --plot {out}.png"),
        ("any", "laplacian {mesh} --matrix {out}.npz --mass-matrix {out}2.npz"),
        ("any", "laplacian {mesh} --poisson f -o {out}.vtu"),
        ("any", "laplacian {mesh} --poisson f --solver multigrid"),
        ("any", "laplacian {mesh} --poisson f --operator intrinsic-delaunay"),
        ("any", "laplacian {mesh} --poisson f --operator tufted"),
        ("any", "laplacian {mesh} --harmonic --fix {v}=0 --fix {w}=1 -o {out}.npz"),
        ("medium", "laplacian {mesh} --eigen {pairs}"),
        ("medium", "laplacian {mesh} --eigen {pairs} --mass galerkin -o {out}.npz"),
        ("medium", "laplacian {mesh} --smooth {area} -o {out}.ply"),
        ("small", "laplacian {mesh} --form-eigen 4"),
        ("medium", "laplacian {mesh} --heat f --duration {time} --dt {step}"),
        ("medium", "laplacian {mesh} --wave f --duration {size} --dt {edge}"),
        ("medium", "laplacian {mesh} --parameterize harmonic -o {out}.obj"),
        ("medium", "laplacian {mesh} --parameterize conformal -o {out}.obj"),
        ("medium", "laplacian {mesh} --parameterize discrete-conformal"),
        ("small", "laplacian {mesh} --hks {time} --hks {area} -o {out}.npz"),
        ("any", "hodge {mesh}"),
        ("any", "hodge {mesh} -o {out}.vtu"),
        ("any", "hodge {mesh} --generators {out}.vtp"),
        ("medium", "hodge {mesh} --field wind -o {out}.vtu"),
        ("medium", "hodge {mesh} --basis -o {out}.vtu"),
        ("medium", "dec {mesh} -o {out}.npz"),
        ("medium", "dec {mesh} --star circumcentric -o {out}.npz"),
        ("medium", "dec {mesh} --wedge f f --forms {out}.npz"),
        ("any", "geodesic {mesh} --source {v}"),
        ("any", "geodesic {mesh} --source {v} --method heat -o {out}.vtu"),
        ("any", "geodesic {mesh} --source {v},{w} --method fast-marching"),
        ("any", "geodesic {mesh} --source {v} --method dijkstra -o {out}.ply"),
        ("any", "geodesic {mesh} --source-boundary --method heat"),
        ("medium", "geodesic {mesh} --source {v} --compare heat --compare fast-marching"),
        ("any", "geodesic {mesh} --source {v} --path-to {w} --transport -o {out}.vtp"),
        ("medium", "geodesic {mesh} --source {v} --isolines {count} --method {method}"),
        ("medium", "geodesic {mesh} --source {v} --log-map -o {out}.npz"),
        ("medium", "geodesic {mesh} --source {v} --log-map --method heat"),
        ("medium", "geodesic {mesh} --source {v},{w} --voronoi -o {out}.vtu"),
        ("any", "geodesic {mesh} --source {v} --fan {rays} --fan-length {radius}"),
        ("medium", "geodesic {mesh} --source {v} --fan {rays} --fan-length {size} --method fast-marching"),
        ("any", "geodesic {mesh} --trace 0:1,0,0:1,0.3,0:{long}"),
        ("medium", "geodesic {mesh} --source {v},{w},5,9 --target 7,8 --distance-matrix {out}.npz"),
        ("medium", "geodesic {mesh} --source {v},{w} --each-source --method {method} -o {out}.npz"),
        ("medium", "geodesic {mesh} --source {v} --certify"),
        ("any", "geodesic {mesh} --source {v} --spread-vector 1,0,0"),
        ("any", "geodesic {mesh} --source-point {point} --method heat"),
        ("medium", "geodesic {mesh} --field wind"),
        ("medium", "geodesic {mesh} --source {v} --plot {out}.png"),
        ("small", "willmore-flow {mesh} --steps {few} -o {out}.vtkhdf"),
        ("small", "willmore-flow {mesh} --flow newton --steps {few}"),
        ("medium", "willmore-flow {mesh} --steps {few} --dt {tiny}"),
        ("any", "willmore-flow {mesh} --flow mean-curvature --steps {few} --dt {tiny} -o {out}.vtkhdf"),
        ("small", "willmore-flow {mesh} --remesh mean --steps {few}"),
        ("small", "willmore-flow {mesh} --flow mean-curvature --steps 9 --dt {tiny} --plot {out}.png"),
        ("small", "willmore-flow {mesh} --fix-volume --fix-area --steps {few}"),
        ("medium", f"shell-sim {{mesh}} {SHELL} --dt 1e-3 --pin {{v}} --steps {{few}}"),
        (
            "any",
            f"shell-sim {{mesh}} {SHELL} --integrator verlet --dt {{instant}} --steps {{some}}",
        ),
        (
            "small",
            f"shell-sim {{mesh}} {SHELL} --model bending=midedge --dt 1e-3 --pin {{v}} --steps {{few}}",
        ),
        ("small", f"shell-sim {{mesh}} {SHELL} --pin {{v}} --pin {{w}} --pin 7 --modes 10"),
        ("medium", "fluid-sim {mesh} --vorticity f --dt 1e-2 --steps {few} -o {out}.vtkhdf"),
        ("medium", "fluid-sim {mesh} --vorticity f --integrator conservative --dt 1e-3 --steps {some}"),
        ("medium", "fluid-sim {mesh} --vorticity f --integrator energy --dt 1e-3 --steps {some}"),
        (
            "medium",
            "fluid-sim {mesh} --vorticity f --integrator covector --viscosity 1e-3 --dt 1e-3 --steps {few}",
        ),
        ("small", "fluid-sim {mesh} --vorticity f --dt 1e-2 --steps {few} --plot {out}.png"),
        ("any", "view {mesh} -o {out}.html"),
        ("small", "tradeoff curvature {mesh} --budget 20"),
        ("small", "tradeoff geodesic {mesh} --source {v} --budget 20"),
        ("small", "tradeoff laplacian {mesh} --budget 20"),
        ("small", "tradeoff delaunay {mesh} --budget 20"),
        ("small", "tradeoff willmore-flow {mesh} --budget 20"),
    ],
    SOLID: [
        ("any", "info {mesh} -o {out}.vtu"),
        ("any", "laplacian {mesh} --matrix {out}.npz"),
        ("any", "laplacian {mesh} --poisson f -o {out}.npz"),
        ("medium", "laplacian {mesh} --eigen {pairs}"),
        ("small", "laplacian {mesh} --form-eigen 4"),
        ("any", "hodge {mesh}"),
        ("any", "hodge {mesh} --basis"),
        ("any", "hodge {mesh} --field wind -o {out}.vtu"),
        ("any", "dec {mesh} -o {out}.npz"),
        ("medium", "fluid-sim {mesh} --flow vortex-ring --integrator {transport} --dt 1e-3 --steps {few}"),
        ("any", "view {mesh} -o {out}.html"),
    ],
    CURVE: [
        ("any", "info {mesh} -o {out}.vtu"),
        ("any", "info {mesh} --plot {out}.png"),
        ("any", "curvature {mesh} --frames -o {out}.npz"),
        ("any", "curvature {mesh} --resample 20000"),
        ("medium", "curve-flow {mesh} --dt {tiny} --steps {some} -o {out}.npz"),
        ("medium", "curve-flow {mesh} --flow elastic --dt {tiny} --steps {some}"),
        ("medium", "curve-flow {mesh} --flow area-preserving --no-redistribute --dt {tiny} --steps {some}"),
    ],
}


@dataclass(frozen=True)
class MeshFacts:
    """What the words of a call refer to."""

    path: Path
    kind: str
    elements: int
    n_vertices: int
    edge: float
    size: float
    point: str


def meshes(folder: Path, further: Path | None) -> list[MeshFacts]:
    """Meshes of all kinds: generated, the samples, and those of a folder that can be read.

    Each is written with arrays `f` on vertices and `wind` on cells into `folder`.
    """
    every: list[tuple[str, Callable[[], Any]]] = []
    for n in SIZES:
        every += [(f"{name}-{n}", lambda make=make, n=n: make(n)) for name, make in GENERATORS.items()]
    roots = [Path(__file__).parents[2] / "sample_meshes", *([further] if further else [])]
    for root in roots:
        files = [path for path in sorted(root.iterdir()) if path.is_file()]
        every += [(path.stem, lambda path=path: read_mesh(str(path)).mesh) for path in files]
    return [facts for name, make in every if (facts := _written(folder, name, make))]


def _written(folder: Path, name: str, make: Callable[[], Any]) -> MeshFacts | None:
    path = folder / f"{name}.npz"
    try:
        mesh = make()
    except (InputError, OSError, UnicodeDecodeError):
        return None  # a script or a page beside the meshes
    kind = CURVE if isinstance(mesh, CurveSet) else SOLID if hasattr(mesh, "tetrahedra") else SURFACE
    points = mesh.points
    cells = mesh.n_vertices if kind == CURVE else len(mesh.tetrahedra if kind == SOLID else mesh.faces)
    size = float(np.ptp(points, axis=0).max())
    edge = float(mesh.side_length.mean()) if kind == SURFACE else size / max(mesh.n_vertices, 1) ** 0.5
    if not path.exists():
        wind = {} if kind == CURVE else {"wind": np.tile([1.0, 0.5, 0.2], (cells, 1))}
        f = (points[:, 2] - points[:, 2].min()) / size + (points[:, 0] - points[:, 0].min()) / size
        write_mesh(str(path), AnnotatedMesh(mesh, vertex={"f": f}, face=wind))
    point = ",".join(repr(float(x)) for x in points[len(points) // 3])
    return MeshFacts(path, kind, cells, mesh.n_vertices, edge, size, point)


def _stretched(n: int) -> Any:
    mesh = shapes.random_sphere(n // 2 + 2, 1)
    return mesh.moved(mesh.points * [1.0, 0.2, 5.0])


def _rough(n: int) -> Any:
    mesh = shapes.random_sphere(n // 2 + 2, 2)
    noise = 0.05 * mesh.side_length.mean() * np.random.default_rng(0).standard_normal(len(mesh.points))
    return mesh.moved(mesh.points * (1 + noise)[:, None])


def _torus(n: int) -> Any:
    k = max(4, round((n / 4) ** 0.5))
    return shapes.torus(2 * k, k)


def _waves(n: int) -> Any:
    k = max(2, round((n / 2) ** 0.5))
    mesh = shapes.grid(k, k)
    wave = 0.1 * np.sin(5 * mesh.points[:, :1]) * np.cos(4 * mesh.points[:, 1:2])
    return mesh.moved(mesh.points + wave * [0.0, 0.0, 1.0])


def _circle(n: int) -> Any:
    angle = np.linspace(0, 2 * np.pi, n // 4 + 1)
    return CurveSet.from_paths([np.stack([np.cos(angle), 0.6 * np.sin(angle), 0 * angle], axis=1)])


GENERATORS: dict[str, Callable[[int], Any]] = {
    "sphere": lambda n: shapes.random_sphere(n // 2 + 2, 0),
    "stretched": _stretched,
    "rough": _rough,
    "torus": _torus,
    "waves": _waves,
    "box": lambda n: shapes.box_tetrahedra(*3 * [max(2, round((min(n, 100_000) / 6) ** (1 / 3)))]),
    "circle": _circle,
}


def random_call(rng: Random, every: list[MeshFacts], out: Path) -> tuple[str, list[str]]:
    """Name of the mesh and words of a call."""
    kind = rng.choices([SURFACE, SOLID, CURVE], [10, 2, 1])[0]
    by_command: dict[str, list[tuple[str, str]]] = {}
    for template in TEMPLATES[kind]:
        by_command.setdefault(template[1].split()[0], []).append(template)
    # commands with many options are drawn more often
    names = list(by_command)
    command = rng.choices(names, [len(by_command[name]) ** 0.7 for name in names])[0]
    largest, words = rng.choice(by_command[command])
    fitting = [m for m in every if m.kind == kind and m.elements <= LARGEST[largest]]
    mesh = rng.choices(fitting, [max(m.elements, 300) ** 0.3 for m in fitting])[0]
    return mesh.path.stem, words.format(mesh=mesh.path, out=out, **_values(rng, mesh)).split()


def _values(rng: Random, mesh: MeshFacts) -> dict[str, Any]:
    """Values of the names in templates."""
    return {
        "v": rng.randrange(mesh.n_vertices), "w": rng.randrange(mesh.n_vertices), "point": mesh.point,
        "edge": mesh.edge, "size": mesh.size, "radius": 0.4 * mesh.size,
        "ball": rng.choice([2, 3, 5]) * mesh.edge, "long": rng.choice([1, 20, 300]) * mesh.size,
        "area": rng.choice([0.5, 5]) * mesh.edge**2, "time": 0.1 * mesh.size**2,
        "step": rng.choice([1e-2, 1e-3]) * mesh.size**2, "tiny": 1e-6 * mesh.edge**2,
        "millimetre": 1e-3 * mesh.size, "instant": 1e-9 * mesh.size,
        "angle": rng.choice([15, 20, 25, 28]), "pairs": rng.choice([6, 20, 60, 200]),
        "count": rng.choice([10, 50, 200]), "rays": rng.choice([50, 300, 1000]),
        "few": rng.choice([2, 5, 12]), "some": rng.choice([10, 40, 100]),
        "method": rng.choice(["exact", "heat", "fast-marching"]),
        "transport": rng.choice(["circulation", "energy", "covector"]),
    }  # fmt: skip
