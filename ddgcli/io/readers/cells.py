"""Cells of VTK and meshio sorted into polygons, tetrahedra and segments."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshFileError, counted
from ddgcli.io.readers.raw_mesh import RawMesh
from ddgcli.mesh.ragged import repeat_with_place

# VTK cell type -> (kind, corners kept; None: all). Higher order cells keep their corners.
VTK_CELLS = {
    3: ("line", 2), 4: ("path", None), 21: ("line", 2), 35: ("line", 2), 68: ("line", 2),
    5: ("face", 3), 6: ("strip", None), 7: ("face", None), 9: ("face", 4), 22: ("face", 3), 23: ("face", 4),
    28: ("face", 4), 34: ("face", 3), 69: ("face", 3), 70: ("face", 4), 30: ("face", 4),
    10: ("tetra", 4), 24: ("tetra", 4), 71: ("tetra", 4), 8: ("pixel", 4),
    1: ("skip", None), 2: ("skip", None), 0: ("skip", None),
}  # fmt: skip
VERTEX, LINE, STRIP, POLYGON = 1, 4, 6, 7  # VTK cell types of the four lists of PolyData
NAMES = {11: "voxel", 12: "hexahedron", 13: "wedge", 14: "pyramid", 42: "polyhedron"}


def add_vtk_cells(
    raw: RawMesh, types: NDArray, connectivity: NDArray, sizes: NDArray, arrays: dict[str, NDArray]
) -> None:
    """Add cells to `raw`, with the arrays of the kind that `assembled` keeps.

    Parameters
    ----------
    raw : RawMesh
        Changed in place.
    types, sizes : (c,) ndarray of int
        VTK type and number of nodes of each cell.
    connectivity : (sum of sizes,) ndarray of int
    arrays : dict of str to (c, ...) ndarray

    Raises
    ------
    MeshFileError
        Sizes that do not fit the connectivity, cells of another kind, or a cell with too few nodes.
    """
    if (sizes < 0).any() or len(types) != len(sizes) or len(connectivity) != sizes.sum():
        raise MeshFileError("the cells' offsets do not fit their connectivity; the file is damaged")
    start = np.cumsum(sizes) - sizes
    groups: dict[str, list[NDArray]] = {"line": [], "face": [], "tetra": []}
    lists: dict[str, list[tuple[NDArray, NDArray]]] = {"line": [], "face": [], "tetra": []}
    # runs of one type keep the file's order
    change = np.flatnonzero(np.diff(types)) + 1
    for a, b in zip(np.concatenate([[0], change]), np.concatenate([change, [len(types)]])):
        if a == b:
            continue
        kind, keep = _kind(int(types[a]))
        which = np.arange(a, b)
        if kind == "skip":
            continue
        members, owner, size = _nodes(connectivity, start, sizes, which, kind, keep)
        kind = {"path": "line", "strip": "face", "pixel": "face"}.get(kind, kind)
        groups[kind].append(owner)
        lists[kind].append((members, size))
        if keep and (sizes[which] > keep).any():
            count = counted(int((sizes[which] > keep).sum()), "cell", "cells")
            raw.notes.append(f"{count} of higher order reduced to corners")
    if lists["face"]:
        raw.corners = _joined([m for m, _ in lists["face"]])
        raw.sizes = _joined([s for _, s in lists["face"]])
    if lists["tetra"]:
        raw.tetrahedra = _joined([m for m, _ in lists["tetra"]]).reshape(-1, 4)
    if lists["line"]:
        raw.lines = _joined([m for m, _ in lists["line"]]).reshape(-1, 2)
    for kind, place in (("face", raw.face), ("tetra", raw.cell), ("line", raw.line)):
        if groups[kind]:
            owner = np.concatenate(groups[kind])
            place.update({name: value[owner] for name, value in arrays.items()})


def _joined(arrays: list[NDArray]) -> NDArray[np.int64]:
    """The arrays one after the other; one array alone is not copied."""
    return (np.concatenate(arrays) if len(arrays) > 1 else arrays[0]).astype(np.int64, copy=False)


def _kind(code: int) -> tuple[str, int | None]:
    if code not in VTK_CELLS:
        name = NAMES.get(code, f"VTK type {code}")
        raise MeshFileError(
            f"cells of kind {name}; only triangles, polygons, tetrahedra and lines can be read: convert them"
        )
    return VTK_CELLS[code]


def _nodes(
    connectivity: NDArray, start: NDArray, sizes: NDArray, which: NDArray, kind: str, keep: int | None
) -> tuple[NDArray, NDArray, NDArray]:
    """Nodes of cells, the cell of each resulting one, and their sizes."""
    if keep is not None:
        if (sizes[which] < keep).any():
            raise MeshFileError(f"a cell has fewer than {keep} nodes; the file is damaged")
        if (sizes[which] == keep).all():  # then the nodes lie one after the other
            nodes = connectivity[start[which[0]] :][: keep * len(which)].reshape(-1, keep)
        else:
            nodes = connectivity[start[which, None] + np.arange(keep)]
        if kind == "pixel":
            nodes = nodes[:, [0, 1, 3, 2]]
        return nodes.ravel(), which, np.full(len(which), keep)
    count = sizes[which]
    first, local = repeat_with_place(start[which], count)
    nodes = connectivity[first + local]
    if kind == "face":
        return nodes, which, count
    reach = 1 if kind == "path" else 2
    at = np.flatnonzero(local < np.repeat(count, count) - reach)
    owner = np.repeat(which, count)[at]
    if kind == "path":
        return np.stack([nodes[at], nodes[at + 1]], axis=1).ravel(), owner, np.full(len(at), 2)
    odd = local[at] % 2 == 1
    triangles = np.stack([nodes[at + odd], nodes[at + 1 - odd], nodes[at + 2]], axis=1)
    return triangles.ravel(), owner, np.full(len(at), 3)
