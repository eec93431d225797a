"""Decompositions of the components of a solid as one decomposition."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.hodge.decomposition import HodgeDecomposition
from ddgcli.mesh.solid_components import SolidComponent
from ddgcli.mesh.tet_mesh import TetMesh


def component_indices(component: SolidComponent, place: str) -> NDArray[np.int64]:
    """Indices of the values of a component in a field of the whole mesh.

    Parameters
    ----------
    component : SolidComponent
    place : {'vertex', 'cell', 'edge'}

    Returns
    -------
    ndarray of int64
    """
    return {"vertex": component.vertices, "cell": component.tetrahedra, "edge": component.edges}[place]


def joined_decomposition(
    mesh: TetMesh, components: Sequence[SolidComponent], splits: Sequence[HodgeDecomposition], place: str
) -> HodgeDecomposition:
    """Decomposition of a field in a solid, from those in its components.

    Parameters
    ----------
    mesh : TetMesh
    components : sequence of SolidComponent
        All of the mesh.
    splits : sequence of HodgeDecomposition
        One for each component.
    place : {'vertex', 'cell', 'edge'}
        Place of the field.

    Returns
    -------
    HodgeDecomposition
        Residuals are those of the worst component, relative to the field there; values are zero at vertices
        of no tetrahedron.
    """
    counts = {"vertex": mesh.n_vertices, "cell": len(mesh.tetrahedra), "edge": len(mesh.edges)}
    numbers = [component_indices(component, place) for component in components]

    def joined(name: str) -> NDArray[np.float64]:
        return _scattered(counts[place], numbers, [getattr(split, name) for split in splits])

    def worst(name: str) -> float:
        return max(getattr(split, name) for split in splits)

    norms = {name: [split.norms[name] for split in splits] for name in splits[0].norms}
    with np.errstate(over="ignore"):
        norm = {name: float(np.hypot.reduce(values)) for name, values in norms.items()}
    potentials = [split.potential for split in splits]
    copotentials = [split.copotential for split in splits if split.copotential is not None]
    triangles = [component.triangles for component in components]
    return HodgeDecomposition(
        exact=joined("exact"),
        coexact=joined("coexact"),
        harmonic=joined("harmonic"),
        potential=_scattered(mesh.n_vertices, [component.vertices for component in components], potentials),
        copotential=_scattered(len(mesh.triangles), triangles, copotentials) if copotentials else None,
        norms=norm,
        orthogonality=worst("orthogonality"),
        reconstruction_residual=worst("reconstruction_residual"),
        harmonic_residual=worst("harmonic_residual"),
    )


def _scattered(count: int, numbers: Sequence[NDArray], values: Sequence[NDArray]) -> NDArray[np.float64]:
    """(count, ...) values of the components at their numbers, zero elsewhere."""
    whole = np.zeros((count, *values[0].shape[1:]))
    whole[np.concatenate(numbers)] = np.concatenate(values)
    return whole
