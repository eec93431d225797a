"""STL, binary and ASCII. The format cannot share vertices: equal positions are merged and the map is kept.

Our own reader: trimesh rounds while merging (cracks close or bodies touch), meshio does not check
the header's count.
"""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshFileError
from ddgcli.io.readers.raw_mesh import RawMesh
from ddgcli.io.readers.text import numbers
from ddgcli.mesh.repair import merged_points

FACET = np.dtype([("normal", "<f4", 3), ("corner", "<f4", (3, 3)), ("attribute", "<u2")])
NAME_LINE = re.compile(rb"^[ \t]*((?:end)?solid)[^\r\n]*", re.IGNORECASE | re.MULTILINE)
VERTEX = re.compile(rb"vertex\s+(\S+\s+\S+\s+\S+)", re.IGNORECASE)


def read_stl(data: bytes) -> RawMesh:
    """Read an STL file; `input_vertex` maps corner 3f+k of the file to its vertex."""
    notes: list[str] = []
    soup = _ascii(data) if _is_ascii(data) else _binary(data, notes)
    points, index = merged_points(soup.reshape(-1, 3))
    notes.append(
        f"STL cannot share vertices: {len(index)} corners merged to {len(points)} vertices where equal "
        "(map: input_vertex)"
    )
    raw = RawMesh(points, input_vertex=index, notes=notes)
    raw.add_faces(index.reshape(-1, 3))
    return raw


def _is_ascii(data: bytes) -> bool:
    """Prefer binary if its count fits, for binary files may begin with "solid" too."""
    if len(data) >= 84 and len(data) == 84 + 50 * int.from_bytes(data[80:84], "little"):
        return False
    return data.lstrip()[:5].lower() == b"solid" and (b"facet" in data.lower() or len(data) < 84)


def _binary(data: bytes, notes: list[str]) -> NDArray:
    if len(data) < 84:
        raise MeshFileError("not an STL file: shorter than a header; it is truncated or of another format")
    count, capacity = int.from_bytes(data[80:84], "little"), (len(data) - 84) // 50
    if count > capacity:
        raise MeshFileError(
            f"the header counts {count} facets, the file has room for {capacity}; it is truncated or damaged"
        )
    if 84 + 50 * count != len(data):
        notes.append(f"{len(data) - 84 - 50 * count} bytes after the last of {count} facets ignored")
    return np.frombuffer(data, FACET, count, 84)["corner"]


def _ascii(data: bytes) -> NDArray:
    without_names = NAME_LINE.sub(rb"\1", data)
    data = without_names if b"facet" in without_names.lower() else data  # all on one line
    vertices = VERTEX.findall(data)
    lower = data.lower()
    facets, ends = lower.count(b"facet") - lower.count(b"endfacet"), lower.count(b"endfacet")
    if b"endsolid" not in lower or facets != ends or len(vertices) != 3 * ends:
        raise MeshFileError(
            f"ASCII STL with {facets} facets, {ends} ends of facets and {len(vertices)} vertices; "
            "it is truncated or damaged"
        )
    try:
        values = numbers(b" ".join(vertices))
    except ValueError:
        raise MeshFileError("a vertex of the ASCII STL is not three numbers; correct the file") from None
    if len(values) != 3 * len(vertices):
        raise MeshFileError("a vertex of the ASCII STL is not three numbers; correct the file")
    return values
