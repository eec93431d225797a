"""The result of a measurement: a mesh with arrays, numbers, and estimates of their error."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.library.mesh_arguments import mesh_of_kind
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.fields import AnyMesh
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.representation import short_repr


@dataclass(frozen=True, eq=False)
class Measurement:
    """Arrays on a mesh, global results, and the accuracy of both, by the names of the command line.

    Parameters
    ----------
    mesh : TriangleMesh, TetMesh, IntrinsicMesh or CurveSet
        What was measured, or the curves that were computed.
    vertex, face, edge : dict of str to ndarray
        Arrays of leading length n, m and e (`mesh.topology.edges` order).
    results : dict
        Numbers of the whole mesh, and one entry per curve under `paths`.
    accuracy : dict
        Measures of the error: residuals of identities and of solvers, estimates.
    converged : bool
        False when a computation did not reach what was required of it.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> measured = ddg.curvature(ddg.icosphere(2))
    >>> isinstance(measured, ddg.Measurement), sorted(measured.edge)
    (True, ['dihedral_angle', 'edge_mean_curvature', 'edges'])
    >>> ddg.write_mesh("sphere.vtu", measured)
    """

    mesh: AnyMesh
    vertex: dict[str, NDArray] = field(default_factory=dict)
    face: dict[str, NDArray] = field(default_factory=dict)
    edge: dict[str, NDArray] = field(default_factory=dict)
    results: dict[str, Any] = field(default_factory=dict)
    accuracy: dict[str, Any] = field(default_factory=dict)
    converged: bool = True

    __repr__ = short_repr

    @property
    def surface(self) -> TriangleMesh:
        """The mesh of a surface, or the boundary of tetrahedra; MeshError for other meshes."""
        mesh = self.mesh.boundary if isinstance(self.mesh, TetMesh) else self.mesh
        return mesh_of_kind(mesh, ("surface",), "surface")

    @property
    def polylines(self) -> list[NDArray[np.float64]]:
        """(k, 3) points of each curve in order, where curves were computed; else an empty list.

        A path without points has an empty array. Closed curves end where they begin.
        """
        if not isinstance(self.mesh, CurveSet):
            return []
        number = self.mesh.point_arrays["path_id"]
        count = len(self.results["paths"])
        return np.split(self.mesh.points, np.searchsorted(number, np.arange(1, count)))[:count]
