"""Exceptions of the project, and their exit codes.

An `InputError` is caused by the call or the input (exit 2, no output file); a `SolveError` is a failed
computation with valid input (exit 1). Messages say what is wrong, where, and what to do.
"""

import os

try:
    import resource
except ImportError:  # Windows sets no such limits
    resource = None  # type: ignore[assignment]

MAX_EXCERPT_LENGTH = 100  # characters of a file, or of another program's message, in a message


def excerpt(value: object, max_length: int = MAX_EXCERPT_LENGTH) -> str:
    """Part of a file, or of another program's message, as one short line of printable characters."""
    text = value[: 4 * max_length].decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
    text = " ".join(text[: 8 * max_length].split())
    text = "".join(letter if letter.isprintable() else "?" for letter in text[: max_length + 1])
    return text if len(text) <= max_length else text[: max_length - 3] + "..."


class DdgError(Exception):
    """Base of all exceptions of the project; the command line exits with `exit_code`."""

    exit_code = 1


class InputError(DdgError, ValueError):
    """The call or the input is wrong, and the caller can correct it."""

    exit_code = 2


class MeshFileError(InputError):
    """A file that is missing, unreadable, of unknown format or without the required cells."""


class MeshError(InputError):
    """A mesh without a required property: shape, index range, manifold, orientation, ..."""


class ParameterError(InputError):
    """A parameter out of range, of unknown name, or in conflict with another.

    Parameters
    ----------
    message : str
        Other parameters are in back quotes, alone or with a value: `` `method=exact` ``; the command line
        writes them as its options.
    parameter : str, optional
        Name of the wrong parameter, as in the signature of the function.
    """

    def __init__(self, message: str, *, parameter: str | None = None) -> None:
        super().__init__(message if parameter is None else f"{parameter}: {message}")
        self.message, self.parameter = message, parameter


class SceneError(InputError):
    """A scene file with an unknown key, a wrong type or unit, or an effect its object cannot have.

    Parameters
    ----------
    message : str
    mesh : str, optional
        File of the mesh that the message is about.
    """

    def __init__(self, message: str, *, mesh: str | None = None) -> None:
        super().__init__(message)
        self.mesh = mesh


class OutputError(InputError):
    """An output that cannot be written: folder missing, format unknown, the input itself."""


class MissingExtraError(InputError):
    """A feature whose optional dependency is not installed; the message names the extra."""


class SolveError(DdgError, RuntimeError):
    """A computation with valid input failed: divergence, no convergence, overflow."""


MAX_BYTES = 16 * 2**30  # of one result, checked before it is allocated


def memory_limit() -> float:
    """Bytes that one result may take: MAX_BYTES, the memory of the machine, or `ulimit -v` where less."""
    limits: list[float] = [MAX_BYTES]
    if hasattr(os, "sysconf") and "SC_PHYS_PAGES" in os.sysconf_names:
        limits.append(float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")))
    if resource is not None and (soft := resource.getrlimit(resource.RLIMIT_AS)[0]) >= 0:
        limits.append(float(soft))
    return min(limits)


def check_memory(estimate: float, what: str, cure: str) -> None:
    """Raise ParameterError if the estimated bytes of a result exceed `memory_limit`."""
    limit = memory_limit()
    if estimate > limit:
        raise ParameterError(
            f"{what} need about {estimate / 2**30:.3g} GiB, above {limit / 2**30:.3g} GiB; {cure}"
        )
