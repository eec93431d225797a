"""Commands that measure kernels on surfaces."""

from benchmarks.costs.task import (
    ITERATIVE_EXPONENTS,
    LARGE_SIZES,
    PAIRS,
    PIECE_SIZES,
    SHELL,
    SHELL_SIZES,
    SIZES,
    SMALL_SIZES,
    STIFF,
    TARGETS,
    Task,
)

SURFACE = [
    Task("info", "info {mesh}", LARGE_SIZES, exponent=1.2),
    Task("info self-intersections", "info {mesh} --self-intersections", LARGE_SIZES[1:]),
    Task("write vtu", "info {mesh} -o {out}.vtu"),
    Task("write npz", "info {mesh} -o {out}.npz"),
    Task("write ply", "info {mesh} -o {out}.ply"),
    Task("write text", "info {mesh} -o {out}.obj"),
    Task("picture", "info {mesh} --plot {out}.png --size 200x200"),
    Task("picture pixels", "info {mesh} --plot {out}.png", (10_000,), mesh="needle"),
    Task("picture covered pixels", "info {mesh} --plot {out}.png", (10_000,), mesh="disk"),
    Task("picture of triangulations", "delaunay {mesh} --plot {out}.png", (2_000, 20_000)),
    Task("repair", "repair {mesh} --for curvature", LARGE_SIZES),
    Task(
        "repair holes",
        "repair {mesh} --fill-holes 100000",
        (20_000, 60_000),
        mesh="disk",
        exponent=1.0,
    ),
    *(
        Task(f"curvature {scheme}", f"curvature {{mesh}} --scheme {scheme}", LARGE_SIZES, short=True)
        for scheme in ("cotan", "normal-cycle", "corrected", "quadric")
    ),
    *(
        Task(
            f"curvature {scheme} radius",
            f"curvature {{mesh}} --scheme {scheme} --radius {{radius}}",
            short=True,
        )
        for scheme in ("normal-cycle", "corrected")
    ),
    Task(
        "curvature further arrays",
        "curvature {mesh} --scheme corrected -o {out}.ply",
        LARGE_SIZES,
        short=True,
    ),
    Task("curvature energies", "curvature {mesh} --scheme corrected", LARGE_SIZES),
    Task("curvature sheared", "curvature {mesh}", (80_000, 250_000, 500_000), mesh="sheared", exponent=1.3),
    Task("curvature wide fits", "curvature {mesh}", mesh="detailed"),
    Task("curvature noise", "curvature {mesh}", (800, 10_000), mesh="noisy"),
    Task("curvature normal-voting", "curvature {mesh} --scheme normal-voting", short=True),
    *(
        Task(
            f"curvature {scheme} radius",
            f"curvature {{mesh}} --scheme {scheme} --radius {{wide}}",
            short=True,
        )
        for scheme in ("quadric", "normal-voting")
    ),
    Task("curvature offset", "curvature {mesh} --scheme cotan --offset 0.01", (2_000, 20_000)),
    Task("delaunay", "delaunay {mesh}", LARGE_SIZES, exponent=1.15),
    Task("delaunay refine", "delaunay {mesh} --refine 25", (1_000, *SIZES)),
    Task("delaunay overlay", "delaunay {mesh} --overlay {out}.ply"),
    Task("delaunay further faces", "delaunay {mesh} --overlay {out}.ply", mesh="sheared"),
    Task("delaunay refined faces", "delaunay {mesh} --refine 25 --overlay {out}.ply", (1_000, *SIZES)),
    Task("delaunay transfer", "delaunay {mesh} --transfer f", LARGE_SIZES, exponent=1.25),
    Task("delaunay dual", "delaunay {mesh} --dual {out}.npz"),
    Task("delaunay condition", "delaunay {mesh} --condition", LARGE_SIZES, exponent=1.3),
    Task("laplacian", "laplacian {mesh}"),
    Task("laplacian tufted", "laplacian {mesh} --operator tufted", LARGE_SIZES),
    Task("laplacian matrix", "laplacian {mesh} --matrix {out}.npz"),
    Task("laplacian poisson", "laplacian {mesh} --poisson f", LARGE_SIZES, exponent=1.25),
    *(
        Task(
            f"laplacian {kernel} {solver}",
            f"laplacian {{mesh}} {words} --solver {solver}",
            sizes,
            exponent=max(exponent, least),
        )
        for solver, exponent in ITERATIVE_EXPONENTS
        for kernel, words, sizes, least in (
            ("poisson", "--poisson f", SIZES, 1.0),
            ("eigen", "--eigen 8", SMALL_SIZES, 1.0),
            ("eigenpair", "--eigen 40", SMALL_SIZES, 1.0),
            ("smooth", "--smooth 1e-4", SIZES, 1.0),
            ("form-eigen", "--form-eigen 4", (500, 3_000), 1.4),
            ("heat", "--heat 0 --duration 1 --frames 2", SMALL_SIZES, 1.3),
            ("wave", "--wave f --duration 1 --dt 0.01", SMALL_SIZES, 1.3),
        )
    ),
    Task("laplacian eigen", exponent=1.1, words="laplacian {mesh} --eigen 8"),
    Task("laplacian eigenpair", exponent=1.1, words="laplacian {mesh} --eigen 150"),
    Task("laplacian smooth", exponent=1.15, words="laplacian {mesh} --smooth 1e-4"),
    Task("laplacian discrete-conformal", "laplacian {mesh} --parameterize discrete-conformal", mesh="disk"),
    Task(
        "laplacian conformal", exponent=1.15, words="laplacian {mesh} --parameterize conformal", mesh="disk"
    ),
    Task("laplacian harmonic", "laplacian {mesh} --parameterize harmonic", mesh="disk"),
    Task("laplacian form-eigen", "laplacian {mesh} --form-eigen 4", SMALL_SIZES),
    Task("laplacian heat", "laplacian {mesh} --heat 0 --duration 1 --frames 2"),
    Task("laplacian heat frame", "laplacian {mesh} --heat 0 --duration 1 --frames 100"),
    Task("laplacian wave", "laplacian {mesh} --wave f --duration 1 --dt 0.01"),
    Task("hodge", "hodge {mesh}"),
    Task("hodge field", "hodge {mesh} --field wind"),
    Task("dec", "dec {mesh} -o {out}.npz"),
    Task("geodesic exact", exponent=1.12, words="geodesic {mesh} --source 0"),
    Task("geodesic heat", "geodesic {mesh} --source 0 --method heat", LARGE_SIZES, exponent=1.3),
    Task(
        "geodesic fast-marching",
        "geodesic {mesh} --source 0 --method fast-marching",
        (5_000, 20_000, 80_000, 320_000),
    ),
    *(
        Task(
            f"geodesic {kernel} {solver}",
            f"geodesic {{mesh}} --method heat {words} --solver {solver}",
            sizes,
            exponent=exponent,
        )
        for solver, exponent in ITERATIVE_EXPONENTS
        for kernel, words, sizes in (
            ("heat", "--source 0", SIZES),
            ("heat solve", "--source 0,9,99,999 --each-source", SMALL_SIZES),
            ("vector-heat", "--source 0 --log-map", SIZES),
        )
    ),
    Task("geodesic dijkstra", "geodesic {mesh} --source 0 --method dijkstra"),
    *(
        Task(
            f"geodesic {method} solve",
            f"geodesic {{mesh}} --source 0,9,99,999 --each-source --method {method}",
        )
        for method in ("exact", "heat", "fast-marching", "dijkstra")
    ),
    Task("geodesic log-map", "geodesic {mesh} --source 0 --log-map"),
    Task(
        "geodesic job",
        "geodesic {mesh} --source 0,9,99,999 --each-source --jobs 2",
        (10_000,),
    ),
    Task(
        "geodesic many sources",
        f"geodesic {{mesh}} --source {','.join(map(str, range(17)))} --method dijkstra",
    ),
    Task("geodesic point", "geodesic {mesh} --source-point 0,0,1"),
    Task(
        "geodesic field", "geodesic {mesh} --field wind --field-seeds 1 --field-time 1e-4 --field-step 1e-4"
    ),
    Task(
        "geodesic field round",
        "geodesic {mesh} --field wind --field-seeds 1 --field-time 0.1 --field-step 1e-4",
        (10_000,),
        exponent=1.0,
    ),
    Task(
        "geodesic field step",
        "geodesic {mesh} --field wind --field-seeds 300 --field-time {radius} --field-step 1e-3",
        (1_000, 10_000, 80_000),
        exponent=1.0,
    ),
    Task("geodesic transport", "geodesic {mesh} --source 0 --path-to 9 --transport"),
    Task("geodesic vector-heat", "geodesic {mesh} --source 0 --spread-vector 0.3,0.5,1"),
    Task("geodesic heat log-map", "geodesic {mesh} --source 0 --method heat --log-map"),
    Task("geodesic marching log-map", "geodesic {mesh} --source 0 --method fast-marching --log-map"),
    Task("geodesic trace", "geodesic {mesh} --trace 0:1,0,0:1,0.3,0:1"),
    Task("geodesic crossings", "geodesic {mesh} --trace 0:1,0,0:1,0.3,0:1000", (2_000, 10_000)),
    Task("geodesic fan", "geodesic {mesh} --source 0 --fan 9 --fan-length 1 --method fast-marching"),
    Task(  # rays that stop at the boundary
        "geodesic fan levels",
        "geodesic {mesh} --source 0 --fan 5000 --fan-length 1000 --method fast-marching",
        (200,),
        mesh="disk",
    ),
    Task(
        "geodesic fan crossings",
        "geodesic {mesh} --source 0 --fan 300 --fan-length 30 --method fast-marching",
        (500, 2_000, 10_000, 80_000),
    ),
    Task("geodesic isolines", "geodesic {mesh} --source 0 --isolines 20 --method fast-marching"),
    Task(
        "geodesic level",
        "geodesic {mesh} --source 0 --isolines 1000 --method dijkstra",
        (500, 5_000, 30_000),
        exponent=1.0,
    ),
    Task(
        "write curves",
        "geodesic {mesh} --source 0 --isolines 1000 --method dijkstra --paths-output {out}.vtp",
        (500, 5_000, 30_000),
        exponent=1.0,
    ),
    Task("geodesic path", f"geodesic {{mesh}} --source 0 --path-to {TARGETS}", (2_000, 60_000), exponent=1.0),
    Task(
        "geodesic frames",
        f"geodesic {{mesh}} --source 0 --path-to {TARGETS} --darboux",
        (2_000, 60_000),
        exponent=1.0,
    ),
    Task("geodesic edge path", "geodesic {mesh} --curve 0,9"),
    Task("geodesic leg", f"geodesic {{mesh}} {' '.join(f'--curve {pair}' for pair in PAIRS)}"),
    Task(
        "geodesic straighten",
        f"geodesic {{mesh}} {' '.join(f'--straighten {pair}' for pair in PAIRS)}",
        exponent=1.0,
    ),
    Task("geodesic voronoi", "geodesic {mesh} --source 0,9 --voronoi"),
    Task("willmore-flow", "willmore-flow {mesh} --steps 1 --dt 1e-9", SMALL_SIZES),
    Task(
        "willmore-flow mean-curvature",
        "willmore-flow {mesh} --flow mean-curvature --steps 1 --dt 1e-9",
        (2_000, 80_000),
    ),
    *(
        Task(
            f"willmore-flow {flow} step",
            f"willmore-flow {{mesh}} --flow {flow} --steps 9 --dt 1e-9",
            (*SMALL_SIZES, 80_000),
            exponent=1.15,
        )
        for flow in ("quadratic", "mean-curvature")
    ),
    *(
        Task(
            f"willmore-flow {kind} step",
            f"willmore-flow {{mesh}} --flow {flow} --steps 20",  # the memory of many factors
            SMALL_SIZES,
            mesh="torus",
            uses="steps",
        )
        for kind, flow in (("descent", "quadratic"), ("newton", "newton"))
    ),
    Task(
        "willmore-flow improvement",
        "willmore-flow {mesh} --steps 1",
        (20_000, 40_000, 80_000),
        exponent=1.25,
    ),
    Task(
        "willmore-flow remeshing",
        "willmore-flow {mesh} --remesh mean --steps 1",
        SMALL_SIZES,
        mesh="torus",
        uses="remeshes",
    ),
    Task("willmore-flow conformal", "willmore-flow {mesh} --flow conformal", (500, 2_000), mesh="torus"),
    Task(
        "shell-sim",
        f"shell-sim {{mesh}} {SHELL} --effect bending --integrator verlet --dt 1e-8 --steps 1",
        PIECE_SIZES,
        mesh="disk",
        exponent=1.2,
    ),
    Task(
        "shell-sim assembly",
        f"shell-sim {{mesh}} {SHELL} --effect bending --effect 'damping stiffness=1e-9' --integrator verlet "
        "--dt 1e-8 --steps 1",
        SHELL_SIZES,
        mesh="disk",
    ),
    Task(
        "shell-sim solvers",
        f"shell-sim {{mesh}} {SHELL} --effect bending --dt 1e-8 --pin 0 --steps 1",
        (300,),  # their modules, for the rest is that of the step
        mesh="disk",
    ),
    Task(
        "shell-sim implicit step",
        f"shell-sim {{mesh}} {SHELL} --effect bending --dt 5e-3 --pin 0 --steps 5",
        SHELL_SIZES,
        mesh="disk",
        exponent=1.15,
    ),
    *(
        Task(
            f"shell-sim {kind}rest check",
            f"shell-sim {{mesh}} {STIFF.removesuffix(' --effect gravity')} "
            f"--effect \"bending model='{model}'\" --pin 0 --pin 9 --pin 99 --integrator static",
            sizes,
            mesh="disk",
            exponent=1.15,
        )
        for kind, model, sizes in (("", "hinge", SMALL_SIZES), ("midedge ", "midedge", (1_000, 4_000)))
    ),
    *(
        Task(
            f"shell-sim {kind}iteration",
            f"shell-sim {{mesh}} {STIFF} --effect \"bending model='{model}'\" --pin 0 --pin 9 --pin 99 "
            "--integrator static",
            sizes,
            mesh="disk",
            exponent=1.15,
            uses="newton_iterations",
        )
        for kind, model, sizes in (("", "hinge", SMALL_SIZES), ("midedge ", "midedge", (1_000, 4_000)))
    ),
    *(
        Task(
            f"shell-sim {task}",
            f"shell-sim {{mesh}} {SHELL} --effect bending --pin 0 --pin 9 --pin 99 --{task} 10",
            SMALL_SIZES,
            mesh="torus",
            exponent=1.15,
        )
        for task in ("modes", "buckling")
    ),
    Task(
        "shell-sim iterative implicit step",
        f"shell-sim {{mesh}} {SHELL} --effect bending --dt 5e-3 --pin 0 --steps 5",
        (10_000, 30_000, 100_000),
        mesh="disk",
        exponent=1.35,
        solver="multigrid",
    ),
    Task(
        "shell-sim iterative midedge step",
        f"shell-sim {{mesh}} {SHELL} --effect \"bending model='midedge'\" --dt 5e-3 --pin 0 --steps 5",
        SMALL_SIZES,
        mesh="disk",
        exponent=1.15,
        solver="multigrid",
    ),
    Task(
        "shell-sim midedge step",
        f"shell-sim {{mesh}} {SHELL} --effect \"bending model='midedge'\" --dt 5e-3 --pin 0 --steps 5",
        SMALL_SIZES,
        mesh="disk",
        exponent=1.15,
    ),
    Task(
        "shell-sim explicit step",
        f"shell-sim {{mesh}} {SHELL} --effect bending --integrator verlet --dt 1e-8 --steps 40",
        PIECE_SIZES,
        mesh="disk",
    ),
    Task(
        "shell-sim avi",
        f"shell-sim {{mesh}} {SHELL} --effect bending --integrator avi --dt 1e-8 --steps 1",
        mesh="disk",
    ),
    Task(
        "shell-sim pairs step",
        f"shell-sim {{mesh}} {SHELL} --effect bending --effect 'contact self_contact=true' --dt 5e-3 --pin 0 "
        "--steps 5",
        SMALL_SIZES,
        mesh="disk",
    ),
    Task("fluid-sim", "fluid-sim {mesh} --vorticity f --dt 1e-7 --steps 1", LARGE_SIZES, exponent=1.2),
    *(
        Task(
            f"fluid-sim {name} step",
            f"fluid-sim {{mesh}} --vorticity f --integrator {name} --dt 1e-7 --steps 9",
            (2_000, *SIZES),
        )
        for name in ("circulation", "conservative", "energy", "covector")
    ),
    *(
        Task(f"tradeoff {words.split()[0]}", f"tradeoff {words} --budget 600", sizes)
        for words, sizes in (
            ("curvature {mesh}", SMALL_SIZES),
            ("delaunay {mesh}", SMALL_SIZES),
            ("laplacian {mesh}", SMALL_SIZES),
            ("geodesic {mesh} --source 0", SMALL_SIZES),
            ("willmore-flow {mesh}", (500, 2_000)),
        )
    ),
    Task("view", "view {mesh} -o {out}.html"),
    Task("view frame", "view {mesh} -o {out}.html", mesh="trajectory"),
    Task(
        "picture of a run",
        "willmore-flow {mesh} --flow mean-curvature --steps 1 --dt 1e-9 --plot {out}.png",
        SMALL_SIZES,
    ),
]
