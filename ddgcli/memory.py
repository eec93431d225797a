"""Memory that a computation may take, and the refusal of what cannot fit."""

import os
import sys

from ddgcli.errors import ParameterError

try:
    import resource
except ImportError:  # Windows sets no such limits
    resource = None  # type: ignore[assignment]

__all__ = [
    "available_memory", "check_memory", "memory_limit", "peak_by_getrusage", "release_freed_memory",
    "resident_memory",
]  # fmt: skip

MAX_BYTES = 16 * 2**30  # of one result, checked before it is allocated
CGROUP_FILES = (
    ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory.current"),
    ("/sys/fs/cgroup/memory/memory.limit_in_bytes", "/sys/fs/cgroup/memory/memory.usage_in_bytes"),
)


def available_memory(enough: float = float("inf")) -> float:
    """Bytes that this process can still take without swapping.

    The least of the memory that the system can free, what is left of the limit of the container, and what is
    left of `ulimit -v`. What the allocator keeps of freed arrays goes back to the system first, unless
    `enough` bytes are available without it: the system clears the memory that it gives again.

    Parameters
    ----------
    enough : float

    Returns
    -------
    float
        Inf where the system does not report it.
    """
    unused = _unused_memory()
    if unused >= enough:
        return unused
    release_freed_memory()
    return _unused_memory()


def _unused_memory() -> float:
    """`available_memory` without what the allocator keeps of freed arrays."""
    limits = [float("inf")]
    free = _proc_value("/proc/meminfo", "MemAvailable:")
    if free is not None:
        limits.append(free)
    elif hasattr(os, "sysconf") and "SC_PHYS_PAGES" in os.sysconf_names:
        limits.append(float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")))
    limits += [_number(most) - (_number(usage) or 0.0) for most, usage in CGROUP_FILES if _number(most)]
    if resource is not None and (soft := resource.getrlimit(resource.RLIMIT_AS)[0]) >= 0:
        limits.append(soft - (_proc_value("/proc/self/status", "VmSize:") or 0.0))
    return max(0.0, min(limits))


def resident_memory() -> tuple[float, float]:
    """Bytes of this process in memory.

    Returns
    -------
    now, peak : float
        The same if the system states one only.
    """
    peak = _proc_value("/proc/self/status", "VmHWM:")
    if peak is None:
        peak = peak_by_getrusage()
    return _proc_value("/proc/self/status", "VmRSS:") or peak, peak


def peak_by_getrusage() -> float:
    """Peak memory of this process, as `getrusage` reports it.

    Returns
    -------
    float
        In bytes; 0 where the system does not report it.
    """
    if resource is None:
        return 0.0
    unit = 1 if sys.platform == "darwin" else 1024  # bytes on macOS, KiB elsewhere
    return float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit)


def memory_limit() -> float:
    """Bytes that one result may take: MAX_BYTES, or the available memory where that is less."""
    return min(MAX_BYTES, available_memory())


def check_memory(estimate: float, what: str, remedy: str) -> None:
    """Raise an error if the estimated bytes of a result exceed `memory_limit`.

    Parameters
    ----------
    estimate : float
        In bytes.
    what : str
        Subject of the message, in the plural.
    remedy : str
        What the user can do.

    Raises
    ------
    ParameterError
    """
    limit = memory_limit()
    if estimate > limit:
        raise ParameterError(
            f"{what} need about {estimate / 2**30:.3g} GiB, above {limit / 2**30:.3g} GiB; {remedy}"
        )


def release_freed_memory() -> bool:
    """Return the free blocks of glibc's heap to the system.

    Returns
    -------
    bool
        Whether the allocator offers it.
    """
    import ctypes

    try:
        ctypes.CDLL(None).malloc_trim(0)
    except (AttributeError, OSError, TypeError):
        return False
    return True


def _proc_value(path: str, name: str) -> float | None:
    """Bytes of a line `NAME  123 kB`; None where file or line is missing."""
    try:
        with open(path, encoding="ascii", errors="replace") as lines:
            for line in lines:
                if line.startswith(name):
                    return float(line.split()[1]) * 1024
    except (OSError, ValueError, IndexError):
        pass
    return None


def _number(path: str) -> float:
    """Number in a file; inf for the word `max`, 0 where there is none."""
    try:
        with open(path, encoding="ascii", errors="replace") as file:
            text = file.read().strip()
        return float("inf") if text == "max" else float(text)
    except (OSError, ValueError):
        return 0.0
