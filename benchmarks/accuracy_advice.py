"""Which method to take when: sentences, and for each what the tables must show for it to stand."""

ADVICE = {
    "curvature": """
Which: `quadric` (the default): ten to a thousand times more accurate than all else on every family but the
sphere, in a tenth of a second at 20,000 faces; observed rates are 2.5 to 4. `corrected` at the star takes a
quarter of that time, is exact on spheres, a fifth of a per cent off on regular meshes and some per cent on
irregular ones. `cotan` and `normal-cycle` at the star stay 7 to 67 % off on irregular triangulations however
fine; balls (`--radius`) make them converge slowly, at five to twenty times the time.
""",
    "geodesic": """
Which: `exact` for one source: a tenth of the error of anything else, for a few tenths of a second at 20,000
faces; `--tolerance 0.1` halves that time at ten times the error. For many sources `heat`, where a further
source costs a twentieth of an exact one: half a per cent off, one and a half on stretched triangles, where
without Delaunay flips (`--operator plain`) it is a fifth off. Its error stays where it is as meshes get
finer; with `--heat-refine 3` it falls, but not on stretched triangles. `fast-marching` keeps a tenth of a per
cent on every family.
""",
    "laplacian": """
Which: any: all are of second order on every family. The Galerkin mass errs two to three times more than a
lumped one on good triangles, but on stretched ones with `intrinsic-delaunay` it has the smallest largest
error. Flips do not improve eigenvalues here; they keep weights positive, which Poisson problems and flows
need.
""",
    "delaunay": """
Which: flips. On stretched triangles they more than halve the error of a Poisson solve for the price of half a
solve; on good ones they change nothing and cost next to nothing. Refinement takes ten to a hundred times as
long and does not lower this error (the surface, not the triangles, makes it): take it where angles must be
bounded.
""",
    "willmore-flow": """
Which: `sullivan` (the default) has the smaller error on the sphere and the ellipsoid, `cotan` on the torus.
On irregular triangulations trust no energy as a number to better than a tenth, however fine the mesh: make
the mesh regular first. A step of an eighth of a mode's life time costs `sullivan` next to no accuracy: there
the mesh, not the step, makes the error.
""",
    "fluid-sim": """
Which: `conservative` (the default): its error is the mesh's at both steps, so take the long one (what its
stability does not allow is divided). `midpoint` is as accurate, and cheaper where the flow is nearly steady.
`circulation` mostly has ten times the error or more; at a fixed step it does not fall steadily as meshes get
finer, and can grow. It pays with long steps on irregular meshes, whose smallest faces bind the step of
rk4; that it is the more accurate there too is luck: its shorter step has ten times the error.
""",
    "shell-sim": """
Which: `alternating` or `right` grids, not `cross`, whose bending is off by more than an eighth at any size.
On flat rests `quadratic` has the error of `hinge` in less time. For short free motion of a soft sheet
`verlet` is the cheapest; `newmark` and `implicit-midpoint` have errors of its size at equal steps. The Euler
schemes are never worth it for accuracy.
""",
}
