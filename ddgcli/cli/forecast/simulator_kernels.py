"""Kernels of simulators and flows: their steps, and the iterations of their equilibria."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from ddgcli.choices import EXPLICIT_INTEGRATORS, ITERATIVE_SOLVERS
from ddgcli.cli.forecast.use import KNOWN, InputSize, Range, Use

__all__ = ["curve_flow_kernels", "expected_steps", "fluid_kernels", "shell_kernels", "willmore_kernels"]

# iterations to the first equilibrium, and to the next after a load step: stiff shells need few, cloth many
ITERATIONS_TO_REST, REST_RANGE = 120, (0.06, 8.0)
ITERATIONS_PER_LOAD_STEP, LOAD_STEP_RANGE = 30, (0.1, 3.0)
TIMED_RANGE: Range = (0.7, 20.0)  # steps that increase the energy are divided repeatedly
# steps of a flow to rest, and their range; curve flows end after 2,000 steps by default
FLOW_STEPS: dict[str, tuple[int, Range]] = {
    "willmore-flow": (100, (0.01, 10.0)),
    "curve-flow": (1000, (0.01, 2.0)),
}
TRIED_STEPS = 3  # steps per adaptive step: one, and two of half its length
ADAPTIVE_RANGE: Range = (1.0, 10.0)  # adaptive steps per frame
CONTACT_STEPS = 2.7  # cost of a step with contact in steps without, due to more Newton iterations
# few iterations before contact; a stiff sheet at an impact needs many
CONTACT_RANGE: Range = (0.15, 4.0)
PAIRS_RANGE: Range = (0.3, 8.0)  # contact between shells: impacts need the most iterations
# contact without resistance to stretching: triangles collapse, and steps are divided into hundreds
LIMP_CONTACT_RANGE: Range = (0.15, 400.0)
DAMPED_EXPLICIT_STEPS = 2.5  # cost of an explicit step with stiffness damping in steps without
# Newton iterations per step of a motion from rest grow with the cube root of the step number, up to the
# second number; the kernels were measured over the first
MEASURED_STEPS, GROWING_STEPS = 5, 40
STEPS_PER_ITERATION = 0.5  # an iteration is a factorisation, a step a factorisation and further moves
DESCENT_RANGE: Range = (0.1, 1.5)  # over --steps: a flow may reach rest earlier
# values of `ddgcli.models.willmore.remesh_step`, which would load its imports; uneven triangles take more
# rounds
REMESHING_INTERVAL, MAX_REMESHES = 5, 30
ENERGIES_OF_OWN_TRIANGLES = ("hinge", "quadratic")  # their flows neither flip edges nor slide vertices
IMPROVEMENT_RANGE: Range = (0.1, 1.6)  # improvement of the triangles before the first step
REMESHING_RANGE: Range = (0.3, 4.0)
CONFORMAL_RANGE: Range = (0.2, 5.0)
MEASURED_MODES = 10
STEPS_WITHOUT_SLIDING = 0.5  # cost of a step without sliding: one factorisation instead of two
ELASTIC_STEPS = 1.7  # cost of a step of the elastic flow, in steps of the curvature flow
# low end of the range of iterative steps, which were measured at 5 ms: steps of 1 ms have more inertia, so
# conjugate gradients converge sooner
MIN_ITERATIVE = 0.08
CIRCULATION_RANGE: Range = (0.7, 2.5)  # fixed points of an accelerating flow need more iterations
NEWTON_RANGE: Range = (0.6, 3.0)  # implicit steps: Newton iterations, and rejected steps


def _step_uses(
    kernel: str,
    size: InputSize,
    factor: float = 1.0,
    unknown: Range = KNOWN,
    attempts: float = TRIED_STEPS,
    assumes: str = "",
) -> Use:
    """The steps of a run: `factor` of the kernel each, within a range, or `attempts` of that if adaptive."""
    if size.adaptive:
        factor, unknown = attempts * factor, _product(unknown, ADAPTIVE_RANGE)
        assumes = "one adaptive step a frame"
    if size.steps is None:
        steps, to_rest = FLOW_STEPS[kernel.split()[0]]
        return Use(kernel, factor * steps, range=_product(unknown, to_rest), assumes=f"{steps} steps")
    return Use(kernel, factor * size.steps, range=unknown, assumes=assumes)


def expected_steps(command: str) -> int:
    """Steps of a flow until it is at rest."""
    return FLOW_STEPS[command][0]


def mean_iterations(last: float, first: float = 0.0) -> float:
    """Newton iterations of a step of a motion from rest, over those of its first: the mean of some steps."""

    def total(count: float) -> float:
        """Integral of the cube root, constant from `GROWING_STEPS` on."""
        growing = min(count, GROWING_STEPS)
        return 0.75 * growing ** (4 / 3) + (count - growing) * GROWING_STEPS ** (1 / 3)

    return (total(last) - total(first)) / (last - first)


def _product(first: Range, second: Range) -> Range:
    return first[0] * second[0], first[1] * second[1]


def willmore_kernels(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    flow = options.get("flow")
    yield Use("willmore-flow mean-curvature" if flow == "mean-curvature" else "willmore-flow")
    if flow == "conformal":  # solves for one equilibrium
        yield Use("willmore-flow conformal", range=CONFORMAL_RANGE, assumes="few iterations to rest")
        return
    in_time = flow == "mean-curvature" or options.get("step") or options.get("duration")
    kind = flow if flow in ("mean-curvature", "newton") else "quadratic" if in_time else "descent"
    if kind == "descent" and options.get("energy") not in ENERGIES_OF_OWN_TRIANGLES:
        assumes = "flips and slides as of uneven triangles"
        yield Use("willmore-flow improvement", range=IMPROVEMENT_RANGE, assumes=assumes)
    if options.get("remesh"):
        steps = expected_steps("willmore-flow") if size.steps is None else size.steps
        count = min(1 + max(steps - 1, 0) // REMESHING_INTERVAL, MAX_REMESHES)
        assumes = f"{count} remeshes, as those of even triangles"
        low, high = REMESHING_RANGE
        low /= 1 if in_time else count  # a flow to rest may be there before the second
        yield Use("willmore-flow remeshing", count, range=(low, high), assumes=assumes)
    divided = (TIMED_RANGE, "no divided step") if in_time else (KNOWN, "")
    use = _step_uses(f"willmore-flow {kind} step", size, 1.0, divided[0], assumes=divided[1])
    # a flow to rest ends when it is there, whatever the number of steps
    if in_time or size.steps is None:
        yield use
    else:
        yield replace(use, range=DESCENT_RANGE, assumes=f"all {size.steps} steps until it is at rest")


def curve_flow_kernels(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    yield Use("curve-flow")
    factor = ELASTIC_STEPS if options.get("flow") == "elastic" else 1.0
    if options.get("redistribute") is False:
        factor *= STEPS_WITHOUT_SLIDING
    yield _step_uses("curve-flow step", size, factor)
    if size.n_curves > 1:  # each curve is searched for crossings with itself
        yield _step_uses("curve-flow search", size, float(size.n_curves))


def shell_kernels(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    """Kernels of a shell scene, from its integrator, its linear `solver` if fixed, and its `cost_facts`.

    The latter are `contact`, `stretching`, `midedge`, `stiffness_damping`, `modes`, `buckling` and
    `pair_elements`, the number of faces among which contact searches for pairs.
    """
    integrator = options.get("integrator")
    yield Use("shell-sim")
    for task in ("modes", "buckling"):
        if options.get(task):
            yield Use(f"shell-sim {task}", max(1.0, options[task] / MEASURED_MODES))
    contact, unknown, assumes = 1.0, NEWTON_RANGE, "no rejected step"
    if options.get("contact"):
        contact, unknown, assumes = CONTACT_STEPS, CONTACT_RANGE, "contact in some steps"
        if not options.get("stretching", True):
            unknown = LIMP_CONTACT_RANGE
            assumes += " and none divided, though no effect such as stretching resists collapse"
    iterative = "iterative " if options.get("solver") in ITERATIVE_SOLVERS else ""
    explicit = integrator in EXPLICIT_INTEGRATORS
    if not explicit or options.get("stiffness_damping") or options.get("modes") or options.get("buckling"):
        yield Use("shell-sim assembly")  # once, and the modules of the solvers
    if not explicit or options.get("modes") or options.get("buckling"):
        yield Use("shell-sim solvers", added=1.0)
    bending = "midedge" if options.get("midedge") else "implicit"
    if integrator == "avi":
        yield Use("shell-sim avi")
    if explicit:
        factor = DAMPED_EXPLICIT_STEPS if options.get("stiffness_damping") else 1.0
        yield _step_uses("shell-sim explicit step", size, factor)
    elif integrator == "static" and not iterative:
        kind = "shell-sim midedge" if options.get("midedge") else "shell-sim"
        yield Use(f"{kind} rest check")
        yield from _equilibria(f"{kind} iteration", size)
    elif size.steps != 0:
        if integrator == "static":
            contact, unknown = STEPS_PER_ITERATION * contact * ITERATIONS_TO_REST, REST_RANGE
            assumes = f"{ITERATIONS_TO_REST} iterations to rest"
        elif size.steps is not None and not options.get("contact"):  # which begins with a free fall
            contact *= mean_iterations(size.steps) / mean_iterations(MEASURED_STEPS)
        if iterative:
            unknown, assumes = (MIN_ITERATIVE, unknown[1]), f"{assumes}, steps as stiff as of 5 ms"
        yield _step_uses(f"shell-sim {iterative}{bending} step", size, contact, unknown, assumes=assumes)
    if options.get("pair_elements"):
        share = options["pair_elements"] / max(size.elements, 1)
        yield _step_uses("shell-sim pairs step", size, share, PAIRS_RANGE, assumes="contact in some steps")


def _equilibria(kernel: str, size: InputSize) -> Iterator[Use]:
    """Newton iterations to rest, and from there along a path of loads."""
    yield Use(
        kernel, ITERATIONS_TO_REST, range=REST_RANGE, assumes=f"{ITERATIONS_TO_REST} iterations to rest"
    )
    if (further := (size.steps or 1) - 1) > 0:
        assumes = f"{ITERATIONS_PER_LOAD_STEP} iterations a further load step"
        yield Use(kernel, ITERATIONS_PER_LOAD_STEP * further, range=LOAD_STEP_RANGE, assumes=assumes)


def fluid_kernels(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    yield Use("fluid-sim")
    # the fixed points of short steps need fewer iterations than those of the measured ones
    integrator = options.get("integrator") or "circulation"
    unknown, assumes = (
        (CIRCULATION_RANGE, "iterations as at the start") if integrator == "circulation" else (KNOWN, "")
    )
    yield _step_uses(f"fluid-sim {integrator} step", size, 1.0, unknown, 1.0, assumes)
