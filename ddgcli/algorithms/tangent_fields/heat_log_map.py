"""Logarithmic map by the vector heat method: the cheapest for many sources, with the largest error.

The angle of a vertex is that between the gradient of the distance there and the source's x axis, transported
to the vertex (N. Sharp, Y. Soliman, K. Crane, "The Vector Heat Method", 2019, section 8.2; they diffuse the
radial direction too, where this map takes the gradient). With the factors of a mesh a further source costs
three pairs of triangular solves.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ddgcli.algorithms.geodesics.sources import Sources
from ddgcli.algorithms.tangent_fields.log_map import LogMap, SourceFrame, require_single_source
from ddgcli.algorithms.tangent_fields.polar_coordinates import submesh_near_source
from ddgcli.algorithms.tangent_fields.vector_heat import VectorHeat
from ddgcli.algorithms.tracing.trace import Tracer
from ddgcli.errors import ParameterError
from ddgcli.geometry.intrinsic import face_area
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators.connection import vertex_axes
from ddgcli.operators.gradient import gradient


def vertex_gradient(mesh: TriangleMesh) -> csr_array:
    """(n, n) complex matrix: gradient of a vertex function in the vertices' frames, times a positive number.

    The sum over the faces around a vertex of their gradients, weighted by area, in its tangent plane.
    """
    x, y = vertex_axes(mesh)
    vertex = mesh.faces.ravel()
    face = np.repeat(np.arange(mesh.n_faces), 3)
    longest = float(mesh.side_length.max(initial=0.0)) or 1.0  # squares of tiny sides would underflow
    area = face_area(mesh.side_length / longest)[face]
    values = (x[vertex] + 1j * y[vertex]) * area[:, None]
    columns = 3 * face[:, None] + np.arange(3)
    shape = mesh.n_vertices, 3 * mesh.n_faces
    onto_vertices = csr_array((values.ravel(), (np.repeat(vertex, 3), columns.ravel())), shape=shape)
    return csr_array(onto_vertices @ gradient(mesh))


def require_source_vertex(sources: Sources) -> None:
    """Raise an error unless there is one source, at a vertex.

    Parameters
    ----------
    sources : Sources

    Raises
    ------
    ParameterError
    """
    require_single_source(sources)
    if not len(sources.vertex):
        raise ParameterError(
            "the source of a map by heat must be a vertex; for a point use `method=exact` or "
            "`method=fast-marching`",
            parameter="sources",
        )


def heat_log_map(
    mesh: TriangleMesh,
    distance: NDArray,
    sources: Sources,
    *,
    transport: VectorHeat | None = None,
    slope: csr_array | None = None,
) -> LogMap:
    """Logarithmic map of one source vertex at all vertices, by vector heat.

    Parameters
    ----------
    mesh : TriangleMesh
        Consistently oriented.
    distance : (n,) ndarray
        From that source, e.g. by the heat method; it is the norm of the map.
    sources : Sources
        One vertex.
    transport : VectorHeat, optional
        Of this mesh, shared by several sources.
    slope : csr_array, optional
        `vertex_gradient(mesh)`, shared by several sources.

    Returns
    -------
    LogMap

    Raises
    ------
    ParameterError
        The source is not one vertex.
    """
    require_source_vertex(sources)
    transport = VectorHeat(mesh) if transport is None else transport
    slope = vertex_gradient(mesh) if slope is None else slope
    at_source = np.zeros(mesh.n_vertices, dtype=bool)
    at_source[sources.vertex] = True
    _, fan, at = submesh_near_source(mesh, at_source, sources)
    axis = SourceFrame(Tracer(fan), at).axis()
    reached = np.isfinite(distance)
    lengths = np.where(reached, distance, 0.0)
    x_axis = transport.transport(sources.vertex, np.ones(1, dtype=np.complex128)).vector
    direction = (slope @ lengths) * x_axis.conj()
    size = np.abs(direction)
    unit = np.divide(direction, size, out=np.ones_like(direction), where=size > 0)
    mapped = lengths * unit
    coordinates = np.stack([mapped.real, mapped.imag], axis=1)
    coordinates[~reached] = np.inf
    return LogMap(coordinates, axis)
