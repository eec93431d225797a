"""Known truths of `willmore-flow`, for the atlas: energies, and the decay of a mode of the sphere."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.atlas.trial import Case, Trial, known_truth, last_frame
from benchmarks.common.mesh_classes import ellipsoids
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.willmore import setup
from ddgcli.models.willmore.energies import ENERGIES
from ddgcli.operators.laplacian import lumped_vertex_area
from ddgcli.simulation.account import Account
from ddgcli.tradeoff.candidates import Candidate

# int H^2 of half axes 1, 1, 2: with w = 4 - 3 t^2, t the cosine of the parameter along the meridian, it is
# 4 pi int_0^1 w^(-1/2) (1 + 1/w)^2 dt, and the three powers of w integrate to pi / sqrt(27), 1/4 and 1/8
ELLIPSOID_112 = 4 * math.pi * (math.pi / math.sqrt(27) + 2 / 4 + 1 / 8)
TORUS_2 = 22.7928750311
RATE, SPAN, BUMP = 12.0, 0.5 / 12, 1e-4
SMOOTH_ENERGIES = ("gauss-map", "sullivan", "cotan")


def _energy_trial(make: Callable[[int], TriangleMesh], truth: float, level: int) -> Trial:
    mesh = make(level)
    candidates = [
        Candidate(
            name,
            {},
            partial(kind.of, mesh),
            lambda energy: np.array([energy.value(mesh.points)]),
            {"energy": name},
            1e-6 * mesh.n_faces,
        )
        for name, kind in ENERGIES.items()
    ]
    return known_truth(mesh.n_faces, float(mesh.side_length.mean()), truth, candidates)


def _torus_energy(pattern: str) -> Callable[[int], Trial]:
    def make(level: int) -> TriangleMesh:
        return shapes.torus(24 * 2**level, 12 * 2**level, 2.0, 1.0, pattern=pattern)

    return partial(_energy_trial, make, TORUS_2)


def _bumpy(mesh: TriangleMesh) -> TriangleMesh:
    z = mesh.points[:, 2]
    return mesh.moved(mesh.points * (1 + BUMP * (3 * z**2 - 1) / 2)[:, None])


def _mode_flow(start: TriangleMesh, energy: str, steps: int) -> Any:
    flow, model = setup.build(start, setup.FlowOptions(energy=energy, timed=True))
    times = {"step": SPAN / steps, "duration": SPAN, "frame_every": SPAN}
    return {"s": model}, setup.schedule(flow, times), Account()


def _decay(mesh: TriangleMesh, start: TriangleMesh, ready: Any) -> NDArray[np.float64]:
    """Rate at which the bump of degree two has decayed."""
    weight = lumped_vertex_area(mesh) * (3 * mesh.points[:, 2] ** 2 - 1)
    begun, left = (
        float((weight * (r - r.mean())).sum())
        for r in (np.linalg.norm(points, axis=1) for points in (start.points, last_frame(ready).points))
    )
    return np.array([-np.log(left / begun) / SPAN if left > 0 else np.inf])


def _mode_by_mesh(level: int) -> Trial:
    mesh = shapes.icosphere(level + 1)
    start = _bumpy(mesh)
    candidates = [
        Candidate(
            energy,
            {"dt": float(f"{SPAN / steps:.2g}")},
            partial(_mode_flow, start, energy, steps),
            partial(_decay, mesh, start),
            {"energy": energy, "dt": f"{SPAN / steps:.3g}"},
            steps * (4e-3 + 8e-6 * mesh.n_faces),
        )
        for energy in SMOOTH_ENERGIES
        for steps in (4, 32)
    ]
    return known_truth(mesh.n_faces, float(mesh.side_length.mean()), RATE, candidates)


@lru_cache
def _mode_limit(energy: str) -> NDArray[np.float64]:
    mesh = shapes.icosphere(2)
    start = _bumpy(mesh)
    return _decay(mesh, start, _mode_flow(start, energy, 256))


def _mode_by_step(level: int) -> Trial:
    """The rate against the same energy's limit of small steps: the error in time alone."""
    mesh, steps = shapes.icosphere(2), 2 ** (level + 2)
    start = _bumpy(mesh)

    def rate(energy: str, ready: Any) -> NDArray[np.float64]:
        return RATE + _decay(mesh, start, ready) - _mode_limit(energy)

    candidates = [
        Candidate(
            energy,
            {},
            partial(_mode_flow, start, energy, steps),
            partial(rate, energy),
            {"energy": energy, "dt": f"{SPAN / steps:.3g}"},
            steps * 6e-3,
        )
        for energy in SMOOTH_ENERGIES
    ]
    return known_truth(mesh.n_faces, SPAN / steps, RATE, candidates)


WILLMORE = [
    *(
        Case("energy of the ellipsoid 1,1,2", mesh_class, partial(_energy_trial, make, ELLIPSOID_112))
        for mesh_class, make in ellipsoids((1.0, 1.0, 2.0)).items()
    ),
    Case("energy of the torus 2,1", "alternating", _torus_energy("alternating")),
    Case("energy of the torus 2,1", "right", _torus_energy("right")),
    Case("rate of the sphere's mode l=2", "meshes", _mode_by_mesh),
    Case("limit of small steps", "steps", _mode_by_step),
]
