"""Mean curvature: schemes and radii, against a known truth or against two schemes' disagreement."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature_measure import measure
from ddgcli.errors import ParameterError
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.tradeoff.candidates import Candidate, Problem, Reference, relative_to_rms
from ddgcli.tradeoff.truths import Truth

# radii in mean edge lengths, cheap ones first; None is the scheme's own region
RADII: dict[str, tuple[float | None, ...]] = {
    "cotan": (None,),
    "normal-cycle": (None, 2.0, 4.0),
    "corrected": (None, 2.0, 4.0),
    "quadric": (None, 3.0),
}


def problem(mesh: TriangleMesh, *, truth: Truth | None = None, **_) -> Problem:
    """Mean curvature at the inner vertices."""
    if truth is not None and truth.mean_curvature is None:
        raise ParameterError(f"no mean curvature is known of the {truth.name}; drop --truth")
    inside = mesh.topology.referenced_vertex & ~mesh.topology.boundary_vertex
    edge = float(mesh.side_length.mean())
    if truth is not None and truth.mean_curvature is not None:
        values = np.where(inside, truth.mean_curvature(mesh.points), np.nan)
        known = Reference(f"known truth: {truth.name}", values, 1e-15, known=True)
        references = [(0.0, lambda: known)]
    else:
        references = [(_work(mesh, 3.0) * 2, lambda: _two_schemes(mesh, inside, edge))]
    return Problem(
        candidates=[
            _candidate(mesh, scheme, None if radius is None else radius * edge, radius)
            for scheme, radii in RADII.items()
            for radius in radii
        ],
        references=references,
        error=relative_to_rms,
        error_scale="the root mean square of the reference's mean curvature",
        query="mesh",
    )


def mean_curvature(mesh: TriangleMesh, scheme: str, radius: float | None) -> NDArray[np.float64]:
    """(n,) mean curvature by a scheme."""
    return measure(mesh, scheme, radius).vertex["mean_curvature"]


def _candidate(mesh: TriangleMesh, scheme: str, radius: float | None, dial: float | None) -> Candidate:
    words = f"--scheme {scheme}" + (f" --radius {radius:.6g}" if radius is not None else "")
    return Candidate(
        scheme,
        {"radius": f"{dial:g} edges" if dial is not None else "own"},
        lambda: None,
        lambda _: mean_curvature(mesh, scheme, radius),
        words,
        _work(mesh, dial),
    )


def _work(mesh: TriangleMesh, radius: float | None) -> float:
    """Guess of the seconds; balls hold a number of faces that grows with the square of their radius."""
    return 2e-2 + mesh.n_faces * (1.5e-5 if radius is None else 6e-5 * radius**2)


def _two_schemes(mesh: TriangleMesh, inside: NDArray, edge: float) -> Reference:
    """A polyhedron has no pointwise curvature: the best scheme, trusted as far as an unrelated one agrees."""
    fitted = np.where(inside, mean_curvature(mesh, "quadric", None), np.nan)
    other = mean_curvature(mesh, "corrected", 3.0 * edge)
    gap = relative_to_rms(other, fitted)[inside]
    return Reference(
        "quadric fits, as far as corrected measures in balls of 3 edges agree (root mean square)",
        fitted,
        float(np.sqrt(np.mean(gap**2))) if len(gap) else 0.0,
    )
