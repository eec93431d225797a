"""Prediction of peak memory and seconds, and the error for runs that do not fit into memory."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ddgcli.cli.forecast.coefficients import COEFFICIENTS, PROBE_SECONDS, Cost
from ddgcli.cli.forecast.use import KNOWN, InputSize, Range, Use
from ddgcli.errors import ParameterError
from ddgcli.memory import available_memory, resident_memory

__all__ = [
    "Prediction",
    "as_results",
    "as_text",
    "fits",
    "predict",
    "probe",
    "refuse_without_memory",
    "seconds_of_equilibria",
    "seconds_of_steps",
    "with_divided_steps",
    "with_measured_equilibria",
    "with_measured_steps",
]

UNCERTAINTY = 0.5  # relative uncertainty of a prediction
# kernels with fill-in: fraction of their cost that grows with the logarithm of the size of a component
FILLED, FILL_SHARE, FILL_ELEMENTS = (
    (
        "shell-sim implicit step",
        "shell-sim midedge step",
        "shell-sim iteration",
        "shell-sim midedge iteration",
        "shell-sim rest check",
        "shell-sim midedge rest check",
    ),
    0.53,
    1e5,
)
STEP_KERNELS = (" step", " search")  # suffixes of the names of kernels that are repeated in each step
N_PROBES = 10
MIB = 2.0**20


@dataclass(frozen=True)
class Prediction:
    """Cost of a run that has read its input.

    Parameters
    ----------
    peak_mib : float
        Largest resident memory of the process.
    seconds : float
        CPU seconds of the whole run, start-up and reading included.
    seconds_range : (float, float)
        Where only the run shows how many steps or iterations it takes; else twice `seconds`.
    kernels : list of dict
        `kernel`, `times` and `added`, and `elements` where they are not those of the input (as of a `Use`),
        `once` where `times` does not count the constant part, `times_range` and `assumes` where only the run
        shows how many,
        `seconds` and `mib`, both None where the cost of the kernel has not been measured: it is not part of
        the sums.
    read_mib, read_seconds : float
        Resident memory and CPU seconds so far.
    read_peak_mib : float
        Largest resident memory so far.
    """

    peak_mib: float
    seconds: float
    seconds_range: tuple[float, float]
    kernels: list[dict[str, Any]]
    read_mib: float
    read_seconds: float
    read_peak_mib: float = 0.0


def predict(
    uses: Sequence[Use], size: InputSize, *, calibrate: bool = True, earlier: Prediction | None = None
) -> Prediction:
    """Predict the cost of kernels, from the state of this process after reading.

    Parameters
    ----------
    uses : sequence of Use
    size : InputSize
    calibrate : bool
        Scale the seconds of the table by a probe of a few ms; False: leave them as measured.
    earlier : Prediction, optional
        Whose state of the process counts, where it has computed since.
    """
    if earlier is None:
        seconds_so_far = time.process_time()
        now, peak = (value / MIB for value in resident_memory())
    else:
        seconds_so_far, now, peak = earlier.read_seconds, earlier.read_mib, earlier.read_peak_mib
    scale = probe() / PROBE_SECONDS if calibrate else 1.0
    kernels = [_row(use, size, scale) for use in uses]
    shared = max((row["mib"] for row in kernels if row["mib"] and not row["added"]), default=0.0)
    added = sum(row["added"] * row["mib"] for row in kernels if row["mib"])
    total = seconds_so_far + sum(row["seconds"] or 0.0 for row in kernels)
    low, high = (
        seconds_so_far + sum(use.range[k] * (row["seconds"] or 0.0) for use, row in zip(uses, kernels))
        for k in (0, 1)
    )
    return Prediction(max(peak, now + shared + added), total, (low, high), kernels, now, seconds_so_far, peak)


def with_divided_steps(prediction: Prediction, count: float) -> Prediction:
    """The prediction if each step is divided into `count` parts."""
    return _with_scaled_steps(prediction, count, count)


def seconds_of_steps(prediction: Prediction) -> float:
    """Seconds of all steps of a simulation."""
    return sum(row["seconds"] or 0.0 for row in prediction.kernels if _is_step(row))


def with_measured_steps(prediction: Prediction, seconds: float) -> Prediction:
    """The prediction with a measured time of all steps."""
    by_table = seconds_of_steps(prediction)
    return _with_scaled_steps(prediction, 1.0, seconds / by_table) if by_table else prediction


def seconds_of_equilibria(prediction: Prediction) -> float:
    """Seconds of all iterations to equilibria."""
    return sum(row["seconds"] or 0.0 for row in prediction.kernels if row["kernel"].endswith(" iteration"))


def with_measured_equilibria(prediction: Prediction, seconds: float, unknown: Range = KNOWN) -> Prediction:
    """The prediction with a measured time of all iterations to equilibria, and its uncertainty range."""
    by_table = seconds_of_equilibria(prediction)
    if not by_table:
        return prediction
    factor, (low, high), kernels = seconds / by_table, prediction.seconds_range, []
    for row in prediction.kernels:
        if row["kernel"].endswith(" iteration") and row["seconds"]:
            ends = [end / row["times"] for end in row.get("times_range", 2 * (row["times"],))]
            before, times, row = row["seconds"], factor * row["times"], dict(row)
            row |= {"times": times, "seconds": factor * before}
            row["times_range"] = [end * times for end in unknown]
            if unknown == KNOWN:
                del row["times_range"]
                row.pop("assumes", None)
            else:
                row["assumes"] = f"{times:.0f} iterations to rest"
            low += unknown[0] * row["seconds"] - ends[0] * before
            high += unknown[1] * row["seconds"] - ends[1] * before
        kernels.append(row)
    total = prediction.seconds + seconds - by_table
    return replace(prediction, seconds=total, seconds_range=(low, high), kernels=kernels)


def _is_step(row: Mapping[str, Any]) -> bool:
    return row["kernel"].endswith(STEP_KERNELS)


def _with_scaled_steps(prediction: Prediction, count: float, factor: float) -> Prediction:
    """The prediction with `count` times as many steps, which take `factor` times the seconds in all."""
    kernels, added = [], [0.0, 0.0, 0.0]
    for row in prediction.kernels:
        if _is_step(row):
            more = (factor - 1.0) * (row["seconds"] or 0.0)
            times = row["times"] or 1.0  # an analysis of the shape at the start takes no step
            ends = [end / times for end in row.get("times_range", 2 * (times,))]
            added = [sum_ + end * more for sum_, end in zip(added, (1.0, *ends))]
            row = {
                **row,
                "times": count * row["times"],
                "seconds": row["seconds"] and factor * row["seconds"],
            }
        kernels.append(row)
    (low, high), (more, more_low, more_high) = prediction.seconds_range, added
    return replace(
        prediction,
        seconds=prediction.seconds + more,
        seconds_range=(low + more_low, high + more_high),
        kernels=kernels,
    )


def _row(use: Use, size: InputSize, scale: float) -> dict[str, Any]:
    """Cost of one use of a kernel."""
    elements = size.elements if use.elements is None else use.elements
    cost, n = _cost(use.kernel, size.kind), elements / 1e5
    filled = fill(use.kernel, size.component_elements or size.elements)
    row: dict[str, Any] = {"kernel": use.kernel, "times": use.times, "added": use.added}
    if use.elements is not None:
        row["elements"] = use.elements
    if use.once:
        row["once"] = True
    if use.range != KNOWN:
        row["times_range"] = [use.range[0] * use.times, use.range[1] * use.times]
    if use.assumes:
        row["assumes"] = use.assumes
    if cost is None:
        return {**row, "seconds": None, "mib": None}
    constant = cost.seconds * (1.0 if use.once else use.times)
    seconds = scale * (constant + use.times * filled * cost.seconds_per_1e5 * n**cost.exponent)
    return {**row, "seconds": seconds, "mib": cost.mib + filled * cost.mib_per_1e5 * n}


def fill(kernel: str, component_elements: int) -> float:
    """Cost of an element in a component, relative to one in a component of FILL_ELEMENTS.

    Nested dissection leaves n log n numbers in a factor, so that a mesh of many small parts needs less.
    """
    if kernel not in FILLED:
        return 1.0
    return 1.0 - FILL_SHARE * (1.0 - math.log(max(component_elements, 2)) / math.log(FILL_ELEMENTS))


def _cost(kernel: str, kind: str) -> Cost | None:
    """Cost of a kernel on elements of a kind, else on faces; None where it has not been measured."""
    return COEFFICIENTS.get(f"{kernel} {kind}", COEFFICIENTS.get(kernel))


def probe() -> float:
    """CPU seconds of a small fixed computation: sorting, gathering, sums and interpreted Python.

    The least of ten runs: what other processes on the core take lengthens most of them. The sort is stable,
    as most of those of the commands: numpy sorts otherwise with vector instructions, 3.2 times as long
    without them as with AVX2, and 0.66 times with AVX-512.
    """
    import numpy as np

    values = (np.arange(40_000) * 0.6180339887498949) % 1.0
    runs = []
    for _ in range(N_PROBES):
        began = time.process_time()
        order = np.argsort(values, kind="stable")
        gathered = values[order] * values
        np.add.at(gathered, order[:4000], 1.0)
        np.bincount(order % 1000, weights=np.sqrt(gathered))
        total = 0
        for k in range(10_000):
            total += k & 3
        runs.append(time.process_time() - began)
    return min(runs)


def fits(prediction: Prediction, certainly: bool = True) -> bool:
    """Whether a run fits into the available memory, `certainly` or at the low end of its prediction."""
    further = prediction.peak_mib - prediction.read_mib
    required = further * MIB / (1.0 if certainly else 1 + UNCERTAINTY)
    return required <= available_memory(enough=required)


def refuse_without_memory(prediction: Prediction, what: str, remedy: str) -> None:
    """Raise ParameterError for a run that does not fit into memory even at the low end of its prediction."""
    if not fits(prediction, certainly=False):
        available = available_memory() / MIB
        raise ParameterError(
            f"{what} needs about {prediction.peak_mib / 1024:.3g} GiB of memory, and "
            f"{(available + prediction.read_mib) / 1024:.3g} GiB are available; {remedy}"
        )


def as_results(prediction: Prediction, size: InputSize) -> dict[str, Any]:
    """`results` of a dry run."""
    return {
        "dry_run": True,
        "elements": size.elements,
        "peak_mib": prediction.peak_mib,
        "available_mib": (available_memory() + resident_memory()[0]) / MIB,
        "seconds": prediction.seconds,
        "seconds_range": list(prediction.seconds_range),
        "kernels": prediction.kernels,
        "read_mib": prediction.read_mib,
        "read_seconds": prediction.read_seconds,
        "uncertainty": UNCERTAINTY,
    }


def as_text(results: Mapping[str, Any], full: bool) -> list[str]:
    """Summary lines of a dry run, with the kernels if `full`; empty if a batch has no valid run."""
    if "seconds" not in results:
        return []
    low, high = results.get("seconds_range") or 2 * (results["seconds"],)
    known = high <= (1 + UNCERTAINTY) * results["seconds"] and low >= (1 - UNCERTAINTY) * results["seconds"]
    kernels = results.get("kernels", ())
    assumed = "; ".join(dict.fromkeys(row["assumes"] for row in kernels if "assumes" in row))
    reason = f"assumes {assumed}" if assumed else "only the run shows how long it is"
    spread = "" if known else f" ({_two_digits(low)} to {_two_digits(high)} s: {reason})"
    return [
        f"peak memory  {results['peak_mib']:.0f} MiB of {results['available_mib']:.0f} MiB available",
        f"CPU time     {_two_digits(results['seconds'])} s{spread}",
        *(_kernel_lines(kernels) if full else ()),
    ]


def _two_digits(seconds: float) -> str:
    """Seconds with two significant digits, never in scientific notation above 100."""
    rounded = float(f"{seconds:.2g}")
    return f"{rounded:,.0f}" if rounded >= 100 else f"{rounded:.2g}"


def _kernel_lines(kernels: Sequence[Mapping[str, Any]]) -> list[str]:
    """Name, seconds, memory and count of each kernel, in columns."""
    width = max((len(row["kernel"]) for row in kernels), default=0)
    lines = []
    for row in kernels:
        seconds, mib = (
            "not measured" if row[key] is None else f"{row[key]:{form}} {unit}"
            for key, form, unit in (("seconds", ".2g", "s"), ("mib", ".0f", "MiB"))
        )
        count = "" if row["times"] == 1 else f"  {row['times']:.4g} times"
        lines.append(f"  {row['kernel']:<{width}}  {seconds:>12}  {mib:>12}{count}")
    return ["kernels", *lines] if lines else []
