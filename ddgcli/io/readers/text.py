"""Numbers out of text, fast, and with the line of the first that is none."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshFileError


def numbers(text: bytes) -> NDArray[np.float64]:
    """All numbers of whitespace-separated text; ValueError when something in it is no number."""
    if not text.strip():
        return np.zeros(0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # numpy tells of unmatched text by a DeprecationWarning
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
                shown = word[:20].decode("utf-8", "replace")
                raise MeshFileError(f"line {number + 1}: {shown!r} in a {what} is not a number") from None
    raise MeshFileError(f"the numbers of the {what} lines cannot be read; check the file")


def whole_numbers(values: NDArray, what: str) -> NDArray[np.int64]:
    """Floats as int64; MeshFileError where one is not a whole number that int64 can hold."""
    with np.errstate(invalid="ignore"):
        bad = np.flatnonzero(~((values == np.rint(values)) & (np.abs(values) < 2**53)))
    if len(bad):
        raise MeshFileError(f"{what} {values.ravel()[bad[0]]:.17g} is not a usable whole number; mend it")
    return values.astype(np.int64)


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
        width = int(flat[0]) + 1 + extra if 0 <= flat[0] < len(flat) else 0
        if width > 0 and n * width <= len(flat):
            table = flat[: n * width].reshape(n, width)
            if (table[:, 0] == flat[0]).all():
                size = width - 1 - extra
                return table[:, 1 : 1 + size].ravel(), np.full(n, size, dtype=np.int64), n * width
    starts, sizes, at = [], [], 0
    for number in range(n):
        size = int(flat[at]) if at < len(flat) else -1
        if size < 0 or at + 1 + size + extra > len(flat):
            raise MeshFileError(
                f"the file ends inside {what} {number} of {n}, or its count is wrong; it is cut or damaged"
            )
        starts.append(at + 1)
        sizes.append(size)
        at += 1 + size + extra
    size_array = np.array(sizes, dtype=np.int64)
    local = np.arange(size_array.sum()) - np.repeat(np.cumsum(size_array) - size_array, size_array)
    return flat[np.repeat(np.array(starts), size_array) + local], size_array, at
