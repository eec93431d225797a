"""Compare two meshes and their arrays, element by element."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.inspection.compare_summaries import Tolerances
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.vectors import row_matrix

ELEMENTS = ("vertex", "face", "edge")


@dataclass(frozen=True, eq=False)
class ArrayComparison:
    """Differences of two meshes.

    Parameters
    ----------
    moved : list of dict
        `key` (`points`, `cells`, `arrays.NAME`), and for numbers `elements` beyond the tolerance, the
        `first` of them, the `largest` difference, the element `at` which it is, and what is `allowed` there.
    compared : int
        Number of arrays that both have, with `points` and `cells`.
    difference : dict of str to dict of str to ndarray
        For each place the arrays `NAME_difference` (length of the difference) and `NAME_moved` (1 beyond the
        tolerance), on the elements of the expected mesh.
    """

    moved: list[dict[str, Any]]
    compared: int
    difference: dict[str, dict[str, NDArray]] = field(default_factory=dict)


def compare_arrays(expected: AnnotatedMesh, actual: AnnotatedMesh, tolerances: Tolerances) -> ArrayComparison:
    """Compare points, cells and all arrays of two meshes with the same order of their elements.

    A number may differ by `atol + rtol s`, where s is the larger of the size of the expected element and the
    root mean square of the array, so that an element near zero of a large field may have its rounding.
    Elements are not matched by position: a permuted field is a difference.

    Parameters
    ----------
    expected, actual : AnnotatedMesh
    tolerances : Tolerances

    Returns
    -------
    ArrayComparison
    """
    own_cells, other_cells = _cells(expected.mesh), _cells(actual.mesh)
    if not np.array_equal(own_cells, other_cells):
        count = {"expected": list(own_cells.shape), "found": list(other_cells.shape)}
        return ArrayComparison([{"key": "cells", **count}], 1)
    moved: list[dict[str, Any]] = []
    difference: dict[str, dict[str, NDArray]] = {place: {} for place in ELEMENTS}
    compared = 1
    pairs = [("vertex", "points", expected.mesh.points, actual.mesh.points), *_pairs(expected, actual)]
    for place, name, before, after in pairs:
        key = name if name == "points" else f"arrays.{name}"
        if tolerances.leaves_out(key):
            continue
        compared += 1
        if before is None or after is None or np.shape(before) != np.shape(after):
            moved.append({"key": key, "expected": _shape(before), "found": _shape(after)})
            continue
        size, allowed = _difference(np.asarray(before), np.asarray(after), tolerances.of(key))
        beyond = size > allowed
        if place in difference:
            difference[place] |= {f"{name}_difference": size, f"{name}_moved": beyond.astype(np.int8)}
        if beyond.any():
            moved.append({"key": key, **_place_of(size, allowed, beyond)})
    return ArrayComparison(moved, compared, difference)


def _pairs(expected: AnnotatedMesh, actual: AnnotatedMesh) -> Iterator[tuple[str, str, Any, Any]]:
    """Place, name and both arrays of each name; None where a mesh has none.

    An array of the whole mesh in one file has elements in the other where its length is that of a place.
    """
    names: set[str] = set()
    for place in ELEMENTS:
        own, other = getattr(expected, place), getattr(actual, place)
        for name in dict.fromkeys([*own, *other]):
            names.add(name)
            yield (
                place, name, own.get(name, expected.whole.get(name)), other.get(name, actual.whole.get(name))
            )  # fmt: skip
    for name in dict.fromkeys([*expected.whole, *actual.whole]):
        if name not in names:
            yield "whole", name, expected.whole.get(name), actual.whole.get(name)


def _cells(mesh: Any) -> NDArray:
    for name in ("tetrahedra", "lines", "faces"):
        if getattr(mesh, name, None) is not None:
            return np.asarray(getattr(mesh, name))
    return np.zeros((0, 3), dtype=np.int64)


def _shape(values: NDArray | None) -> Any:
    return "missing" if values is None else list(np.shape(values))


def _difference(
    before: NDArray, after: NDArray, tolerance: tuple[float, float]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(k,) length of the difference and what is allowed; infinite where only one is finite or NaN.

    Texts, which have no difference, may not differ: 1 where they do.
    """
    if not {before.dtype.kind, after.dtype.kind} <= set("fiubc"):
        return (row_matrix(before) != row_matrix(after)).any(axis=1).astype(float), np.zeros(len(before))
    rows = [row_matrix(_real(values)) for values in (before, after)]
    same = (rows[0] == rows[1]) | (np.isnan(rows[0]) & np.isnan(rows[1]))
    with np.errstate(invalid="ignore", over="ignore"):
        step = np.where(same, 0.0, rows[1] - rows[0])
        size = np.linalg.norm(np.where(np.isnan(step), np.inf, step), axis=1)
        reach = np.linalg.norm(np.where(np.isfinite(rows[0]), rows[0], 0.0), axis=1)
    mean = float(np.sqrt(np.mean(reach**2))) if len(reach) else 0.0
    rtol, atol = tolerance
    return size, atol + rtol * np.maximum(reach, mean)


def _real(values: NDArray) -> NDArray[np.float64]:
    """Numbers as float64; complex ones as two."""
    if np.iscomplexobj(values):
        values = np.stack([values.real, values.imag], axis=-1)
    return values.astype(np.float64)


def _place_of(size: NDArray, allowed: NDArray, beyond: NDArray) -> Mapping[str, Any]:
    at = int(np.argmax(np.where(beyond, size, -1.0)))
    return {
        "elements": int(beyond.sum()),
        "first": int(np.flatnonzero(beyond)[0]),
        "largest": float(size[at]),
        "at": at,
        "allowed": float(allowed[at]),
    }
