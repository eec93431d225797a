"""Mesh classes and shapes with known geometry."""

from ddgcli.library.mesh_arguments import as_mesh
from ddgcli.library.result import Measurement
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.shapes import box, cylinder, grid, icosphere, torus
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
