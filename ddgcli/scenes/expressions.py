"""Expressions of a scene such as "5*z" or "exp(-(x^2+y^2)/0.1)": parsed here, never by Python's eval."""

from __future__ import annotations

import ast
import difflib
import re
import warnings
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import InfiniteValueError, counted, excerpt

_BINARY: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: np.add, ast.Sub: np.subtract, ast.Mult: np.multiply, ast.Div: np.divide,
    ast.Pow: np.power, ast.Mod: np.mod,
}  # fmt: skip
_COMPARE: dict[type[ast.cmpop], Callable[[Any, Any], Any]] = {
    ast.Lt: np.less, ast.LtE: np.less_equal, ast.Gt: np.greater, ast.GtE: np.greater_equal,
}  # fmt: skip
_NUMBER_WITH_UNIT = re.compile(
    r"((?:\d{1,30}\.?\d{0,30}|\.\d{1,30})(?:[eE][-+]?\d{1,2})?) ((?:1/)?[A-Za-z][\w/^ ]{0,30})$"
)
FUNCTIONS: dict[str, tuple[int, Callable[..., Any]]] = {
    "sin": (1, np.sin), "cos": (1, np.cos), "tan": (1, np.tan), "asin": (1, np.arcsin),
    "acos": (1, np.arccos),
    "atan": (1, np.arctan), "atan2": (2, np.arctan2), "sinh": (1, np.sinh), "cosh": (1, np.cosh),
    "tanh": (1, np.tanh), "exp": (1, np.exp), "log": (1, np.log), "sqrt": (1, np.sqrt), "abs": (1, np.abs),
    "sign": (1, np.sign), "floor": (1, np.floor), "min": (2, np.minimum), "max": (2, np.maximum),
    "where": (3, np.where), "hypot": (2, np.hypot),
}  # fmt: skip
CONSTANTS = {"pi": np.pi, "e": np.e}
MAX_LENGTH = 2000
MAX_DEPTH = 60


def evaluate(text: str, variables: Mapping[str, NDArray]) -> NDArray[np.float64]:
    """Value of an expression at every point.

    Parameters
    ----------
    text : str
        Numbers, `+ - * / % ^ **`, comparisons (1 or 0), parentheses, the functions of `FUNCTIONS`, `pi`, `e`.
    variables : mapping of str to (n,) ndarray
        Usually x, y, z.

    Returns
    -------
    (n,) ndarray of float64

    Raises
    ------
    ValueError
        Anything else in the text.
    InfiniteValueError
        A value that is not finite: a ValueError that ends a run as a failed step does.
    """
    tree = parse(text, tuple(variables))
    size = len(next(iter(variables.values())))
    with np.errstate(all="ignore"):
        result = np.broadcast_to(np.asarray(_value(tree, variables), dtype=np.float64), (size,)).copy()
    bad = np.flatnonzero(~np.isfinite(result))
    if len(bad):
        where = ", ".join(f"{name} = {array[bad[0]]:g}" for name, array in variables.items())
        raise InfiniteValueError(
            f"the expression '{excerpt(text)}' is not finite at {counted(len(bad), 'point', 'points')} "
            f"(first: {where})"
        )
    return result


