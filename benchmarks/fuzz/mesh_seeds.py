"""Small valid mesh files that are mutated: as we write them, as texts, and as other programs write them."""

from __future__ import annotations

import contextlib
import itertools
import struct
import tempfile
import zlib
from base64 import b64encode
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import DdgError


def mesh_seeds(suffix: str) -> list[bytes]:
    """Small valid files of a format: texts, those of other programs, ours with arrays, tetrahedra, curves."""
    from ddgcli.mesh import shapes
    from ddgcli.mesh.curve import CurveSet
    from ddgcli.mesh.fields import AnnotatedMesh
    from ddgcli.mesh.tet_mesh import TetMesh

    ball = shapes.icosphere(0)
    arrays = {"f": ball.points[:, 2], "v": ball.points, "k": np.arange(ball.n_vertices)}
    corners = np.vstack([np.zeros(3), np.eye(3)])
    meshes = [
        AnnotatedMesh(ball, arrays, {"face": np.arange(20)}),
        AnnotatedMesh(TetMesh.from_arrays(corners, np.array([[0, 1, 2, 3]])), {"f": np.arange(4.0)}),
        AnnotatedMesh(CurveSet.from_arrays(corners, np.array([[0, 1], [1, 2], [2, 0]]))),
    ]
    if suffix == ".csv":  # what we write there is a table of vertices, which holds no mesh
        return [CLOSED_CURVE.encode()]
    texts = [TEXTS[suffix](ball.points, ball.faces)] if suffix in TEXTS else []
    foreign = FOREIGN[suffix]() if suffix in FOREIGN else []
    return (
        [text.encode() for text in texts]
        + foreign
        + [data for mesh in meshes for data in _written(mesh, suffix)]
    )


def _written(mesh: Any, suffix: str) -> list[bytes]:
    """The file of a mesh; none in a format that cannot hold it."""
    from ddgcli.io.mesh_file import WRITERS, write_mesh

    if suffix not in WRITERS:
        return []
    with tempfile.TemporaryDirectory() as folder, contextlib.suppress(DdgError):
        path = Path(folder) / f"a{suffix}"
        write_mesh(str(path), mesh)
        return [path.read_bytes()]
    return []


def _rows(numbers: NDArray, first: str = "") -> str:
    return "\n".join(first + " ".join(f"{x:.3g}" for x in row) for row in numbers)


def _ply_text(points: NDArray, faces: NDArray) -> str:
    axes = "".join(f"property float {c}\n" for c in "xyz")
    return (
        f"ply\nformat ascii 1.0\nelement vertex {len(points)}\n{axes}element face {len(faces)}\n"
        f"property list uchar int vertex_indices\nend_header\n{_rows(points)}\n{_rows(faces, '3 ')}\n"
    )


def _vtk_text(points: NDArray, faces: NDArray) -> str:
    return (
        f"# vtk DataFile Version 3.0\na\nASCII\nDATASET POLYDATA\nPOINTS {len(points)} float\n"
        f"{_rows(points)}\nPOLYGONS {len(faces)} {4 * len(faces)}\n{_rows(faces, '3 ')}\n"
        f"POINT_DATA {len(points)}\nSCALARS s int 1\nLOOKUP_TABLE default\n{'1 ' * len(points)}\n"
    )


def _xml_array(name: str, kind: str, values: NDArray, components: int = 1) -> str:
    return (
        f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{components}" format="ascii">\n'
        f"{_rows(values.reshape(len(values), -1))}\n</DataArray>\n"
    )


def _xml_text(kind: str, counts: str, cells: str) -> Callable[[NDArray, NDArray], str]:
    def text(points: NDArray, faces: NDArray) -> str:
        types = _xml_array("types", "UInt8", np.full(len(faces), 5)) if kind == "UnstructuredGrid" else ""
        numbers = counts.format(len(points), len(faces))
        return (
            f'<VTKFile type="{kind}" version="1.0" byte_order="LittleEndian"><{kind}><Piece {numbers}>\n'
            f"<Points>{_xml_array('Points', 'Float64', points, 3)}</Points>\n"
            f"<PointData>{_xml_array('f', 'Float32', points[:, 0])}</PointData>\n"
            f"<{cells}>{_xml_array('connectivity', 'Int64', faces)}"
            f"{_xml_array('offsets', 'Int32', 3 * np.arange(1, len(faces) + 1))}{types}</{cells}>\n"
            f"</Piece></{kind}></VTKFile>\n"
        )

    return text


CLOSED_CURVE = "x,y,z\n0,0,0\n1,0,0\n1,1,0\n0,0,0\n"
TEXTS: dict[str, Callable[[NDArray, NDArray], str]] = {
    ".wkt": lambda points, faces: "TIN (((0 0 0, 1 0 0, 0 1 0, 0 0 0)), ((1 0 0, 1 1 0, 0 1 0, 1 0 0)))",
    ".stl": lambda points, faces: (
        "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\n"
        "endfacet\nendsolid a\n"
    ),
    ".obj": lambda points, faces: (
        "mtllib a.mtl\nv 0 0 0 1 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nvt 0 0\nvn 0 0 1\no a\ng b\nusemtl m\n"
        "f 1/1/1 2/1/1 -2/-1/-1\nf 2//1 4//1 3//1\nl 1 2 3\n"
    ),
    ".ply": _ply_text,
    ".vtk": _vtk_text,
    ".vtu": _xml_text("UnstructuredGrid", 'NumberOfPoints="{}" NumberOfCells="{}"', "Cells"),
    ".vtp": _xml_text("PolyData", 'NumberOfPoints="{}" NumberOfPolys="{}"', "Polys"),
}


PLY_APPEARANCE = """ply
format ascii 1.0
comment strips, colours, texture coordinates, edges
element vertex 4
property float x
property float y
property float z
property float s
property float t
property uchar red
property uchar green
property uchar blue
property uchar alpha
property float n_x
property float n_y
property float n_z
element face 1
property list uchar uint vertex_indices
property list uchar float texcoord
property uchar flags
element edge 1
property int vertex1
property int vertex2
property float crease
end_header
0 0 0 0 0 255 0 0 255 0 0 1
1 0 0 1 0 255 0 0 255 0 0 1
0 1 0 0 1 255 9 0 255 0 0 1
1 1 0 1 1 255 0 9 255 0 0 1
3 0 1 2 6 0 0 1 0 0 1 7
0 1 0.5
"""
PLY_STRIPS = """ply
format ascii 1.0
element vertex 5
property double x
property double y
property double z
element tristrips 1
property list int int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
1 1 0
0 2 0
8 0 1 2 3 -1 2 3 4
"""
OFF_COLOURS = """COFF
# a comment
4 1 0
0 0 0 255 0 0 255
1 0 0 0 0 0 1
1 1 0 0 0 0 1
0 1 0 0 0 0 1
4 0 1 2 3 0.5 0.5 0.5
"""
OFF_NORMALS = """STNOFF 3 1 3
0 0 0 0 0 1 0 0
1 0 0 0 0 1 1 0
0 1 0 0 0 1 0 1
3 0 1 2
"""
VTK_MIXED = """# vtk DataFile Version 2.0
a
ASCII
DATASET UNSTRUCTURED_GRID
POINTS 5 double
0 0 0 1 0 0 0 1 0 1 1 0 0 2 0
CELLS 3 14
3 0 1 2 4 1 3 4 2 4 0 1 2 3
CELL_TYPES 3
5 9 6
CELL_DATA 3
FIELD attributes 2
f 1 3 float
1 2 3
name 2 3 int
1 2 3 4 5 6
POINT_DATA 5
NORMALS n float
0 0 1 0 0 1 0 0 1 0 0 1 0 0 1
TEXTURE_COORDINATES uv 2 float
0 0 1 0 0 1 1 1 0 2
COLOR_SCALARS c 3
0 0 1 0 0 1 0 0 1 0 0 1 0 0 1
"""
VTK_STRIPS = """# vtk DataFile Version 5.1
a
ASCII
DATASET POLYDATA
POINTS 4 float
0 0 0 1 0 0 0 1 0 1 1 0
METADATA
INFORMATION 0

VERTICES 2 1
OFFSETS vtktypeint64
0 1
CONNECTIVITY vtktypeint64
3
LINES 2 2
OFFSETS vtktypeint64
0 2
CONNECTIVITY vtktypeint64
0 3
TRIANGLE_STRIPS 2 4
OFFSETS vtktypeint64
0 4
CONNECTIVITY vtktypeint64
0 1 2 3
"""


def _ply_big_endian() -> bytes:
    header = PLY_APPEARANCE.split("end_header\n")[0].replace("ascii", "binary_big_endian")
    corners = [(0, 0), (1, 0), (0, 1), (1, 1)]
    vertices = b"".join(struct.pack(">5f4B3f", *c, 0, *c, 255, 0, 0, 255, 0, 0, 1) for c in corners)
    face = struct.pack(">B3IB6fB", 3, 0, 1, 2, 6, 0, 0, 1, 0, 0, 1, 7)
    return f"{header}end_header\n".encode() + vertices + face + struct.pack(">iif", 0, 1, 0.5)


def _off_binary(order: str, colour_counts: bool) -> bytes:
    numbers = struct.pack(f"{order}3i9f", 3, 1, 3, 0, 0, 0, 1, 0, 0, 0, 1, 0)
    face = (3, 0, 1, 2, 0) if colour_counts else (3, 0, 1, 2)
    return b"OFF BINARY\n" + numbers + struct.pack(f"{order}{len(face)}i", *face)


def _vtk_binary() -> bytes:
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], dtype=">f4").tobytes()
    head = b"# vtk DataFile Version 3.0\na\nBINARY\nDATASET POLYDATA\nPOINTS 3 float\n"
    cells = np.array([3, 0, 1, 2], dtype=">i4").tobytes()
    values = np.array([1.0, 2.0, 3.0], dtype=">f8").tobytes()
    data = b"POINT_DATA 3\nFIELD FieldData 1\nf 1 3 double\n" + values
    return head + points + b"\nPOLYGONS 1 4\n" + cells + b"\n" + data + b"\n"


def _packed(content: bytes, pack: str, compressed: bool) -> bytes:
    """Bytes of an array of a VTK file: a header of its size and the content, each in base64 or raw."""
    if compressed:
        body = zlib.compress(content)
        header = struct.pack("<4I", 1, len(content), 0, len(body))
    else:
        header, body = struct.pack("<I", len(content)), content
    if pack == "raw":
        return header + body
    return b64encode(header) + b64encode(body) if compressed else b64encode(header + body)


def _xml_file(kind: str, place: str, compressed: bool) -> bytes:
    """Two pieces of one triangle each; arrays `inline` (base64), or appended `base64` or `raw`."""
    appended = b""

    def array(name: str, values: Any, dtype: str, vtk_type: str, components: int = 1) -> bytes:
        nonlocal appended
        content = _packed(
            np.asarray(values, dtype=dtype).tobytes(), "base64" if place == "inline" else place, compressed
        )
        words = f'<DataArray type="{vtk_type}" Name="{name}" NumberOfComponents="{components}" '
        if place == "inline":
            return f'{words}format="binary">'.encode() + content + b"</DataArray>"
        offset, appended = len(appended), appended + content
        return f'{words}format="appended" offset="{offset}"/>'.encode()

    grid = kind == "UnstructuredGrid"
    cells, count = ("Cells", "NumberOfCells") if grid else ("Polys", "NumberOfPolys")
    pieces = b""
    for x in (0.0, 2.0):
        points = [[x, 0, 0], [x + 1, 0, 0], [x, 1, 0]]
        types = array("types", [5], "u1", "UInt8") if grid else b""
        pieces += (
            f'<Piece NumberOfPoints="3" {count}="1"><PointData Scalars="f">'.encode()
            + array("f", [x, 1, 2], "<f4", "Float32")
            + b"</PointData><Points>"
            + array("Points", points, "<f8", "Float64", 3)
            + f"</Points><{cells}>".encode()
            + array("connectivity", [0, 1, 2], "<i8", "Int64")
            + array("offsets", [3], "<i4", "Int32")
            + types
            + f"</{cells}></Piece>".encode()
        )
    packer = ' compressor="vtkZLibDataCompressor"' if compressed else ""
    head = f'<VTKFile type="{kind}" version="0.1" byte_order="LittleEndian"{packer}><{kind}>'.encode()
    tail = (
        b""
        if place == "inline"
        else f'<AppendedData encoding="{place}">_'.encode() + appended + b"</AppendedData>"
    )
    return head + pieces + f"</{kind}>".encode() + tail + b"</VTKFile>\n"


def _xml_files(kind: str) -> list[bytes]:
    return [
        _xml_file(kind, place, packed)
        for place, packed in itertools.product(("inline", "base64", "raw"), (False, True))
    ]


FOREIGN: dict[str, Callable[[], list[bytes]]] = {
    ".ply": lambda: [PLY_APPEARANCE.encode(), PLY_STRIPS.encode(), _ply_big_endian()],
    ".off": lambda: [
        OFF_COLOURS.encode(),
        OFF_NORMALS.encode(),
        _off_binary("<", False),
        _off_binary(">", True),
    ],
    ".vtk": lambda: [VTK_MIXED.encode(), VTK_STRIPS.encode(), _vtk_binary()],
    ".vtu": lambda: _xml_files("UnstructuredGrid"),
    ".vtp": lambda: _xml_files("PolyData"),
}
