"""Queue of windows and list of their origins, in growing arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

POPPED_KEY = np.inf


class WindowPool:
    """Queue of windows: columns (b0, b1, sx, sy, ...), (side, origin), and a key that is inf once popped."""

    def __init__(self, columns: int = 4, capacity: int = 4096, ints: int = 2) -> None:
        self.lines = np.empty((columns, capacity))
        self.where = np.empty((ints, capacity), dtype=np.int64)
        self.key = np.empty(capacity)
        self.top = 0
        self._popped = 0

    def __len__(self) -> int:
        return self.top - self._popped

    def least(self) -> float:
        return float(self.key[: self.top].min(initial=POPPED_KEY))

    def push(self, lines: NDArray, where: NDArray, key: NDArray) -> None:
        end = self.top + len(key)
        if end > len(self.key):
            self._reserve(len(key))
            end = self.top + len(key)
        self.lines[:, self.top : end] = lines
        self.where[:, self.top : end] = where
        self.key[self.top : end] = key
        self.top = end

    def pop_below(self, bound: float) -> tuple[NDArray, NDArray]:
        slot = (self.key[: self.top] < bound).nonzero()[0]
        lines, where = self.lines.take(slot, axis=1), self.where.take(slot, axis=1)
        self.key[slot] = POPPED_KEY
        self._popped += len(slot)
        if self._popped > 2 * (self.top - self._popped) + 1024:
            self._compact()
        return lines, where

    def _compact(self) -> None:
        queued = (self.key[: self.top] < POPPED_KEY).nonzero()[0]
        k = len(queued)
        self.lines[:, :k], self.where[:, :k] = (
            self.lines.take(queued, axis=1),
            self.where.take(queued, axis=1),
        )
        self.key[:k] = self.key.take(queued)
        self.top, self._popped = k, 0

    def _reserve(self, more: int) -> None:
        self._compact()
        capacity = len(self.key)
        if self.top + more > capacity // 2:
            extra = self.top + more
            self.lines = np.concatenate([self.lines, np.empty((len(self.lines), extra))], axis=1)
            self.where = np.concatenate(
                [self.where, np.empty((len(self.where), extra), dtype=np.int64)], axis=1
            )
            self.key = np.concatenate([self.key, np.empty(extra)])


class WindowOrigins:
    """Points from which windows unfold: the sources, and vertices around which shortest paths bend."""

    def __init__(self) -> None:
        self.count = 0
        self._vertex = np.empty(64, dtype=np.int64)
        self._source = np.empty(64, dtype=np.int64)
        self._distance = np.empty(64)

    def add(self, vertex: NDArray, source: NDArray, distance: NDArray) -> NDArray[np.int64]:
        first, self.count = self.count, self.count + len(vertex)
        if self.count > len(self._vertex):
            for name in ("_vertex", "_source", "_distance"):
                old = getattr(self, name)
                grown = np.empty(2 * self.count, dtype=old.dtype)
                grown[:first] = old[:first]
                setattr(self, name, grown)
        self._vertex[first : self.count] = vertex
        self._source[first : self.count] = source
        self._distance[first : self.count] = distance
        return np.arange(first, self.count)

    @property
    def vertex(self) -> NDArray[np.int64]:
        return self._vertex[: self.count]

    @property
    def source(self) -> NDArray[np.int64]:
        return self._source[: self.count]

    @property
    def distance(self) -> NDArray[np.float64]:
        return self._distance[: self.count]
