"""Quantities of a scene: SI numbers, or strings that carry a unit such as "0.4 mm" or "70 GPa"."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Callable
from typing import Annotated, Any

from pydantic import BeforeValidator, Field

# unit -> (factor to SI, dimension as powers of m, kg, s, rad)
_BASE = {
    "m": (1.0, (1, 0, 0, 0)), "kg": (1.0, (0, 1, 0, 0)), "g": (1e-3, (0, 1, 0, 0)), "t": (1e3, (0, 1, 0, 0)),
    "s": (1.0, (0, 0, 1, 0)), "min": (60.0, (0, 0, 1, 0)), "h": (3600.0, (0, 0, 1, 0)),
    "N": (1.0, (1, 1, -2, 0)), "Pa": (1.0, (-1, 1, -2, 0)), "J": (1.0, (2, 1, -2, 0)),
    "Hz": (1.0, (0, 0, -1, 0)), "rad": (1.0, (0, 0, 0, 1)), "deg": (math.pi / 180, (0, 0, 0, 1)),
    "psi": (6894.757293168, (-1, 1, -2, 0)), "bar": (1e5, (-1, 1, -2, 0)),
    "in": (0.0254, (1, 0, 0, 0)), "ft": (0.3048, (1, 0, 0, 0)), "lbf": (4.4482216152605, (1, 1, -2, 0)),
}  # fmt: skip
_PREFIX = {"n": 1e-9, "u": 1e-6, "µ": 1e-6, "m": 1e-3, "c": 1e-2, "d": 1e-1, "k": 1e3, "M": 1e6, "G": 1e9}
_PREFIX_UNITS = ("m", "g", "s", "N", "Pa", "J", "Hz", "rad")
_FACTOR = re.compile(r"([A-Za-zµ]+)(?:\^?(-?\d+))?$")
_QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*$")

Dimension = tuple[int, int, int, int]


def _unit_names() -> list[str]:
    return sorted({*_BASE, *(p + u for p in _PREFIX for u in _PREFIX_UNITS)})


def _simple_unit(name: str) -> tuple[float, Dimension]:
    if name in _BASE:
        return _BASE[name]
    for prefix, factor in _PREFIX.items():
        if name.startswith(prefix) and name[len(prefix) :] in _PREFIX_UNITS:
            base, dimension = _BASE[name[len(prefix) :]]
            return factor * base, dimension
    near = difflib.get_close_matches(name, _unit_names(), 1)
    raise ValueError(f"unknown unit {name!r}" + (f"; did you mean {near[0]!r}?" if near else ""))


def parse_unit(text: str) -> tuple[float, Dimension]:
    """Factor to SI and dimension of a unit such as "kg/m^2", "N m" or "mm/s2".

    Parameters
    ----------
    text : str

    Returns
    -------
    factor : float
    dimension : tuple of int
        Powers of m, kg, s and rad.

    Raises
    ------
    ValueError
        If the text is not a unit.
    """
    factor, total = 1.0, [0, 0, 0, 0]
    for position, piece in enumerate(text.split("/")):
        sign = 1 if position == 0 else -1
        for word in re.split(r"[\s*·]+", piece.strip()):
            if word in ("", "1"):
                continue
            match = _FACTOR.match(word)
            if match is None:
                raise ValueError(f"cannot read the unit {text!r}")
            unit, dimension = _simple_unit(match[1])
            power = sign * int((match[2] or "1")[:6])
            factor *= unit**power
            total = [a + power * b for a, b in zip(total, dimension)]
    return factor, (total[0], total[1], total[2], total[3])


def parse_quantity(value: Any, unit: str) -> float:
    """The SI number of `value`: a number as it is, a string with its unit converted.

    Parameters
    ----------
    value : int, float or str
    unit : str
        SI unit of the quantity ("" for a pure number).

    Returns
    -------
    float

    Raises
    ------
    ValueError
        Wrong type, not finite, unknown unit or one of another dimension.
    """
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        raise ValueError(f"expected a number{_or_string(unit)}, found {_kind(value)}")
    if isinstance(value, str):
        match = _QUANTITY.match(value)
        if match is None:
            raise ValueError(f"expected a number{_or_string(unit)}, found {value!r}")
        number = float(match[1])
        if match[2]:
            try:
                factor, dimension = parse_unit(match[2])
            except OverflowError as error:
                raise ValueError(f"the unit of {value!r} is beyond the floating-point range") from error
            if dimension != parse_unit(unit)[1]:
                expected = f"a multiple of {unit}" if unit else "none"
                raise ValueError(f"the unit of {value!r} does not fit: {expected} is needed")
            number *= factor
    else:
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
    if not math.isfinite(number):
        raise ValueError(f"{str(value)[:40]} is not finite; write a finite number")
    return number


def _or_string(unit: str) -> str:
    return f" or a string with a unit like '1 {unit}'" if unit else ""


def _kind(value: Any) -> str:
    names = {
        bool: "true/false",
        str: "text",
        list: "an array",
        dict: "a table",
        int: "a number",
        float: "a number",
    }
    return f"{names.get(type(value), type(value).__name__)} ({value!r})"


def _scalar(unit: str) -> Callable[[Any], float]:
    return lambda value: parse_quantity(value, unit)


def _vector(unit: str) -> Callable[[Any], tuple[float, float, float]]:
    def read(value: Any) -> tuple[float, float, float]:
        if not isinstance(value, (list, tuple)) or len(value) != 3:
            raise ValueError(f"expected three numbers [x, y, z], found {_kind(value)}")
        x, y, z = (parse_quantity(v, unit) for v in value)
        return x, y, z

    return read


_BOUNDS = {"gt": "exclusiveMinimum", "ge": "minimum", "lt": "exclusiveMaximum", "le": "maximum"}


def quantity(unit: str, text: str = "", **bounds: Any) -> Any:
    """Annotated type of a scalar quantity of a scene.

    Parameters
    ----------
    unit : str
        SI unit; empty without one.
    text : str
        Description.
    **bounds : float
        `gt`, `ge`, `lt`, `le`.

    Returns
    -------
    type
        For fields of sections: a number, or a string with a unit.
    """
    number = {"type": "number", **{_BOUNDS[name]: bound for name, bound in bounds.items()}}
    text_form = {"type": "string", "pattern": r"^\s*[-+]?(\d|\.\d)"}
    schema = {"unit": unit or "1", "anyOf": [number, text_form]}
    return Annotated[
        float,
        BeforeValidator(_scalar(unit)),
        Field(description=text, json_schema_extra=_swap(schema), **bounds),
    ]


def vector(unit: str, text: str = "") -> Any:
    """Annotated type of a vector quantity [x, y, z] of a scene.

    Parameters
    ----------
    unit : str
        SI unit; empty without one.
    text : str
        Description.

    Returns
    -------
    type
        For fields of sections.
    """
    return Annotated[
        tuple[float, float, float],
        BeforeValidator(_vector(unit)),
        Field(description=text, json_schema_extra={"unit": unit or "1"}),
    ]


def _swap(extra: dict[str, Any]) -> Callable[[dict[str, Any]], None]:
    def edit(schema: dict[str, Any]) -> None:
        schema.update(extra)
        for key in ("type", *_BOUNDS):  # of the number alone; a string is converted first
            schema.pop(key, None)

    return edit
