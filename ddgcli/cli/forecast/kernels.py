"""Kernels that a command runs for its options, and how often."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ddgcli.choices import ITERATIVE_SOLVERS

__all__ = ["InputSize", "Use", "kernels_of"]

MEASURED_EIGENPAIRS = 8  # of the kernel `laplacian eigen`
MEASURED_SMOOTHING_STEPS = 10
MAX_RINGS = 1e9  # of a ball, in edge lengths; its square is a number
MEASURED_REFINEMENT_DEGREES = 25.0
MEASURED_EVOLUTION_STEPS = 100
DEFAULT_FLOW_STEPS = 100  # a guess: flows end at rest
CERTIFICATE_RUNS = 4
PICTURES = (".png", ".svg", ".pdf", ".gif", ".mp4")
# steps that cost as much as an equilibrium from afar, and as one after a small change of the load: guesses
STEPS_TO_REST, STEPS_PER_LOAD_STEP = 60, 5
CONTACT_STEPS = 2.2  # steps without contact that cost as much as one with it, for its Newton iterations


@dataclass(frozen=True)
class InputSize:
    """Size of an input.

    Parameters
    ----------
    kind : {'surface', 'tetrahedra', 'curve'}
    elements : int
        Faces, tetrahedra or points of curves; of several inputs the sum.
    edge_length : float, optional
        Mean length of an edge, for costs of neighbourhoods.
    steps : int, optional
        Steps of a simulation, where they are known.
    frame_count : int
        Frames that are written or drawn.
    component_elements : int, optional
        Elements of the largest connected component; default all.
    """

    kind: str
    elements: int
    edge_length: float | None = None
    steps: int | None = None
    frame_count: int = 1
    component_elements: int | None = None


@dataclass(frozen=True)
class Use:
    """One use of a kernel of the table `COEFFICIENTS`.

    Parameters
    ----------
    kernel : str
    times : float
        Factor of its seconds.
    added : float
        Factor of its memory that other kernels do not free; 0: the kernels of a command share memory, and
        the largest counts.
    """

    kernel: str
    times: float = 1.0
    added: float = 0.0


def kernels_of(
    command: str,
    options: Mapping[str, Any],
    size: InputSize,
    outputs: tuple[str, ...] = (),
    plot: bool = False,
    full: bool = True,
) -> list[Use]:
    """Kernels of a command.

    Parameters
    ----------
    command : str
    options : mapping
        As in the summary: names of parameters with their values.
    size : InputSize
    outputs : tuple of str
        Paths of the result; their extensions choose the cost of writing.
    plot : bool
        Whether a picture is drawn.
    full : bool
        Whether the run computes more than the short summary of `curvature`.
    """
    uses = list(_KERNELS[command](options, size))
    if command == "curvature" and full and size.kind != "curve":
        uses.append(Use("curvature further results"))
    if command not in ("view", "dec", "tradeoff"):
        meshes = [path for path in outputs if Path(path).suffix.lower() not in PICTURES]
        uses += [Use(f"write {_written_as(path)}", size.frame_count) for path in meshes]
    if plot:
        uses.append(Use("picture"))
    return uses


def _written_as(path: str) -> str:
    """Extension with a measured cost that stands for the extension of a path."""
    suffix = Path(path).suffix.lower()
    if suffix in (".npz", ".vtkhdf", ".h5"):
        return "npz"
    return (
        "ply"
        if suffix in (".ply", ".stl", ".glb", ".vtp")
        else "text"
        if suffix in (".obj", ".off")
        else "vtu"
    )


def _info(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    yield Use("info")


def _nothing(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    return iter(())


def _repair(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    yield Use("repair")


def _curvature(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    if size.kind == "curve":
        yield Use("curvature")
        return
    scheme, radius = options["scheme"], options.get("radius")
    if radius is None:
        yield Use(f"curvature {scheme}")
    elif radius == "auto":
        yield Use(f"curvature {scheme} auto")
    else:
        yield Use(f"curvature {scheme}")
        rings = min(float(radius) / (size.edge_length or 1.0), MAX_RINGS)
        yield Use(f"curvature {scheme} radius", rings**2)


def _delaunay(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    yield Use("delaunay")
    if options.get("refine"):
        yield Use("delaunay refine", max(0.1, float(options["refine"]) / MEASURED_REFINEMENT_DEGREES) ** 2)
    for name in ("overlay", "dual", "condition"):
        if options.get(name):
            yield Use(f"delaunay {name}")


def _laplacian(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    yield Use("laplacian")
    if options.get("matrix"):
        yield Use("laplacian matrix")
    if options.get("mass_matrix"):
        yield Use("laplacian matrix", 0.2)
    if options.get("poisson") or options.get("harmonic"):
        way = " multigrid" if options.get("solver") in ITERATIVE_SOLVERS else ""
        yield Use(f"laplacian poisson{way}")
    pairs = options.get("eigen") or (100 if options.get("hks") else 0)
    if pairs:
        yield Use("laplacian eigen")
        if (further := pairs - MEASURED_EIGENPAIRS) > 0:
            yield Use("laplacian eigenpair", further, added=further)
    if options.get("smooth"):
        steps = (options.get("smooth_steps") or MEASURED_SMOOTHING_STEPS) / MEASURED_SMOOTHING_STEPS
        yield Use("laplacian smooth", steps)
    if options.get("parameterize"):
        yield Use(f"laplacian {options['parameterize']}")
    if options.get("form_eigen"):
        yield Use("laplacian form-eigen", options["form_eigen"] / 4)
    if options.get("heat") or options.get("wave"):
        yield Use("laplacian evolution", (size.steps or MEASURED_EVOLUTION_STEPS) / MEASURED_EVOLUTION_STEPS)


def _hodge(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    yield Use("hodge field" if options.get("field") else "hodge")


def _dec(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    yield Use("dec")


def _geodesic(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    method = options.get("method", "exact")
    sources = max(1, len(options.get("source") or ()))
    yield Use(f"geodesic {method}")
    further = sources if options.get("each_source") or options.get("target") else 0
    if options.get("target"):
        further /= min(options.get("jobs", 1), sources)
    if options.get("certify"):
        further += CERTIFICATE_RUNS
    if further:
        yield Use(f"geodesic {method} solve", further)
    for other in options.get("compare") or ():
        yield Use(f"geodesic {other}")
    if options.get("log_map"):
        yield Use("geodesic vector-heat" if method == "heat" else "geodesic log-map")
    if options.get("signed_distance") or options.get("transport"):
        yield Use("geodesic vector-heat")


def _steps(size: InputSize) -> int:
    return DEFAULT_FLOW_STEPS if size.steps is None else size.steps


def _willmore(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    yield Use("willmore-flow")
    flow = "mean-curvature" if options.get("flow") == "mean-curvature" else "quadratic"
    yield Use(f"willmore-flow {flow} step", _steps(size))


def _curve_flow(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    yield Use("curve-flow")
    yield Use("curve-flow step", _steps(size))


def _shell(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    """A shell scene; `contact` and `midedge` are facts of it, `pair_elements` the faces that pairs search.

    `solver` is that of its linear systems where one is fixed.
    """
    integrator = options.get("integrator")
    yield Use("shell-sim")
    steps = _steps(size)
    if integrator in ("verlet", "symplectic-euler", "avi"):
        yield Use("shell-sim explicit step", steps)
    else:
        way = "midedge" if options.get("midedge") else "implicit"
        way = f"iterative {way}" if options.get("solver") in ITERATIVE_SOLVERS else way
        if integrator == "static":
            steps = STEPS_TO_REST + STEPS_PER_LOAD_STEP * (steps - 1)
        yield Use(f"shell-sim {way} step", steps * (CONTACT_STEPS if options.get("contact") else 1.0))
    if options.get("pair_elements"):
        yield Use("shell-sim pairs step", steps * options["pair_elements"] / max(size.elements, 1))


def _fluid(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    yield Use("fluid-sim")
    yield Use(f"fluid-sim {options.get('integrator') or 'circulation'} step", _steps(size))


def _frame_export(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    if options.get("pictures"):
        yield Use("picture", size.frame_count)


def _view(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    yield Use("view", size.frame_count, added=size.frame_count)


def _tradeoff(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    """The heaviest method of the compared command; the budget bounds the seconds."""
    heaviest: dict[str, dict[str, Any]] = {
        "curvature": {"scheme": "quadric"},
        "delaunay": {"refine": MEASURED_REFINEMENT_DEGREES},
        "laplacian": {"eigen": options.get("eigen") or MEASURED_EIGENPAIRS},
        "geodesic": {"method": "exact"},
        "willmore-flow": {"steps": 1},
    }
    yield from _KERNELS[options["compared"]](heaviest[options["compared"]], size)


_KERNELS: dict[str, Callable[[Mapping[str, Any], InputSize], Iterator[Use]]] = {
    "info": _info,
    "repair": _repair,
    "examples": _nothing,
    "check": _nothing,
    "curvature": _curvature,
    "delaunay": _delaunay,
    "laplacian": _laplacian,
    "hodge": _hodge,
    "dec": _dec,
    "geodesic": _geodesic,
    "willmore-flow": _willmore,
    "curve-flow": _curve_flow,
    "shell-sim": _shell,
    "fluid-sim": _fluid,
    "frames": _frame_export,
    "view": _view,
    "tradeoff": _tradeoff,
}
