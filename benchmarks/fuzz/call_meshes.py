"""Small random meshes of many classes, with arrays, as the input files of random calls."""

from __future__ import annotations

import io
from collections.abc import Callable
from random import Random
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.hardcases import meshes
from ddgcli.mesh import shapes

Arrays = tuple[NDArray[np.float64], NDArray[np.int64]]
SURFACE, TETRAHEDRA, CURVE = "faces", "tetrahedra", "lines"  # names of the cells in .npz
PATTERNS = ("right", "left", "alternating")
SCALES = (1e-100, 1e-30, 1e-8, 1e-3, 1e3, 1e8, 1e30, 1e100)
OFFSETS = (1e3, 1e6, 1e10, 1e14)  # in units of the mesh
SUFFIXES = (".npz", ".npz", ".npz", ".npz", ".obj", ".off", ".ply", ".vtu")
CURVE_SUFFIXES = (".npz", ".npz", ".obj", ".csv")
SHARE_OF_MODIFIERS = 0.35


def moebius(cells: int = 8) -> Arrays:
    """Möbius band of one row of `cells` squares, not orientable."""
    angle = 2 * np.pi * np.arange(cells) / cells
    sides = []
    for sign in (-1, 1):
        r = 1 + 0.3 * sign * np.cos(angle / 2)
        sides.append(np.stack([r * np.cos(angle), r * np.sin(angle), 0.3 * sign * np.sin(angle / 2)], 1))
    low = np.arange(cells)
    after = np.where(low + 1 < cells, low + 1, cells)  # the last square joins the other side
    high, high_after = low + cells, np.where(low + 1 < cells, low + 1 + cells, 0)
    faces = np.concatenate([np.stack([low, after, high_after], 1), np.stack([low, high_after, high], 1)])
    return np.concatenate(sides), faces


