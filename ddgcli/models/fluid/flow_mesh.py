"""Meshes of surfaces that carry a flow, and the number of their harmonic flows."""

from __future__ import annotations

import numpy as np

from ddgcli.errors import MeshError
from ddgcli.geometry.intrinsic import face_area
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.ragged import unique_keys

FLAT_FACE_TOLERANCE = 1e-12  # area over the longest side squared, below which a face counts as flat


def harmonic_count(mesh: SurfaceMesh) -> int:
    """Number of harmonic flows: of each component 2 genus, and its boundary loops but one.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
        Oriented.

    Returns
    -------
    int
    """
    topology = mesh.topology
    n_with_boundary = len(unique_keys(topology.vertex_component[topology.boundary_vertex]))
    return 2 * (topology.genus or 0) + topology.boundary_loops - n_with_boundary


def require_flow(mesh: SurfaceMesh) -> None:
    """Raise an error for a mesh that carries no flow: not an oriented manifold, flat faces, extreme sizes.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh

    Raises
    ------
    MeshError
    """
    from ddgcli.mesh.require import refuse_flat_faces, require

    require(mesh, "fluid-sim", manifold=True, oriented=True)
    longest = mesh.side_length.max(axis=1)
    with np.errstate(all="ignore"):
        thin = face_area(mesh.side_length / longest[:, None])
    bad = np.flatnonzero(~(thin > FLAT_FACE_TOLERANCE))
    refuse_flat_faces(bad, mesh.topology, manifold=True, oriented=True)
    size = float(longest.max())
    if not 1e-60 < size < 1e60:
        raise MeshError(f"the longest side measures {size:.3g}; fluid-sim takes 1e-60 to 1e60: rescale")
