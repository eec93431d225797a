"""Memory of freed arrays serves the next arrays; the environment has precedence."""

import os
import platform
import subprocess
import sys
from types import SimpleNamespace

import pytest

CODE = (
    "import resource, sys, numpy as np\n"
    "from ddgcli.cli.allocation import keep_freed_memory\n"
    "print(keep_freed_memory() if sys.argv[1] == 'keep' else None)\n"
    "before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt\n"
    "for k in range(200):\n"
    "    first, second = np.ones(100_000 + 1000 * k), np.ones(90_000 + 1000 * k)\n"
    "print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)"
)
RELEASE = (
    "import numpy as np\n"
    "from ddgcli.cli.allocation import keep_freed_memory\n"
    "from ddgcli.memory import available_memory, resident_memory\n"
    "keep_freed_memory()\n"
    "arrays = [np.ones(8 << 20) for _ in range(6)]\n"  # 64 MiB each
    "last = np.ones(1000)\n"
    "del arrays\n"
    "kept = resident_memory()[0]\n"
    "available_memory(enough=1)\n"
    "still_kept = resident_memory()[0]\n"
    "available_memory()\n"
    "print(kept, still_kept, resident_memory()[0])"
)


def measured(word: str, **variables: str) -> list[str]:
    process = subprocess.run(
        [sys.executable, "-c", CODE, word],
        capture_output=True, text=True, check=True, env={**os.environ, **variables},
    )  # fmt: skip
    return process.stdout.split()


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="thresholds of glibc's allocator")
def test_arrays_reuse_freed_memory_unless_the_environment_sets_the_allocator():
    keeps_memory, faults = measured("keep")
    assert keeps_memory == "True" and int(faults) < int(measured("leave")[1]) / 3
    assert measured("keep", MALLOC_TRIM_THRESHOLD_="131072")[0] == "False"


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="glibc's allocator")
def test_memory_kept_for_arrays_counts_as_available():
    process = subprocess.run([sys.executable, "-c", RELEASE], capture_output=True, text=True, check=True)
    held_bytes, still_kept, released = (float(word) for word in process.stdout.split())
    assert held_bytes - released > 300 * 2**20
    assert held_bytes - still_kept < 2**20  # where the rest suffices nothing is released


@pytest.mark.parametrize(("system", "unit"), [("darwin", 1), ("linux", 1024)])
def test_peak_memory_has_the_unit_of_the_system(monkeypatch, system, unit):
    """macOS reports bytes, other systems KiB: a prediction there was 1024 times too large."""
    from ddgcli import memory

    usage = SimpleNamespace(ru_maxrss=3_000_000)
    monkeypatch.setattr(memory, "resource", SimpleNamespace(RUSAGE_SELF=0, getrusage=lambda who: usage))
    monkeypatch.setattr(memory, "_proc_value", lambda path, name: None)
    monkeypatch.setattr(sys, "platform", system)
    assert memory.resident_memory() == (3_000_000 * unit, 3_000_000 * unit)
