"""CPU seconds and peak memory of a process, from a launcher so small that its own memory does not count.

Linux hands the peak of the parent down to a child until it has loaded its program: a peak measured from a
large Python process is never below that of this process.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]

_LAUNCHER = """
import os, sys
out, error = (os.open(path, os.O_RDWR | os.O_CREAT | os.O_TRUNC, 0o600) for path in sys.argv[1:3])
actions = [(os.POSIX_SPAWN_DUP2, out, 1), (os.POSIX_SPAWN_DUP2, error, 2)]
pid = os.posix_spawn(sys.argv[3], sys.argv[3:], os.environ, file_actions=actions)
_, status, usage = os.wait4(pid, 0)
print(os.waitstatus_to_exitcode(status), usage.ru_utime, usage.ru_stime, usage.ru_maxrss)
"""


@dataclass(frozen=True)
class MeasuredProcess:
    """Exit code, CPU seconds, peak resident MiB and output of a process.

    The seconds of the operating system stand apart: the first touch of a GiB costs up to 16 of them on a
    virtual machine whose host takes idle pages back.
    """

    exit_code: int
    seconds: float
    system_seconds: float
    mib: float
    output: str
    error: str

    @property
    def summary(self) -> dict[str, Any]:
        """Standard output as JSON."""
        return json.loads(self.output)


def measured_process(
    words: Sequence[str], folder: Path, environment: Mapping[str, str] | None = None
) -> MeasuredProcess:
    """Run `words` with one thread and measure them; `folder` takes two temporary files."""
    out, error = folder / f"out-{os.getpid()}.txt", folder / f"error-{os.getpid()}.txt"
    variables = {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    call = [sys.executable, "-I", "-S", "-c", _LAUNCHER, str(out), str(error), *words]
    done = subprocess.run(
        call, cwd=folder, env=os.environ | variables | (environment or {}), capture_output=True, check=True
    )
    code, seconds, system_seconds, kib = done.stdout.split()
    texts = out.read_text(encoding="utf-8"), error.read_text(encoding="utf-8")
    out.unlink()
    error.unlink()
    return MeasuredProcess(int(code), float(seconds), float(system_seconds), float(kib) / 1024, *texts)


def measured_command(words: Sequence[str], folder: Path) -> MeasuredProcess:
    """Measure `ddgcli WORDS` of this checkout."""
    return measured_process([sys.executable, "-m", "ddgcli", *words], folder)
