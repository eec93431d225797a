"""Hinges: the interior edges of a surface with their two faces, their angles, and the form of bending."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.intrinsic import corner_cotan
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.scatter import columns_at
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.vectors import cross, dot


def hinges(topology: Topology) -> NDArray[np.int64]:
    """Hinges of a surface: the vertices of every edge with two faces that agree in orientation.

    Parameters
    ----------
    topology : Topology

    Returns
    -------
    (h, 4) ndarray of int64
        Vertices x0, x1, x2, x3: x0 x1 is the edge, x2 the apex of the face (x0, x1, x2), x3 that of
        (x1, x0, x3).

    Examples
    --------
    >>> hinges(Topology(np.array([[0, 1, 2], [2, 1, 3]]), 4)).tolist()
    [[1, 2, 0, 3]]
    """
    faces, tail, head = topology.faces, topology.side_tail, topology.side_head
    side, other = hinge_sides(topology)
    apex = faces[side // 3, (side % 3 + 2) % 3]
    apex_other = faces[other // 3, (other % 3 + 2) % 3]
    return np.stack([tail[side], head[side], apex, apex_other], axis=1)


def hinge_sides(topology: Topology) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Both sides of every hinge.

    Parameters
    ----------
    topology : Topology

    Returns
    -------
    first, second : (h,) ndarray of int64
        Flat side indices 3*face + j in both faces; the edge x0 x1 of `hinges` runs along the first.
    """
    side = topology.interior_sides
    other = topology.side_twin.ravel()[side]
    agree = topology.side_tail[side] == topology.side_head[other]
    return side[agree], other[agree]


def hinge_cotans(mesh: SurfaceMesh) -> NDArray[np.float64]:
    """Coefficients of the quadratic bending energy of hinges.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
        The rest shape.

    Returns
    -------
    (h, 4) ndarray of float64
        Without unit, one for each vertex of `hinges`. If positions x are isometric to the mesh, then
        |sum c_i x_i| = 2 |e| sin(theta/2) for the edge e with dihedral angle theta. Each row sums to zero.

    References
    ----------
    Bergou2006 in docs/references.bib.
    """
    cotan = corner_cotan(mesh.side_length).ravel()
    side, other = hinge_sides(mesh.topology)

    def at(flat: NDArray, step: int) -> NDArray:
        return cotan[3 * (flat // 3) + (flat % 3 + step) % 3]

    tail, head = at(side, 0), at(side, 1)
    head_t, tail_t = at(other, 0), at(other, 1)
    return np.stack([head + head_t, tail + tail_t, -tail - head, -tail_t - head_t], axis=1)


@dataclass(frozen=True, eq=False)
class HingeFrame:
    """Geometry of every hinge: normals n, nt; heights h, ht; feet s, st; edge direction u; its length.

    Vectors are (3, h): whole components lie together, which numpy works on four times as fast.
    """

    n: NDArray
    nt: NDArray
    h: NDArray
    ht: NDArray
    s: NDArray
    st: NDArray
    u: NDArray
    length: NDArray
    angle: NDArray

    def __getitem__(self, rows: slice) -> HingeFrame:
        """Some of the hinges."""
        return HingeFrame(*(getattr(self, field.name)[..., rows] for field in fields(self)))


def hinge_frame(x: NDArray, stencil: NDArray) -> HingeFrame:
    """Geometry of hinges: normals, heights, angle.

    Parameters
    ----------
    x : (n, 3) ndarray of float64
        Positions.
    stencil : (h, 4) ndarray of int64
        As returned by `hinges`.

    Returns
    -------
    HingeFrame
        The angle is 0 where the faces are coplanar and positive where their normals diverge (convex).
    """
    x0, x1, x2, x3 = columns_at(x, stencil)
    e, p, q = x1 - x0, x2 - x0, x3 - x0
    length = np.sqrt(dot(e, e))
    u = e / length
    n, nt = cross(e, p), cross(q, e)
    double, double_t = np.sqrt(dot(n, n)), np.sqrt(dot(nt, nt))
    n, nt = n / double, nt / double_t
    angle = np.arctan2(dot(cross(n, nt), u), dot(n, nt))
    s, st = dot(p, u) / length, dot(q, u) / length
    return HingeFrame(n, nt, double / length, double_t / length, s, st, u, length, angle)


def angle_slopes(f: HingeFrame) -> list[NDArray]:
    """Gradient of the hinge angle in each of the four vertices.

    Parameters
    ----------
    f : HingeFrame

    Returns
    -------
    list of four (3, h) ndarray of float64
        In 1/length.
    """
    a, at = f.n / f.h, f.nt / f.ht
    head, head_t = f.s * a, f.st * at
    return [a - head + at - head_t, head + head_t, -a, -at]


def angle_gradient(f: HingeFrame) -> NDArray[np.float64]:
    """Gradient of the hinge angle in the four vertices.

    Parameters
    ----------
    f : HingeFrame

    Returns
    -------
    (h, 4, 3) ndarray of float64
        In 1/length.
    """
    return np.stack(angle_slopes(f), axis=1).transpose(2, 1, 0)
