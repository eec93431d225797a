"""Formats that meshio and trimesh read, in a guarded process.

The guard is needed because these readers print, call `sys.exit`, renumber, follow references to any file, or
loop without end on files that are damaged; they run in a process of their own (`guarded`). meshio
takes what finite elements write (it keeps node order and arrays, and reads tetrahedra); trimesh takes what
artists' tools write (glTF, 3MF, COLLADA, ...), without merging or processing.
"""

from __future__ import annotations

import contextlib
import io
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ddgcli.errors import MeshFileError, counted, excerpt
from ddgcli.io.appearance import COLOR, UV, colors_of_fractions
from ddgcli.io.readers.cells import NAMES, VTK_CELLS
from ddgcli.io.readers.guarded import guarded
from ddgcli.io.readers.inflate import check_zip
from ddgcli.io.readers.raw_mesh import RawMesh

MESHIO = {
    ".msh": ("gmsh", "ansys"), ".mesh": ("medit",), ".meshb": ("medit",), ".vtk": ("vtk",),
    ".xdmf": ("xdmf",), ".xmf": ("xdmf",), ".inp": ("abaqus",), ".bdf": ("nastran",),
    ".nas": ("nastran",), ".fem": ("nastran",),
    ".avs": ("avsucd",), ".cgns": ("cgns",), ".dat": ("tecplot",), ".tec": ("tecplot",), ".dato": ("permas",),
    ".post": ("permas",), ".e": ("exodus",), ".ex2": ("exodus",), ".exo": ("exodus",), ".ele": ("tetgen",),
    ".node": ("tetgen",), ".f3grid": ("flac3d",), ".h5m": ("h5m",), ".hmf": ("hmf",), ".mdpa": ("mdpa",),
    ".med": ("med",), ".su2": ("su2",), ".ugrid": ("ugrid",), ".vol": ("netgen",),
    ".xml": ("dolfin-xml",),
}  # fmt: skip
TRIMESH = {
    ".glb",
    ".gltf",
    ".dae",
    ".zae",
    ".3mf",
    ".3dxml",
    ".xaml",
    ".ctm",
    ".dxf",
    ".xyz",
    ".stp",
    ".step",
    ".zip",
}
# formats whose meshio reader takes an open text file, in which an endless read at the end can be stopped
TEXT_FORMATS = {"abaqus", "nastran", "avsucd", "tecplot", "permas", "su2", "netgen"}
BINARY_FORMATS = {"mdpa", "ansys"}
HDF5 = {".xdmf", ".xmf", ".cgns", ".h5m", ".hmf", ".med", ".e", ".ex2", ".exo"}


def read_meshio(path: str, suffix: str) -> RawMesh:
    """Read through meshio, in a process of its own.

    Parameters
    ----------
    path : str
    suffix : str
        A key of `MESHIO`.

    Returns
    -------
    RawMesh

    Raises
    ------
    MeshFileError
        Every reader of the extension fails, or a bound of `guarded` is exceeded.
    """
    needs = ("meshio", "h5py") if suffix in HDF5 else ("meshio",)
    return guarded("readers.foreign", "content_by_meshio", path, suffix, needs=needs, **_bounds(path))


def read_trimesh(path: str, suffix: str) -> RawMesh:
    """Read through trimesh, in a process of its own; the parts of a scene become one mesh, not merged.

    Parameters
    ----------
    path : str
    suffix : str
        A member of `TRIMESH`.

    Returns
    -------
    RawMesh

    Raises
    ------
    MeshFileError
        The reader fails or needs a missing package, the file has no triangles, or a bound of `guarded` is
        exceeded.
    """
    return guarded("readers.foreign", "content_by_trimesh", path, suffix, needs=("trimesh",), **_bounds(path))


def _bounds(path: str) -> dict[str, Any]:
    """Limits of the process that reads a file; a file that unpacks to too much is an error at once."""
    data = Path(path).read_bytes()
    check_zip(data)
    return {"size": len(data), "folder": str(Path(path).resolve().parent)}


