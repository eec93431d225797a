"""Bytes of .glb files: binary glTF 2.0 with texture coordinates and colours."""

from __future__ import annotations

import json
import logging
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import counted
from ddgcli.io.appearance import color, corner_uv, vertex_uv
from ddgcli.io.writers.cell_data import CellData, surface_only, warn_of_lost_arrays

log = logging.getLogger("ddgcli")

FLOAT, UNSIGNED_BYTE, UNSIGNED_INT = 5126, 5121, 5125
KINDS = {np.dtype("<f4"): FLOAT, np.dtype("u1"): UNSIGNED_BYTE, np.dtype("<u4"): UNSIGNED_INT}
WIDTHS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
VERTICES, INDICES = 34962, 34963  # targets of buffer views


def glb_bytes(data: CellData) -> bytes:
    """One mesh with float32 positions; vertices at texture seams are written once per value.

    glTF has one texture coordinate per vertex; the attribute `_INPUT_VERTEX` then holds the mesh vertex.
    """
    data = surface_only(data, ".glb")
    warn_of_lost_arrays(data, ".glb", writable_names=("uv", "corner_uv", "color"))
    faces, uv, colors = data.cells, vertex_uv(data.vertex), color(data.vertex)
    seams = corner_uv(data.cell)
    source = None
    if uv is None and seams is not None:
        faces, source, uv = _split(data, seams)
    rows = np.arange(len(data.points)) if source is None else source
    with np.errstate(over="ignore"):
        attributes = {"POSITION": np.ascontiguousarray(data.points[rows], dtype="<f4")}
        if uv is not None:  # glTF counts from the upper edge of the picture
            attributes["TEXCOORD_0"] = np.nan_to_num(np.column_stack([uv[:, 0], 1.0 - uv[:, 1]])).astype(
                "<f4"
            )
    if colors is not None:
        opaque = np.full((len(colors), 4 - colors.shape[1]), 255, dtype=np.uint8)
        attributes["COLOR_0"] = np.column_stack([colors, opaque])[rows]
    if source is not None:
        attributes["_INPUT_VERTEX"] = source.astype("<f4")
    return _container(data, attributes, faces.astype("<u4").ravel())


def _split(data: CellData, seams: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """(faces, vertex of the mesh, uv) with one vertex for every pair of vertex and texture coordinate.

    The vertices of the mesh keep their indices; the further ones follow.
    """
    n = len(data.points)
    corner = np.nan_to_num(seams.reshape(-1, 2))
    table = np.column_stack([data.cells.ravel().astype(np.float64), corner])
    rows, first, number = np.unique(table, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first, kind="stable")
    vertex = rows[order, 0].astype(np.int64)
    is_first = np.zeros(len(vertex), dtype=bool)
    is_first[np.unique(vertex, return_index=True)[1]] = True
    place = np.where(is_first, vertex, n + np.cumsum(~is_first) - 1)
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = place
    source = np.concatenate([np.arange(n), vertex[~is_first]])
    uv = np.zeros((len(source), 2))
    uv[place] = rows[order, 1:]
    added = counted(len(source) - n, "vertex at a seam is", "vertices at seams are")
    log.warning(
        f".glb has one texture coordinate per vertex: {added} added, "
        "the attribute _INPUT_VERTEX names the vertex of each"
    )
    return rank[np.ravel(number)].reshape(-1, 3), source, uv


def _container(data: CellData, attributes: dict[str, NDArray], indices: NDArray) -> bytes:
    """The JSON chunk and the binary chunk."""
    views: list[dict[str, Any]] = []
    accessors: list[dict[str, Any]] = []
    binary = bytearray()

    def add(values: NDArray, target: int) -> int:
        binary.extend(b"\0" * (-len(binary) % 4))
        content = values.tobytes()
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(content), "target": target})
        binary.extend(content)
        accessor = {
            "bufferView": len(views) - 1,
            "componentType": KINDS[values.dtype],
            "count": len(values),
            "type": WIDTHS[1 if values.ndim == 1 else values.shape[1]],
        }
        if values.dtype == np.uint8:
            accessor["normalized"] = True
        accessors.append(accessor)
        return len(accessors) - 1

    numbers = {name: add(values, VERTICES) for name, values in attributes.items()}
    position = attributes["POSITION"]
    if len(position):
        bounds = {"min": position.min(axis=0).tolist(), "max": position.max(axis=0).tolist()}
        accessors[numbers["POSITION"]] |= bounds
    primitive = {"attributes": numbers, "indices": add(indices, INDICES), "mode": 4, "material": 0}
    material = {"pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 0.9}, "doubleSided": True}
    scene = {
        "asset": {"version": "2.0", "generator": "ddgcli", "extras": {"ddgcli": json.loads(data.provenance)}},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "materials": [material],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(binary) + -len(binary) % 4}],
    }
    binary.extend(b"\0" * (-len(binary) % 4))
    text = json.dumps(scene, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    total = 12 + 8 + len(text) + 8 + len(binary)
    head = b"glTF" + np.array([2, total], dtype="<u4").tobytes()
    json_head = np.uint32(len(text)).astype("<u4").tobytes() + b"JSON"
    binary_head = np.uint32(len(binary)).astype("<u4").tobytes() + b"BIN\0"
    return head + json_head + text + binary_head + bytes(binary)
