"""Signed distance to curves of edges: exact for closed curves, by the signed heat method for broken ones."""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array

from ddgcli.algorithms.geodesics.edge_sets import EdgeSet
from ddgcli.algorithms.geodesics.exact.exact_distance import exact_distance
from ddgcli.algorithms.geodesics.sources import Sources, edge_lengths, no_indices
from ddgcli.algorithms.tangent_fields.vector_heat import VectorHeat
from ddgcli.choices import SIGNED_DISTANCE_METHODS
from ddgcli.errors import ParameterError
from ddgcli.geometry.intrinsic import face_area
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.geometry.unfolding import unfold
from ddgcli.linalg.constrain import Dirichlet
from ddgcli.mesh.components import connected_labels
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.ragged import unique_keys
from ddgcli.mesh.require import require
from ddgcli.mesh.topology import NEXT
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators.connection import check_tangent_planes, side_angles
from ddgcli.operators.laplacian import corner_sum, stiffness

_log = logging.getLogger("ddgcli")


@dataclass(frozen=True, eq=False)
class SignedDistance:
    """Signed distance to curves.

    Parameters
    ----------
    distance : (n,) ndarray of float64
        Negative on the left of the curves (inside, where they run counter-clockwise), zero on them; inf where
        no curve reaches.
    method : {'exact', 'heat'}
    closed : bool
        The curves separate the surface into regions of opposite sign.
    residual : float
        heat: largest relative residual of the linear systems; exact: 0.
    """

    distance: NDArray[np.float64]
    method: str
    closed: bool
    residual: float


def signed_distance(mesh: TriangleMesh, curves: EdgeSet, method: str = "auto") -> SignedDistance:
    """Signed distance from every vertex to curves of edges.

    Parameters
    ----------
    mesh : TriangleMesh
    curves : EdgeSet
        Directed edges have their negative side on the left. Undirected ones must separate the surface; the
        region of the largest area on each component is then positive.
    method : {'auto', 'exact', 'heat'}
        'exact' (polyhedral distance) needs curves that separate the surface. 'heat' diffuses the normals
        of the curves, as gaps in them allow, and integrates the normalised result. 'auto' is exact where
        it can be.

    Returns
    -------
    SignedDistance

    Raises
    ------
    ParameterError
        On exact distance to curves that do not separate the surface, on the heat method with undirected
        edges.
    MeshError
        Where the faces are not consistently oriented.

    References
    ----------
    N. Feng, K. Crane, "A heat method for generalized signed distance", 2024.
    """
    sign = check_query(mesh, curves, method)
    if sign is None:
        closed = method == "heat" and region_signs(mesh, curves) is not None
        return _heat(mesh, curves, warn=method == "auto", closed=closed)
    zero = np.zeros(len(curves), dtype=np.int64)
    distance = exact_distance(mesh, Sources(no_indices(), SurfacePoints.none(), curves.edge, zero)).distance
    of_vertex = np.ones(mesh.n_vertices)
    of_vertex[mesh.faces.ravel()] = np.repeat(sign, 3)
    return SignedDistance(np.where(distance > 0, of_vertex * distance, 0.0), "exact", True, 0.0)


def check_query(mesh: TriangleMesh, curves: EdgeSet, method: str = "auto") -> NDArray[np.float64] | None:
    """Signs of the faces for the exact method; raises the errors of `signed_distance`.

    Parameters
    ----------
    mesh : TriangleMesh
    curves : EdgeSet
    method : {'auto', 'exact', 'heat'}

    Returns
    -------
    (m,) ndarray of float64 or None
        None for the heat method.

    Raises
    ------
    ParameterError, MeshError
    """
    if method not in SIGNED_DISTANCE_METHODS:
        raise ParameterError(
            f"{method!r} is not one of {', '.join(SIGNED_DISTANCE_METHODS)}", parameter="method"
        )
    require(mesh, "signed distance", oriented=True)
    sign = None if method == "heat" else region_signs(mesh, curves)
    if sign is None and method == "exact":
        raise ParameterError(
            "the curves do not separate the surface into a negative and a positive side; use the heat method",
            parameter="curves",
        )
    if sign is None and not curves.sign.all():
        edge = mesh.topology.edges[curves.edge[int(np.argmin(np.abs(curves.sign)))]]
        raise ParameterError(
            f"the curves do not separate the surface, and edge {edge[0]}-{edge[1]} has no direction; "
            "give directed vertex pairs (the negative side on their left)",
            parameter="curves",
        )
    if sign is None:
        check_tangent_planes(mesh)
    return sign


