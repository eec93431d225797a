"""Discrete differential geometry on meshes: the library behind the command line.

`import ddgcli as ddg` loads only the table below; a name is imported, with its dependencies, when it is
first used. `docs/library.md` shows recipes. Warnings go to `logging.getLogger("ddgcli")`.
"""

from __future__ import annotations

from _thread import RLock

__version__ = "0.1.0"

# module of `ddgcli.library` -> names that it exports
_NAMES: dict[str, tuple[str, ...]] = {
    "meshes": (
        "CurveSet", "IntrinsicMesh", "Measurement", "TetMesh", "TriangleMesh", "as_mesh", "box",
        "cylinder", "grid", "icosphere", "torus",
    ),
    "files": ("read_mesh", "read_trajectory", "write_mesh", "write_trajectory"),
    "curvatures": ("curvature", "curvature_measures", "offset_body"),
    "operators": (
        "connection_laplacian", "d0", "d1", "d2", "dec_operators", "divergence", "galerkin_mass", "gradient",
        "hodge_star", "laplace_operator", "lumped_mass", "stiffness", "uniform_stiffness",
        "voronoi_mass",
    ),
    "triangulations": (
        "circumcentric_dual", "conformal_map", "delaunay_refinement", "intrinsic_delaunay", "subdivide",
    ),
    "decomposition": ("betti_numbers", "harmonic_basis", "hodge_decomposition", "homology_generators"),
    "equations": (
        "eigenpairs", "harmonic_interpolation", "heat_kernel_signature", "mean_curvature_flow",
        "parameterize", "poisson",
    ),
    "forms": ("eigenforms", "flat", "interior_product", "lie_derivative", "sharp", "wedge"),
    "evolution": ("heat_equation", "wave_equation"),
    "flows": ("curve_flow", "willmore_flow"),
    "distances": (
        "DistanceSolver", "HeatSolver", "distance_gradient", "geodesic_distance", "measure_distance",
    ),
    "curves": ("edge_paths", "isolines", "shortest_paths", "straighten_paths", "trace"),
    "fields": ("integral_curves", "logarithmic_map", "parallel_transport"),
    "wavefronts": ("distance_matrix", "geodesic_fan", "geodesic_voronoi", "signed_distance", "vertex_types"),
    "repairs": ("inspect_mesh", "repair_mesh"),
    "simulations": ("Simulation", "simulate"),
    "costs": ("tradeoff_table",),
    "pictures": ("write_picture",),
}  # fmt: skip
_MODULE = {name: f"ddgcli.library.{module}" for module, names in _NAMES.items() for name in names}
_MODULE["errors"] = "ddgcli.errors"

__all__ = ["__version__", *sorted(_MODULE)]

# numpy fails if threads begin its import at the same time. No module of the package uses a name of the table
# while it is imported, so a thread that has an import lock never waits for this one.
_import_lock = RLock()

TYPE_CHECKING = False  # type checkers assume it is true; importing `typing` would cost milliseconds
if TYPE_CHECKING:
    from ddgcli import errors as errors
    from ddgcli.library.costs import *  # noqa: F403
    from ddgcli.library.curvatures import *  # noqa: F403
    from ddgcli.library.curves import *  # noqa: F403
    from ddgcli.library.decomposition import *  # noqa: F403
    from ddgcli.library.distances import *  # noqa: F403
    from ddgcli.library.equations import *  # noqa: F403
    from ddgcli.library.evolution import *  # noqa: F403
    from ddgcli.library.fields import *  # noqa: F403
    from ddgcli.library.files import *  # noqa: F403
    from ddgcli.library.flows import *  # noqa: F403
    from ddgcli.library.forms import *  # noqa: F403
    from ddgcli.library.meshes import *  # noqa: F403
    from ddgcli.library.operators import *  # noqa: F403
    from ddgcli.library.pictures import *  # noqa: F403
    from ddgcli.library.repairs import *  # noqa: F403
    from ddgcli.library.simulations import *  # noqa: F403
    from ddgcli.library.triangulations import *  # noqa: F403
    from ddgcli.library.wavefronts import *  # noqa: F403


def __getattr__(name: str) -> object:
    if name not in _MODULE:
        raise AttributeError(f"module 'ddgcli' has no attribute {name!r}")
    import importlib

    with _import_lock:
        module = importlib.import_module(_MODULE[name])
        value = module if name == "errors" else getattr(module, name)
        globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)  # what completion offers in a notebook
