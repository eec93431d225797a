"""Surfaces brought to unit size, so that no threshold of the flow depends on the unit of length."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshError
from ddgcli.geometry.extrinsic import face_area_vector
from ddgcli.mesh.require import refuse_flat_faces, require
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import vector_length


def centred_at_unit_size(mesh: TriangleMesh) -> tuple[TriangleMesh, NDArray[np.float64], float]:
    """Bring a surface to its centre and to an area near 4 pi.

    Parameters
    ----------
    mesh : TriangleMesh

    Returns
    -------
    mesh : TriangleMesh
    centre : (3,) ndarray of float64
        Of the input.
    scale : float
        Length unit of the result in units of the input, a power of two.

    Raises
    ------
    MeshError
        When the surface is not an oriented manifold, has a face without area, or is too large or small for
        its squares to be represented.
    """
    require(mesh, "willmore-flow", manifold=True, oriented=True)
    points = mesh.points[mesh.topology.referenced_vertex]
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    extent = float(np.abs(points - centre).max())
    if not 1e-60 < extent < 1e60:
        raise MeshError(
            f"the surface measures {extent:.3g} from its centre; willmore-flow takes 1e-60 to 1e60: rescale"
        )
    unit = mesh.moved_unchecked((mesh.points - centre) / extent)
    refuse_flat_faces(unit.flat_faces, mesh.topology, manifold=True, oriented=True)
    radius = extent * math.sqrt(vector_length(face_area_vector(unit)).sum() / (4.0 * math.pi))
    scale = 2.0 ** round(math.log2(radius))
    return mesh.moved_unchecked((mesh.points - centre) / scale), centre, scale
