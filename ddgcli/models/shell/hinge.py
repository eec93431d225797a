"""Hinges of a surface: the angle at every interior edge, its gradient and its Hessian in closed form.

A hinge is a row (x0, x1, x2, x3) of `geometry.hinges.hinges`.
The angle is 0 where the faces are coplanar and positive where their normals diverge (convex). Formulas after
Tamstorf and Grinspun 2013, checked by finite differences.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.vectors import cross, dot


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
    """Geometry of the hinges at positions x."""
    x0, x1, x2, x3 = (np.ascontiguousarray(x[stencil[:, k]].T) for k in range(4))
    e, p, q = x1 - x0, x2 - x0, x3 - x0
    length = np.sqrt(dot(e, e))
    u = e / length
    n, nt = cross(e, p), cross(q, e)
    double, double_t = np.sqrt(dot(n, n)), np.sqrt(dot(nt, nt))
    n, nt = n / double, nt / double_t
    angle = np.arctan2(dot(cross(n, nt), u), dot(n, nt))
    s, st = dot(p, u) / length, dot(q, u) / length
    return HingeFrame(n, nt, double / length, double_t / length, s, st, u, length, angle)


def angle_gradient(f: HingeFrame) -> NDArray[np.float64]:
    """(h, 4, 3) gradient of the angle in the four vertices."""
    a, at = f.n / f.h, f.nt / f.ht
    head, head_t = f.s * a, f.st * at
    gradient = np.empty((len(f.h), 4, 3))
    for k, row in enumerate((a - head + at - head_t, head + head_t, -a, -at)):
        gradient[:, k] = row.T
    return gradient


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
    for k, (n, h, s, apex, side) in enumerate(((f.n, f.h, f.s, 2, 1.0), (f.nt, f.ht, f.st, 3, -1.0))):
        m = side * cross(n, f.u)
        along, across = m / (2 * f.length), n / f.length
        _write_feet(left[:, 2 * k], n / h, s, apex)
        _write_feet(right[:, 2 * k], m / h, s, apex)
        _write_feet(left[:, 2 * k + 1], f.u / h, s, apex, along)
        right[:, 2 * k + 1, 0:3] = across.T
        right[:, 2 * k + 1, 3:6] = -across.T


def _write_feet(row: NDArray, vector: NDArray, s: NDArray, apex: int, along: NDArray | None = None) -> None:
    """c times a (3, h) vector, plus d times another, into (h, 12) rows."""
    head = s * vector
    tail = vector - head
    if along is not None:
        tail += along
        head -= along
    row[:, 0:3], row[:, 3:6], row[:, 3 * apex : 3 * apex + 3] = tail.T, head.T, -vector.T


def wrapped(angle: NDArray) -> NDArray[np.float64]:
    """Angles brought to (-pi, pi]."""
    return angle - 2 * np.pi * np.round(angle / (2 * np.pi))