def content_by_meshio(path: str, suffix: str) -> RawMesh:
    """The same in this process, without a bound."""
    reasons = []
    for name in MESHIO[suffix]:
        try:
            with _guarded() as output:
                return _raw(_meshio_mesh(path, name))
        except (MeshFileError, MemoryError):
            raise
        except _Endless:
            reasons.append("the file ends early")
        except SystemExit:  # meshio prints what is wrong, and ends the program
            reasons.append(excerpt(output.getvalue(), 120) or "its reader ended the program")
        except Exception as error:  # third-party readers raise any exception
            reasons.append(_in_a_line(error))
    raise MeshFileError(
        f"cannot be read as {suffix} ({'; '.join(reasons)}); it is truncated, damaged or of another format"
    )


def content_by_trimesh(path: str, suffix: str) -> RawMesh:
    """The same in this process, without a bound."""
    import trimesh

    try:
        with _guarded():
            scene: Any = trimesh.load_scene(path, file_type=suffix[1:], process=False, maintain_order=True)
            scene_meshes = scene.dump() if scene.geometry else []
            names = [scene.graph[node][1] for node in scene.graph.nodes_geometry]
    except (MeshFileError, MemoryError):
        raise
    except ImportError as error:
        raise MeshFileError(
            f"{suffix} needs a package that is not here ({_in_a_line(error)}): "
            "pip install lxml pycollada networkx"
        ) from None
    except (Exception, SystemExit) as error:
        raise MeshFileError(
            f"cannot be read as {suffix} ({_in_a_line(error)}); the file is damaged"
        ) from None
    meshes = [p for p in scene_meshes if hasattr(p, "faces")]
    if not meshes:
        raise MeshFileError("no triangles in the file; this format is read for surfaces only")
    shift = np.cumsum([0] + [len(m.vertices) for m in meshes])
    raw = RawMesh(np.concatenate([np.asarray(m.vertices, dtype=np.float64) for m in meshes]))
    raw.add_faces(np.concatenate([np.asarray(m.faces) + s for m, s in zip(meshes, shift)]))
    with _guarded():  # `dump` copies no vertex colours of textured meshes: use the originals
        visuals = [scene.geometry[name].visual for name, p in zip(names, scene_meshes) if hasattr(p, "faces")]
        raw.vertex = _appearance(visuals, [len(m.vertices) for m in meshes])
    if len(meshes) > 1:
        raw.notes.append(f"{len(meshes)} parts of a scene put into one mesh; vertices are not merged")
    if suffix == ".dae":
        raw.notes.append("Collada numbers vertices by face corner: their order is that of first use")
    return raw


def _appearance(visuals: list[Any], sizes: list[int]) -> dict[str, np.ndarray]:
    """`uv` and `color` of the vertices of all parts; parts without have NaN and opaque white."""
    uvs = [_rows_of(getattr(visual, "uv", None), n) for visual, n in zip(visuals, sizes)]
    colors = [_vertex_colors(visual, n) for visual, n in zip(visuals, sizes)]
    arrays = {}
    if any(uv is not None for uv in uvs):
        uv_blocks = [np.full((n, 2), np.nan) if uv is None else uv[:, :2] for uv, n in zip(uvs, sizes)]
        arrays[UV] = np.concatenate(uv_blocks).astype(np.float64)
    if any(color is not None for color in colors):
        white = [np.full((n, 4), 255) if c is None else c for c, n in zip(colors, sizes)]
        arrays[COLOR] = np.concatenate(white).astype(np.uint8)
    return arrays


def _vertex_colors(visual: Any, count: int) -> np.ndarray | None:
    """(n, 4) colours on the vertices of a trimesh mesh."""
    if visual.kind == "vertex":
        return _rows_of(visual.vertex_colors, count)
    stored = _rows_of(getattr(visual, "vertex_attributes", {}).get("color"), count)
    if stored is None:
        return None
    stored = stored if stored.dtype == np.uint8 else colors_of_fractions(stored)
    return stored if stored.shape[1] == 4 else np.column_stack([stored, np.full(count, 255)])


def _rows_of(values: Any, count: int) -> np.ndarray | None:
    """A table with one row per vertex, None if it is missing or has another length."""
    return None if values is None or np.ndim(values) != 2 or len(values) != count else np.asarray(values)


def _in_a_line(error: BaseException) -> str:
    """Kind and message of an exception, in one short line."""
    message = excerpt(error, 120)
    return f"{type(error).__name__}: {message}" if message else type(error).__name__


class _Endless(Exception):
    """A reader continued at the end of a file."""