def klein_bottle(cells: int = 6) -> Arrays:
    """Square torus grid glued with one reflection, in random position: closed, not orientable."""
    number = np.arange(cells * cells).reshape(cells, cells)
    across = np.concatenate([number, number[:1, ::-1]])
    whole = np.concatenate([across, across[:, :1]], axis=1)
    a, b, c, d = (w.ravel() for w in (whole[:-1, :-1], whole[1:, :-1], whole[1:, 1:], whole[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return np.random.default_rng(3).normal(size=(cells * cells, 3)), faces


def book(pages: int = 3) -> Arrays:
    """Triangles that share one edge."""
    angle = 2 * np.pi * np.arange(pages) / pages
    outer = np.stack([np.cos(angle), np.sin(angle), 0 * angle + 0.5], 1)
    faces = np.stack([np.zeros(pages), np.ones(pages), 2 + np.arange(pages)], 1).astype(np.int64)
    return np.concatenate([[[0.0, 0, 0], [0, 0, 1]], outer]), faces


SURFACES: dict[str, Callable[[Random], Arrays]] = {
    "sphere": lambda rng: meshes.sphere(rng.choice([0, 1, 1, 2])),
    "square": lambda rng: meshes.square(rng.choice([1, 2, 4, 7]), rng.choice(PATTERNS)),
    "torus": lambda rng: meshes.arrays_of(shapes.torus(rng.choice([6, 10]), rng.choice([4, 6]))),
    "cylinder": lambda rng: meshes.arrays_of(shapes.cylinder(rng.choice([4, 9]), rng.choice([1, 4]))),
    "catenoid": lambda rng: meshes.arrays_of(shapes.catenoid(8, 4)),
    "box": lambda rng: meshes.arrays_of(shapes.box(1, rng.choice([1, 2]), rng.choice([1, 3]))),
    "handles": lambda rng: meshes.handles(rng.choice([1, 2, 3])),
    "needles": lambda rng: meshes.needles(rng.choice([1e2, 1e4, 1e8])),
    "caps": lambda rng: meshes.caps(rng.choice([1e1, 1e3, 1e8])),
    "fan": lambda rng: meshes.fan(rng.choice([3, 6, 60])),
    "hinge": lambda rng: meshes.hinge(rng.choice([0.0, 1e-9, 1.0, 3.0, np.pi])),
    "one triangle": lambda rng: rng.choice([meshes.one_triangle, meshes.turned_triangle, meshes.kite])(),
    "tetrahedron surfaces": lambda rng: meshes.tetrahedra(rng.choice([1, 2, 7])),
    "triangles": lambda rng: meshes.triangles(rng.choice([2, 5])),
    "two spheres": lambda rng: _twice(meshes.sphere(rng.choice([0, 1]))),
    "soup": lambda rng: meshes.soup(rng.choice([2, 10, 40])),
    "crossing faces": lambda rng: meshes.voxel_soup(rng.choice([5, 10])),
    "pinched": lambda rng: meshes.pinched(rng.choice([2, 5])),
    "voxels": lambda rng: meshes.voxel_gyroid(rng.choice([4, 6])),
    "moebius": lambda rng: moebius(rng.choice([5, 8])),
    "klein bottle": lambda rng: klein_bottle(rng.choice([3, 6])),
    "book": lambda rng: book(rng.choice([3, 4])),
}


def _twice(arrays: Arrays) -> Arrays:
    points, cells = arrays
    return np.concatenate([points, points + [3.0, 0, 0]]), np.concatenate([cells, cells + len(points)])


def _box_tetrahedra(rng: Random) -> Arrays:
    mesh = shapes.box_tetrahedra(rng.choice([1, 2, 3]), rng.choice([1, 2]), rng.choice([1, 2]))
    return np.array(mesh.points), np.array(mesh.tetrahedra)


def _one_tetrahedron(rng: Random) -> Arrays:
    height = rng.choice([1.0, 1e-9])
    return np.vstack([np.zeros(3), np.diag([1.0, 1.0, height])]), np.array([[0, 1, 2, 3]])


def _circle(rng: Random) -> Arrays:
    n, turns = rng.choice([3, 5, 12, 30]), rng.choice([1, 1, 2])
    angle = 2 * np.pi * turns * np.arange(n) / n
    k = np.arange(n)
    height = rng.choice([0.0, 0.0, 0.2]) * np.sin(3 * angle)
    return np.stack([np.cos(angle), np.sin(angle), height], 1), np.stack([k, (k + 1) % n], 1)


def _path(rng: Random) -> Arrays:
    n = rng.choice([2, 3, 10])
    x = np.linspace(0, 2, n)
    k = np.arange(n - 1)
    bend = rng.choice([0.0, 1.0])
    return np.stack([x, bend * x**2, bend * np.sin(5 * x)], 1), np.stack([k, k + 1], 1)


CURVES: dict[str, Callable[[Random], Arrays]] = {
    "circle": _circle,
    "path": _path,
    "two circles": lambda rng: _twice(_circle(rng)),
    "star of lines": lambda rng: (np.eye(4)[:, :3] * 1.0, np.array([[0, 3], [1, 3], [2, 3]])),
}
SOLIDS: dict[str, Callable[[Random], Arrays]] = {
    "box of tetrahedra": _box_tetrahedra,
    "one tetrahedron": _one_tetrahedron,
    "two tetrahedra": lambda rng: _twice(_one_tetrahedron(rng)),
}


# ---------------------------------------------------------------- modifiers
def _scaled(rng: Random, arrays: Arrays) -> Arrays:
    return arrays[0] * rng.choice(SCALES), arrays[1]


def _far(rng: Random, arrays: Arrays) -> Arrays:
    size = np.ptp(arrays[0], axis=0).max()
    return arrays[0] + size * rng.choice(OFFSETS) * np.array([1.0, -0.3, 0.7]), arrays[1]


def _noisy(rng: Random, arrays: Arrays) -> Arrays:
    noise = np.random.default_rng(rng.randrange(1 << 30)).normal(size=arrays[0].shape)
    return arrays[0] + rng.choice([1e-6, 0.02, 0.3]) * np.ptp(arrays[0], axis=0).max() * noise, arrays[1]


def _stretched(rng: Random, arrays: Arrays) -> Arrays:
    return arrays[0] * np.array([1.0, rng.choice([1e-6, 1e-2, 1e3]), 1.0]), arrays[1]


def _flat(rng: Random, arrays: Arrays) -> Arrays:
    return arrays[0] * np.array([1.0, 1.0, 0.0]), arrays[1]


def _unreferenced(rng: Random, arrays: Arrays) -> Arrays:
    return np.concatenate([arrays[0], arrays[0][:2] + 0.5]), arrays[1]


def _some_turned(rng: Random, arrays: Arrays) -> Arrays:
    cells = arrays[1].copy()
    rows = rng.sample(range(len(cells)), rng.randint(1, len(cells)))
    cells[rows, :2] = cells[rows, 1::-1]
    return arrays[0], cells


def _some_degenerate(rng: Random, arrays: Arrays) -> Arrays:
    """Vertices of a cell in one place, or a corner on the opposite side."""
    points, cells = arrays[0].copy(), arrays[1]
    cell = cells[rng.randrange(len(cells))]
    points[cell[0]] = rng.choice([points[cell[1]], (points[cell[1]] + points[cell[-1]]) / 2])
    return points, cells


def _repeated_corner(rng: Random, arrays: Arrays) -> Arrays:
    cells = np.concatenate([arrays[1], arrays[1][-1:]])
    cells[-1, 0] = cells[-1, 1]
    return arrays[0], cells


def _duplicate_cell(rng: Random, arrays: Arrays) -> Arrays:
    return arrays[0], np.concatenate([arrays[1], arrays[1][:1]])


def _some_missing(rng: Random, arrays: Arrays) -> Arrays:
    rows = sorted(rng.sample(range(len(arrays[1])), max(1, int(0.8 * len(arrays[1])))))
    return arrays[0], arrays[1][rows]


def _other_numbers(rng: Random, arrays: Arrays) -> Arrays:
    order = list(range(len(arrays[0])))
    rng.shuffle(order)
    points = np.empty_like(arrays[0])
    points[order] = arrays[0]
    return points, np.array(order)[arrays[1]]


MODIFIERS: tuple[Callable[[Random, Arrays], Arrays], ...] = (
    _scaled, _scaled, _far, _noisy, _noisy, _stretched, _flat, _unreferenced, _some_turned, _some_degenerate,
    _repeated_corner, _duplicate_cell, _some_missing, _other_numbers,
)  # fmt: skip


def random_mesh(rng: Random, kind: str = SURFACE) -> dict[str, Any]:
    """A mesh of a random class as plain data; `cells` is their kind, `numbers` are their vertices."""
    table = {SURFACE: SURFACES, TETRAHEDRA: SOLIDS, CURVE: CURVES}[kind]
    name = rng.choice(list(table))
    arrays, names = table[name](rng), [name]
    while rng.random() < SHARE_OF_MODIFIERS:
        modifier = rng.choice(MODIFIERS)
        arrays = modifier(rng, arrays)
        names.append(modifier.__name__.strip("_"))
    suffixes = {SURFACE: SUFFIXES, TETRAHEDRA: (".npz", ".npz", ".vtu"), CURVE: CURVE_SUFFIXES}[kind]
    return {
        "name": ", ".join(names), "suffix": rng.choice(suffixes), "cells": kind,
        "points": arrays[0].tolist(), "numbers": arrays[1].tolist(),
    }  # fmt: skip


def mesh_arrays(mesh: dict[str, Any]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Points and cells of a random mesh."""
    return np.array(mesh["points"], dtype=np.float64), np.array(mesh["numbers"], dtype=np.int64)


def mesh_file(mesh: dict[str, Any]) -> bytes:
    """The file of a mesh: .npz with arrays on vertices, faces and edges; texts without."""
    points, cells = mesh_arrays(mesh)
    suffix = mesh["suffix"]
    if suffix in TEXTS:
        return TEXTS[suffix](mesh["cells"], points, cells).encode()
    stream = io.BytesIO()
    np.savez(stream, points=points, **{mesh["cells"]: cells}, **example_arrays(points, cells))
    return stream.getvalue()


def example_arrays(points: NDArray, cells: NDArray) -> dict[str, NDArray]:
    """Arrays `f`, `v`, `k` on vertices; `ff`, `fv` on cells; `edges` with `w` on the edges of faces."""
    size = np.ptp(points, axis=0).max() or 1.0
    unit = (points - points.min(axis=0)) / size
    middle = unit[cells].mean(axis=1)
    arrays = {"f": unit[:, 0], "v": unit[:, [1, 0, 2]], "k": (unit[:, 0] > 0.5).astype(np.int64)}
    arrays |= {"ff": middle[:, 0] + 1e-3 * np.arange(len(cells)), "fv": middle[:, [1, 2, 0]]}
    if cells.shape[1] == 3:
        sides = np.concatenate([cells[:, [0, 1]], cells[:, [1, 2]], cells[:, [2, 0]]])
        edges = np.unique(np.sort(sides, axis=1), axis=0)
        arrays |= {"edges": edges, "w": np.sin(np.arange(len(edges)))}
    return arrays


def _rows(numbers: NDArray, head: str, integer: bool = False) -> str:
    return "".join(
        head + " ".join(str(int(x)) if integer else repr(float(x)) for x in row) + "\n" for row in numbers
    )


def _obj(kind: str, points: NDArray, cells: NDArray) -> str:
    return _rows(points, "v ") + _rows(cells + 1, "l " if kind == CURVE else "f ", integer=True)


def _off(kind: str, points: NDArray, cells: NDArray) -> str:
    return f"OFF\n{len(points)} {len(cells)} 0\n{_rows(points, '')}{_rows(cells, '3 ', integer=True)}"


def _ply(kind: str, points: NDArray, cells: NDArray) -> str:
    axes = "".join(f"property double {c}\n" for c in "xyz")
    return (
        f"ply\nformat ascii 1.0\nelement vertex {len(points)}\n{axes}element face {len(cells)}\n"
        f"property list uchar int vertex_indices\nend_header\n{_rows(points, '')}"
        f"{_rows(cells, '3 ', integer=True)}"
    )


def _csv(kind: str, points: NDArray, cells: NDArray) -> str:
    closed = [0] if (cells[-1] == [len(points) - 1, 0]).all() else []
    rows = points[[*range(len(points)), *closed]]
    return "".join(",".join(repr(float(x)) for x in row) + "\n" for row in rows)


def _vtu(kind: str, points: NDArray, cells: NDArray) -> str:
    def array(name: str, number: str, values: NDArray, components: int = 1) -> str:
        form = 'format="ascii"'
        text = _rows(values.reshape(len(values), -1), "", integer=number[0] != "F")
        return (
            f'<DataArray type="{number}" Name="{name}" NumberOfComponents="{components}" {form}>\n'
            f"{text}</DataArray>\n"
        )

    corners = cells.shape[1]
    types = np.full(len(cells), {2: 3, 3: 5, 4: 10}[corners])
    return (
        '<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian"><UnstructuredGrid>\n'
        f'<Piece NumberOfPoints="{len(points)}" NumberOfCells="{len(cells)}">\n'
        f"<Points>{array('Points', 'Float64', points, 3)}</Points>\n"
        f"<PointData>{array('f', 'Float64', points[:, 0])}</PointData>\n"
        f"<Cells>{array('connectivity', 'Int64', cells)}"
        f"{array('offsets', 'Int64', corners * np.arange(1, len(cells) + 1))}"
        f"{array('types', 'UInt8', types)}</Cells>\n"
        "</Piece></UnstructuredGrid></VTKFile>\n"
    )


TEXTS: dict[str, Callable[[str, NDArray, NDArray], str]] = {
    ".obj": _obj, ".off": _off, ".ply": _ply, ".csv": _csv, ".vtu": _vtu,
}  # fmt: skip
