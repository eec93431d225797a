"""HDF5 files that are whole at every moment: the metadata is written once, rows are added by plain writes.

HDF5 changes many places of a file when a dataset grows, and a process killed between two of them leaves a
file that nothing opens. Here every dataset gets its final room at once (contiguous, allocated early: a hole
in the file until it is used), the HDF5 library closes the file, and from then on a new row is

1. bytes are written after the rows that readers can see,
2. one short write that moves the row count (the dataset's extent and storage size, neighbours in its header).

Headers are of format version 1 (`libver="earliest"`), which carries no checksum. No HDF5 handle stays open,
so other processes read the file while it grows.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import OutputError
from ddgcli.io.trajectories.positioned_file import PositionedFile

_HEADER_PREFIX = 16  # bytes of a version 1 object header before its first message
METADATA_BYTES = 1 << 20  # more than groups, headers and attributes take
_DATASPACE, _LAYOUT = 0x0001, 0x0008


@dataclass
class RowLayout:
    """A growing dataset.

    Parameters
    ----------
    dtype : numpy dtype
    shape : tuple of int
        Of one row.
    capacity : int
        Rows that fit.
    offset, header : int
        Places in the file: first row, and the bytes from the extent to the storage size.
    count : int
        Rows that readers see.
    """

    dtype: np.dtype
    shape: tuple[int, ...]
    capacity: int
    offset: int = 0
    header: int = 0
    template: bytes = b""
    count: int = 0

    @property
    def row_bytes(self) -> int:
        return int(self.dtype.itemsize * np.prod(self.shape, dtype=np.int64))


class RowFile:
    """A file with growing datasets, whole at every moment.

    Parameters
    ----------
    path : path of a new file
    rows : dict of str to RowLayout
        Datasets that grow; each must hold a row before readers open the file.
    marks : dict of str to int
        Sentinel values (int64, written as attributes by `fill`) that `set_mark` will overwrite in place.
    fill : callable (h5py.File) -> None
        Writes groups, attributes and static datasets.
    static_bytes : int
        About what `fill` writes; refused beforehand (OSError) where the disk has no room for it.

    Attributes
    ----------
    file : PositionedFile
        For closing, and for opening it again where it was moved to.
    """

    def __init__(
        self,
        path: str | Path,
        rows: dict[str, RowLayout],
        marks: dict[str, bytes],
        fill: Any,
        static_bytes: int = 0,
    ) -> None:
        self.rows = rows
        _need_room(path, static_bytes, sum(row.row_bytes * row.capacity for row in rows.values()))
        with h5py.File(path, "w", libver="earliest") as file:
            fill(file)
            addresses = {name: _allocate(file, name, row) for name, row in rows.items()}
        self.file = PositionedFile(str(path))
        head = self.file.read(1 << 16, 0)
        self._marks = {name: _only(head, sentinel, name) for name, sentinel in marks.items()}
        for name, row in rows.items():
            row.header, row.template = _extent_field(self.file, addresses[name], row)

    def write(self, name: str, start: int, values: NDArray) -> None:
        """Put rows from row `start` on; readers do not see rows beyond the count."""
        row = self.rows[name]
        data = np.ascontiguousarray(values, dtype=row.dtype)
        self.file.write(data.tobytes(), row.offset + start * row.row_bytes)

    def show(self, name: str, count: int) -> None:
        """Let readers see `count` rows."""
        row = self.rows[name]
        if count == row.count:
            return
        field = bytearray(row.template)
        struct.pack_into("<q", field, 0, count)
        struct.pack_into("<q", field, len(field) - 8, count * row.row_bytes)
        self.file.write(bytes(field), row.header)
        row.count = count

    def set_mark(self, name: str, value: bytes) -> None:
        """Overwrite a mark in place, with as many bytes as its sentinel had."""
        self.file.write(value, self._marks[name])

    def copy_rows(self, name: str, other: RowFile, count: int) -> None:
        """Copy the first rows of the same dataset of another file."""
        row, source = self.rows[name], other.rows[name]
        copied_bytes, total = 0, count * row.row_bytes
        while copied_bytes < total:
            piece = other.file.read(min(1 << 24, total - copied_bytes), source.offset + copied_bytes)
            self.file.write(piece, row.offset + copied_bytes)
            copied_bytes += len(piece)


def _need_room(path: str | Path, static_bytes: int, row_bytes: int) -> None:
    """OSError where the disk cannot take the file: HDF5 itself crashes when a write of its own fails."""
    file = PositionedFile(str(path), create=True)
    try:
        block = b"\1" * (1 << 20)
        for at in range(0, static_bytes + METADATA_BYTES, len(block)):
            file.write(block, at)
        file.truncate(static_bytes + METADATA_BYTES + row_bytes)
        file.truncate(0)
    finally:
        file.close()


def _allocate(file: h5py.File, name: str, row: RowLayout) -> int:
    """Create the dataset with its full capacity; the address of its header."""
    creation = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    creation.set_layout(h5py.h5d.CONTIGUOUS)
    creation.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
    creation.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
    folder, leaf = name.rsplit("/", 1)
    kind = h5py.h5t.py_create(row.dtype, logical=True)
    if row.dtype.names:  # a type by reference keeps the header short, in one piece
        kind.commit(file.require_group(f"{folder}/types").id, leaf.encode())
    dataset = h5py.h5d.create(
        file.require_group(folder).id,
        leaf.encode(),
        kind,
        h5py.h5s.create_simple((row.capacity, *row.shape)),
        creation,
    )
    row.offset = dataset.get_offset()
    return int(h5py.h5o.get_info(dataset).addr)


def _extent_field(file: PositionedFile, address: int, row: RowLayout) -> tuple[int, bytes]:
    """Place and bytes of the header from the first extent to the end of the storage size."""
    header = file.read(1 << 14, address)
    if header[0] != 1:
        raise OutputError("the HDF5 library wrote an object header that rows cannot be added to")
    at, first, end = _HEADER_PREFIX, -1, -1
    for _ in range(struct.unpack_from("<H", header, 2)[0]):
        kind, size = struct.unpack_from("<HH", header, at)
        if kind == _DATASPACE:
            first = at + 8 + (8 if header[at + 8] == 1 else 4)
        if kind == _LAYOUT:
            end = at + 8 + 2 + 8 + 8
        at += 8 + size
    ok = (
        0 < first < end
        and struct.unpack_from("<q", header, first)[0] == row.capacity
        and struct.unpack_from("<q", header, end - 8)[0] == row.capacity * row.row_bytes
    )
    if not ok:
        raise OutputError("the HDF5 library wrote an object header that rows cannot be added to")
    return address + first, header[first:end]


def _only(data: bytes, sentinel: bytes, name: str) -> int:
    if data.count(sentinel) != 1:
        raise OutputError(f"the mark {name} was not found once in the file's head")
    return data.index(sentinel)
