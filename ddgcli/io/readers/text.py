"""Fast reading of numbers from text, with the line of the first error."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshFileError, excerpt
from ddgcli.mesh.ragged import ranges


def numbers(text: bytes) -> NDArray[np.float64]:
    """All numbers of whitespace-separated text.

    Parameters
    ----------
    text : bytes

    Returns
    -------
    (k,) ndarray of float64

    Raises
    ------
    ValueError
        Something in the text is not a number.
    """
    if not text.strip():
        return np.zeros(0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # numpy reports unmatched text by a DeprecationWarning
        try:
            return np.fromstring(text, dtype=np.float64, sep=" ")
        except (DeprecationWarning, ValueError) as error:
            raise ValueError("not a number") from error


@dataclass(frozen=True, eq=False)
class TextLines:
    """Lines of a text, each with one newline at its end.

    Parameters
    ----------
    text : bytes
    begin : (k + 1,) ndarray of int64
        Place of each line in the text, and the length of the text.
    number : (k,) ndarray of int64
        Index of each line in the file, from 0.
    """

    text: bytes
    begin: NDArray[np.int64]
    number: NDArray[np.int64]

    @classmethod
    def of(cls, data: bytes) -> TextLines:
        """All lines of a file; they end with a line feed, a carriage return, or both."""
        if b"\r" in data:
            data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
        if not data.endswith(b"\n"):
            data += b"\n"
        begin = _line_starts(np.frombuffer(data, dtype=np.uint8))
        return cls(data, begin, np.arange(len(begin) - 1))

    @property
    def characters(self) -> NDArray[np.uint8]:
        """The text as an array of its bytes."""
        return np.frombuffer(self.text, dtype=np.uint8)

    @property
    def n_words(self) -> NDArray[np.int64]:
        """(k,) number of words in each line."""
        ends = np.searchsorted(word_starts(self.characters > 32), self.begin[1:])
        return np.diff(ends, prepend=0)

    def select(self, lines: NDArray) -> TextLines:
        """Some lines, in ascending order."""
        if len(lines) == 0:
            return TextLines(b"", np.zeros(1, dtype=np.int64), self.number[lines])
        gap = np.flatnonzero(np.diff(lines) != 1)
        first, last = lines[np.append(0, gap + 1)], lines[np.append(gap, -1)]
        pieces = zip(self.begin[first].tolist(), self.begin[last + 1].tolist())
        text = b"".join([self.text[start:end] for start, end in pieces])
        begin = np.append(0, np.cumsum(self.begin[lines + 1] - self.begin[lines]))
        return TextLines(text, begin, self.number[lines])

    def without(self, pattern: bytes) -> TextLines:
        """The lines without what matches a pattern, which matches no newline."""
        text = re.sub(pattern, b"", self.text)
        return TextLines(text, _line_starts(np.frombuffer(text, dtype=np.uint8)), self.number)


def _line_starts(characters: NDArray[np.uint8]) -> NDArray[np.int64]:
    return np.append(0, np.flatnonzero(characters == ord("\n")) + 1)


def word_starts(is_word: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Places where a run of True begins.

    Parameters
    ----------
    is_word : (k,) ndarray of bool

    Returns
    -------
    (w,) ndarray of int64
        Ascending.
    """
    starts = is_word.copy()
    starts[1:] &= ~is_word[:-1]
    return np.flatnonzero(starts)


def rows(lines: Sequence[bytes], line_number: Sequence[int], what: str) -> tuple[NDArray, NDArray]:
    """Numbers of lines, and how many each holds.

    Parameters
    ----------
    lines : sequence of bytes
    line_number : sequence of int
        Index of each line in the file, from 0, for the error.
    what : str
        Name of a line in the error, such as `row`.

    Returns
    -------
    values : (k,) ndarray of float64
        Of all lines, one after the other.
    count : (n,) ndarray of int64
        How many of them each line holds.

    Raises
    ------
    MeshFileError
        Names the first line with something else.
    """
    count = np.fromiter((len(line.split()) for line in lines), dtype=np.int64, count=len(lines))
    return _counted_numbers(b"\n".join(lines), count, zip(lines, line_number), what), count


