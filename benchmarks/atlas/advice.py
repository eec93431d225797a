"""Advice on methods: sentences, and for each the condition on the tables that supports it."""

from __future__ import annotations

from collections.abc import Callable

from benchmarks.atlas.tables import Finest

ADVICE = {
    "curvature": """
Choosing a method:
`quadric` (the default): at least ten times more accurate than every other scheme and peer on every
mesh class of the ellipsoid, at about the cost of a fit of libigl or pymeshlab; its rates are 2.5 to 3.5.
`corrected` at the star is exact on spheres and takes a third of that time: a third of a per cent off on
good meshes, some per cent on others. `cotan`, `normal-cycle` and pymeshlab's discrete curvature at the
star stay more than 5 % off on irregular, noisy and stretched triangles however fine; balls (`--radius`)
make them converge slowly, at several times the cost of `quadric`.
""",
    "geodesic": """
Choosing a method:
`exact` for one source: on every mesh class nothing else that is not exact has a smaller error, and it
converges at second order; no `--tolerance` takes longer, and 0.3 saves a sixth to two fifths of the time
(smaller ones are answered exactly, or nearly, on meshes of this size).
For many sources `heat`, where a further source costs a fifteenth of an exact one or less: two per cent
off or better, also on stretched triangles, where without Delaunay flips (`--operator plain`) it is a
fifth off. `fast-marching` keeps a tenth of a per cent on every mesh class, for a fifth of the time.
""",
    "laplacian": """
Choosing a method:
any: all are of second order on every mesh class. The Galerkin mass errs two to three times more than a
lumped one on good, irregular and noisy triangles. Flips do not improve eigenvalues here; they keep
weights positive, which Poisson problems and flows need.
""",
    "delaunay": """
Choosing a method:
flips. On stretched triangles they more than halve the error of a Poisson solve at the cost of a
quarter of a solve; on good ones they change nothing. Refinement to 25 degrees takes longer than the solve
and, on irregular, stretched and noisy triangles, does not lower this error (the surface, not the
triangles, makes it): take it where angles must be bounded.
""",
    "willmore-flow": """
Choosing a method:
`gauss-map` (the default): no other energy has a smaller error on good, irregular, refined and stretched
triangles of the ellipsoid, and none that stands for int H^2 on the torus; it costs two to three times as
much to evaluate, a step to rest little more. On irregular and refined triangulations it errs by a fiftieth
or less, on stretched ones by a sixteenth, however fine the mesh; `sullivan` and `cotan` by up to five times
the energy itself. On noisy vertices it is the worst of the three: off by as much as the energy itself, where
`sullivan` and `cotan` are off by a fifth.
The sphere's mode is within half a per cent from 5,000 faces, at steps of a sixtieth of its life time; of an
eighth, within two per cent.
""",
    "fluid-sim": """
Choosing a method:
`conservative` (the default): its error is the mesh's at both steps, so take the long one (what its
stability does not allow is divided). `energy` is as accurate. Stretched triangles cost five times the
error of good ones. `circulation` takes steps of any length. On good meshes its error of the wave's speed is
below that of `conservative`, that of Taylor-Green's decay above it; it falls as meshes get finer at a fixed
step too. On stretched and refined triangles `covector` has a smaller error of the wave's speed than both.
""",
    "shell-sim": """
Choosing a method:
`alternating` or `right` grids, not `cross`, whose bending is off by more than an eighth at any
size, and not stretched, jittered or refined meshes, which stay at a twentieth or more: the constant of
hinges is that of regular grids. On flat rests `quadratic` has the error of `hinge` in less time. For
short free motion of a soft sheet `verlet` is the cheapest of second order: `newmark` and
`implicit-midpoint` have errors of its size at equal steps. The Euler schemes are never worth it for accuracy.
""",
}

