"""Verdict on one run of one command: right, degraded and reported, refused in one line, or wrong.

`right` needs exit 0, strict JSON, a summary, and every check of the command and the case to hold. A violated
check is `degraded` only where a warning names its subject; else the run is wrong.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.hardcases.checks import CHECKS, FURTHER_CHECKS, Evidence

RIGHT_VERDICT, DEGRADED_VERDICT, REFUSED_VERDICT, WRONG_VERDICT = "right", "degraded", "refused", "wrong"
MAX_MESSAGE_LENGTH = 1200  # characters, path included
ABSENT_AS_NAN = ("uv", "corner_uv")  # NaN where the input has no texture coordinates (docs/files.md)


@dataclass
class Outcome:
    """What a command left behind.

    Parameters
    ----------
    exit_code : int
        Negative: minus the signal that ended it.
    stdout, stderr : str
        Its streams.
    seconds, peak_mib : float
        Processor time and largest resident memory.
    over : str
        'time' or 'memory' where a limit ended it, else empty.
    arrays : dict
        What the written file holds.
    """

    exit_code: int
    stdout: str = ""
    stderr: str = ""
    seconds: float = 0.0
    peak_mib: float = 0.0
    over: str = ""
    arrays: dict[str, NDArray] = field(default_factory=dict)


@dataclass(frozen=True)
class Verdict:
    """One cell: its kind and the reason."""

    kind: str
    note: str = ""


# arrays in which an infinite value is an answer: a vertex that no source reaches
# unreached vertices; straight pieces of a curve
INFINITE_ARRAYS = ("geodesic_distance", "signed_distance", "log_map", "osculating_radius")


def judge(
    command: str,
    outcome: Outcome,
    points: NDArray | None = None,
    faces: NDArray | None = None,
    expected: dict[str, Any] | None = None,
    checks: tuple[str, ...] = (),
) -> Verdict:
    """Verdict on one run.

    Parameters
    ----------
    command : str
        Name of the command.
    outcome : Outcome
        What it left behind.
    points, faces : ndarray, optional
        The mesh as it was built.
    expected : dict, optional
        Truths of the case.
    checks : tuple of str
        Further checks of the case.
    """
    expected = expected or {}
    message = outcome.stderr.strip()
    if outcome.over:
        amounts = f"{outcome.seconds:.0f} s CPU, {outcome.peak_mib:.0f} MiB"
        return Verdict(WRONG_VERDICT, f"over its {outcome.over} limit ({amounts})")
    if "Traceback" in message or "internal error" in message.lower():
        return Verdict(WRONG_VERDICT, f"internal error: {message.splitlines()[-1][:200]}")
    if outcome.exit_code not in (0, 1, 2):
        return Verdict(WRONG_VERDICT, f"exit {outcome.exit_code}: {message[-200:]}")
    errors = [line for line in message.splitlines() if not line.startswith(("Warning:", "Note:"))]
    if outcome.exit_code == 2:
        return _refusal(outcome, errors)
    if expected.get("refused") or expected.get("load") == "error":
        return Verdict(WRONG_VERDICT, f"exit {outcome.exit_code} for an input that must be refused")
    if outcome.exit_code == 1:
        if not errors and not _warnings(outcome):
            return Verdict(WRONG_VERDICT, "exit 1 without a reason")
        fault = _spoilt(outcome, required=False)
        return (
            Verdict(WRONG_VERDICT, fault)
            if fault
            else Verdict(DEGRADED_VERDICT, (errors or _warnings(outcome))[0][:200])
        )
    if fault := _spoilt(outcome, required=True):
        return Verdict(WRONG_VERDICT, fault)
    return _verdict_of_checks(command, outcome, points, faces, expected, checks)


def _refusal(outcome: Outcome, errors: list[str]) -> Verdict:
    if len(errors) != 1:
        return Verdict(WRONG_VERDICT, f"refused in {len(errors)} lines")
    if outcome.stdout.strip():
        return Verdict(WRONG_VERDICT, "refused, yet a summary was printed")
    if len(errors[0]) > MAX_MESSAGE_LENGTH:
        return Verdict(WRONG_VERDICT, f"refused in {len(errors[0])} characters")
    return Verdict(REFUSED_VERDICT, errors[0].removeprefix("Error: ")[:200])


def _warnings(outcome: Outcome) -> list[str]:
    try:
        return list(json.loads(outcome.stdout).get("warnings", []))
    except (json.JSONDecodeError, AttributeError):
        return []


def _reject(name: str) -> None:
    raise ValueError(f"{name} in the summary")


def _spoilt(outcome: Outcome, required: bool) -> str:
    """What is wrong with the form of the summary and the arrays; empty where nothing is."""
    if not outcome.stdout.strip():
        return "no summary" if required else ""
    try:
        summary = json.loads(outcome.stdout, parse_constant=_reject)
    except ValueError as error:
        return f"summary: {error}"[:200]
    if not isinstance(summary, dict):
        return "the summary is no object"
    for name, array in outcome.arrays.items():
        if not np.issubdtype(array.dtype, np.floating) or name in ABSENT_AS_NAN:
            continue
        if np.isnan(array).any():
            return f"NaN in array {name}"
        if np.isinf(array).any() and not name.startswith(INFINITE_ARRAYS):
            return f"infinite value in array {name}"
    return ""


def _verdict_of_checks(
    command: str, outcome: Outcome, points: Any, faces: Any, expected: dict[str, Any], checks: tuple[str, ...]
) -> Verdict:
    evidence = Evidence(json.loads(outcome.stdout), outcome.arrays, points, faces, expected)
    warnings = " ".join(evidence.summary.get("warnings", []))
    reported = []
    for check in (*CHECKS.get(command, ()), *(FURTHER_CHECKS[name] for name in checks)):
        for fault, words in check(evidence):
            if not any(word.lower() in warnings.lower() for word in words):
                return Verdict(WRONG_VERDICT, fault)
            reported.append(fault)
    return Verdict(DEGRADED_VERDICT, f"{reported[0]}, reported") if reported else Verdict(RIGHT_VERDICT)
