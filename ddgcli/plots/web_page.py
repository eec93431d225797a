"""A self-contained page for the browser: surfaces, curves and trajectories drawn by WebGL2."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.plots.colour import first_quantity, is_signed, robust_limits, value_scale
from ddgcli.plots.viewpoint import up_axis_of

# Browsers read an element in time quadratic in its length: 160 MiB in one element took 40 s.
SEGMENT_LENGTH = 1 << 20


@dataclass(frozen=True, eq=False)
class ViewedObject:
    """Contents of the page for one input.

    Parameters
    ----------
    name : str
    points : sequence of (n, 3) ndarray
        one entry, or one per frame.
    cells : sequence of (m, 3) or (m, 2) ndarray of int64
        Triangles or segments: one entry, or one per frame.
    vertex, face : mapping of str to sequence of ndarray
        One array, or one per frame; vectors are shown by their length.
    """

    name: str
    points: Sequence[NDArray]
    cells: Sequence[NDArray[np.int64]]
    vertex: Mapping[str, Sequence[NDArray]] = field(default_factory=dict)
    face: Mapping[str, Sequence[NDArray]] = field(default_factory=dict)


def page_bytes(
    title: str,
    objects: Sequence[ViewedObject],
    times: Sequence[float] = (),
    *,
    show: str | None = None,
    up: str | None = None,
) -> bytes:
    """Content of the page, in UTF-8; equal content gives equal bytes.

    Parameters
    ----------
    title : str
    objects : sequence of ViewedObject
        One at least.
    times : sequence of float
        Times of the frames in seconds; empty if nothing moves.
    show : str, optional
        Array to begin with; default: the first that is not a map, such as `input_vertex`.
    up : {'y', 'z'}, optional
        Default: z with times, else from the shape.

    Returns
    -------
    bytes
        HTML.
    """
    clouds = [points for viewed in objects for points in viewed.points]
    centre, half = _bounds(clouds)
    size = float(half.max()) or 1.0
    data = {
        "objects": [_object(viewed, centre, size) for viewed in objects],
        "centre": centre.tolist(),
        "size": size,
        "half": (half / size).tolist(),
        "radius": max((_radius(points - centre) for points in clouds), default=0.0) / size or 1.0,
        "times": [float(time) for time in times],
        "show": show or first_quantity(n for o in objects for n in (*o.vertex, *o.face)) or "",
        "up": up or ("z" if times else up_axis_of(_first_frame(objects, centre, size))),
    }
    text = json.dumps(data, allow_nan=False, ensure_ascii=False).replace("<", "\\u003c")
    segments = [text[start : start + SEGMENT_LENGTH] for start in range(0, len(text), SEGMENT_LENGTH)]
    template = files("ddgcli.plots").joinpath("viewer.html").read_text("utf-8")
    return (
        template.replace("@TITLE@", escape(title))
        .replace("@DATA@", '</script>\n<script type="application/json">'.join(segments))
        .encode(errors="backslashreplace")
    )


def _radius(points: NDArray) -> float:
    """Largest distance from the origin."""
    return float(np.sqrt(np.max(np.sum(points**2, axis=1), initial=0.0)))


def _bounds(clouds: Sequence[NDArray]) -> tuple[NDArray, NDArray]:
    """Centre of the bounding box of all points, and half its sides."""
    filled = [points for points in clouds if len(points)] or [np.zeros((1, 3))]
    low = np.min([points.min(axis=0) for points in filled], axis=0)
    high = np.max([points.max(axis=0) for points in filled], axis=0)
    return (low + high) / 2, (high - low) / 2


def _first_frame(objects: Sequence[ViewedObject], centre: NDArray, size: float) -> TriangleMesh:
    """The triangles of all objects at the start, relative to the bounding box."""
    start = np.cumsum([0, *(len(viewed.points[0]) for viewed in objects)])
    faces = [viewed.cells[0] + k for viewed, k in zip(objects, start) if viewed.cells[0].shape[1] == 3]
    points = (np.concatenate([viewed.points[0] for viewed in objects]) - centre) / size
    return TriangleMesh.from_arrays(points, np.concatenate([np.zeros((0, 3), dtype=np.int64), *faces]))


def _object(viewed: ViewedObject, centre: NDArray, size: float) -> dict[str, Any]:
    """Data that the page draws; positions are relative to the bounding box, in single precision."""
    arrays = [_array(name, "vertex", values_by_frame) for name, values_by_frame in viewed.vertex.items()]
    arrays += [_array(name, "face", values_by_frame) for name, values_by_frame in viewed.face.items()]
    return {
        "name": viewed.name,
        "points": [_packed((points - centre) / size, "f4") for points in viewed.points],
        "faces": [_packed(cells, "u4") for cells in viewed.cells],
        "cells": len(viewed.cells[0]),
        "corners": int(viewed.cells[0].shape[1]),
        "arrays": arrays,
    }


def _array(name: str, place: str, values_by_frame: Sequence[NDArray]) -> dict[str, Any]:
    values = [np.linalg.norm(v, axis=1) if v.ndim == 2 else v.astype(np.float64) for v in values_by_frame]
    joined = np.concatenate(values)
    low, high, signed = robust_limits(joined, is_signed(name, values_by_frame[0].ndim), value_scale(name))
    finite = joined[np.isfinite(joined)]
    return {
        "name": name,
        "place": place,
        "low": low,
        "high": high,
        "signed": signed,
        "ends": [float(finite.min()), float(finite.max())] if len(finite) else None,
        "frames": [_packed(v, "f8") for v in values],
    }


def _packed(values: NDArray, kind: str) -> dict[str, str]:
    """Little-endian bytes of an array as base64."""
    content = np.ascontiguousarray(values, dtype=f"<{kind}").tobytes()
    return {"type": kind, "base64": base64.b64encode(content).decode("ascii")}
