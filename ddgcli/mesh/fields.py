"""Results: a mesh with named arrays, and a frame of a trajectory."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from numpy.typing import NDArray

from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh

AnyMesh = TriangleMesh | TetMesh | IntrinsicMesh | CurveSet


@dataclass(frozen=True, eq=False)
class AnnotatedMesh:
    """A mesh and its named arrays; files use the same names.

    Parameters
    ----------
    mesh : TriangleMesh, TetMesh, IntrinsicMesh or CurveSet
    vertex, face, edge : dict of str to ndarray
        Arrays of leading length n, m (cells, for tetrahedra) and e (`topology.edges` order).
    whole : dict of str to ndarray
        Arrays that belong to the whole mesh.
    metadata : dict of str to str
        Provenance: command line, version, input and its SHA-256, options.
    """

    mesh: AnyMesh
    vertex: dict[str, NDArray] = field(default_factory=dict)
    face: dict[str, NDArray] = field(default_factory=dict)
    edge: dict[str, NDArray] = field(default_factory=dict)
    whole: dict[str, NDArray] = field(default_factory=dict)
    metadata: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Frame:
    """One frame of a trajectory.

    Parameters
    ----------
    step : int
    time : float
        Seconds.
    points : (n, 3) ndarray, or None where the surface does not move
    vertex : dict of str to ndarray
    scalar : dict of str to float
        Energies, momenta, step size, iterations, residuals.
    """

    step: int
    time: float
    points: NDArray | None
    vertex: dict[str, NDArray] = field(default_factory=dict)
    scalar: dict[str, float] = field(default_factory=dict)
