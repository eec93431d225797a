"""Every way to say no, and the exit code that it means.

An `InputError` is the caller's to mend (exit 2, no output file); a `SolveError` says that sound input
still could not be computed (exit 1). Messages name what was found, where, and what to do.
"""

LONGEST_EXCERPT = 100  # characters of a file, or of another program's message, that a message repeats


def excerpt(value: object, longest: int = LONGEST_EXCERPT) -> str:
    """A piece of a file, or another program's message, as one short line of printable characters."""
    text = value[: 4 * longest].decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
    text = " ".join(text[: 8 * longest].split())
    text = "".join(letter if letter.isprintable() else "?" for letter in text[: longest + 1])
    return text if len(text) <= longest else text[: longest - 3] + "..."


class DdgError(Exception):
    """Base of all refusals; `exit_code` is what the command line ends with."""

    exit_code = 1


class InputError(DdgError, ValueError):
    """The call or the input is wrong and the caller can mend it."""

    exit_code = 2


class MeshFileError(InputError):
    """A file that is missing, unreadable, of unknown format or without the cells asked for."""


class MeshError(InputError):
    """A mesh that breaks what an algorithm needs: shape, index range, manifold, orientation, ..."""


class ParameterError(InputError):
    """A parameter out of range, of unknown name, or in conflict with another.

    Parameters
    ----------
    message : str
        Other parameters stand between back quotes, alone or with a value: `` `method=exact` ``; the command
        line writes them as its options.
    parameter : str, optional
        Name of the parameter that is wrong, as in the function's signature.
    """

    def __init__(self, message: str, *, parameter: str | None = None) -> None:
        super().__init__(message if parameter is None else f"{parameter}: {message}")
        self.message, self.parameter = message, parameter


class SceneError(InputError):
    """A scene file with an unknown key, a wrong type or unit, or an effect its object cannot have."""


class OutputError(InputError):
    """An output that cannot be written: folder missing, format unknown, the input itself."""


class MissingExtraError(InputError):
    """A feature whose optional dependency is not installed; the message names the extra."""


class SolveError(DdgError, RuntimeError):
    """Sound input whose computation failed: divergence, no convergence, overflow."""


MAX_BYTES = 16 * 2**30  # of one dense result: more is refused before it is allocated


def check_memory(estimate: float, what: str, cure: str) -> None:
    """Refuse what would take more than 16 GiB, with the estimate in bytes; ParameterError."""
    if estimate > MAX_BYTES:
        raise ParameterError(
            f"{what} need about {estimate / 2**30:.3g} GiB, above {MAX_BYTES / 2**30:g} GiB; {cure}"
        )
