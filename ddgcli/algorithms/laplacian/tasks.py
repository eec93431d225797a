"""Tasks with the Laplacian of a mesh, and their result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.laplacian.laplace_operator import LaplaceOperator
from ddgcli.errors import ParameterError
from ddgcli.mesh.fields import AnnotatedMesh, surface_arrays
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh

if TYPE_CHECKING:
    from ddgcli.algorithms.conformal.conformal_map import ConformalMap


@dataclass(frozen=True, eq=False)
class LaplacianTasks:
    """Operator, mass and the tasks to solve with them.

    Parameters
    ----------
    operator, mass : str
        See `laplace_operator`.
    eigen : int, optional
        Number of eigenpairs.
    poisson : (n,) or (n, c) ndarray, optional
        Source of a Poisson problem, or of one for each column.
    harmonic : bool
        Interpolate the fixed values.
    fixed : mapping of vertex to value
    smooth : float, optional
        Time of mean curvature flow, in `smooth_steps` steps (10), by `smooth_flow` ('mean-curvature').
    parameterize : {'harmonic', 'conformal', 'discrete-conformal'}, optional
    cones : mapping of vertex to degrees
        Angle sums of a discrete conformal map.
    boundary : str, optional
        Of a discrete conformal map, as in `conformal_targets`; default 'free'.
    boundary_values : (n,) ndarray, optional
        Logarithmic scale factors or angle sums in degrees on the boundary.
    hks : sequence of float
        Times of heat kernel signatures.
    form_eigen : int, optional
        Number of eigenpairs of the Hodge Laplacian of 1-forms.
    seed : int
    """

    operator: str | None = None
    mass: str = "lumped"
    eigen: int | None = None
    poisson: NDArray | None = None
    harmonic: bool = False
    fixed: Mapping[int, float] = field(default_factory=dict)
    smooth: float | None = None
    smooth_steps: int | None = None
    smooth_flow: str | None = None
    parameterize: str | None = None
    cones: Mapping[int, float] = field(default_factory=dict)
    boundary: str | None = None
    boundary_values: NDArray | None = None
    hks: tuple[float, ...] = ()
    form_eigen: int | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        if self.harmonic and not self.fixed:
            raise ParameterError("needs fixed values; add `fixed={ID: VALUE}`", parameter="harmonic")
        if self.fixed and not self.harmonic and self.poisson is None:
            raise ParameterError("applies to `harmonic` and `poisson`; add one of them", parameter="fixed")
        for name in ("smooth_steps", "smooth_flow"):
            if getattr(self, name) is not None and self.smooth is None:
                raise ParameterError("applies to `smooth`; add `smooth=TIME`", parameter=name)
        if self.cones:
            self._require_discrete_conformal("cones")
        for name in ("boundary", "boundary_values"):
            if getattr(self, name) is not None:
                self._require_discrete_conformal(name)

    def _require_discrete_conformal(self, name: str) -> None:
        if self.parameterize != "discrete-conformal":
            raise ParameterError(
                "applies to `parameterize=discrete-conformal`; add it, or leave this out", parameter=name
            )


@dataclass(eq=False)
class LaplacianResult:
    """Arrays, results, accuracy, and whether all tasks converged; smoothing replaces `mesh`."""

    mesh: TriangleMesh | TetMesh
    operator: LaplaceOperator
    vertex: dict[str, NDArray] = field(default_factory=dict)
    face: dict[str, NDArray] = field(default_factory=dict)
    edge: dict[str, NDArray] = field(default_factory=dict)
    results: dict[str, Any] = field(default_factory=dict)
    accuracy: dict[str, Any] = field(default_factory=dict)
    converged: bool = True
    conformal: ConformalMap | None = None

    @property
    def annotated(self) -> AnnotatedMesh:
        return AnnotatedMesh(self.mesh, vertex=self.vertex, face=self.face, edge=self.edge)

    @property
    def surface(self) -> TriangleMesh:
        """The surface of a picture: the mesh, or the boundary of tetrahedra."""
        return self.mesh.boundary if isinstance(self.mesh, TetMesh) else self.mesh

    @property
    def picture_arrays(self) -> dict[str, NDArray]:
        """Arrays on the vertices and the faces of `surface`; the first is the default of a picture.

        It is a result that is not constant, on vertices if there is one, and else the size of the vertices.
        """
        size, *results = self.vertex  # vertex_area or vertex_volume
        on_faces = surface_arrays(self.mesh, self.face)
        arrays = {name: self.vertex[name] for name in results} | on_faces | {size: self.vertex[size]}
        varying = (name for name, values in arrays.items() if values.size and np.ptp(values) > 0)
        first = next(varying, next(iter(arrays)))
        return {first: arrays[first]} | arrays
