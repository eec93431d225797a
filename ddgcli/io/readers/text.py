"""Fast reading of numbers from text, with the line of the first error."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshFileError, excerpt
from ddgcli.mesh.ragged import ranges


def numbers(text: bytes) -> NDArray[np.float64]:
    """All numbers of whitespace-separated text; ValueError when something in it is no number."""
    if not text.strip():
        return np.zeros(0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # numpy reports unmatched text by a DeprecationWarning
        try:
            return np.fromstring(text, dtype=np.float64, sep=" ")
        except (DeprecationWarning, ValueError) as error:
            raise ValueError("not a number") from error


def rows(lines: Sequence[bytes], line_number: Sequence[int], what: str) -> tuple[NDArray, NDArray]:
    """Numbers of lines and how many each holds; MeshFileError naming the first line with something else."""
    count = np.fromiter((len(line.split()) for line in lines), dtype=np.int64, count=len(lines))
    try:
        values = numbers(b"\n".join(lines))
        if len(values) == count.sum():
            return values, count
    except ValueError:
        pass
    for line, number in zip(lines, line_number):
        for word in line.split():
            try:
                float(word)
            except ValueError:
                bad_word = excerpt(word, 20)
                raise MeshFileError(f"line {number + 1}: {bad_word!r} in a {what} is not a number") from None
    raise MeshFileError(f"the numbers of the {what} lines cannot be read; check the file")


def whole_numbers(values: NDArray, what: str) -> NDArray[np.int64]:
    """Floats as int64; MeshFileError where one is not a whole number that int64 can hold."""
    with np.errstate(invalid="ignore"):
        bad = np.flatnonzero(~((values == np.rint(values)) & (np.abs(values) < 2**53)))
    if len(bad):
        raise MeshFileError(
            f"{what} {values.ravel()[bad[0]].item()} is not a usable whole number; correct it"
        )
    return values.astype(np.int64)


def typed(values: NDArray, dtype: Any, what: str) -> NDArray:
    """Floats of a text in the type that the file declares.

    Raises
    ------
    MeshFileError
        A value of an integer type that is not a whole number, or that the type cannot hold.
    """
    dtype = np.dtype(dtype)
    if dtype.kind == "f":
        with np.errstate(over="ignore"):
            return values.astype(dtype)
    whole, bounds = whole_numbers(values, what), np.iinfo(dtype)
    bad = np.flatnonzero((whole < bounds.min) | (whole > min(bounds.max, np.iinfo(np.int64).max)))
    if len(bad):
        raise MeshFileError(f"{what} {whole[bad[0]]} does not fit its type {dtype.name}; correct it")
    return whole.astype(dtype)


def ragged(flat: NDArray, n: int, what: str, extra: int = 0) -> tuple[NDArray, NDArray, int]:
    """`n` lists, each its length and then its members (and `extra` more values), from a flat array.

    Returns
    -------
    members : (c,) ndarray
    sizes : (n,) ndarray of int64
    used : int
        Values of `flat` that were consumed.
    """
    if n == 0:
        return flat[:0], np.zeros(0, dtype=np.int64), 0
    if len(flat):
        width = _list_size(flat, 0) + 1 + extra
        if width > extra and n * width <= len(flat):
            table = flat[: n * width].reshape(n, width)
            if (table[:, 0] == flat[0]).all():
                size = width - 1 - extra
                return table[:, 1 : 1 + size].ravel(), np.full(n, size, dtype=np.int64), n * width
    starts, sizes, at = [], [], 0
    for number in range(n):
        size = _list_size(flat, at)
        if size < 0 or at + 1 + size + extra > len(flat):
            raise MeshFileError(
                f"the file ends inside {what} {number} of {n}, or its count is wrong; repair the file"
            )
        starts.append(at + 1)
        sizes.append(size)
        at += 1 + size + extra
    size_array = np.array(sizes, dtype=np.int64)
    return flat[ranges(np.array(starts, dtype=np.int64), size_array)[0]], size_array, at


def _list_size(flat: NDArray, at: int) -> int:
    """The whole number at a place that counts the members of a list; -1 where there is no such number."""
    value = flat[at] if at < len(flat) else -1
    return int(value) if 0 <= value < len(flat) and value == int(value) else -1
