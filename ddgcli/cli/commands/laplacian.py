"""`ddgcli laplacian`."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ddgcli.choices import (
    CONFORMAL_BOUNDARIES,
    LAPLACE_OPERATORS,
    MASSES,
    PARAMETERIZATIONS,
    SMOOTHING_FLOWS,
)
from ddgcli.cli import options
from ddgcli.cli.commands.laplacian_evolution import (
    EvolutionOptions,
    evolution_options,
    start_of,
    write_evolution,
)
from ddgcli.cli.options import CommonOptions, Real
from ddgcli.cli.run import Run
from ddgcli.errors import ParameterError, renamed_parameters

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ddgcli.algorithms.laplacian.tasks import LaplacianResult
    from ddgcli.io.mesh_file import MeshInput

log = logging.getLogger("ddgcli")

OPERATOR_OPTIONS = ("operator", "mass")  # the other options are tasks
OVERLAY_FORMATS = (".npz", ".vtkhdf", ".ply", ".vtu", ".vtp", ".vtk", ".xdmf", ".obj", ".off", ".stl")
MATRIX_FORMATS = (".npz", ".mtx")


class FixedValue(click.ParamType):
    """A vertex and its value, ID=VALUE."""

    def __init__(self, unit: str = "value") -> None:
        self.name = f"id={unit}"

    def convert(self, value: Any, param: Any, ctx: Any) -> tuple[int, float]:
        vertex, equals, number = str(value).partition("=")
        if not equals or not vertex.strip().isdigit():
            self.fail(f"{value!r} is not ID=VALUE, such as 12=0.5", param, ctx)
        return int(vertex), Real().convert(number, param, ctx)


@click.command(
    "laplacian",
    epilog="Choosing an operator: the default, intrinsic-delaunay with lumped mass, costs little more than "
    "cotan and keeps weights positive on any triangles; galerkin bounds eigenvalues from above. See "
    "docs/laplacian.md and docs/accuracy/laplacian.md.",
)
@options.mesh_arg
@click.option(
    "--operator",
    type=click.Choice(LAPLACE_OPERATORS),
    help="Default: intrinsic-delaunay; tufted where the mesh is not an oriented manifold; cotan of "
    "tetrahedra, which have uniform besides.",
)
@click.option("--mass", type=click.Choice(MASSES), default="lumped", show_default=True)
@click.option("--matrix", metavar="PATH", help="Write the stiffness L (.npz of scipy.sparse, or .mtx).")
@click.option("--mass-matrix", metavar="PATH", help="Write the mass M.")
@click.option(
    "--eigen",
    type=click.IntRange(min=1),
    metavar="K",
    help="The K smallest eigenpairs of L x = lambda M x: eigenvector_000, ...",
)
@click.option(
    "--poisson",
    metavar="ARRAY|FILE",
    help="Solve L u = M f (minus the Laplacian of u is f) for an array of MESH or of a file; "
    "one solution for each column.",
)
@click.option("--harmonic", is_flag=True, help="Interpolate the values of --fix harmonically.")
@click.option(
    "--fix",
    "fixed",
    multiple=True,
    type=FixedValue(),
    metavar="ID=VALUE...",
    help="Value at a vertex, for --harmonic and --poisson.",
)
@click.option(
    "--smooth",
    type=options.POSITIVE_NUMBER,
    metavar="TIME",
    help="Implicit mean curvature flow for TIME (length squared); the written mesh is smoothed. The "
    "mean edge length squared removes noise, a thousandth of the area changes the shape, and by a fiftieth "
    "of it a sphere has vanished; results.smooth_sensible_time has the numbers of MESH.",
)
@click.option(
    "--smooth-flow",
    type=click.Choice(SMOOTHING_FLOWS),
    help="Flow of --smooth: conformalized keeps angles and does not pinch thin parts off.  "
    "[default: mean-curvature]",
)
@click.option(
    "--smooth-steps", type=click.IntRange(min=1), metavar="N", help="Steps of --smooth.  [default: 10]"
)
@click.option(
    "--parameterize",
    type=click.Choice(PARAMETERIZATIONS),
    help="Flatten a surface: array uv. harmonic and conformal need a boundary; discrete-conformal maps any "
    "topology, with cones.",
)
@click.option(
    "--cone",
    "cones",
    multiple=True,
    type=FixedValue("degrees"),
    metavar="ID=DEGREES...",
    help="With discrete-conformal: angle sum at a vertex, 360 inside where not named.",
)
@click.option(
    "--boundary",
    type=click.Choice(CONFORMAL_BOUNDARIES),
    help="With discrete-conformal: free keeps boundary lengths (least distortion of area), lengths takes log "
    "scale factors, angles takes angle sums.  [default: free]",
)
@click.option(
    "--boundary-values",
    metavar="ARRAY|FILE",
    help="Vertex array for --boundary: log scale factors, or degrees.",
)
@click.option(
    "--overlay",
    metavar="PATH",
    help="With discrete-conformal: the common subdivision of MESH and its flat triangulation, cut open along "
    "seams, with uv.",
)
@click.option(
    "--hks",
    multiple=True,
    type=options.POSITIVE_NUMBER,
    metavar="T...",
    help="Heat kernel signatures at these times: hks_000, ...",
)
@click.option(
    "--form-eigen",
    type=click.IntRange(min=1),
    metavar="K",
    help="The K smallest eigenpairs of the Hodge Laplacian on 1-forms: eigenform_000, ... on edges, "
    "eigenform_vectors_000, ... on cells.",
)
@evolution_options
@options.solver
@options.subdivide
@options.common
def command(
    mesh_path: str, matrix: str | None, mass_matrix: str | None, poisson: str | None, fixed: tuple,
    cones: tuple, boundary_values: str | None, overlay: str | None, evolution: EvolutionOptions,
    solver: str | None, subdivide: int, common: CommonOptions, **tasks: Any,
) -> None:  # fmt: skip
    """Assemble the Laplace matrices of MESH, a surface or tetrahedra, and solve with them.

    L is the positive semidefinite stiffness, M the mass: L x = lambda M x has lambda >= 0.

    \b
    Examples:
      ddgcli laplacian bunny.ply --matrix L.npz --mass-matrix M.npz
      ddgcli laplacian bunny.ply --eigen 50 -o modes.vtu
      ddgcli laplacian face.obj --harmonic --fix 12=0 --fix 300=1 -o harmonic.ply --plot harmonic.png
      ddgcli laplacian face.obj --parameterize conformal -o uv.npz
      ddgcli laplacian face.obj --parameterize discrete-conformal --boundary angles --overlay flat.vtu
      ddgcli laplacian scan.ply --smooth 1e-4 -o smooth.ply
      ddgcli laplacian bunny.ply --wave 0 --duration 2 -o wave.vtkhdf
    """
    options.use_solver(solver)
    selected = [value for name, value in tasks.items() if name not in OPERATOR_OPTIONS]
    evolution.check(any((matrix, mass_matrix, poisson, fixed, cones, boundary_values, overlay, *selected)))
    run = Run("laplacian", common, matrix=matrix, mass_matrix=mass_matrix, poisson=poisson,
              fix=[f"{vertex}={value:.17g}" for vertex, value in fixed],
              cone=[f"{vertex}={value:.17g}" for vertex, value in cones],
              boundary_values=boundary_values, overlay=overlay,
              **({"solver": solver} if solver else {}),
              subdivide=subdivide, **tasks, **evolution.changed())  # fmt: skip
    run.plan_output(matrix, MATRIX_FORMATS)
    run.plan_output(mass_matrix, MATRIX_FORMATS)
    run.plan_output(overlay, OVERLAY_FORMATS)
    if overlay is not None and tasks["parameterize"] != "discrete-conformal":
        raise ParameterError("needs `parameterize=discrete-conformal`", parameter="overlay")
    for name in (poisson, boundary_values, evolution.heat, evolution.wave):
        run.add_input(name)
    source = run.read(mesh_path, accept=("surface", "tetrahedra"), subdivide=subdivide)

    if evolution.equation is not None:
        _evolve(run, source, evolution, tasks["operator"], tasks["mass"])
        return
    from ddgcli.algorithms.laplacian.check_tasks import array_names, check_tasks
    from ddgcli.algorithms.laplacian.solve_tasks import solve_laplacian_tasks
    from ddgcli.algorithms.laplacian.tasks import LaplacianTasks

    selected_tasks = LaplacianTasks(
        poisson=vertex_values(source, poisson, "poisson"),
        fixed=values_by_vertex(fixed, "fixed"),
        cones=values_by_vertex(cones, "cones"),
        boundary_values=vertex_values(
            source,
            boundary_values,
            "boundary_values",
            at_midpoints=180.0 if tasks["boundary"] == "angles" else None,
        ),
        seed=common.seed,
        **tasks,
    )
    mesh = mesh_of(source)
    check_tasks(mesh, selected_tasks)
    names = array_names(mesh, selected_tasks)
    drawn = (*names["vertex"], *names["face"])
    run.begin(drawn, drawn)
    result = solve_laplacian_tasks(mesh, selected_tasks, run.progress("laplacian"))
    arrays = result.picture_arrays
    name, values = run.picture_array(arrays, next(iter(arrays)))
    write_matrices(run, result, matrix, mass_matrix)
    run.write(result.annotated, converged=result.converged)
    if overlay is not None and result.conformal is not None:
        run.write_file(overlay, result.conformal.overlay(), converged=result.converged)
    run.plot(lambda path: draw(path, result, name, values, run.picture_options))
    run.finish(result.results, result.accuracy, converged=result.converged)


def _evolve(
    run: Run, source: MeshInput, evolution: EvolutionOptions, operator: str | None, mass: str
) -> None:
    """Solve the heat or the wave equation, write its frames, and draw the last one."""
    from ddgcli.algorithms.laplacian.check_tasks import check_evolution
    from ddgcli.algorithms.laplacian.evolution import array_names, solve_evolution
    from ddgcli.algorithms.laplacian.evolution_times import EvolutionTimes
    from ddgcli.algorithms.laplacian.laplace_operator import laplace_operator
    from ddgcli.plots.array import draw_array

    mesh, equation = mesh_of(source), str(evolution.equation)
    times = EvolutionTimes.of(evolution.duration, evolution.time_step, evolution.n_frames)
    start = start_of(source, evolution)
    with renamed_parameters(start=equation):
        check_evolution(mesh, start, operator, mass)
    names = array_names(equation)
    run.begin(names, names)
    with renamed_parameters(start=equation):
        result = solve_evolution(
            laplace_operator(mesh, operator, mass), equation, start, times, run.progress(equation)
        )
    name, values = run.picture_array(result.arrays, equation)
    write_evolution(run, mesh, result)
    run.plot(lambda path: draw_array(path, source.surface, name, values, **run.picture_options))
    run.finish(result.results, result.accuracy)


def mesh_of(source: MeshInput) -> Any:
    """The surface, or the mesh of tetrahedra."""
    return source.mesh if source.kind == "tetrahedra" else source.surface


def values_by_vertex(pairs: tuple[tuple[int, float], ...], parameter: str) -> dict[int, float]:
    """Values by vertex; a vertex may be named twice with one value, not with two."""
    fixed: dict[int, float] = {}
    for vertex, value in pairs:
        if fixed.setdefault(vertex, value) != value:
            raise ParameterError(
                f"vertex {vertex} has two values, {fixed[vertex]:g} and {value:g}; keep one",
                parameter=parameter,
            )
    return fixed


def vertex_values(
    source: MeshInput, name: str | None, parameter: str, *, at_midpoints: float | None = None
) -> Any:
    """The vertex array of --poisson or --boundary-values."""
    if name is None:
        return None
    from ddgcli.cli.subdivided_input import input_function

    array, place = input_function(source, name, parameter, at_midpoints=at_midpoints)
    if place not in ("vertex", ""):
        raise ParameterError(
            f"needs values on vertices; {name!r} has values on {place}s", parameter=parameter
        )
    if Path(name).suffix.lower() == ".csv" and _may_have_decimal_commas(array):
        log.warning(
            f"{name}: each line holds two whole numbers, which are two functions; "
            "write decimal points if they are one number with a comma"
        )
    return array


def _may_have_decimal_commas(array: NDArray) -> bool:
    """Whether each row could be one number such as 1,5."""
    is_pair = array.ndim == 2 and array.shape[1] == 2
    return is_pair and bool((array == array.round()).all() and (array[:, 1] >= 0).all())


def write_matrices(run: Run, result: LaplacianResult, matrix: str | None, mass_matrix: str | None) -> None:
    """Write the stiffness and the mass matrix, if they have paths."""
    from ddgcli.io.matrix_file import matrix_bytes

    for path, content in ((matrix, result.operator.stiffness), (mass_matrix, result.operator.mass)):
        if path is not None:
            run.write_bytes(path, matrix_bytes(path, content, run.command_line))


def draw(path: str, result: LaplacianResult, name: str, values: NDArray | None, look: dict[str, Any]) -> None:
    """Draw the surface with an array; flat coordinates as squares on it beside the flat layout."""

    from ddgcli.plots.array import draw_array

    if result.conformal is not None and name in ("uv", "log_scale_factor") and not look.get("show"):
        opened = result.conformal.overlay()
        surface: Any = opened.mesh
        uv = opened.vertex["uv"]
        draw_layout(path, (surface, uv), (surface.moved(uv), uv), look)
        return
    if values is None or values.ndim == 1 or values.shape[1] != 2:
        draw_array(path, result.surface, name, values, **look)
        return
    layout = result.surface.moved(values)
    draw_layout(path, (result.surface, values), (layout, values), look)


def draw_layout(path: str, surface: Any, layout: Any, look: dict[str, Any]) -> None:
    """Draw a surface beside its flat layout; both with their coordinates in the plane as squares."""
    from ddgcli.plots.surface import draw_beside

    size = {key: look[key] for key in ("width", "height", "dpi") if key in look}
    angle: dict[str, Any] = {key: look[key] for key in ("view", "up") if key in look}
    draw_beside(
        path,
        [(surface[0], {"values": surface[1], "title": "surface", **angle}),
         (layout[0], {"values": layout[1], "title": "flat layout", "view": "z", "up": "z"})],
        **size,
    )  # fmt: skip
