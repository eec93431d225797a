"""Read and write mesh files of all formats; outputs are written whole or not at all.

OBJ, OFF, PLY, STL, VTK, VTU, VTP, CSV, NPZ and VTKHDF have readers of their own, which keep the order and the
arrays of the file, check counts, and are fast. Other formats of finite element programs are read by meshio,
those of 3D graphics by trimesh, both in a guarded process (`readers.foreign`).
"""

from __future__ import annotations

import importlib
import os
import stat
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from numpy.typing import NDArray

from ddgcli.errors import InputError, MeshError, MeshFileError, OutputError, excerpt
from ddgcli.io.output_file import check_place, write_atomically
from ddgcli.io.readers.raw_mesh import RawMesh, assembled
from ddgcli.io.temporary import StagedOutputs
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.requirements import kind_error, kind_of
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.representation import short_repr

# extension -> (module, function); modules are imported on demand
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
    ".glb": ("writers.gltf", "glb_bytes"), ".csv": ("writers.table", "csv_bytes"),
}  # fmt: skip
INTRINSIC_FORMATS = (".npz", ".vtkhdf")


class ContentDigest:
    """SHA-256 of the bytes of a file, computed at its first use, which releases the bytes."""

    def __init__(self, content: bytes = b"") -> None:
        self._content: bytes | None = content
        self._digest = ""

    def sha256(self) -> str:
        """Hexadecimal digits."""
        if self._content is not None:
            import hashlib

            self._digest, self._content = hashlib.sha256(self._content).hexdigest(), None
        return self._digest


@dataclass(frozen=True, eq=False)
class MeshInput:
    """A mesh with the arrays of its file and notes about the reading.

    Parameters
    ----------
    mesh : TriangleMesh, TetMesh or CurveSet
    path : str
    digest : ContentDigest
        Of the file's bytes, which it holds until `sha256` is read.
    vertex, face, edge, whole : dict of str to ndarray
        Arrays of the file; `face` those on cells (tetrahedra, segments), repeated where polygons were
        split; `edge` in the order of the file's own `edges`.
    input_vertex : (k,) ndarray of int64, or None
        Vertex of the mesh for each vertex of the file, where the format needed a merge.
    input_face : (m,) ndarray of int64, or None
        Polygon of the file for each triangle, where polygons were split.
    notes : tuple of str
        Changes to the input: merged, triangulated, ...
    """

    mesh: TriangleMesh | TetMesh | CurveSet
    path: str
    digest: ContentDigest = field(default_factory=ContentDigest, repr=False)
    vertex: dict[str, NDArray] = field(default_factory=dict)
    face: dict[str, NDArray] = field(default_factory=dict)
    edge: dict[str, NDArray] = field(default_factory=dict)
    whole: dict[str, NDArray] = field(default_factory=dict)
    input_vertex: NDArray | None = None
    input_face: NDArray | None = None
    notes: tuple[str, ...] = ()

    __repr__ = short_repr

    @property
    def sha256(self) -> str:
        """SHA-256 of the file's bytes, hexadecimal."""
        return self.digest.sha256()

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
        raise MeshError(f"{self.path}: {kind_error(self.mesh, ('surface',), path=self.path)}")


def read_mesh(path: str, input_format: str | None = None) -> MeshInput:
    """Read a mesh file.

    Parameters
    ----------
    path : str
        `-` is standard input, which needs `input_format`.
    input_format : str, optional
        An extension, used instead of that of the path.

    Returns
    -------
    MeshInput

    Raises
    ------
    MeshFileError, MeshError
        One line that begins with the path.
    """
    suffix = format_of(path, input_format)
    data = _bytes(path)
    if not data:
        raise MeshFileError(f"{path}: the file is empty; write it again")
    try:
        raw = _raw(path, data, suffix)
        mesh, cells, polygon = assembled(raw)
    except InputError as error:
        raise type(error)(f"{path}: {error}{_format_hint(data, suffix)}") from error
    except (MemoryError, OverflowError, RecursionError) as error:
        raise MeshFileError(
            f"{path}: needs more memory than there is ({excerpt(error)}); the file is damaged"
        ) from error
    return MeshInput(
        mesh, path, ContentDigest(data), raw.vertex, cells, raw.edge, raw.whole,
        raw.input_vertex, polygon, tuple(raw.notes),
    )  # fmt: skip


def format_of(path: str, input_format: str | None = None) -> str:
    """The extension that chooses the reader; MeshFileError if no reader accepts it."""
    if input_format:
        suffix = "." + input_format.lower().lstrip(".")
    elif path == "-":
        raise MeshFileError("-: standard input needs `input_format`, such as `input_format=ply`")
    elif Path(path).is_dir():
        raise MeshFileError(f"{path}: is a folder; name a mesh file")
    else:
        suffix = Path(path).suffix.lower()
    if suffix in READERS:
        return suffix
    if suffix == ".toml":
        raise MeshFileError(f"{path}: is a scene of shell-sim or fluid-sim; name a mesh file")
    if suffix in COMPRESSED:
        raise MeshFileError(f"{path}: is compressed: unpack it ({COMPRESSED[suffix]})")
    from ddgcli.io.readers import foreign  # imports what starts processes

    if suffix not in foreign.suffixes():
        suffixes = " ".join(sorted({*READERS, *foreign.suffixes()}))
        raise MeshFileError(
            f"{path}: unknown format {excerpt(suffix, 20) or '(no extension)'}; set `input_format`; "
            f"known: {suffixes}"
        )
    return suffix


COMPRESSED = {".gz": "gunzip", ".bz2": "bunzip2", ".xz": "unxz", ".zst": "unzstd"}

# first bytes of formats, for files with a wrong extension
_BEGINNINGS = {
    b"ply": ".ply", b"OFF": ".off", b"solid": ".stl", b"# vtk DataFile": ".vtk", b"\x89HDF": ".vtkhdf",
    b"glTF": ".glb", b"$MeshFormat": ".msh", b"MeshVersionFormatted": ".mesh",
}  # fmt: skip


def _format_hint(data: bytes, suffix: str) -> str:
    """Likely format of a file that cannot be read, as the end of the message."""
    if data[:2] == b"\x1f\x8b":
        return "; it is compressed: unpack it (gunzip)"
    likely = next((name for begin, name in _BEGINNINGS.items() if data.startswith(begin)), suffix)
    for kind, name in ((b'type="UnstructuredGrid"', ".vtu"), (b'type="PolyData"', ".vtp")):
        likely = name if kind in data[:400] else likely
    return "" if likely == suffix else f"; it begins like a {likely} file: use `input_format={likely[1:]}`"


def _bytes(path: str) -> bytes:
    if path == "-":
        if sys.stdin is None:
            raise MeshFileError("-: standard input is closed; name a file")
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
        reason = str(getattr(error, "strerror", None) or error).lower()
        raise MeshFileError(f"{path}: {reason}; check the path") from None


def _raw(path: str, data: bytes, suffix: str) -> RawMesh:
    raw = _function(READERS[suffix])(data) if suffix in READERS else None
    if raw is not None:
        return raw
    import tempfile

    from ddgcli.io.readers import foreign

    read = foreign.read_meshio if suffix in foreign.MESHIO else foreign.read_trimesh
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
    """Format of an output, checked before any work.

    Parameters
    ----------
    path : str
        `-` is standard output, which needs `output_format`.
    output_format : str, optional
        An extension, used for standard output.
    formats : sequence of str, optional
        Extensions that are allowed; default those of meshes.

    Returns
    -------
    str
        Extension in lower case, with its dot.

    Raises
    ------
    OutputError
        Unknown extension, missing folder, or a folder, pipe or device in the place of the file.
    """
    suffix = (
        "." + output_format.lower().lstrip(".")
        if path == "-" and output_format
        else Path(path).suffix.lower()
    )
    if path == "-" and not output_format:
        raise OutputError("standard output (-) needs `output_format`, such as `output_format=ply`")
    suffixes = tuple(WRITERS) if formats is None else tuple(formats)
    if suffix not in suffixes:
        raise OutputError(
            f"{path}: unknown format {suffix or '(no extension)'}; known here: {' '.join(suffixes)}"
        )
    if path != "-":
        check_place(path)
    return suffix


def write_mesh(
    path: str,
    annotated: AnnotatedMesh,
    *,
    output_format: str | None = None,
    staged: StagedOutputs | None = None,
) -> None:
    """Write a mesh with its arrays, whole or not at all; the extension chooses the format.

    Parameters
    ----------
    path : str
        `-` is standard output, which needs `output_format`.
    annotated : AnnotatedMesh
    output_format : str, optional
        An extension, used for standard output.
    staged : StagedOutputs, optional
        As for `atomic_output`.

    Raises
    ------
    OutputError
        As for `check_output`; a format that cannot hold the mesh; a file that cannot be written.
    """
    suffix = check_output(path, output_format)
    from ddgcli.io.writers.cell_data import cell_data_of, warn_of_lost_edge_arrays

    if isinstance(annotated.mesh, IntrinsicMesh) and suffix not in INTRINSIC_FORMATS:
        raise OutputError(f"{path}: {suffix} cannot hold an intrinsic triangulation; write .npz or .vtkhdf")
    content = cell_data_of(annotated)
    if suffix not in INTRINSIC_FORMATS:
        warn_of_lost_edge_arrays(content, suffix)
    try:
        data = _function(WRITERS[suffix])(content)
    except OutputError as error:
        raise OutputError(f"{path}: {error}") from error
    write_atomically(path, data, staged=staged)
