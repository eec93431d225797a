"""Short text of results for notebooks and prompts: arrays by type and shape instead of their numbers."""

from __future__ import annotations

import dataclasses
import textwrap
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

MAX_NUMBERS, MAX_ENTRIES, MAX_CHARACTERS = 6, 16, 80


def short_repr(instance: Any) -> str:
    """Text of a dataclass, a line for each field; `__repr__ = short_repr` in its body.

    Parameters
    ----------
    instance : dataclass instance
        Private fields, functions and iterators are left out.

    Returns
    -------
    str
    """
    shown = {f.name: getattr(instance, f.name) for f in dataclasses.fields(instance) if f.name[0] != "_"}
    lines = [
        textwrap.fill(
            f"{name}={value_text(value)},", 100, initial_indent=" " * 4, subsequent_indent=" " * 8,
            break_long_words=False, break_on_hyphens=False,
        )
        for name, value in shown.items()
        if not (callable(value) or isinstance(value, Iterator))
    ]  # fmt: skip
    return "\n".join([f"{type(instance).__name__}(", *lines, ")"])


def value_text(value: Any) -> str:
    """Text of a field: arrays and matrices by type and shape, long collections by their length.

    Parameters
    ----------
    value : object

    Returns
    -------
    str
    """
    name = type(value).__name__
    if isinstance(value, np.ndarray) and value.size > MAX_NUMBERS:
        return f"{value.dtype}[{','.join(map(str, value.shape))}]"
    if isinstance(value, np.ndarray):
        return value_text(value.tolist())
    if isinstance(value, float):
        return f"{value:.6g}"
    if hasattr(value, "nnz"):
        return f"{name} {value.shape} with {value.nnz} entries"
    if isinstance(value, Mapping):
        entries = [f"{key!r}: {value_text(one)}" for key, one in list(value.items())[:MAX_ENTRIES]]
        more = len(value) - len(entries)
        return "{" + ", ".join(entries + [f"{more} more"] * (more > 0)) + "}"
    if isinstance(value, list | tuple):
        if len(value) > MAX_NUMBERS:
            return f"{name} of {len(value)} {type(value[0]).__name__}"
        left, right = "()" if isinstance(value, tuple) else "[]"
        return left + ", ".join(map(value_text, value)) + right
    text = repr(value)
    if dataclasses.is_dataclass(value) and ("\n" in text or len(text) > MAX_CHARACTERS):
        return f"{name}(...)"
    return name if " at 0x" in text else textwrap.shorten(text, MAX_CHARACTERS, placeholder="...")
