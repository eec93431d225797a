"""Mesh classes and shapes with known geometry."""

from ddgcli.library.arguments import checked_arguments
from ddgcli.library.mesh_arguments import as_mesh
from ddgcli.library.result import Measurement
from ddgcli.mesh import shapes
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh

__all__ = [
    "CurveSet",
    "IntrinsicMesh",
    "Measurement",
    "TetMesh",
    "TriangleMesh",
    "as_mesh",
    "box",
    "cylinder",
    "grid",
    "icosphere",
    "torus",
]

icosphere = checked_arguments(shapes.icosphere)
torus = checked_arguments(shapes.torus)
grid = checked_arguments(shapes.grid)
cylinder = checked_arguments(shapes.cylinder)
box = checked_arguments(shapes.box)
