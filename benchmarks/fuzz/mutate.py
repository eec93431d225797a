"""Mutations of valid inputs: of bytes, of lines and numbers, of the arrays inside `.npz` and HDF5."""

from __future__ import annotations

import contextlib
import io
import random
import re
import struct
import zipfile
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

WORDS = (
    b"nan", b"inf", b"-1", b"1e400", b"0", b"4294967297", b"99999999999999999999", b"1.5", b"", b"\0", b" ",
    b"\n", b"[", b"]", b'"', b"UInt8", b"Float64", b"vertex", b"#", b"<", b">", b"-", b"1e-320", b"true",
)  # fmt: skip
NUMBERS = (
    b"nan", b"-inf", b"1e308", b"-1e308", b"1e-308", b"5e-324", b"-0.0", b"2147483648", b"-2147483649",
    b"9223372036854775807", b"9223372036854775808", b"18446744073709551616", b"0x10", b"1_000",
    b"1e999999999", b"7" * 400, b"0." + b"3" * 400, b"+1", b"1.", b".5", b"1d3", b"1,5", "\u0664".encode(),
)  # fmt: skip
BINARY_NUMBERS = tuple(
    struct.pack(order + kind, value)
    for order in "<>"
    for kind, values in (
        ("d", (np.nan, np.inf, 1e308, 5e-324, -0.0)),
        ("f", (np.nan, -np.inf, 3e38, 1e-45)),
        ("q", (-1, 2**31, 2**32, 2**62, -(2**63))),
        ("i", (-1, 2**31 - 1, -(2**31), 65536)),
    )
    for value in values
)
LENGTHS = (1, 1, 2, 4, 8, 40, 400)
SEARCHED_BYTES = 20_000  # of the beginning, for numbers and lines
NUMBER = re.compile(rb"[-+]?[0-9][0-9.eE+-]*")
WORD = re.compile(rb"[A-Za-z_][A-Za-z_0-9]*")
ELEMENT = re.compile(rb"<[^<>]*>|\[[^\[\]]*\]|\{[^{}]*\}|\([^()]*\)")
DTYPES = (
    "f8", "f4", "i8", "u1", "i1", "u8", "c16", "S3", "U2", "?", "f2", ">i4", ">f8", ">u2", "g",
    "M8[s]", "m8[D]", "V4",
)  # fmt: skip
LINE_END = 10
SHARE_OF_STRUCTURE = 0.5  # of the changes of texts and bytes
SHARE_OF_ARRAYS = 0.5  # of the mutations of `.npz` and HDF5: the others change bytes


def mutated(
    data: bytes, rng: random.Random, others: Sequence[bytes], tokens: Sequence[bytes] = WORDS
) -> bytes:
    """Random changes: arrays of a container, else bytes, numbers, words, lines, pieces of another file.

    Parameters
    ----------
    data : bytes
        A valid file, or one that reached a new line.
    rng : random.Random
    others : sequence of bytes
        Files to take pieces of.
    tokens : sequence of bytes
        Words of the format.
    """
    if rng.random() < SHARE_OF_ARRAYS:
        container = {b"PK\3\4": mutated_npz, b"\x89HDF": mutated_hdf5}.get(data[:4])
        if container is not None:
            with contextlib.suppress(Exception):  # damaged by an earlier mutation
                return container(data, rng)
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 3, 8))):
        if rng.random() < SHARE_OF_STRUCTURE:
            changed = _changed_structure(changed, rng, others, tokens)
        else:
            changed = _changed_bytes(changed, rng, others)
    return bytes(changed)


def _changed_structure(
    changed: bytearray, rng: random.Random, others: Sequence[bytes], tokens: Sequence[bytes]
) -> bytearray:
    """A word, number, element or section of the format changed, repeated or taken from another file."""
    kind = rng.randrange(7)
    patterns = {0: WORD, 1: NUMBER, 2: ELEMENT}
    if kind in patterns:
        match = patterns[kind].search(changed, rng.randrange(min(len(changed), SEARCHED_BYTES) + 1))
        if match:
            first, last = match.span()
            token = rng.choice(tokens)
            words = (token, token, match[0] + b" " + token, token + b" " + match[0])
            other = {0: rng.choice(words), 1: rng.choice(NUMBERS), 2: rng.choice((b"", 2 * match[0]))}
            changed[first:last] = other[kind]
    elif kind == 3:
        return bytearray(_spliced(changed, rng.choice(others), rng))
    elif kind == 4:
        _repeat_section(changed, rng)
    elif kind == 5:
        number = rng.choice(BINARY_NUMBERS)
        at = rng.randrange(len(changed) + 1)
        changed[at : at + len(number)] = number
    else:  # the other byte order
        width, at = rng.choice((2, 4, 8)), rng.randrange(len(changed) + 1)
        changed[at : at + width] = changed[at : at + width][::-1]
    return changed


def _spliced(data: bytes | bytearray, other: bytes, rng: random.Random) -> bytes | bytearray:
    """The beginning of one file and the end of another, cut at lines where both have some."""
    cuts = [[k for k, byte in enumerate(text[:SEARCHED_BYTES]) if byte == LINE_END] for text in (data, other)]
    first, second = (
        rng.choice(places) if places else rng.randrange(len(text) + 1)
        for places, text in zip(cuts, (data, other), strict=True)
    )
    return data[:first] + other[second:]


def _repeat_section(changed: bytearray, rng: random.Random) -> None:
    """Some lines once more, here or further on; or without them."""
    lines = bytes(changed[:SEARCHED_BYTES]).split(b"\n")
    first = rng.randrange(len(lines))
    section = lines[first : first + rng.choice((1, 2, 4, 12))]
    if rng.random() < 0.3:
        del lines[first : first + len(section)]
    else:
        at = rng.choice((first, rng.randrange(len(lines) + 1)))
        lines[at:at] = section
    changed[:SEARCHED_BYTES] = b"\n".join(lines)


