"""Types of the arguments of library functions, checked against their annotations."""

from __future__ import annotations

import functools
import inspect
import logging
import math
import numbers
import operator
import os
import re
from collections.abc import Callable, Iterable, Mapping
from contextvars import ContextVar
from typing import Any, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from ddgcli.choices import MAX_PIXELS, MIN_PIXELS
from ddgcli.errors import QUOTED_MESH, QUOTED_REPAIR, DdgError, ParameterError, excerpt

_log = logging.getLogger("ddgcli")
_is_in_library: ContextVar[bool] = ContextVar("_is_in_library", default=False)

P = ParamSpec("P")
R = TypeVar("R")

QUOTED_SUBDIVISION = re.compile(r"`subdivide(=1)?`")
QUOTED_CHOICE = re.compile(r"`([a-z_]+)=([a-z][a-z-]*)`")  # a parameter and the name that is its value
MAX_INTEGER = 2**63 - 1  # largest int64


def with_repair_call(message: str) -> str:
    """Write what a message advises in Python: `` `repair=orient fill_holes=9` `` becomes a call.

    Names are quoted: `` `radius=auto` `` becomes `` `radius='auto'` ``.
    """

    def call(match: re.Match[str]) -> str:
        steps = (step.partition("=") for step in match.group(2).split())
        values = (f"{name}={value or ('0' if name == 'weld' else 'True')}" for name, _, value in steps)
        return f"`ddg.repair_mesh(mesh, {', '.join(values)})`"

    def other_mesh(match: re.Match[str]) -> str:
        if match.group(1) == "boundary_mesh":
            return "`mesh.boundary`"
        return f"`ddg.delaunay_refinement(mesh, {match.group(2)}).mesh`, its `points` and `faces`"

    message = QUOTED_MESH.sub(other_mesh, QUOTED_REPAIR.sub(call, message))
    message = QUOTED_SUBDIVISION.sub("`ddg.subdivide(mesh)`", message)
    return QUOTED_CHOICE.sub(r"`\1='\2'`", message)


class _RepairCalls(logging.Filter):
    """Rewrite the repairs that warnings of the core advise as library calls, inside library functions.

    The command line uses the same logger and rewrites them as commands.
    """

    def filter(self, record: logging.LogRecord) -> bool:
        if _is_in_library.get() and "`" in (message := record.getMessage()):
            record.msg, record.args = with_repair_call(message), ()
        return True


_log.addFilter(_RepairCalls())


def _with_repair_calls(error: DdgError) -> None:
    """Rewrite the repairs that an error of the core advises as library calls."""
    if isinstance(error, ParameterError):
        error.message = with_repair_call(error.message)
    error.args = (with_repair_call(str(error)),)


def _scalar(value: Any) -> Any:
    """The number in a 0-d array; anything else unchanged."""
    return value[()] if isinstance(value, np.ndarray) and value.ndim == 0 else value


def _shown(value: Any) -> str:
    """Excerpt of a value for an error message; strings are quoted, because '5' is not a number."""
    return excerpt(repr(value) if isinstance(value, str) else value, 40)


def real_number(value: Any, name: str) -> float:
    """A float; ParameterError for NaN, numbers above 1e308, True, False, and anything but a real number."""
    if isinstance(number := _scalar(value), numbers.Real) and not isinstance(number, bool):
        try:
            converted = float(number)
        except OverflowError:
            converted = math.nan
        if not math.isnan(converted):
            return converted
    raise ParameterError(f"must be a number, not {_shown(value)}", parameter=name)


def whole_number(value: Any, name: str) -> int:
    """An int of at most 2^63 - 1; ParameterError for anything else, such as 2.0 or True."""
    is_whole = isinstance(number := _scalar(value), numbers.Integral) and not isinstance(number, bool)
    if is_whole and abs(whole := operator.index(number)) <= MAX_INTEGER:
        return whole
    raise ParameterError(f"must be a whole number, not {_shown(value)}", parameter=name)


def vertex_index(value: Any, name: str) -> int:
    """An int, also from a float with an integer value; ParameterError for anything else."""
    number = _scalar(value)
    if isinstance(number, (float, np.floating)) and float(number).is_integer():
        number = int(number)
    return whole_number(number, name)


