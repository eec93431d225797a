"""Do plates of `midedge` bend as those of the Hellan-Herrmann-Johnson method of NGSolve?

Run: `python -m benchmarks.peers.plate`, with `pip install ngsolve`. A square plate under a uniform load,
clamped or simply supported, on the same triangles: grids and irregular ones. NGSolve solves the mixed problem
of lowest order (moments constant in each face, their normal part continuous; linear deflections), which
`midedge` solves with the moments eliminated: the deflections of all vertices agree up to rounding.
`clamp` also holds edges inside that join two vertices of the border (at corners of `right` and irregular
meshes), which NGSolve's plate does not: there the two differ by what a corner's triangle bends.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.common.measure import machine, print_commands, print_table
from benchmarks.common.rectangle_meshes import irregular_rectangle
from ddgcli.io.scene_file import parse_scene
from ddgcli.linalg.factor import Factor
from ddgcli.mechanics.increment import Increment
from ddgcli.mechanics.objective import Objective
from ddgcli.mesh.shapes import grid
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.shell import model
from ddgcli.models.shell.scene import KIND
from ddgcli.scenes.scene import resolve
from ddgcli.simulation.account import Account

POISSON, YOUNG, THICKNESS = 0.3, 1e9, 0.01
RIGIDITY = YOUNG * THICKNESS**3 / (12 * (1 - POISSON**2))
LOAD = 1e-4  # Pa
TIMOSHENKO = {"clamped": 0.00126532, "simply supported": 0.00406235}  # of the middle, in q a^4 / D
SCENE = """
[time]
integrator = "static"
duration = 1
[[object]]
name = "s"
role = "shell"
mesh = "m"
density = 1
thickness = {thickness}
young = {young}
poisson = {poisson}
[effects]
stretching = {{}}
bending = {{ model = "midedge" }}
pin = {{ vertices = {border}, clamp = {clamp} }}
load = {{ traction = [0, 0, {load}] }}
"""

# whole commands, timed as a user starts them
COMMANDS = ("shell-sim cap.ply --effect stretching --effect bending --steps 2 --dt 1e-3",)


def square(pattern: str, n: int) -> TriangleMesh:
    """The unit square."""
    return irregular_rectangle(1, 1, n, n) if pattern == "irregular" else grid(n, n, 1, 1, pattern)


def own_deflection(mesh: TriangleMesh, clamped: bool) -> NDArray[np.float64]:
    """(n,) deflections of `shell-sim`, by one solve with the Hessian at rest."""
    q = np.asarray(mesh.points)[:, :2]
    border = np.flatnonzero(((q < 1e-9) | (q > 1 - 1e-9)).any(axis=1)).tolist()
    text = SCENE.format(
        border=border, clamp=str(clamped).lower(), load=LOAD, thickness=THICKNESS, young=YOUNG,
        poisson=POISSON,
    )  # fmt: skip
    scene = resolve(parse_scene(text), KIND, {})
    source = SimpleNamespace(mesh=mesh, vertex={}, face={}, sha256="", notes=[])
    context, _ = model.contexts(scene, lambda path: source)["s"]
    system = model.make_system(scene, context, Account())
    x, objective = np.asarray(mesh.points), Objective(system)
    matrix = objective.hessian(Increment(0.0, x), x, "exact")
    return objective.scatter(Factor(matrix).solve(objective.gather(-system.gradient(x))))[:, 2]


def peer_deflection(mesh: TriangleMesh, clamped: bool) -> NDArray[np.float64]:
    """(n,) deflections of the mixed method in NGSolve."""
    import ngsolve as ng
    from netgen.meshing import Element1D, Element2D, FaceDescriptor, MeshPoint, Pnt
    from netgen.meshing import Mesh as NetgenMesh

    netgen = NetgenMesh(dim=2)
    number = [netgen.Add(MeshPoint(Pnt(*map(float, p)))) for p in np.asarray(mesh.points)]
    netgen.Add(FaceDescriptor(surfnr=1, domin=1, bc=1))
    for face in np.asarray(mesh.faces):
        netgen.Add(Element2D(1, [number[v] for v in face]))
    topology = mesh.topology
    for a, b in topology.edges[topology.boundary_edges]:
        netgen.Add(Element1D([number[a], number[b]], index=1))
    netgen.SetBCName(0, "border")
    domain = ng.Mesh(netgen)
    moments = ng.HDivDiv(domain, order=0, dirichlet="" if clamped else "border")
    space = moments * ng.H1(domain, order=1, dirichlet="border")
    (sigma, w), (tau, v) = space.TnT()
    normal = ng.specialcf.normal(2)

    def coupling(moment: Any, deflection: Any) -> Any:
        slope = ng.grad(deflection) * normal
        return (moment * normal) * normal * slope * ng.dx(element_boundary=True)

    compliance = 1 / (RIGIDITY * (1 - POISSON))
    trace = POISSON / (1 + POISSON) * ng.Trace(sigma) * ng.Trace(tau)
    form = ng.BilinearForm(space, symmetric=True)
    form += compliance * (ng.InnerProduct(sigma, tau) - trace) * ng.dx
    form += coupling(sigma, v) + coupling(tau, w)
    load = ng.LinearForm(-LOAD * v * ng.dx)
    form.Assemble()
    load.Assemble()
    solution = ng.GridFunction(space)
    solution.vec.data = form.mat.Inverse(space.FreeDofs()) * load.vec
    return np.array([solution.components[1](domain(*p[:2])) for p in np.asarray(mesh.points)])


def main() -> None:
    """Table of the differences."""
    print(machine())
    rows = []
    for pattern in ("right", "alternating", "irregular"):
        for n in (8, 16):
            mesh = square(pattern, n)
            for support, truth in TIMOSHENKO.items():
                own = own_deflection(mesh, support == "clamped")
                try:
                    peer = peer_deflection(mesh, support == "clamped")
                except ImportError:
                    print("NGSolve is not installed: pip install ngsolve")
                    return
                unit = LOAD / RIGIDITY
                rows.append(
                    [pattern, mesh.n_faces, support, f"{own.max() / unit / truth:.5f}",
                     f"{np.abs(peer).max() / unit / truth:.5f}",
                     f"{np.abs(own - peer).max() / own.max():.1e}"]
                )  # fmt: skip
    header = ["mesh", "triangles", "support", "midedge", "NGSolve", "largest difference of a vertex"]
    print_table("deflection of a square plate over Timoshenko's", header, rows)


if __name__ == "__main__":
    main()
    print_commands(*COMMANDS)
