"""Compressed content with a bound: a small file must not become more than a machine can hold.

deflate packs zeros 1,000 to 1; meshes pack 2 to 30 to 1. What a file unpacks to is therefore bounded by
`largest_content` of its size, and a file beyond is refused before its content is held.
"""

from __future__ import annotations

import io
import zlib

from ddgcli.errors import MeshFileError

MIN_CONTENT_LIMIT = 1 << 26  # bytes: 64 MiB
MAX_COMPRESSION_RATIO = 200  # of content to file


def largest_content(file_size: int) -> int:
    """Most bytes that a file of this size may unpack to: 64 MiB, or 200 times its size.

    Parameters
    ----------
    file_size : int
        In bytes.

    Returns
    -------
    int
        The larger of both bounds.
    """
    return max(MIN_CONTENT_LIMIT, MAX_COMPRESSION_RATIO * file_size)


class Budget:
    """Bytes that the arrays of one file may still unpack to."""

    def __init__(self, file_size: int) -> None:
        self.remaining = self.whole = largest_content(file_size)

    def take(self, size: int) -> None:
        """Count bytes of content; MeshFileError beyond the budget."""
        self.remaining -= size
        if self.remaining < 0:
            raise MeshFileError(too_much(self.whole))

    def inflated(self, packed: bytes | memoryview) -> bytes:
        """Content of a zlib stream; MeshFileError beyond the budget or if the stream is damaged."""
        stream = zlib.decompressobj()
        try:
            data = stream.decompress(packed, self.remaining + 1)
        except zlib.error as error:
            raise MeshFileError(f"a compressed array cannot be unpacked ({error}); it is damaged") from None
        self.take(len(data))
        if not stream.eof:
            raise MeshFileError("a compressed array ends early; the file is truncated")
        return data


def too_much(limit: int) -> str:
    """Error for a file that unpacks to more than `limit` bytes."""
    return (
        f"unpacks to more than {limit / 2**20:.0f} MiB, far beyond what meshes are packed by; "
        "if it is sound, store it without compression"
    )


def check_zip(data: bytes) -> None:
    """Refuse a .zip whose members unpack to more than `largest_content`, by their stated sizes.

    zipfile reads no more of a member than its stated size. A damaged archive and data of
    another format pass.

    Parameters
    ----------
    data : bytes

    Raises
    ------
    MeshFileError
        The members unpack to too much.
    """
    if not data.startswith(b"PK"):
        return
    import zipfile

    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            total = sum(member.file_size for member in archive.infolist())
    except Exception:  # damaged: its reader reports how
        return
    limit = largest_content(len(data))
    if total > limit:
        raise MeshFileError(too_much(limit))