def rows_of(lines: TextLines, what: str) -> tuple[NDArray, NDArray]:
    """Numbers of the lines of a text, and how many each holds: `rows` without a list of lines.

    Parameters
    ----------
    lines : TextLines
    what : str
        Name of a line in the error, such as `vertex`.

    Returns
    -------
    values : (k,) ndarray of float64
        Of all lines, one after the other.
    count : (n,) ndarray of int64
        How many of them each line holds.

    Raises
    ------
    MeshFileError
        Names the first line with something else.
    """
    count = lines.n_words
    by_line = zip(lines.text.split(b"\n"), lines.number)
    return _counted_numbers(lines.text, count, by_line, what), count


def _counted_numbers(
    text: bytes, count: NDArray, lines: Iterable[tuple[bytes, int]], what: str
) -> NDArray[np.float64]:
    try:
        values = numbers(text)
        if len(values) == count.sum():
            return values
    except ValueError:
        pass
    for line, number in lines:
        for word in line.split():
            try:
                float(word)
            except ValueError:
                bad_word = excerpt(word, 20)
                raise MeshFileError(f"line {number + 1}: {bad_word!r} in a {what} is not a number") from None
    raise MeshFileError(f"the numbers of the {what} lines cannot be read; check the file")


def leading(values: NDArray, count: NDArray, width: int) -> NDArray[np.float64]:
    """First numbers of each of n lines.

    Parameters
    ----------
    values : (k,) ndarray of float64
        Of all lines, one after the other.
    count : (n,) ndarray of int64
        How many of them each line holds, `width` at least.
    width : int

    Returns
    -------
    (n, width) ndarray of float64
    """
    if len(count) == 0:
        return np.zeros((0, width))
    if (count == count[0]).all():
        return np.ascontiguousarray(values.reshape(len(count), -1)[:, :width])
    first = np.cumsum(count) - count
    return values[first[:, None] + np.arange(width)]


def integers(text: bytes) -> NDArray[np.int64] | None:
    """All whole numbers of a text, four times as fast as `numbers`.

    Parameters
    ----------
    text : bytes

    Returns
    -------
    (k,) ndarray of int64, or None
        None if the text holds anything else.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return np.fromstring(text, dtype=np.int64, sep=" ") if text.strip() else np.zeros(0, np.int64)
        except (DeprecationWarning, ValueError):
            return None


def whole_numbers(values: NDArray, what: str) -> NDArray[np.int64]:
    """Numbers as int64.

    Parameters
    ----------
    values : ndarray of int or float
    what : str
        Name of a number in the error, such as `vertex index`.

    Returns
    -------
    ndarray of int64
        Of the same shape.

    Raises
    ------
    MeshFileError
        A fraction, a number that is not finite, or one of 2^53 or more in size.
    """
    if values.dtype.kind in "iu" and values.dtype.itemsize < 8:
        return values.astype(np.int64)
    with np.errstate(invalid="ignore"):
        bad = np.flatnonzero(~((values == np.rint(values)) & (np.abs(values) < 2**53)))
    if len(bad):
        raise MeshFileError(
            f"{what} {values.ravel()[bad[0]].item()} is not a usable whole number; correct it"
        )
    return values.astype(np.int64)


def typed(values: NDArray, dtype: Any, what: str) -> NDArray:
    """Floats of a text in the type that the file declares.

    Parameters
    ----------
    values : ndarray of float64
    dtype : numpy dtype, or what becomes one
        Of floats or integers.
    what : str
        Name of a number in the error.

    Returns
    -------
    ndarray of `dtype`
        Of the same shape; floats that are too large for a shorter type become infinite.

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
    """Split a flat array in `n` lists: each has its length first, then its members, then `extra` more values.

    Parameters
    ----------
    flat : (k,) ndarray of int or float
    n : int
        Number of lists.
    what : str
        Name of a list in the error, such as `face`.
    extra : int
        Number of values after the members of each list, which are skipped.

    Returns
    -------
    members : (c,) ndarray
    sizes : (n,) ndarray of int64
    used : int
        Values of `flat` that were consumed.

    Raises
    ------
    MeshFileError
        A length that is not an integer, or that leads beyond the end.
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