def region_signs(mesh: TriangleMesh, curves: EdgeSet) -> NDArray[np.float64] | None:
    """(m,) sign of each face: -1 on the left of directed curves; None where no such signs exist.

    Faces joined across other edges have one sign, faces on both sides of a curve have opposite signs.
    """
    topology, m = mesh.topology, mesh.n_faces
    on_curve = np.zeros(topology.n_edges, dtype=np.int64)
    on_curve[curves.edge] = 1
    sides = topology.interior_sides
    face, across = sides // 3, topology.side_twin.ravel()[sides] // 3
    crossing = on_curve[topology.side_edge.ravel()[sides]] > 0
    # the double cover of the faces: copies f and f + m are joined across the curves
    i = np.concatenate([face, face + m])
    j = np.where(
        np.tile(crossing, 2), np.concatenate([across + m, across]), np.concatenate([across, across + m])
    )
    count, label = connected_labels(i, j, 2 * m)
    if (label[:m] == label[m:]).any():
        return None
    sign = np.where(label[:m] < label[m:], 1.0, -1.0)
    face_component = np.minimum(label[:m], label[m:])  # faces of one component of the surface
    direction = np.zeros(topology.n_edges)
    direction[curves.edge] = curves.sign
    side_direction = (direction[topology.side_edge] * topology.side_sign).ravel()
    directed = np.flatnonzero(side_direction)
    left = side_direction[directed] > 0  # the face of the side lies on the left of the curve
    vote = np.where(left, -1.0, 1.0) * sign[directed // 3]
    total = np.bincount(face_component[directed // 3], vote, minlength=count)
    is_consistent = np.abs(total) == np.bincount(face_component[directed // 3], minlength=count)
    if not is_consistent.all():
        return None
    area = np.bincount(face_component, sign * face_area(mesh.side_length), minlength=count)
    flip = np.where(total != 0, np.sign(total), np.where(area < 0, -1.0, 1.0))
    return np.asarray(sign * flip[face_component])


def _heat(mesh: TriangleMesh, curves: EdgeSet, *, warn: bool, closed: bool) -> SignedDistance:
    """Signed heat method: diffuse the curves' normals, normalise on faces, integrate; zero on the curves."""
    if warn:
        _log.warning("the curves do not separate the surface: signed distance by the signed heat method")
    vertex, start = _curve_normals(mesh, curves)
    solver = VectorHeat(mesh)
    transported = solver.transport(vertex, start)
    # Steiner points on the boundary are needed here too: the flat faces at an edge that they cut would force
    # the function to be linear along it
    is_split = solver.mesh.n_vertices > mesh.n_vertices
    work, field = (solver.mesh, transported.extended) if is_split else (mesh, transported.vector)
    ends = unique_keys(mesh.topology.edges[curves.edge])
    component = work.topology.vertex_component
    reached = np.isin(component, component[ends]) & work.topology.referenced_vertex
    fixed = ~reached
    fixed[ends] = True
    system = Dirichlet(csc_array(stiffness(work)), fixed)
    rhs = _integrated_slope(work, field)
    distance = system.solve(np.zeros(len(system.fixed)), rhs)
    residual = max(transported.residual, float(system.residual(distance, rhs)))
    distance = np.where(reached, distance, np.inf)[: mesh.n_vertices]
    return SignedDistance(distance, "heat", closed, residual)


def _integrated_slope(mesh: SurfaceMesh, field: NDArray) -> NDArray[np.float64]:
    """(n,) integral over the faces of the gradients of the hats times the directions of a vertex field.

    The field on a face is the normalised sum of those at its corners.
    """
    at_tail, _ = side_angles(mesh)
    direction = unfold(mesh).direction.reshape(-1, 2) @ np.array([1.0, 1j])
    corner = field[mesh.faces.ravel()] * direction * np.exp(-1j * at_tail)
    in_face = corner.reshape(-1, 3).sum(axis=1)
    size = np.abs(in_face)
    unit = np.divide(in_face, size, out=np.zeros_like(in_face), where=size > 0)
    side = mesh.side_length * direction.reshape(-1, 3)
    # area times the gradient of a hat: half of the opposite side, turned by a right angle
    return corner_sum(mesh, 0.5 * (side[:, NEXT].conj() * unit[:, None]).imag)


def _curve_normals(mesh: TriangleMesh, curves: EdgeSet) -> tuple[NDArray[np.int64], NDArray[np.complex128]]:
    """Vertices of the curves, and their normals to the right integrated over half of each edge."""
    topology = mesh.topology
    at_tail, at_head = side_angles(mesh)
    direction = np.zeros(topology.n_edges)
    direction[curves.edge] = curves.sign
    edge, first = np.unique(topology.side_edge.ravel(), return_index=True)
    side = first[np.searchsorted(edge, curves.edge)]
    along = direction[curves.edge] * topology.side_sign.ravel()[side]
    half = 0.5 * edge_lengths(mesh)[curves.edge] * along
    vertex = np.concatenate([topology.side_tail[side], topology.side_head[side]])
    angle = np.concatenate([at_tail[side], at_head[side] + np.pi])
    value = np.tile(half, 2) * np.exp(1j * (angle - 0.5 * np.pi))
    unique, of = np.unique(vertex, return_inverse=True)
    total = np.bincount(of, value.real) + 1j * np.bincount(of, value.imag)
    return unique, total
