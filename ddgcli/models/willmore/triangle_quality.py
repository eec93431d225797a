"""Slides and flips after a step of a flow, where they leave its gain."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.normals import sphere_normals
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.willmore.edge_flips import delaunay_flips
from ddgcli.models.willmore.redistribution import redistribute


@dataclass(frozen=True, eq=False)
class Improvement:
    """A surface after slides and flips.

    Parameters
    ----------
    mesh : TriangleMesh
    energy : float
    slides, flips : int
        1 where there were some.
    """

    mesh: TriangleMesh
    energy: float
    slides: int = 0
    flips: int = 0


def better_triangles(
    mesh: TriangleMesh,
    energy: float,
    highest: float,
    movable: NDArray[np.bool_],
    value: Callable[[TriangleMesh], float],
    restore: Callable[[TriangleMesh], TriangleMesh],
) -> Improvement:
    """Slide vertices and flip edges, each kept where the energy stays low enough.

    Parameters
    ----------
    mesh : TriangleMesh
    energy : float
        Of the mesh.
    highest : float
        Energy above which a slide or a flip is undone.
    movable : (n,) ndarray of bool
    value : callable
        TriangleMesh -> energy.
    restore : callable
        TriangleMesh -> TriangleMesh on the constraints.

    Returns
    -------
    Improvement
    """
    slides = flips = 0
    slid = redistribute(mesh, sphere_normals(mesh), movable)
    if slid is not None:
        slid = restore(slid)
        if (slid_energy := value(slid)) <= highest:
            mesh, energy, slides = slid, slid_energy, 1
    topology = delaunay_flips(mesh, movable)
    if topology is not None:
        flipped = restore(TriangleMesh(mesh.points, topology))
        if (flipped_energy := value(flipped)) <= highest:
            mesh, energy, flips = flipped, flipped_energy, 1
    return Improvement(mesh, energy, slides, flips)
