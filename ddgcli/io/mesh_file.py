"""The door for mesh files: every format in, every format out, nothing half-written.

Readers, and why these: OBJ, OFF, PLY, STL, VTK, VTU, VTP, CSV, NPZ and VTKHDF are read by our own short
readers (each says why in its file: faithful order, guarded counts, arrays kept, speed); what finite elements
write otherwise goes through meshio, what artists write through trimesh, both behind a guard (`read_foreign`).
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import os
import stat
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from numpy.typing import NDArray

from ddgcli.errors import InputError, MeshError, MeshFileError, OutputError, excerpt
from ddgcli.io.readers.raw_mesh import RawMesh, assembled
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.require import kind_of, wrong_kind
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh

# extension -> (module, function); modules are imported only when their format is met
READERS = {
    ".obj": ("readers.obj", "read_obj"), ".off": ("readers.off", "read_off"),
    ".ply": ("readers.ply", "read_ply"),
    ".stl": ("readers.stl", "read_stl"), ".vtu": ("readers.vtk_xml", "read_vtk_xml"),
    ".vtp": ("readers.vtk_xml", "read_vtk_xml"), ".csv": ("readers.tables", "read_csv"),
    ".txt": ("readers.tables", "read_csv"), ".wkt": ("readers.tables", "read_wkt"),
    ".npz": ("readers.tables", "read_npz"), ".vtk": ("readers.vtk_legacy", "read_vtk_legacy"),
    ".vtkhdf": ("readers.vtkhdf", "read_vtkhdf"), ".h5": ("readers.vtkhdf", "read_vtkhdf"),
    ".hdf": ("readers.vtkhdf", "read_vtkhdf"),
}  # fmt: skip
WRITERS = {
    ".ply": ("writers.text", "ply_bytes"), ".vtu": ("writers.vtk", "vtu_bytes"),
    ".vtk": ("writers.vtk", "vtk_bytes"), ".vtp": ("writers.vtk", "vtp_bytes"),
    ".vtkhdf": ("writers.arrays", "vtkhdf_bytes"), ".obj": ("writers.text", "obj_bytes"),
    ".off": ("writers.text", "off_bytes"), ".stl": ("writers.text", "stl_bytes"),
    ".xdmf": ("writers.vtk", "xdmf_bytes"), ".npz": ("writers.arrays", "npz_bytes"),
}  # fmt: skip
INTRINSIC_FORMATS = (".npz", ".vtkhdf")


@dataclass(frozen=True, eq=False)
class MeshInput:
    """A mesh as read, with the arrays and the story of its file.

    Parameters
    ----------
    mesh : TriangleMesh, TetMesh or CurveSet
    path, sha256 : str
    vertex, face, edge, whole : dict of str to ndarray
        Arrays the file carried; `face` those on cells (tetrahedra, segments), repeated where polygons were
        split; `edge` in the order of the file's own `edges`.
    input_vertex : (k,) ndarray of int64, or None
        Vertex of the mesh for each vertex of the file, where the format needed a merge.
    input_face : (m,) ndarray of int64, or None
        Polygon of the file for each triangle, where polygons were split.
    notes : tuple of str
        What was done to the input: merged, triangulated, ...
    """

    mesh: TriangleMesh | TetMesh | CurveSet
    path: str
    sha256: str
    vertex: dict[str, NDArray] = field(default_factory=dict)
    face: dict[str, NDArray] = field(default_factory=dict)
    edge: dict[str, NDArray] = field(default_factory=dict)
    whole: dict[str, NDArray] = field(default_factory=dict)
    input_vertex: NDArray | None = None
    input_face: NDArray | None = None
    notes: tuple[str, ...] = ()

    @property
    def kind(self) -> str:
        """'surface', 'tetrahedra' or 'curve'."""
        return kind_of(self.mesh)

    @property
    def surface(self) -> TriangleMesh:
        """The mesh of a surface, or the boundary of tetrahedra; MeshError for a curve."""
        if isinstance(self.mesh, TetMesh):
            return self.mesh.boundary
        if isinstance(self.mesh, TriangleMesh):
            return self.mesh
        raise MeshError(f"{self.path}: {wrong_kind(self.mesh, ('surface',))}")


def read_mesh(path: str, input_format: str | None = None) -> MeshInput:
    """Read a mesh file.

    Parameters
    ----------
    path : str
        `-` is standard input, which needs `input_format`.
    input_format : str, optional
        An extension that outranks the path's own.

    Raises
    ------
    MeshFileError, MeshError
        One line that begins with the path.
    """
    suffix = format_of(path, input_format)
    data = _bytes(path)
    if not data:
        raise MeshFileError(f"{path}: the file is empty; see what should have written it")
    try:
        raw = _raw(path, data, suffix)
        mesh, cells, polygon = assembled(raw)
    except InputError as error:
        raise type(error)(f"{path}: {error}{_told_apart(data, suffix)}") from error
    except (MemoryError, OverflowError, RecursionError) as error:
        raise MeshFileError(
            f"{path}: asks for more than can be held ({excerpt(error)}); the file is damaged"
        ) from error
    return MeshInput(
        mesh, path, hashlib.sha256(data).hexdigest(), raw.vertex, cells, raw.edge, raw.whole,
        raw.input_vertex, polygon, tuple(raw.notes),
    )  # fmt: skip


def format_of(path: str, input_format: str | None = None) -> str:
    """The extension that chooses the reader; refused when no reader knows it."""
    from ddgcli.io.readers import foreign as read_foreign

    if input_format:
        suffix = "." + input_format.lower().lstrip(".")
    elif path == "-":
        raise MeshFileError("-: standard input needs --input-format, such as --input-format ply")
    elif Path(path).is_dir():
        raise MeshFileError(f"{path}: is a folder; name a mesh file")
    else:
        suffix = Path(path).suffix.lower()
    if suffix not in READERS and suffix not in read_foreign.suffixes():
        known = " ".join(sorted({*READERS, *read_foreign.suffixes()}))
        raise MeshFileError(
            f"{path}: unknown format {excerpt(suffix, 20) or '(no extension)'}; name it by --input-format; "
            f"known: {known}"
        )
    return suffix


# how files of a format begin that are met under another's name
_BEGINNINGS = {
    b"ply": ".ply", b"OFF": ".off", b"solid": ".stl", b"# vtk DataFile": ".vtk", b"\x89HDF": ".vtkhdf",
    b"glTF": ".glb", b"$MeshFormat": ".msh", b"MeshVersionFormatted": ".mesh",
}  # fmt: skip


def _told_apart(data: bytes, suffix: str) -> str:
    """What else a file that cannot be read seems to be, as the end of the message."""
    if data[:2] == b"\x1f\x8b":
        return "; it is compressed: unpack it (gunzip)"
    likely = next((name for begin, name in _BEGINNINGS.items() if data.startswith(begin)), suffix)
    for kind, name in ((b'type="UnstructuredGrid"', ".vtu"), (b'type="PolyData"', ".vtp")):
        likely = name if kind in data[:400] else likely
    return "" if likely == suffix else f"; it begins like a {likely} file: --input-format {likely[1:]}"


def _bytes(path: str) -> bytes:
    if path == "-":
        return sys.stdin.buffer.read()
    try:
        mode = os.stat(path).st_mode
        if stat.S_ISCHR(mode) or stat.S_ISBLK(mode):
            raise MeshFileError(f"{path}: is a device, which may have no end; name a file, or - for input")
        return Path(path).read_bytes()
    except FileNotFoundError:
        raise MeshFileError(f"{path}: no such file; check the path") from None
    except MeshFileError:
        raise
    except (OSError, ValueError) as error:
        raise MeshFileError(f"{path}: cannot be opened ({getattr(error, 'strerror', error)})") from None


def _raw(path: str, data: bytes, suffix: str) -> RawMesh:
    raw = _function(READERS[suffix])(data) if suffix in READERS else None
    if raw is not None:
        return raw
    from ddgcli.io.readers import foreign as read_foreign

    read = read_foreign.read_meshio if suffix in read_foreign.MESHIO else read_foreign.read_trimesh
    if path != "-" and Path(path).suffix.lower() == suffix:
        return read(path, suffix)
    with tempfile.TemporaryDirectory() as folder:
        copy = os.path.join(folder, f"input{suffix}")
        Path(copy).write_bytes(data)
        return read(copy, suffix)


def _function(entry: tuple[str, str]) -> Callable:
    module, name = entry
    return getattr(importlib.import_module(f"ddgcli.io.{module}"), name)


def check_output(path: str, output_format: str | None = None, *, formats: Sequence[str] | None = None) -> str:
    """The format of an output, checked before any work; `formats` are those allowed, by default the meshes'.

    Raises
    ------
    OutputError
        Unknown extension, missing folder, or a folder in the place of the file.
    """
    suffix = (
        "." + output_format.lower().lstrip(".")
        if path == "-" and output_format
        else Path(path).suffix.lower()
    )
    if path == "-" and not output_format:
        raise OutputError("-o - needs --output-format, such as --output-format ply")
    known = tuple(WRITERS) if formats is None else tuple(formats)
    if suffix not in known:
        raise OutputError(
            f"{path}: unknown format {suffix or '(no extension)'}; known here: {' '.join(known)}"
        )
    if path != "-":
        check_place(path)
    return suffix


def check_place(path: str, *, inputs: tuple[str, ...] = ()) -> None:
    """Refuse an output path in a folder that is not there, or that is one of the inputs."""
    target = Path(path)
    _check_regular(path)
    if not target.parent.is_dir():
        raise OutputError(f"{path}: folder {target.parent} does not exist; create it")
    if not os.access(target.parent, os.W_OK):
        raise OutputError(f"{path}: folder {target.parent} cannot be written to; choose another")
    for source in inputs:
        if target.exists() and os.path.exists(source) and os.path.samefile(target, source):
            raise OutputError(f"{path}: is the input itself; write to another file")


def _check_regular(path: str) -> None:
    """Refuse a pipe, socket or device: what is written whole takes the place of what is there."""
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError):  # nothing there, or not to be seen: writing will say so
        return
    if stat.S_ISDIR(mode):
        raise OutputError(f"{path}: is a folder; name a file in it")
    if not stat.S_ISREG(mode):
        raise OutputError(f"{path}: is a pipe or device, not a file; name a file, or -o - for output")


def write_mesh(path: str, annotated: AnnotatedMesh, *, output_format: str | None = None) -> None:
    """Write a mesh with its arrays, whole or not at all; the extension chooses the format.

    A `path` of `-` writes to standard output in `output_format`.
    """
    suffix = check_output(path, output_format)
    from ddgcli.io.writers.cell_data import sheet_of

    if isinstance(annotated.mesh, IntrinsicMesh) and suffix not in INTRINSIC_FORMATS:
        raise OutputError(f"{path}: {suffix} cannot hold an intrinsic triangulation; write .npz or .vtkhdf")
    try:
        data = _function(WRITERS[suffix])(sheet_of(annotated))
    except OutputError as error:
        raise OutputError(f"{path}: {error}") from error
    if path == "-":
        sys.stdout.buffer.write(data)
        sys.stdout.buffer.flush()
        return
    write_whole(path, data)


def write_whole(path: str, data: bytes) -> None:
    """Put bytes at a path, whole or not at all."""
    with written_whole(path) as partial:
        Path(partial).write_bytes(data)


@contextlib.contextmanager
def written_whole(path: str) -> Iterator[str]:
    """A temporary path beside `path` (same extension) that is renamed to it when the block ends well.

    A link is written through; permissions of a file that is replaced stay. After an error nothing is left.
    """
    _check_regular(path)
    target = Path(os.path.realpath(path))
    try:
        handle, partial = tempfile.mkstemp(dir=target.parent, prefix=f".{target.stem}-", suffix=target.suffix)
        os.close(handle)
        try:
            yield partial
            os.chmod(partial, _mode(target))
            os.replace(partial, target)
        finally:
            if os.path.exists(partial):
                os.unlink(partial)
    except OSError as error:
        raise OutputError(
            f"{path}: cannot be written ({error.strerror or error}); nothing was changed"
        ) from error


def _mode(target: Path) -> int:
    """Permissions of the file that is replaced, or what the user's mask gives a new one."""
    if target.exists():
        return target.stat().st_mode & 0o777
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask
