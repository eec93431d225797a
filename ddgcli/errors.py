"""Exceptions of the project, and their exit codes.

An `InputError` is caused by the call or the input (exit 2, no output file); a `SolveError` is a failed
computation with valid input (exit 1). Messages state what is wrong, where, and what to do.
"""

import logging
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TypeVar

T = TypeVar("T")

MAX_EXCERPT_LENGTH = 100  # characters of a file, or of another program's message, in a message
QUOTED_REPAIR = re.compile(r"`repair(_cells)?=([^`]*)`")  # in a message, steps that repair the mesh
# in a message, a mesh to use in place of the input: its boundary (of the mesh of a path), or its refinement
# to an angle in degrees
QUOTED_MESH = re.compile(r"`(boundary_mesh|refined_mesh)(?:=([^`]*))?`")
QUOTED_PARAMETER = re.compile(r"`([a-z]\w*)(?:=([^`]*))?`")  # in a message, a parameter, maybe with a value
LONG_NUMBER = re.compile(r"(\d{20})\d{40,}")  # its first digits and the others
LONG_WORD = re.compile(r"(\S{100})\S{240,}(\S{40})")  # its first letters, the others and its last
LONG_QUOTE = re.compile(r"('[^']{100})[^']{240,}([^']{40}')")  # the same for a value with spaces


def excerpt(value: object, max_length: int = MAX_EXCERPT_LENGTH) -> str:
    """A file's content, or another program's message, as one short line of printable characters.

    Parameters
    ----------
    value : bytes, str or object
    max_length : int

    Returns
    -------
    str
    """
    text = value[: 4 * max_length].decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
    text = " ".join(text[: 8 * max_length].split())
    text = "".join(letter if letter.isprintable() else "?" for letter in text[: max_length + 1])
    return text if len(text) <= max_length else text[: max_length - 3] + "..."


def counted(number: int, one: str, several: str) -> str:
    """A number with the words that agree with it.

    Parameters
    ----------
    number : int
    one, several : str
        Such as "edge has" and "edges have".

    Returns
    -------
    str
    """
    return f"{number} {one if number == 1 else several}"


def encodable(text: str) -> str:
    r"""Text that can be written as UTF-8.

    Parameters
    ----------
    text : str

    Returns
    -------
    str
        Bytes of file names that are not UTF-8 become escapes such as \udce9, as in JSON.
    """
    return text.encode(errors="backslashreplace").decode()


def with_short_words(message: str) -> str:
    """A message with long numbers and words cut, which damaged files and long options hold.

    Parameters
    ----------
    message : str

    Returns
    -------
    str
        Numbers of 60 digits or more keep their first 20; words of 380 letters or more their first 100 and
        last 40, as do values in quotes.
    """
    message = LONG_NUMBER.sub(r"\1...", message)
    return LONG_QUOTE.sub(r"\1...\2", LONG_WORD.sub(r"\1...\2", message))


class DdgError(Exception):
    """Base of all exceptions of the project; the command line exits with `exit_code`."""

    exit_code = 1

    def __init__(self, message: str = "") -> None:
        super().__init__(with_short_words(message))


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
        self.message, self.parameter = with_short_words(message), parameter

    def rename(self, names: Mapping[str, str]) -> None:
        """Replace the names of parameters in the message; `names` maps old to new ones."""
        self.message = with_parameter_names(self.message, names)
        self.parameter = names.get(self.parameter or "", self.parameter)
        self.args = (self.message if self.parameter is None else f"{self.parameter}: {self.message}",)


def with_parameter_names(message: str, names: Mapping[str, str]) -> str:
    """A message with other names for the parameters in its back quotes.

    Parameters
    ----------
    message : str
    names : mapping of str to str

    Returns
    -------
    str
    """

    def renamed(match: re.Match[str]) -> str:
        name, value = match.groups()
        return f"`{names.get(name, name)}`" if value is None else f"`{names.get(name, name)}={value}`"

    return QUOTED_PARAMETER.sub(renamed, message)


@contextmanager
def renamed_parameters(default: str | None = None, /, **names: str) -> Iterator[None]:
    """Name the parameters of a called function in its errors as the caller names them.

    Parameters
    ----------
    default : str, optional
        The parameter of errors that name none.
    **names : str
        The caller's name of each parameter of the called function:
        ``with renamed_parameters(k="eigen"): spectrum(operator, eigen)``.

    Yields
    ------
    None
    """
    try:
        yield
    except ParameterError as error:
        error.rename(names)
        if error.parameter is None and default is not None:
            error.parameter = default
            error.rename({})
        raise
    except DdgError as error:
        error.args = (with_parameter_names(str(error), names),)
        raise


def named_array(
    arrays: Mapping[str, T], name: str, what: str = "array", *, parameter: str | None = None
) -> T:
    """Look up an array by its name.

    Parameters
    ----------
    arrays : mapping of str to array
    name : str
    what : str
        Kind of array in the message.
    parameter : str, optional
        That names the array.

    Returns
    -------
    array

    Raises
    ------
    ParameterError
        If there is no such array; the message lists the names.
    """
    if name not in arrays:
        names = ", ".join(sorted(arrays))
        advice = f"choose one of: {names}" if names else "there is none to choose from"
        raise ParameterError(f"no {what} {name!r}; {advice}", parameter=parameter)
    return arrays[name]


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


class StandardOutputError(OutputError):
    """Standard output that does not take all of a file; what it took is cut."""


class MissingExtraError(InputError):
    """A feature whose optional dependency is not installed; the message names the extra."""


class SolveError(DdgError, RuntimeError):
    """A computation with valid input failed: divergence, no convergence, overflow."""


class InfiniteValueError(SolveError, ValueError):
    """An expression of the input is not finite: wrong input at the start of a run, a failed run later."""


@contextmanager
def without_warnings() -> Iterator[None]:
    """Log nothing within the block: for a trial of what the run itself does, which logs the same warnings.

    Yields
    ------
    None
    """
    log = logging.getLogger("ddgcli")
    disabled, log.disabled = log.disabled, True
    try:
        yield
    finally:
        log.disabled = disabled
