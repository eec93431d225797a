"""Threads of the linear algebra libraries: one by default, so that many runs share a machine.

OpenBLAS, MKL and similar libraries read these variables when numpy loads them. Their own default, a thread
for each core, takes ten times the work on the small dense blocks of sparse solvers and blocks other
processes.
"""

from __future__ import annotations

import os
from collections.abc import MutableMapping, Sequence

THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)


def set_thread_variables(
    words: Sequence[str] = (), environment: MutableMapping[str, str] = os.environ
) -> None:
    """Set the number of threads; call it before numpy is imported.

    Parameters
    ----------
    words : sequence of str
        Command line; `--threads N` in it wins. Without it, exported variables are kept; if there
        are none, every library gets one thread.
    environment : mutable mapping
        Changed in place.
    """
    requested = requested_threads(words)
    if requested is None and any(name in environment for name in THREAD_VARIABLES):
        return
    environment.update(dict.fromkeys(THREAD_VARIABLES, str(requested or 1)))


def requested_threads(words: Sequence[str]) -> int | None:
    """N of `--threads N` or `--threads=N`; None where it is missing or not a positive number."""
    for index, word in enumerate(words):
        name, equals, value = word.partition("=")
        if name == "--threads":
            text = value if equals else "".join(words[index + 1 : index + 2])
            return int(text) if text.isdecimal() and int(text) > 0 else None
    return None
