"""What theory says of each command, and which method to take when, as the tables bear out."""

from ddgcli.evolve.integrators import INTEGRATORS

ADVICE = {
    "curvature": """
Theory: a fit that takes quartic terms in where they help converges at second order at least, on any sampling;
corrected measures in balls that shrink more slowly than the edges; cotangent and normal-cycle values at the
star on regular meshes only.

Which: `quadric` (the default): ten to a thousand times more accurate than all else on every family but the
sphere, in a tenth of a second at 20,000 faces; observed rates are 2.5 to 4. `corrected` at the star takes a
quarter of that time, is exact on spheres, a fifth of a per cent off on regular meshes and some per cent on
irregular ones. `cotan` and `normal-cycle` at the star stay 7 to 67 % off on irregular triangulations however
fine; balls (`--radius`) make them converge slowly, at five to twenty times the time.
""",
    "geodesic": """
Theory: the exact polyhedral distance converges to the smooth one at second order; fast marching at
first; heat at first at best; paths along edges not at all.

Which: `exact` for one source: a tenth of the error of anything else, for a few tenths of a second at 20,000
faces; `--tolerance 0.1` halves that time at ten times the error. For many sources `heat`, where a further
source costs a twentieth of an exact one: half a per cent off, one and a half on stretched triangles, where
without Delaunay flips (`--operator plain`) it is a fifth off. Its error stays where it is as meshes get
finer; with `--heat-refine 3` it falls, but not on stretched triangles. `fast-marching` keeps a tenth of a per
cent on every family.
""",
    "laplacian": """
Theory: eigenvalues converge at second order; from above for the Galerkin mass.

Which: any: all are of second order on every family. The Galerkin mass errs two to three times more than a
lumped one on good triangles, but on stretched ones with `intrinsic-delaunay` it has the smallest largest
error. Flips do not improve eigenvalues here; they keep weights positive, which Poisson problems and flows
need.
""",
    "delaunay": """
Theory: second order on every family; flips and refinement lower the constant where triangles are bad.

Which: flips. On stretched triangles they more than halve the error of a Poisson solve for the price of half a
solve; on good ones they change nothing and cost next to nothing. Refinement takes ten to a hundred times as
long and does not lower this error (the surface, not the triangles, makes it): take it where angles must be
bounded.
""",
    "willmore-flow": """
Theory: `sullivan` and `cotan` are of second order where vertex stars are symmetric to leading order (geodesic
spheres, grids of one diagonal); on irregular or alternating stars an error stays that refinement does not
remove. `hinge` depends on the directions of the edges. Timed steps are of second order.

Which: `sullivan` (the default) has the smaller error on the sphere and the ellipsoid, `cotan` on the torus.
On irregular triangulations trust no energy as a number to better than a tenth, however fine the mesh: make
the mesh regular first. A step of an eighth of a mode's life time costs `sullivan` next to no accuracy: there
the mesh, not the step, makes the error.
""",
    "fluid-sim": """
Theory: `conservative` is of second order in the mesh and of fourth (rk4) or second (midpoint) in the step;
`circulation` is of first order in the step, and no rate in the mesh is known.

Which: `conservative` (the default): its error is the mesh's at both steps, so take the long one (what its
stability does not allow is divided). `midpoint` is as accurate, and cheaper where the flow is nearly steady.
`circulation` mostly has ten times the error or more; at a fixed step it does not fall steadily as meshes get
finer, and can grow. It pays with long steps on irregular meshes, whose smallest faces bind the step of
rk4; that it is the more accurate there too is luck: its shorter step has ten times the error.
""",
    "shell-sim": """
Theory: the column of cells that holds the cantilever is an error of first order; what is left is the plate
that a hinge mesh is, which depends on the pattern and does not go away (docs/shell-sim.md), so the rate
ends at zero (and is of no meaning where the error changes its sign on the way).

Which: `alternating` or `right` grids, not `cross`, whose bending is off by more than an eighth at any size.
On flat rests `quadratic` has the error of `hinge` in less time. For short free motion of a soft sheet
`verlet` is the cheapest; `newmark` and `implicit-midpoint` have errors of its size at equal steps. The Euler
schemes are never worth it for accuracy.
""",
}

# rates of the smooth energies hold where vertex stars are symmetric to leading order
SYMMETRIC = ("good", "right", "meshes", "steps")


def theory(command: str, family: str, configuration: str) -> str:
    """Rate that theory gives a simulator's configuration, "-" where it gives none."""
    method = configuration.split(" dt=")[0]
    if command == "willmore-flow":
        return "2" if family in SYMMETRIC and method in ("sullivan", "cotan") else "-"
    if command == "fluid-sim":
        orders = {"conservative": "4", "conservative midpoint": "2", "circulation": "1"}
        if family == "steps":
            return orders[method]
        return "2" if method.startswith("conservative") else "-"
    if command == "shell-sim":
        return str(INTEGRATORS[method].order) if family == "steps" else "1, then 0"
    return "-"