def seed_number(value: Any, name: str) -> int:
    """An int of 0 or more; ParameterError for anything else."""
    if (whole := whole_number(value, name)) < 0:
        raise ParameterError(f"must be 0 or more, not {whole}", parameter=name)
    return whole


def truth(value: Any, name: str) -> bool:
    """A bool; ParameterError for anything but True, False, 1 and 0."""
    if isinstance(flag := _scalar(value), (bool, np.bool_, numbers.Integral)) and flag in (0, 1):
        return bool(flag)
    raise ParameterError(f"must be True or False, not {_shown(value)}", parameter=name)


def text(value: Any, name: str) -> str:
    """A str; ParameterError for anything else."""
    if isinstance(value, str):
        return value
    raise ParameterError(f"must be a name in quotes, not {_shown(value)}", parameter=name)


def path_text(value: Any, name: str) -> str:
    """A path as a str; ParameterError for anything else, such as bytes."""
    if isinstance(value, (str, os.PathLike)) and isinstance(path := os.fspath(value), str):
        return path
    raise ParameterError(f"must be a path, not {_shown(value)}", parameter=name)


def path_or_table(value: Any, name: str) -> str | Mapping[str, Any]:
    """A dict whose keys are strings, or a path as a str; ParameterError for anything else."""
    if isinstance(value, Mapping):
        return table(value, name)
    if isinstance(value, (str, os.PathLike)):
        return path_text(value, name)
    raise ParameterError(f"must be a dict or a path, not {_shown(value)}", parameter=name)


def table(value: Any, name: str) -> Mapping[str, Any]:
    """A dict whose keys are strings; ParameterError for anything else."""
    if not isinstance(value, Mapping):
        raise ParameterError(f"must be a dict from name to value, not {_shown(value)}", parameter=name)
    for key in value:
        text(key, f"key of {name}")
    return value


def number_or_name(value: Any, name: str) -> float | str:
    """A string unchanged, else a float; ParameterError for anything else."""
    return value if isinstance(value, str) else real_number(value, name)


def whole_number_or_name(value: Any, name: str) -> int | str:
    """A string unchanged, else an int; ParameterError for anything else."""
    return value if isinstance(value, str) else whole_number(value, name)


def real_array(value: Any, name: str) -> NDArray:
    """An array of real numbers or booleans; ParameterError for ragged lists, text, complex numbers, ..."""
    if np.ma.is_masked(value):
        raise ParameterError(
            "has masked entries; give them values first, as numpy.ma.filled does", parameter=name
        )
    try:
        array = np.asarray(value)
        if array.dtype == np.uint64 and array.max(initial=0) > MAX_INTEGER:
            array = array.astype(np.float64)  # no index, and a cast to int64 would make it negative
        if array.dtype.kind == "O":  # integers beyond 64 bits, fractions; None would become NaN
            if any(not isinstance(number, numbers.Real) for number in array.flat):
                raise TypeError("not real")
            array = array.astype(np.float64)
    except (TypeError, ValueError, OverflowError):
        array = np.array("")
    if array.dtype.kind in "biuf":
        return array
    raise ParameterError(f"must be an array of real numbers, not {_shown(value)}", parameter=name)


def array_or_name(value: Any, name: str) -> NDArray | str:
    """A string unchanged, else an array of real numbers; ParameterError for anything else."""
    return value if isinstance(value, str) else real_array(value, name)


def angles_or_name(value: Any, name: str) -> tuple[float, ...] | str:
    """A string unchanged, else two floats; ParameterError for anything else."""
    return value if isinstance(value, str) else few_numbers(value, name, 2, "a name or two angles")


def pixels(value: Any, name: str) -> tuple[int, int]:
    """Two whole numbers; ParameterError for anything else."""
    sides = few_numbers(value, name, 2, "a width and a height in pixels")
    if not all(side.is_integer() and MIN_PIXELS <= side <= MAX_PIXELS for side in sides):
        raise ParameterError(f"each side has {MIN_PIXELS} to {MAX_PIXELS} whole pixels", parameter=name)
    return int(sides[0]), int(sides[1])


