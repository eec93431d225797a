"""Dry runs of random calls beside the runs: they refuse what the runs refuse, with the same error."""

from __future__ import annotations

import re
import shlex
from random import Random
from typing import Protocol

SHARE_OF_RUNS = 0.4  # whose dry run is tried too; of refused runs every one, which costs little
OTHER_PROCESSES = ("batch", "check", "tradeoff")  # their dry runs are processes of other commands
TOO_LARGE = "GiB of memory"
# refusals that only a computation shows, by command
FROM_RESULTS = {
    "repair": re.compile(
        r"--(?:fill-holes|cut-to-disk): |the (?:repair|weld) leaves no face"
    ),  # of repaired meshes
    "dec": re.compile(r"leave the floating-point range"),  # of entries of the stars
    "view": re.compile(r"the page would have"),
    "geodesic": re.compile(r"is lost to rounding"),  # heat, after it is solved
    "curvature": re.compile(r"--radius: balls of radius"),  # of the noise that `auto` measures
}


class Outcome(Protocol):
    """Outcome of a call: its words, exit code and error."""

    @property
    def words(self) -> list[str]:
        """Words of the call."""
        ...

    @property
    def exit_code(self) -> int:
        """Exit code."""
        ...

    @property
    def error(self) -> str:
        """The line of the error, without its beginning."""
        ...


def has_dry_run(words: list[str], *, refused: bool) -> bool:
    """Whether the dry run of a call is tried, before a run or after a refused one."""
    if words[0] in OTHER_PROCESSES or {"--dry-run", "--effects", "--schema"} & {*words}:
        return False
    return refused or Random(" ".join(words)).random() < SHARE_OF_RUNS


def disagreement(dry: Outcome, run: Outcome) -> str:
    """What a dry run and the run do not have in common; "" where they agree."""
    if TOO_LARGE in dry.error:
        return ""
    call = shlex.join(dry.words)
    if dry.exit_code == 2 != run.exit_code:
        return f"{call}: the dry run is refused, the run is not: {dry.error}"
    if run.exit_code != 2 or _is_from_results(run):
        return ""
    if dry.exit_code != 2:
        return f"{call}: exit code {dry.exit_code}, the run's 2: {run.error}"
    return "" if dry.error == run.error else f"{call}: refused by {dry.error!r}, the run by {run.error!r}"


def _is_from_results(run: Outcome) -> bool:
    pattern = FROM_RESULTS.get(run.words[0])
    return pattern is not None and pattern.search(run.error) is not None
