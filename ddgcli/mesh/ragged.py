"""Ragged lists in flat arrays: list k is `member[start[k]:start[k + 1]]`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

MAX_UNORDERED_SHARE = 0.1  # of values in runs that are sorted again, above which `argsort` is faster


def list_starts(count: NDArray | list[int]) -> NDArray[np.int64]:
    """(k + 1,) first position of each of k lists with `count` members, and the end of the last."""
    return np.concatenate([[0], np.cumsum(count)]).astype(np.int64, copy=False)


def ranges(first: NDArray, count: NDArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Numbers of the ranges [first, first + count) in sequence, and the position where each range begins."""
    end = count.cumsum()
    begin = end - count
    return np.arange(end[-1] if len(end) else 0) + (first - begin).repeat(count), begin


def repeat_with_place(item: NDArray, count: NDArray) -> tuple[NDArray, NDArray[np.int64]]:
    """Repeat each item `count` times, and number its repetitions from 0."""
    return np.repeat(item, count), ranges(np.zeros(len(count), dtype=np.int64), count)[0]


def group_by_key(key: NDArray, item: NDArray, n_keys: int) -> tuple[NDArray[np.int64], NDArray]:
    """Lists of the items with key 0 .. n_keys - 1, as (start, member); items keep their order."""
    return list_starts(np.bincount(key, minlength=n_keys)), item[sorted_keys(key, n_keys)[1]]


def sorted_keys(key: NDArray, n_keys: int, *, overwrite: bool = False) -> tuple[NDArray, NDArray[np.int64]]:
    """Keys 0 .. n_keys - 1 in ascending order, and the stable order that sorts them.

    Key and place are packed into one integer where 63 bits hold them: sorting values is several times faster
    than sorting their places. `overwrite`: a key of int64 may lose its values, which saves a copy.
    """
    bits = len(key).bit_length()
    if int(n_keys).bit_length() + bits > 63:
        order = np.argsort(key, kind="stable")
        return key[order], order
    packed = key.astype(np.int64, copy=not overwrite)
    packed <<= bits
    packed |= np.arange(len(key))
    packed.sort()
    order = packed & ((1 << bits) - 1)
    packed >>= bits
    return packed, order


def ascending_order(values: NDArray) -> NDArray[np.int64]:
    """Stable order that sorts float64 values, none negative: that of `argsort`, in a quarter of its time.

    Places are packed below the leading bits of the values; runs of equal leading bits are sorted again.
    """
    bits = len(values).bit_length()
    order = np.ascontiguousarray(values + 0.0).view(np.int64)  # no -0.0: the order of the bits is theirs
    order >>= bits
    order <<= bits
    order |= np.arange(len(order))
    order.sort()
    is_new = np.diff(order >> bits, prepend=-1) != 0
    order &= (1 << bits) - 1
    ordered = values.take(order)
    descents = np.flatnonzero(ordered[1:] < ordered[:-1])
    if len(descents):
        run = np.cumsum(is_new)
        has_descent = np.zeros(run[-1] + 1, dtype=bool)
        has_descent[run[descents]] = True
        rows = np.flatnonzero(has_descent[run])
        if len(rows) > MAX_UNORDERED_SHARE * len(values):
            return np.argsort(values, kind="stable")
        some = order[rows]
        order[rows] = some[np.lexsort((some, values[some], run[rows]))]
    return order


def expand_lists(
    owner: NDArray, number: NDArray, lists: tuple[NDArray, NDArray]
) -> tuple[NDArray, NDArray[np.int64]]:
    """Pair each owner with every member of the list of its number; `lists` is (start, member)."""
    start, member = lists
    count = start[number + 1] - start[number]
    return np.repeat(owner, count), member[ranges(start[number], count)[0]]