def table_of_vertices(value: Any, name: str) -> dict[int, float]:
    """A dict from vertex to number; ParameterError where a key or a value is something else."""
    if not isinstance(value, Mapping):
        raise ParameterError(
            f"must be a dict such as {{0: 1.0}}, from vertex to number, not {_shown(value)}",
            parameter=name,
        )
    return {vertex_index(key, f"key of {name}"): real_number(v, f"{name}[{key}]") for key, v in value.items()}


def few_numbers(value: Any, name: str, count: int = 3, what: str = "three numbers") -> tuple[float, ...]:
    """Floats, by default three; ParameterError for anything else."""
    array = real_array(value, name)
    if array.shape != (count,) or not np.isfinite(array).all():
        raise ParameterError(f"must be {what}, not {_shown(value)}", parameter=name)
    return tuple(float(number) for number in array)


def list_of_arrays(
    value: Any, name: str, what: str = "lists of vertices such as [[0, 1, 2]]"
) -> list[NDArray]:
    """One array for each list; ParameterError for anything but a sequence of lists."""
    if isinstance(_scalar(value), (str, bytes, Mapping)) or not isinstance(_scalar(value), Iterable):
        raise ParameterError(f"must be {what}, not {_shown(value)}", parameter=name)
    return [real_array(numbers_of_one, name) for numbers_of_one in value]


def polylines(value: Any, name: str) -> list[NDArray]:
    """One (k, 3) array for each polyline; ParameterError for anything else."""
    lines = list_of_arrays(value, name, "arrays (k, 3) of points, one for each polyline")
    for line in lines:
        if line.ndim != 2 or line.shape[1] != 3:
            raise ParameterError(
                f"must be arrays (k, 3) of points, not one of shape {line.shape}", parameter=name
            )
    return [line.astype(np.float64) for line in lines]


# annotation of a parameter, without `| None` -> its check and conversion
CONVERSIONS: dict[str, Callable[[Any, str], Any]] = {
    "float": real_number,
    "int": whole_number,
    "bool": truth,
    "str": text,
    "float | str": number_or_name,
    "int | str": whole_number_or_name,
    "ArrayLike": real_array,
    "Sequence[float]": real_array,
    "int | Sequence[int] | NDArray": real_array,
    "Sequence[int] | NDArray": real_array,
    "tuple[float, float, float]": few_numbers,
    "Sequence[Sequence[int]]": list_of_arrays,
    "Sequence[ArrayLike]": polylines,
    "str | ArrayLike": array_or_name,
    "str | tuple[float, float]": angles_or_name,
    "tuple[int, int]": pixels,
    "Mapping[int, float]": table_of_vertices,
    "Mapping[str, ArrayLike]": table,
    "Path": path_text,
    "str | os.PathLike[str]": path_text,
    "str | os.PathLike[str] | Mapping[str, Any]": path_or_table,
}


def _conversion(parameter: inspect.Parameter) -> Callable[[Any, str], Any] | None:
    annotation = str(parameter.annotation)
    if parameter.name == "seed":
        return seed_number
    if annotation.startswith(("Literal['", 'Literal["')) or isinstance(parameter.default, str):
        return text
    if annotation.startswith("Literal["):
        return whole_number
    return CONVERSIONS.get(annotation.removesuffix(" | None"))


def checked_arguments(function: Callable[P, R]) -> Callable[P, R]:
    """Decorator: check arguments against the annotations of a function, and convert them.

    Parameters
    ----------
    function : callable
        Its annotations are strings; those that are keys of `CONVERSIONS` are checked.
    """
    parameters = inspect.signature(function).parameters.values()
    checks = {
        p.name: (conversion, p.default is None or str(p.annotation).endswith("| None"))
        for p in parameters
        if (conversion := _conversion(p)) is not None
    }
    positional = [p.name for p in parameters if p.kind is not p.KEYWORD_ONLY]

    def converted(name: str, value: Any) -> Any:
        if name not in checks:
            return value
        conversion, is_optional = checks[name]
        return None if value is None and is_optional else conversion(value, name)

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        names = positional + [""] * (len(args) - len(positional))  # too many: Python's own error
        own = [converted(name, value) for name, value in zip(names, args)]
        token = _is_in_library.set(True)
        try:
            return function(*own, **{name: converted(name, value) for name, value in kwargs.items()})
        except DdgError as error:
            _with_repair_calls(error)
            raise
        finally:
            _is_in_library.reset(token)

    return call