def _changed_bytes(changed: bytearray, rng: random.Random, others: Sequence[bytes]) -> bytearray:
    at = rng.randrange(len(changed) + 1)
    end = min(len(changed), at + rng.choice(LENGTHS))
    kind = rng.randrange(10)
    if kind == 0 and changed:
        changed[min(at, len(changed) - 1)] = rng.choice((0, 1, 127, 128, 255, rng.randrange(256)))
    elif kind == 1:
        changed[at:end] = rng.choice(WORDS)
    elif kind == 2:
        del changed[at:end]
    elif kind == 3:
        changed[at:at] = changed[at:end]
    elif kind == 4:
        other = rng.choice(others)
        start = rng.randrange(len(other) + 1)
        changed[at:end] = other[start : start + rng.choice((1, 8, 100))]
    elif kind == 5 and end - at >= 4:
        value = rng.choice((0, 1, -1, 2**31 - 1, -(2**31), rng.randrange(2**31)))
        changed[at : at + 4] = value.to_bytes(4, rng.choice(("little", "big")), signed=True)
    elif kind in (6, 7):
        number = NUMBER.search(changed, rng.randrange(min(len(changed), SEARCHED_BYTES) + 1))
        if number:
            first, last = number.span()
            last = last if kind == 7 else first + 1  # a digit, or the whole number
            changed[first:last] = rng.choice(WORDS)
    elif kind == 8:
        lines = bytes(changed[:SEARCHED_BYTES]).split(b"\n")
        first, second = (rng.randrange(len(lines)) for _ in range(2))
        lines[first], lines[second] = lines[second], rng.choice((lines[first], lines[second], b""))
        changed[:SEARCHED_BYTES] = b"\n".join(lines)
    elif kind == 9 and rng.random() < 0.3:
        del changed[at:]
    return changed


def mutated_array(array: NDArray, rng: random.Random) -> NDArray:
    """Another shape, type or value."""
    kind = rng.randrange(6)
    changed = np.array(array)
    if kind == 0:
        with np.errstate(all="ignore"):
            try:
                return changed.astype(rng.choice(DTYPES))
            except (TypeError, ValueError):
                return changed
    if kind == 1:
        shapes = (
            (), (0,), (0, 3), (3, 0), (1,), (changed.size,), (1, changed.size), (*changed.shape, 1),
            changed.shape[::-1],
        )  # fmt: skip
        return np.resize(changed, rng.choice(shapes))
    if kind == 2 and changed.ndim:
        return changed[: rng.randrange(len(changed) + 1)]
    if kind == 3 and changed.ndim:
        return np.concatenate([changed, changed])
    if changed.size and changed.dtype.kind in "fiu":
        numbers: tuple[Any, ...] = (0, 1, np.iinfo(np.int8).max)
        if changed.dtype.kind == "f":
            limits = np.finfo(changed.dtype)
            numbers = (
                *numbers,
                np.nan,
                np.inf,
                -np.inf,
                -1.0,
                -0.0,
                1.5,
                limits.max,
                limits.smallest_subnormal,
            )
        elif changed.dtype.kind == "i":
            numbers = (*numbers, -1, np.iinfo(changed.dtype).max, np.iinfo(changed.dtype).min)
        changed.reshape(-1)[rng.randrange(changed.size)] = rng.choice(numbers)
    return changed


def mutated_npz(data: bytes, rng: random.Random) -> bytes:
    """One array of an archive changed, dropped or renamed; the sums of the archive stay right."""
    with np.load(io.BytesIO(data), allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files}
    name = rng.choice(list(arrays))
    if rng.random() < 0.2:
        array = arrays.pop(name)
        if rng.random() < 0.5:
            arrays[rng.choice(("", "a/b", "points", "faces", "file", "x" * 300))] = array
    else:
        arrays[name] = mutated_array(arrays[name], rng)
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as changed:
        for name, array in arrays.items():
            with changed.open(f"{name}.npy", "w") as member:
                np.lib.format.write_array(member, np.asarray(array), allow_pickle=False)
    return stream.getvalue()


def mutated_hdf5(data: bytes, rng: random.Random) -> bytes:
    """One array, group or attribute of an HDF5 file changed, dropped or put elsewhere."""
    import h5py

    stream = io.BytesIO(data)
    with h5py.File(stream, "r+") as file:
        names: list[str] = []
        file.visit(names.append)
        name = rng.choice(names)
        item = file[name]
        kind = rng.randrange(4)
        if kind == 0 and len(item.attrs):
            key = rng.choice(list(item.attrs))
            value = rng.choice((-1, 10**9, 1.5, "text", b"PolyData", [1, 2], None))
            if value is None:
                del item.attrs[key]
            else:
                item.attrs[key] = value
        elif kind == 1:
            del file[name]
            if rng.random() < 0.5:
                file.create_group(name) if rng.random() < 0.5 else file.create_dataset(name, data=[1, 2])
        elif kind == 2:
            other = rng.choice(names)
            if other != name and not other.startswith(name + "/"):
                del file[name]
                file[name] = file[other]
        elif isinstance(item, h5py.Dataset) and item.dtype.kind in "fiu":
            changed = mutated_array(item[()], rng)
            attributes = dict(item.attrs)
            del file[name]
            file.create_dataset(
                name, data=changed if changed.dtype.kind not in "UM" else changed.astype("S40")
            )
            file[name].attrs.update(attributes)
    return stream.getvalue()
