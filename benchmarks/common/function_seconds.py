"""CPU seconds of the functions of one command without the operating system's, from a profile of a process.

`python -m benchmarks.common.function_seconds WORDS` runs `ddgcli WORDS` and prints the seconds as JSON.
"""

from __future__ import annotations

import contextlib
import cProfile
import io
import json
import os
import pstats
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import ddgcli

PACKAGE = Path(ddgcli.__file__).parent
TOTAL = "total"  # of the whole process


def function_seconds(*words: str) -> dict[str, float]:
    """CPU seconds by "module:function", calls of others included, and `TOTAL`; outputs are not kept."""
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [sys.executable, "-m", "benchmarks.common.function_seconds", *words],
            cwd=folder, env=os.environ | {"PYTHONPATH": str(PACKAGE.parent), "OMP_NUM_THREADS": "1"},
            check=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        )  # fmt: skip
    return json.loads(done.stdout.splitlines()[-1])


def _user_seconds() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_utime


def _profiled(words: list[str]) -> dict[str, float]:
    from ddgcli.cli.main import main

    profile = cProfile.Profile(_user_seconds)
    with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
        profile.runcall(main, words)
    seconds = {TOTAL: _user_seconds()}
    for (path, _, name), entry in pstats.Stats(profile).stats.items():  # type: ignore[attr-defined]
        if Path(path).is_relative_to(PACKAGE):
            key = f"{Path(path).relative_to(PACKAGE).with_suffix('').as_posix()}:{name}"
            seconds[key] = seconds.get(key, 0.0) + entry[3]
    return seconds


if __name__ == "__main__":
    print(json.dumps(_profiled(sys.argv[1:])))