UNEVEN_MESH_CLASSES = ("irregular", "stretched", "noisy")
STAR_SCHEMES = ("cotan radius=own", "normal-cycle radius=own", "pymeshlab discrete")
PEER_FITS = ("libigl radius=2 rings", "pymeshlab quadric")
EXACT_METHOD = "exact tolerance=0"
SOLVERS = ("conservative dt=0.1", "conservative dt=0.025")
SPEED, GREEN = "Rossby-Haurwitz speed", "Taylor-Green decay"
HANGING_PROBLEM, FREE_PROBLEM = "cantilever, weight 2", "verlet with a small step"
EGG, TORUS, MODE = "energy of the ellipsoid 1,1,2", "energy of the torus 2,1", "rate of the sphere's mode l=2"

Claim = tuple[str, Callable[[Finest], bool]]


CLAIMS: dict[str, list[Claim]] = {
    "curvature": [
        (
            "at least ten times more accurate than every other scheme and peer",
            lambda t: all(
                row["mean_error"] > 10 * t.error("quadric radius=own", f)
                for f in t.mesh_classes
                for row in t.others(["quadric"], f)
            ),
        ),
        (
            "about the cost of a fit of libigl or pymeshlab",
            lambda t: all(
                0.6 < t.seconds("quadric radius=own", f) / t.seconds(peer, f) < 1.6
                for f in t.mesh_classes
                for peer in PEER_FITS
            ),
        ),
        (
            "its rates are 2.5 to 3.5",
            lambda t: all(2.4 < t.rate("quadric radius=own", f) < 3.6 for f in t.mesh_classes),
        ),
        ("exact on spheres", lambda t: t.error("corrected radius=own", "irregular", "sphere:1") < 1e-9),
        (
            "takes a third of that time",
            lambda t: all(
                t.seconds("corrected radius=own", f) < 0.45 * t.seconds("quadric radius=own", f)
                for f in t.mesh_classes
            ),
        ),
        (
            "a third of a per cent off on good meshes, some per cent on others",
            lambda t: (
                t.error("corrected radius=own", "good") < 3.5e-3
                and all(0.01 < t.error("corrected radius=own", f) < 0.06 for f in UNEVEN_MESH_CLASSES)
            ),
        ),
        (
            "stay more than 5 % off on irregular, noisy and stretched triangles however fine",
            lambda t: all(
                t.error(c, f) > 0.05 and t.rate(c, f) < 0.2 for c in STAR_SCHEMES for f in UNEVEN_MESH_CLASSES
            ),
        ),
        (
            "converge slowly, at several times the cost of `quadric`",
            lambda t: all(
                t.rate("normal-cycle radius=2 edges", f) > 0.4
                and t.seconds("normal-cycle radius=2 edges", f) > 2 * t.seconds("quadric radius=own", f)
                for f in UNEVEN_MESH_CLASSES
            ),
        ),
    ],
    "geodesic": [
        (
            "nothing else that is not exact has a smaller error",
            lambda t: all(
                row["mean_error"] > t.error(EXACT_METHOD, f)
                for f in t.mesh_classes
                for row in t.others(["exact", "pygeodesic"], f)
            ),
        ),
        (
            "it converges at second order",
            lambda t: all(1.8 < t.rate(EXACT_METHOD, f) < 2.3 for f in t.mesh_classes),
        ),
        (
            "no `--tolerance` takes longer",
            lambda t: all(
                t.seconds(f"exact tolerance={slack}", f) < 1.1 * t.seconds(EXACT_METHOD, f)
                for f in t.mesh_classes
                for slack in (0.01, 0.03, 0.1, 0.3)
            ),
        ),
        (
            "0.3 saves a sixth to two fifths of the time",
            lambda t: all(
                0.55 < t.seconds("exact tolerance=0.3", f) / t.seconds(EXACT_METHOD, f) < 0.88
                for f in t.mesh_classes
            ),
        ),
        (
            "smaller ones are answered exactly, or nearly, on meshes of this size",
            lambda t: all(
                t.error(f"exact tolerance={slack}", f) < 1e-3
                for f in t.mesh_classes
                for slack in (0.01, 0.03, 0.1)
            ),
        ),
        (
            "a further source costs a fifteenth of an exact one or less",
            lambda t: all(t.query("heat", f) < t.query(EXACT_METHOD, f) / 15 for f in t.mesh_classes),
        ),
        (
            "two per cent off or better, also on stretched triangles",
            lambda t: all(t.error("heat", f) < 0.02 for f in t.mesh_classes),
        ),
        ("it is a fifth off", lambda t: 0.15 < t.error("heat operator=plain", "stretched") < 0.35),
        (
            "keeps a tenth of a per cent on every mesh class, for a fifth of the time",
            lambda t: all(
                t.error("fast-marching", f) < 1.2e-3
                and 0.14 < t.seconds("fast-marching", f) / t.seconds(EXACT_METHOD, f) < 0.26
                for f in t.mesh_classes
            ),
        ),
    ],
    "laplacian": [
        (
            "all are of second order on every mesh class",
            lambda t: all(
                1.6 < t.rate(row["configuration"], f) < 2.5
                for f in t.mesh_classes
                for row in t.others(["none"], f)
            ),
        ),
        (
            "two to three times more than a lumped one on good, irregular and noisy triangles",
            lambda t: all(
                1.9 < t.error(f"{op} mass=galerkin", f) / t.error(f"{op} mass=lumped", f) < 3.3
                for f in ("good", "irregular", "noisy")
                for op in ("cotan", "intrinsic-delaunay")
            ),
        ),
        (
            "Flips do not improve eigenvalues here",
            lambda t: all(
                t.error("intrinsic-delaunay mass=lumped", f) > 0.95 * t.error("cotan mass=lumped", f)
                for f in t.mesh_classes
            ),
        ),
    ],
    "delaunay": [
        (
            "they more than halve the error of a Poisson solve",
            lambda t: t.error("flips", "stretched") < 0.5 * t.error("input as it is", "stretched"),
        ),
        (
            "at the cost of a quarter of a solve",
            lambda t: t.row("flips", "stretched")["setup_seconds"] < 0.35 * t.query("flips", "stretched"),
        ),
        (
            "on good ones they change nothing",
            lambda t: abs(t.error("flips", "good") / t.error("input as it is", "good") - 1) < 1e-3,
        ),
        (
            "on irregular, stretched and noisy triangles, does not lower this error",
            lambda t: all(
                t.row("refine degrees=25", f)["setup_seconds"] > 2 * t.query("flips", f)
                and t.error("refine degrees=25", f) > t.error("flips", f)
                for f in UNEVEN_MESH_CLASSES
            ),
        ),
    ],
    "willmore-flow": [
        (
            "smaller error on good, irregular, refined and stretched triangles of the ellipsoid",
            lambda t: all(
                t.error("gauss-map", f, EGG) <= t.error(e, f, EGG)
                for f in ("good", "refined", "irregular", "stretched")
                for e in ("sullivan", "cotan", "hinge")
            ),
        ),
        (
            "and none that stands for int H^2 on the torus",
            lambda t: all(
                t.error("gauss-map", pattern, TORUS) < t.error(e, pattern, TORUS)
                for pattern in ("alternating", "right")
                for e in ("sullivan", "cotan")
            ),
        ),
        (
            "errs by a fiftieth or less, on stretched ones by a sixteenth",
            lambda t: (
                all(t.error("gauss-map", f, EGG) < 0.02 for f in ("irregular", "refined"))
                and t.error("gauss-map", "stretched", EGG) < 1 / 16
            ),
        ),
        (
            "off by as much as the energy itself, where `sullivan` and `cotan` are off by a fifth",
            lambda t: (
                0.8 < t.error("gauss-map", "noisy", EGG) < 1.2
                and all(t.error(e, "noisy", EGG) < 0.2 for e in ("sullivan", "cotan"))
            ),
        ),
        (
            "by up to five times the energy itself",
            lambda t: all(3.5 < t.error(e, "stretched", EGG) < 6 for e in ("sullivan", "cotan")),
        ),
        (
            "within half a per cent from 5,000 faces",
            lambda t: (
                t.error("gauss-map dt=0.0013", "meshes", MODE) < 0.005
                and t.error("gauss-map dt=0.01", "meshes", MODE) < 0.02
            ),
        ),
    ],
    "fluid-sim": [
        (
            "its error is the mesh's at both steps",
            lambda t: all(
                abs(t.error(SOLVERS[0], f, SPEED) / t.error(SOLVERS[1], f, SPEED) - 1) < 0.05
                for f in t.having(*SOLVERS)
            ),
        ),
        (
            "`energy` is as accurate",
            lambda t: all(
                t.error("energy dt=0.025", f, SPEED) < 1.2 * t.error(SOLVERS[0], f, SPEED)
                for f in t.having("energy dt=0.025", SOLVERS[0])
            ),
        ),
        (
            "Stretched triangles cost five times the error of good ones",
            lambda t: 3 < t.error(SOLVERS[0], "stretched", SPEED) / t.error(SOLVERS[0], "good", SPEED) < 8,
        ),
        (
            "`covector` has a smaller error of the wave's speed than both",
            lambda t: all(
                t.error("covector dt=0.1", f, SPEED)
                < 0.8 * min(t.error(SOLVERS[0], f, SPEED), t.error("circulation dt=0.1", f, SPEED))
                for f in ("stretched", "refined")
            ),
        ),
        (
            "wave's speed is below that of `conservative`",
            lambda t: t.error("circulation dt=0.1", "good", SPEED) < t.error(SOLVERS[0], "good", SPEED),
        ),
        (
            "that of Taylor-Green's decay above it",
            lambda t: all(
                t.error("circulation dt=0.05", f, GREEN) > t.error("conservative dt=0.05", f, GREEN)
                for f in ("alternating", "right")
            ),
        ),
        (
            "falls as meshes get finer at a fixed step too",
            lambda t: t.rate("circulation dt=0.05", "right", GREEN) > 1.4,
        ),
    ],
    "shell-sim": [
        (
            "whose bending is off by more than an eighth at any size",
            lambda t: all(t.error("hinge", "cross", f"cantilever, weight {w}") > 0.125 for w in (2, 10)),
        ),
        (
            "which stay at a twentieth or more",
            lambda t: all(
                t.error("hinge", f, HANGING_PROBLEM) > 0.05 for f in ("stretched", "noisy", "refined")
            ),
        ),
        (
            "`quadratic` has the error of `hinge` in less time",
            lambda t: all(
                t.error("quadratic", f, HANGING_PROBLEM) < 1.1 * t.error("hinge", f, HANGING_PROBLEM)
                and t.seconds("quadratic", f, HANGING_PROBLEM) < 1.05 * t.seconds("hinge", f, HANGING_PROBLEM)
                for f in ("alternating", "right")
            ),
        ),
        (
            "`verlet` is the cheapest of second order",
            lambda t: all(
                2 * t.seconds("verlet", "steps", FREE_PROBLEM) < t.seconds(name, "steps", FREE_PROBLEM)
                for name in ("newmark", "implicit-midpoint")
            ),
        ),
        (
            "have errors of its size at equal steps",
            lambda t: all(
                t.error(name, "steps", FREE_PROBLEM) < 3 * t.error("verlet", "steps", FREE_PROBLEM)
                for name in ("newmark", "implicit-midpoint")
            ),
        ),
        (
            "never worth it for accuracy",
            lambda t: all(
                t.error(name, "steps", FREE_PROBLEM) > 30 * t.error("verlet", "steps", FREE_PROBLEM)
                for name in ("implicit-euler", "symplectic-euler")
            ),
        ),
    ],
}