class _EndWatch:
    """Text file that stops a reader which continues after its end."""

    empty = 0

    def readline(self, *args: Any) -> Any:
        line = super().readline(*args)  # type: ignore[misc]
        self.empty = 0 if line else self.empty + 1
        if self.empty > 1000:
            raise _Endless
        return line


class _TextFile(_EndWatch, io.TextIOWrapper):
    pass


class _BinaryFile(_EndWatch, io.BufferedReader):
    pass


def _meshio_mesh(path: str, name: str) -> Any:
    import meshio

    if name in TEXT_FORMATS:
        with _TextFile(io.FileIO(path), encoding="utf-8", errors="replace") as text:
            return meshio.read(text, name)
    if name in BINARY_FORMATS:
        with _BinaryFile(io.FileIO(path)) as data:
            return meshio.read(data, name)
    if name == "tetgen":
        _need_lines(Path(path).with_suffix(".node"), Path(path).with_suffix(".ele"))
    return meshio.read(path, name)


def _need_lines(*paths: Path) -> None:
    """A line that is neither blank nor a comment in each file: meshio's reader looks for one without end."""
    for path in paths:
        with path.open(encoding="utf-8", errors="replace") as text:
            if all(line.strip()[:1] in ("", "#") for line in text):
                raise _Endless


@contextlib.contextmanager
def _guarded() -> Iterator[io.StringIO]:
    """Redirect third-party prints and warnings to a text buffer."""
    sink = io.StringIO()
    with contextlib.redirect_stdout(sink), contextlib.redirect_stderr(sink), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield sink


def _raw(mesh: Any) -> RawMesh:
    from meshio._vtk_common import meshio_to_vtk_type

    points = np.asarray(mesh.points, dtype=np.float64)
    if points.ndim == 2 and points.shape[1] < 3:
        points = np.column_stack([points, np.zeros((len(points), 3 - points.shape[1]))])
    raw = RawMesh(points, vertex={n: np.asarray(v) for n, v in mesh.point_data.items()})
    blocks_of_kind: dict[str, list[int]] = {"face": [], "tetra": [], "line": []}
    for number, block in enumerate(mesh.cells):
        kind, corners = _block_kind(block.type, meshio_to_vtk_type)
        if kind == "skip":
            continue
        blocks_of_kind[kind].append(number)
        data = block.data
        if corners is None:
            sizes = np.array([len(cell) for cell in data], dtype=np.int64)
            flat = (
                np.concatenate([np.asarray(cell, dtype=np.int64) for cell in data])
                if len(data)
                else np.zeros(0, int)
            )
            raw.corners, raw.sizes = np.append(raw.corners, flat), np.append(raw.sizes, sizes)
            continue
        data = np.asarray(data, dtype=np.int64).reshape(-1, np.shape(data)[1])
        if data.shape[1] > corners:
            raw.notes.append(f"{counted(len(data), 'cell', 'cells')} '{block.type}' reduced to corners")
        data = data[:, :corners]
        if kind == "face":
            raw.add_faces(data)
        elif kind == "tetra":
            raw.tetrahedra = np.concatenate([raw.tetrahedra, data])
        else:
            raw.lines = np.concatenate([raw.lines, data])
    for kind, place in (("face", raw.face), ("tetra", raw.cell), ("line", raw.line)):
        for name, blocks in mesh.cell_data.items():
            if blocks_of_kind[kind]:
                place[name] = np.concatenate([np.asarray(blocks[number]) for number in blocks_of_kind[kind]])
    if len(raw.tetrahedra):
        # finite element files list the boundary too
        raw.sizes, raw.corners, raw.face = raw.sizes[:0], raw.corners[:0], {}
    return raw


def _block_kind(name: str, vtk_types: dict[str, int]) -> tuple[str, int | None]:
    if name == "polygon" or name.startswith("VTK_LAGRANGE_CURVE"):
        return ("face", None) if name == "polygon" else ("line", 2)
    code = vtk_types.get(name, -1)
    if code not in VTK_CELLS or VTK_CELLS[code][0] in ("strip", "path", "pixel"):
        kind = NAMES.get(code, name)
        raise MeshFileError(
            f"cells of kind {kind}; only triangles, polygons, tetrahedra and lines can be read: convert them"
        )
    return VTK_CELLS[code]


def suffixes() -> set[str]:
    """Extensions that this module reads.

    Returns
    -------
    set of str
        In lower case, each with its dot.
    """
    return set(MESHIO) | TRIMESH
