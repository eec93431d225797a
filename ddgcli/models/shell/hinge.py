"""Hinges of a surface: the angle at every interior edge, its gradient and its Hessian in closed form.

A hinge is (x0, x1, x2, x3): x0 x1 the edge, x2 the apex of the face (x0, x1, x2), x3 that of (x1, x0, x3).
The angle is 0 where the faces are coplanar and positive where their normals diverge (convex). Formulas after
Tamstorf and Grinspun 2013, checked by finite differences.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.topology import Topology


def hinges(topology: Topology) -> NDArray[np.int64]:
    """(h, 4) vertices x0, x1, x2, x3 of every edge with two faces that agree in orientation."""
    faces = topology.faces
    twin = topology.side_twin.ravel()
    side = np.flatnonzero((twin >= 0) & (np.arange(len(twin)) < twin))
    other = twin[side]
    tail, head = topology.side_tail, topology.side_head
    agree = tail[side] == head[other]
    side, other = side[agree], other[agree]
    apex = faces[side // 3, (side % 3 + 2) % 3]
    apex_other = faces[other // 3, (other % 3 + 2) % 3]
    return np.stack([tail[side], head[side], apex, apex_other], axis=1)


@dataclass(frozen=True, eq=False)
class HingeFrame:
    """Geometry of every hinge: normals n, nt; heights h, ht; feet s, st; edge direction u; in-plane m, mt."""

    n: NDArray
    nt: NDArray
    h: NDArray
    ht: NDArray
    s: NDArray
    st: NDArray
    u: NDArray
    length: NDArray
    angle: NDArray


def frame(x: NDArray, stencil: NDArray) -> HingeFrame:
    """Geometry of the hinges at positions x."""
    x0, x1, x2, x3 = (x[stencil[:, k]] for k in range(4))
    e, p, q = x1 - x0, x2 - x0, x3 - x0
    length = np.sqrt(np.einsum("ei,ei->e", e, e))
    u = e / length[:, None]
    n, nt = _cross(e, p), _cross(q, e)
    double, double_t = np.linalg.norm(n, axis=1), np.linalg.norm(nt, axis=1)
    n, nt = n / double[:, None], nt / double_t[:, None]
    angle = np.arctan2(np.einsum("ei,ei->e", _cross(n, nt), u), np.einsum("ei,ei->e", n, nt))
    s = np.einsum("ei,ei->e", p, u) / length
    st = np.einsum("ei,ei->e", q, u) / length
    return HingeFrame(n, nt, double / length, double_t / length, s, st, u, length, angle)


def angle_gradient(f: HingeFrame) -> NDArray[np.float64]:
    """(h, 4, 3) gradient of the angle in the four vertices."""
    a, at = f.n / f.h[:, None], f.nt / f.ht[:, None]
    s, st = f.s[:, None], f.st[:, None]
    return np.stack([(1 - s) * a + (1 - st) * at, s * a + st * at, -a, -at], axis=1)


def angle_hessian(f: HingeFrame) -> NDArray[np.float64]:
    """(h, 12, 12) Hessian of the angle."""
    left, right = np.zeros((2, len(f.h), 4, 12))
    hessian_factors(f, left, right)
    product = np.matmul(left.transpose(0, 2, 1), right)
    return product + product.transpose(0, 2, 1)


def hessian_factors(f: HingeFrame, left: NDArray, right: NDArray) -> None:
    """Write (h, 4, 12) rows A and B with the Hessian A'B + B'A into arrays that are zero elsewhere.

    The published blocks factor: a face with heights' feet c = (1 - s, s, -1) on (tail, head, apex) and
    d = (1, -1, 0) gives c n/h x c m/h + (c u/h + d m/2L) x d n/L and the transpose.
    """
    d = (1 / f.length)[:, None]
    for k, (n, h, s, apex, side) in enumerate(((f.n, f.h, f.s, 2, 1.0), (f.nt, f.ht, f.st, 3, -1.0))):
        m = side * _cross(n, f.u)
        high, head = (1 / h)[:, None], s[:, None]
        for row, vector in (
            (left[:, 2 * k], n * high),
            (right[:, 2 * k], m * high),
            (left[:, 2 * k + 1], f.u * high),
        ):
            row[:, 3:6] = head * vector
            row[:, 0:3] = vector - row[:, 3:6]
            row[:, 3 * apex : 3 * apex + 3] = -vector
        along = 0.5 * d * m
        left[:, 2 * k + 1, 0:3] += along
        left[:, 2 * k + 1, 3:6] -= along
        right[:, 2 * k + 1, 0:3] = d * n
        right[:, 2 * k + 1, 3:6] = -d * n


def _cross(p: NDArray, q: NDArray) -> NDArray[np.float64]:
    """Cross products of (h, 3) vectors, without the overhead of numpy's."""
    (a, b, c), (d, e, f) = p.T, q.T
    return np.stack([b * f - c * e, c * d - a * f, a * e - b * d], axis=1)


def wrapped(angle: NDArray) -> NDArray[np.float64]:
    """Angles brought to (-pi, pi]."""
    return angle - 2 * np.pi * np.round(angle / (2 * np.pi))
