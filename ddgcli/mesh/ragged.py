"""Ragged lists in flat arrays: list k is `member[start[k]:start[k + 1]]`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def list_starts(count: NDArray | list[int]) -> NDArray[np.int64]:
    """First position of each of k ragged lists, and the end of the last.

    Parameters
    ----------
    count : (k,) ndarray of int64 or list of int
        Members of each list.

    Returns
    -------
    (k + 1,) ndarray of int64
    """
    return np.concatenate([[0], np.cumsum(count)]).astype(np.int64, copy=False)


def ranges(first: NDArray, count: NDArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Integers of the ranges [first, first + count), one range after the other.

    Parameters
    ----------
    first, count : (k,) ndarray of int64

    Returns
    -------
    integer : (sum(count),) ndarray of int64
    begin : (k,) ndarray of int64
        Position in `integer` where each range begins.

    Examples
    --------
    >>> ranges(np.array([5, 0]), np.array([2, 3]))[0].tolist()
    [5, 6, 0, 1, 2]
    """
    end = count.cumsum()
    begin = end - count
    return np.arange(end[-1] if len(end) else 0) + (first - begin).repeat(count), begin


def repeat_with_place(item: NDArray, count: NDArray) -> tuple[NDArray, NDArray[np.int64]]:
    """Repeat each item `count` times, and number its repetitions from 0.

    Parameters
    ----------
    item : (k,) ndarray
    count : (k,) ndarray of int64

    Returns
    -------
    item : (sum(count),) ndarray
    place : (sum(count),) ndarray of int64
    """
    return np.repeat(item, count), ranges(np.zeros(len(count), dtype=np.int64), count)[0]


def group_by_key(key: NDArray, item: NDArray, n_keys: int) -> tuple[NDArray[np.int64], NDArray]:
    """Ragged lists of the items that have the same key.

    Parameters
    ----------
    key : (k,) ndarray of int64
        In 0 .. n_keys - 1.
    item : (k,) ndarray
    n_keys : int

    Returns
    -------
    start : (n_keys + 1,) ndarray of int64
    member : (k,) ndarray
        The items of key i are `member[start[i]:start[i + 1]]`, in their input order.
    """
    return list_starts(np.bincount(key, minlength=n_keys)), item[sorted_keys(key, n_keys)[1]]


def sorted_keys(key: NDArray, n_keys: int, *, overwrite: bool = False) -> tuple[NDArray, NDArray[np.int64]]:
    """Keys in ascending order, and the stable order that sorts them.

    Parameters
    ----------
    key : (k,) ndarray of int64
        In 0 .. n_keys - 1.
    n_keys : int
    overwrite : bool
        A key of int64 may lose its values, which saves a copy.

    Returns
    -------
    key : (k,) ndarray
    order : (k,) ndarray of int64

    Notes
    -----
    Key and place are packed into one integer where 63 bits hold them: sorting values is several times faster
    than sorting their places.
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


def unique_keys(key: NDArray) -> NDArray:
    """Distinct integers in ascending order.

    `np.unique` collects integers in a hash table since numpy 2.3, and takes 30 times as long for 300,000.

    Parameters
    ----------
    key : (...) ndarray of int
        Any shape.

    Returns
    -------
    (k,) ndarray of the same type
    """
    key = np.sort(key, axis=None)
    is_first = np.ones(len(key), dtype=bool)
    np.not_equal(key[1:], key[:-1], out=is_first[1:])
    return key.compress(is_first)


def contains(ascending: NDArray, value: NDArray) -> NDArray[np.bool_]:
    """Which values an ascending list of integers holds.

    Parameters
    ----------
    ascending : (n,) ndarray of int
    value : (...) ndarray of int

    Returns
    -------
    (...) ndarray of bool
    """
    if not len(ascending):
        return np.zeros(np.shape(value), dtype=bool)
    place = np.searchsorted(ascending, value).clip(max=len(ascending) - 1)
    return ascending[place] == value


def expand_lists(
    owner: NDArray, index: NDArray, lists: tuple[NDArray, NDArray]
) -> tuple[NDArray, NDArray[np.int64]]:
    """Pair each owner with every member of its list.

    Parameters
    ----------
    owner : (k,) ndarray
    index : (k,) ndarray of int64
        The list of each owner.
    lists : (start, member)
        Ragged lists.

    Returns
    -------
    owner, member : (p,) ndarray
    """
    start, member = lists
    count = start[index + 1] - start[index]
    return np.repeat(owner, count), member[ranges(start[index], count)[0]]


def repeated_rows(rows: NDArray) -> NDArray[np.int64]:
    """Indices of the rows that an earlier row equals.

    Parameters
    ----------
    rows : (k, c) ndarray of int

    Returns
    -------
    (j,) ndarray of int64
        Ascending.

    Examples
    --------
    >>> repeated_rows(np.array([[0, 1], [2, 3], [0, 1]])).tolist()
    [2]
    """
    if len(rows) == 0:
        return np.zeros(0, dtype=np.int64)
    order = np.lexsort(rows.T)
    same = (rows[order][1:] == rows[order][:-1]).all(axis=1)
    return np.sort(order[1:][same]).astype(np.int64)