def parse(text: str, variables: tuple[str, ...] = ("x", "y", "z")) -> ast.expr:
    """Syntax tree of an expression, checked.

    Parameters
    ----------
    text : str
    variables : tuple of str

    Returns
    -------
    ast.expr

    Raises
    ------
    ValueError
        Names what is not allowed, and the nearest name.
    """
    if len(text) > MAX_LENGTH:
        raise ValueError(f"the expression is longer than {MAX_LENGTH} characters")
    if "#" in text:
        raise ValueError(f"cannot read the expression '{excerpt(text)}': it may not hold a comment")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Python's syntax warnings, such as for "1or 2"
            tree = ast.parse(text.strip().replace("^", "**"), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        hint = _unit_hint(text, variables)
        raise ValueError(f"cannot read the expression '{excerpt(text)}'{hint}") from error
    _check(tree, text, variables, 0)
    return tree


def _unit_hint(text: str, variables: tuple[str, ...]) -> str:
    """Corrected form of a number or expression that ends with a unit, or ""."""
    match = _NUMBER_WITH_UNIT.search(text)
    if match is not None and match[2] not in (*variables, "t"):
        factor = _unit_factor(match[2])
        if factor is not None:
            return _without_unit(f"{float(match[1]) * factor:.12g}", match[0])
    for space in re.finditer(" ", text):  # the longest unit first
        unit, expression = text[space.end() :].strip(), text[: space.start()].strip()
        factor = _unit_factor(unit) if unit[:1].isalpha() and unit not in (*variables, "t") else None
        if factor is not None and _as_factor(expression):
            remedy = expression if factor == 1.0 else f"{factor:.12g}*{_as_factor(expression)}"
            return _without_unit(remedy, text)
    return ""


def _without_unit(remedy: str, text: str) -> str:
    return f": expressions are in SI, without units; write {remedy} for '{excerpt(text)}'"


def _unit_factor(text: str) -> float | None:
    """SI value of a unit, None for other texts."""
    from ddgcli.scenes.units import parse_unit

    try:
        return parse_unit(text.strip())[0]
    except (ValueError, OverflowError):
        return None


def _as_factor(text: str) -> str:
    """An expression as a factor of a product; "" for other texts."""
    try:
        tree = ast.parse(text.replace("^", "**"), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return ""
    is_sum = isinstance(tree, ast.Compare) or (
        isinstance(tree, ast.BinOp) and isinstance(tree.op, (ast.Add, ast.Sub))
    )
    return f"({text})" if is_sum and tree.col_offset == 0 else text


def _check(node: ast.AST, text: str, variables: tuple[str, ...], depth: int) -> None:
    if depth > MAX_DEPTH:
        raise ValueError("the expression is nested too deeply")
    children: list[ast.AST] = []
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        if isinstance(node.value, int) and abs(node.value) > 2**53:
            raise ValueError(f"the number {str(node.value)[:20]}... of '{excerpt(text)}' is too large")
    elif isinstance(node, ast.Name):
        allowed = [*variables, *CONSTANTS]
        if node.id not in allowed:
            raise ValueError(_unknown("name", node.id, allowed))
    elif isinstance(node, ast.BinOp) and type(node.op) in _BINARY:
        children = [node.left, node.right]
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.UAdd, ast.USub)):
        children = [node.operand]
    elif isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in _COMPARE:
        children = [node.left, *node.comparators]
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
        if node.func.id not in FUNCTIONS:
            raise ValueError(_unknown("function", node.func.id, list(FUNCTIONS)))
        if len(node.args) != FUNCTIONS[node.func.id][0]:
            raise ValueError(
                f"{node.func.id} takes {FUNCTIONS[node.func.id][0]} arguments, found {len(node.args)}"
            )
        children = list(node.args)
    else:
        raise ValueError(
            f"the expression '{excerpt(text)}' holds something other than arithmetic in "
            f"{', '.join(variables)}"
        )
    for child in children:
        _check(child, text, variables, depth + 1)


def _unknown(kind: str, name: str, allowed: list[str]) -> str:
    near = difflib.get_close_matches(name, allowed, 1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    return f"unknown {kind} {name!r} in the expression{hint} (known: {', '.join(allowed)})"


def _value(node: ast.AST, variables: Mapping[str, NDArray]) -> Any:
    if isinstance(node, ast.Constant):
        return float(node.value)  # type: ignore[arg-type]
    if isinstance(node, ast.Name):
        return variables[node.id] if node.id in variables else CONSTANTS[node.id]
    if isinstance(node, ast.BinOp):
        return _BINARY[type(node.op)](_value(node.left, variables), _value(node.right, variables))
    if isinstance(node, ast.UnaryOp):
        value = _value(node.operand, variables)
        return -value if isinstance(node.op, ast.USub) else value
    if isinstance(node, ast.Compare):
        compare = _COMPARE[type(node.ops[0])]
        return np.asarray(
            compare(_value(node.left, variables), _value(node.comparators[0], variables)), float
        )
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        return FUNCTIONS[node.func.id][1](*(_value(a, variables) for a in node.args))
    raise ValueError("not an expression")
