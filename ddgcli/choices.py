"""Names of methods, schemes, operators and energies as plain strings: each list exists once, here.

The core checks its parameters against these lists and the command line offers them; no numerics are imported,
so that `--help` stays fast.
"""

from __future__ import annotations

CURVATURE_SCHEMES = ("quadric", "corrected", "normal-cycle", "normal-voting", "cotan")

LAPLACE_OPERATORS = ("cotan", "intrinsic-delaunay", "tufted", "uniform")
MASSES = ("lumped", "voronoi", "galerkin")
SOLID_OPERATORS = ("cotan", "uniform")
SOLID_MASSES = ("lumped", "galerkin")
SMOOTHING_FLOWS = ("mean-curvature", "conformalized")
EVOLUTIONS = ("heat", "wave")  # equations in time
PARAMETERIZATIONS = ("harmonic", "conformal", "discrete-conformal")
CONFORMAL_BOUNDARIES = ("free", "lengths", "angles")  # of discrete conformal maps

MAX_SUBDIVISIONS = 6  # how often every face is split in four
MAX_REFINEMENT_DEGREES = 33.0  # bound of the angle to which Delaunay refinement goes

HODGE_STARS = ("galerkin", "circumcentric", "barycentric")
FIELD_BOUNDARIES = ("tangential", "normal")  # boundary condition of harmonic fields

DISTANCE_METHODS = ("exact", "heat", "fast-marching", "dijkstra")
LOG_MAP_METHODS = ("exact", "fast-marching", "heat")
HEAT_OPERATORS = ("intrinsic-delaunay", "plain", "tufted")  # triangulation of the heat method
DEFAULT_OFFSET_ANGLE = 6.0  # degrees of a step of the arcs of an offset body
MIN_MAX_POINTS, MAX_POINTS_PER_VERTEX = 100_000, 10  # Steiner points without `max_points`
MAX_CROSSINGS = 100_000  # sides and vertices that a straightest geodesic crosses
DEFAULT_HEAT_TIME = 1.0  # time step of the heat method, in squares of the mean side length
SIGNED_DISTANCE_METHODS = ("auto", "exact", "heat")
TRACE_BOUNDARIES = ("stop", "reflect")  # what a traced line does at the boundary

SHELL_FACE_ARRAYS = (
    "strain_tensor", "principal_strain", "stress", "principal_stress", "bending_moment", "principal_moment",
)  # fmt: skip

WILLMORE_ENERGIES = ("gauss-map", "sullivan", "cotan", "hinge", "quadratic", "circle-angle")
WILLMORE_FLOWS = ("quadratic", "newton", "circle-angle", "conformal", "mean-curvature")
WILLMORE_BOUNDARIES = ("clamped", "fixed", "free")

UP_AXES = ("y", "z")
CURVE_FLOWS = ("curvature", "area-preserving", "elastic")

CONSERVED_QUANTITIES = ("energy", "momentum", "angular-momentum")
MECHANICAL_EXAMPLES = ("pendulum", "oscillator")  # systems of the comparison of integrators
ERROR_NORMS = ("max", "mean")
ERROR_PARTS = ("both", "time", "mesh")  # of simulators and flows; the default first
PARTICLES = "particles_"  # scalars of a frame: that and the name of their fluid
VELOCITY_GLYPHS = ("arrows", "streamlines", "none")  # of fluids in pictures; the default first
NO_VERDICT = "no verdict possible"

SYMMETRIC_METHODS = ("exact", "dijkstra")  # of distances: d(a, b) = d(b, a)
EXPLICIT_INTEGRATORS = ("verlet", "symplectic-euler", "avi")  # of shells: their steps solve no systems
# of sparse definite systems: chosen by size and memory, direct ones, iterative ones
ITERATIVE_SOLVERS = ("multigrid", "conjugate-gradients")
LINEAR_SOLVERS = ("auto", "multifrontal", "superlu", "cholmod", "pivoted", *ITERATIVE_SOLVERS)
MAX_ELEVATION = 90  # degrees of a view: beyond it, pictures are upside down
MIN_PIXELS, MAX_PIXELS = 200, 8000  # of each side of a picture
