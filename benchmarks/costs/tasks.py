"""Commands that measure one kernel each: on surfaces (`surface_tasks`), tetrahedra and curves."""

from benchmarks.costs.surface_tasks import SURFACE
from benchmarks.costs.task import CURVE_SIZES, LARGE_SIZES, SIZES, SMALL_SIZES, SOLID_SIZES, Task

TETRAHEDRA = [
    Task("info", "info {mesh}", mesh="box", suffix="tetrahedra"),
    Task("write vtu", "info {mesh} -o {out}.vtu", mesh="box", suffix="tetrahedra"),
    Task("write npz", "info {mesh} -o {out}.npz", mesh="box", suffix="tetrahedra"),
    Task("laplacian", "laplacian {mesh}", mesh="box", suffix="tetrahedra"),
    Task(
        "laplacian poisson",
        exponent=1.15,
        words="laplacian {mesh} --poisson f",
        mesh="box",
        suffix="tetrahedra",
    ),
    Task(
        "laplacian eigen", exponent=1.1, words="laplacian {mesh} --eigen 8", mesh="box", suffix="tetrahedra"
    ),
    Task(
        "laplacian eigenpair",
        "laplacian {mesh} --eigen 100",
        (1_500, *SIZES),
        exponent=1.1,
        mesh="box",
        suffix="tetrahedra",
    ),
    Task(
        "laplacian form-eigen",
        "laplacian {mesh} --form-eigen 4",
        (1_500, 3_000, 10_000),
        exponent=2.0,
        mesh="box",
        suffix="tetrahedra",
    ),
    Task(
        "fluid-sim",
        "fluid-sim {mesh} --flow vortex-ring --integrator energy --dt 1e-7 --steps 1",
        SOLID_SIZES,
        exponent=1.3,
        mesh="box",
        suffix="tetrahedra",
    ),
    *(
        Task(
            f"fluid-sim {name} step",
            f"fluid-sim {{mesh}} --flow vortex-ring --integrator {name} --dt 1e-3 --steps 9",
            SOLID_SIZES,
            exponent=1.3,
            mesh="box",
            suffix="tetrahedra",
        )
        for name in ("circulation", "energy", "covector")
    ),
    Task("hodge", "hodge {mesh}", SMALL_SIZES, mesh="box", suffix="tetrahedra"),
    Task(
        "hodge cochains",
        "hodge {mesh}",
        SMALL_SIZES,
        exponent=1.33,  # iterations grow with the number of edges across
        mesh="pierced",
        suffix="tetrahedra",
    ),
    Task(
        "hodge field",
        "hodge {mesh} --field wind",
        SOLID_SIZES,
        exponent=1.3,
        mesh="box",
        suffix="tetrahedra",
    ),
    Task("dec", "dec {mesh} -o {out}.npz", SOLID_SIZES, mesh="box", suffix="tetrahedra"),
    Task("view", "view {mesh} -o {out}.html", mesh="box", suffix="tetrahedra"),
]
CURVES = [
    Task("info", "info {mesh}", mesh="circle", suffix="curve"),
    Task("curvature", "curvature {mesh}", mesh="circle", suffix="curve"),
    Task("curvature frames", "curvature {mesh} --frames", LARGE_SIZES, mesh="circle", suffix="curve"),
    Task("picture", "info {mesh} --plot {out}.png", mesh="circle", suffix="curve"),
    Task("curve-flow", "curve-flow {mesh} --steps 1 --dt 1e-9", CURVE_SIZES, mesh="circle", suffix="curve"),
    Task(
        "curve-flow step",
        "curve-flow {mesh} --steps 20 --dt 1e-9",
        CURVE_SIZES,
        mesh="circle",
        suffix="curve",
    ),
    Task(
        "curve-flow search",
        "curve-flow {mesh} --steps 20 --dt 1e-9",
        SMALL_SIZES,
        mesh="rings",
        suffix="curve",
    ),
]
TASKS = [*SURFACE, *TETRAHEDRA, *CURVES]
