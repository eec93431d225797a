"""Kernels that a command runs for its options, and how often."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ddgcli.choices import EXPLICIT_INTEGRATORS, ITERATIVE_SOLVERS, MAX_REFINEMENT_DEGREES

__all__ = ["InputSize", "Use", "kernels_of"]

Range = tuple[float, float]

MEASURED_EIGENPAIRS = 8  # of the kernel `laplacian eigen`
MEASURED_SMOOTHING_STEPS = 10
MAX_RINGS = 1e9  # of a ball, in edge lengths; its square is a number
MEASURED_REFINEMENT_DEGREES = 25.0
MEASURED_EVOLUTION_STEPS = 100
DEFAULT_FLOW_STEPS = 100  # a guess: flows end at rest
CERTIFICATE_RUNS = 4
PICTURES = (".png", ".svg", ".pdf", ".gif", ".mp4")
KNOWN: Range = (1.0, 1.0)
# iterations to an equilibrium, and to one after a further load step: stiff parts need few, cloth many
ITERATIONS_TO_REST, REST_RANGE = 120, (0.06, 8.0)
ITERATIONS_PER_LOAD_STEP, LOAD_STEP_RANGE = 30, (0.1, 3.0)
FLOW_RANGE: Range = (0.01, 10.0)  # of DEFAULT_FLOW_STEPS, where a flow ends at rest
TRIED_STEPS = 3  # of an adaptive step: one, and two of half its length
ADAPTIVE_RANGE: Range = (1.0, 10.0)  # adaptive steps of a frame
CONTACT_STEPS = 2.2  # steps without contact that cost as much as one with it, for its Newton iterations
CONTACT_RANGE: Range = (0.4, 5.0)  # before contact none; a stiff sheet that has struck something needs many
STEPS_PER_ITERATION = 0.5  # one factorisation in place of a factorisation and the moves after it
DESCENT_RANGE: Range = (0.1, 1.5)  # of --steps, where a flow ends at rest before
CONFORMAL_RANGE: Range = (0.2, 5.0)
MAX_COMPARED_FACES, TRADEOFF_RANGE = 14_000, (0.2, 5.0)  # on larger meshes the budget bounds the rows
MEASURED_MODES = 10
FIELD_SEEDS, FIELD_RANGE = 16, (0.3, 30.0)  # the default; steps adapt to the field
# guesses: of the seconds and memory of the search for noise in balls, which clean meshes end early
NOISY_SECONDS_SHARE, NOISY_MEMORY_SHARE = 0.2, 0.15
# Steiner points over the angle deficit of `InputSize`, at 25 degrees: 2 on scans and slivers of mechanical
# parts, 6 on random points, on which the kernel is measured; they grow as exp(degrees / 12)
STEINER_POINTS_PER_DEFICIT, STEINER_RANGE, STEINER_DEGREES = 4.7, (0.4, 2.5), 12.0
STEINER_POINTS_OF_MEASURED_FACE, DEFICIT_OF_MEASURED_FACE = 0.78, 0.12


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
    angle_deficit : float, optional
        Sum over the faces of 1 - (smallest angle / angle of --refine), where that is positive.
    adaptive : bool
        `steps` counts frames, between which the steps adapt.
    """

    kind: str
    elements: int
    edge_length: float | None = None
    steps: int | None = None
    frame_count: int = 1
    component_elements: int | None = None
    angle_deficit: float | None = None
    adaptive: bool = False


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
    elements : float, optional
        On which it works, where these are not the elements of the input.
    range : (float, float)
        Least and largest factor of `times`, where only the run shows how long it is.
    """

    kernel: str
    times: float = 1.0
    added: float = 0.0
    elements: float | None = None
    range: Range = KNOWN


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
        uses += _plot(command)
    return uses


def _plot(command: str) -> Iterator[Use]:
    """The picture of --plot: of a surface, or a page of small ones and charts."""
    if command == "delaunay":
        yield Use("delaunay overlay")
    if command == "tradeoff":
        yield Use("picture curve")
    elif command in ("frames", "shell-sim", "fluid-sim", "willmore-flow", "curve-flow"):
        yield Use("picture of a run")
    else:
        yield Use("picture")


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
    if options.get("offset"):
        yield Use("curvature offset")
    if radius in (None, "auto"):
        yield Use("curvature noise", NOISY_SECONDS_SHARE, added=NOISY_MEMORY_SHARE)
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
        yield _refinement(float(options["refine"]), size)
    for name in ("overlay", "dual", "condition"):
        if options.get(name):
            yield Use(f"delaunay {name}")


def _refinement(degrees: float, size: InputSize) -> Use:
    """The insertion of Steiner points, whose number grows with that of the faces with small angles."""
    deficit = size.angle_deficit
    if deficit is None:
        deficit = DEFICIT_OF_MEASURED_FACE * size.elements
    growth = math.exp((min(degrees, MAX_REFINEMENT_DEGREES) - MEASURED_REFINEMENT_DEGREES) / STEINER_DEGREES)
    points = STEINER_POINTS_PER_DEFICIT * growth * deficit
    return Use("delaunay refine", elements=points / STEINER_POINTS_OF_MEASURED_FACE, range=STEINER_RANGE)


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
    if (jobs := min(options.get("jobs", 1), sources)) > 1 and further:
        yield Use("geodesic job", jobs)
    if options.get("certify"):
        further += CERTIFICATE_RUNS
    if further:
        yield Use(f"geodesic {method} solve", further)
    for other in options.get("compare") or ():
        yield Use(f"geodesic {other}")
    if options.get("source_point") or options.get("target_point"):
        yield Use("geodesic point")
    if options.get("field"):
        yield Use(
            "geodesic field", (options.get("field_seeds") or FIELD_SEEDS) / FIELD_SEEDS, range=FIELD_RANGE
        )
    if options.get("log_map"):
        yield Use("geodesic vector-heat" if method == "heat" else "geodesic log-map")
    if options.get("transport"):
        yield Use("geodesic transport")
    if options.get("signed_distance") or options.get("spread_vector"):
        yield Use("geodesic vector-heat")


def _step_uses(
    kernel: str, size: InputSize, factor: float = 1.0, unknown: Range = KNOWN, attempts: float = TRIED_STEPS
) -> Use:
    """The steps of a run: `factor` of the kernel each, within a range, or `attempts` of that if adaptive."""
    if size.adaptive:
        factor, unknown = attempts * factor, _product(unknown, ADAPTIVE_RANGE)
    if size.steps is None:
        return Use(kernel, factor * DEFAULT_FLOW_STEPS, range=_product(unknown, FLOW_RANGE))
    return Use(kernel, factor * size.steps, range=unknown)


def _product(first: Range, second: Range) -> Range:
    return first[0] * second[0], first[1] * second[1]


def _willmore(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    yield Use("willmore-flow")
    flow = options.get("flow")
    if flow == "conformal":  # solves for one equilibrium
        yield Use("willmore-flow conformal", range=CONFORMAL_RANGE)
        return
    in_time = flow == "mean-curvature" or options.get("step") or options.get("duration")
    kind = flow if flow in ("mean-curvature", "newton") else "quadratic" if in_time else "descent"
    if options.get("remesh"):
        yield _step_uses("willmore-flow remeshing", size)
    use = _step_uses(f"willmore-flow {kind} step", size)
    # a flow to rest ends when it is there, whatever the number of steps
    yield use if in_time or size.steps is None else replace(use, range=DESCENT_RANGE)


def _curve_flow(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    yield Use("curve-flow")
    yield _step_uses("curve-flow step", size)


def _shell(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    """A shell scene: integrator, `solver` of the linear systems where one is fixed, and facts of the scene.

    These are `contact`, `midedge`, `modes`, `buckling` and the faces that pairs search, `pair_elements`.
    """
    integrator = options.get("integrator")
    yield Use("shell-sim")
    for task in ("modes", "buckling"):
        if options.get(task):
            yield Use(f"shell-sim {task}", max(1.0, options[task] / MEASURED_MODES))
    contact, unknown = (CONTACT_STEPS, CONTACT_RANGE) if options.get("contact") else (1.0, KNOWN)
    iterative = "iterative " if options.get("solver") in ITERATIVE_SOLVERS else ""
    bending = "midedge" if options.get("midedge") else "implicit"
    if integrator in EXPLICIT_INTEGRATORS:
        yield _step_uses("shell-sim explicit step", size)
    elif integrator == "static" and not iterative:
        yield from _equilibria(f"shell-sim {'midedge ' if options.get('midedge') else ''}iteration", size)
    elif size.steps != 0:
        if integrator == "static":
            contact, unknown = STEPS_PER_ITERATION * contact * ITERATIONS_TO_REST, REST_RANGE
        yield _step_uses(f"shell-sim {iterative}{bending} step", size, contact, unknown)
    if options.get("pair_elements"):
        yield _step_uses("shell-sim pairs step", size, options["pair_elements"] / max(size.elements, 1))


def _equilibria(kernel: str, size: InputSize) -> Iterator[Use]:
    """Newton iterations to rest, and from there along a path of loads."""
    yield Use(kernel, ITERATIONS_TO_REST, range=REST_RANGE)
    if (further := (size.steps or 1) - 1) > 0:
        yield Use(kernel, ITERATIONS_PER_LOAD_STEP * further, range=LOAD_STEP_RANGE)


def _fluid(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    yield Use("fluid-sim")
    # the fixed points of short steps need fewer iterations than those of the measured ones
    yield _step_uses(f"fluid-sim {options.get('integrator') or 'circulation'} step", size, attempts=1)


def _frame_export(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    if options.get("pictures"):
        yield Use("picture", size.frame_count)


def _view(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    yield Use("view")
    if (further := size.frame_count - 1) > 0:
        yield Use("view frame", further, added=further)


def _tradeoff(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    """The heaviest method of the compared command, and all rows on a mesh that the budget suffices for."""
    heaviest: dict[str, dict[str, Any]] = {
        "curvature": {"scheme": "quadric"},
        "delaunay": {"refine": MEASURED_REFINEMENT_DEGREES},
        "laplacian": {"eigen": options.get("eigen") or MEASURED_EIGENPAIRS},
        "geodesic": {"method": "exact"},
        "willmore-flow": {"steps": 1},
    }
    compared = options["compared"]
    yield from _KERNELS[compared](heaviest[compared], replace(size, steps=1))
    yield Use(f"tradeoff {compared}", elements=min(size.elements, MAX_COMPARED_FACES), range=TRADEOFF_RANGE)


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
