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
    """An option or argument out of range, of unknown name, or at odds with another."""


class SceneError(InputError):
    """A scene file with an unknown key, a wrong type or unit, or an effect its object cannot have."""


class OutputError(InputError):
    """An output that cannot be written: folder missing, format unknown, the input itself."""


class MissingExtraError(InputError):
    """A feature whose optional dependency is not installed; the message names the extra."""


class SolveError(DdgError, RuntimeError):
    """Sound input whose computation failed: divergence, no convergence, overflow."""
