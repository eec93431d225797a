"""Size of an input, and one use of a kernel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from ddgcli.choices import ITERATIVE_SOLVERS
from ddgcli.cli.forecast.facts import (
    CurvatureFacts,
    DelaunayFacts,
    GeodesicFacts,
    LaplacianFacts,
    TradeoffFacts,
)

__all__ = ["KNOWN", "InputSize", "Range", "Use", "iterative_suffix"]

Range = tuple[float, float]

KNOWN: Range = (1.0, 1.0)


@dataclass(frozen=True)
class InputSize:
    """Size of an input, and its properties on which the cost of single commands depends.

    Parameters
    ----------
    kind : {'surface', 'tetrahedra', 'curve'}
    elements : int
        Number of faces, tetrahedra or points of curves, summed over several inputs.
    steps : int, optional
        Number of steps of a simulation, if known.
    adaptive : bool
        Whether `steps` counts frames, between which the steps are adaptive.
    frame_count : int
        Frames that are written or drawn.
    component_elements : int, optional
        Elements of the largest connected component; default all.
    picture_share : float
        Fraction of the pixels of a picture that show the surface.
    n_curves : int
        Number of curves of `curve-flow`.
    betti_number : int
        Number of harmonic fields of `hodge`.
    hole_triangles : float
        Triangles among which `repair` chooses the fillings of the holes.
    curvature, delaunay, geodesic, laplacian, tradeoff
        Properties on which the cost of these commands depends.
    """

    kind: str
    elements: int
    steps: int | None = None
    adaptive: bool = False
    frame_count: int = 1
    component_elements: int | None = None
    picture_share: float = 0.5
    n_curves: int = 1
    betti_number: int = 0
    hole_triangles: float = 0.0
    curvature: CurvatureFacts = CurvatureFacts()
    delaunay: DelaunayFacts = DelaunayFacts()
    geodesic: GeodesicFacts = GeodesicFacts()
    laplacian: LaplacianFacts = LaplacianFacts()
    tradeoff: TradeoffFacts = TradeoffFacts()

    def with_curvature(self, **facts: Any) -> InputSize:
        """A copy with other values for `curvature`."""
        return replace(self, curvature=replace(self.curvature, **facts))

    def with_geodesic(self, **facts: Any) -> InputSize:
        """A copy with other values for `geodesic`."""
        return replace(self, geodesic=replace(self.geodesic, **facts))


@dataclass(frozen=True)
class Use:
    """One use of a kernel of the table `COEFFICIENTS`.

    Parameters
    ----------
    kernel : str
    times : float
        Factor of its seconds.
    added : float
        Factor of its memory that other kernels do not free; 0: the kernels of a command share memory, and
        the largest counts.
    elements : float, optional
        On which it works, where these are not the elements of the input.
    range : (float, float)
        Least and largest factor of `times`, where only the run shows how long it is.
    assumes : str
        What `times` takes for granted, where only the run shows it.
    once : bool
        `times` counts the part of its seconds that grows with the elements only, not the constant one.
    """

    kernel: str
    times: float = 1.0
    added: float = 0.0
    elements: float | None = None
    range: Range = KNOWN
    assumes: str = ""
    once: bool = False


def iterative_suffix(options: Mapping[str, Any]) -> str:
    """Suffix of the names of kernels that solve linear systems iteratively; "" for factorisations."""
    return f" {options['solver']}" if options.get("solver") in ITERATIVE_SOLVERS else ""
