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
    n, nt = np.cross(e, p), np.cross(q, e)
    double, double_t = np.linalg.norm(n, axis=1), np.linalg.norm(nt, axis=1)
    n, nt = n / double[:, None], nt / double_t[:, None]
    angle = np.arctan2(np.einsum("ei,ei->e", np.cross(n, nt), u), np.einsum("ei,ei->e", n, nt))
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
    m, mt = np.cross(f.n, f.u), -np.cross(f.nt, f.u)
    blocks = np.zeros((len(f.h), 4, 4, 3, 3))
    _half(blocks, f.n, m, f.u, f.h, f.s, f.length, 2)
    _half(blocks, f.nt, mt, f.u, f.ht, f.st, f.length, 3)
    quad = (_sym(f.n, m) + _sym(f.nt, mt)) / (2 * f.length**2)[:, None, None]
    blocks[:, 0, 0] += quad
    blocks[:, 1, 1] += quad
    blocks[:, 0, 1] -= quad
    blocks[:, 1, 0] = np.swapaxes(blocks[:, 0, 1], 1, 2)
    return blocks.transpose(0, 1, 3, 2, 4).reshape(-1, 12, 12)


def _half(
    blocks: NDArray, n: NDArray, m: NDArray, u: NDArray, h: NDArray, s: NDArray, length: NDArray, apex: int
) -> None:
    """What one face adds to the blocks; m points from the edge line to the apex."""
    nm, nu = _sym(n, m), _sym(n, u)
    a, b = 1 - s, s
    outer = u[:, :, None] * n[:, None, :]
    inner = n[:, :, None] * u[:, None, :]
    hl = _wide(h * length)
    square = nm / _wide(h**2)
    blocks[:, apex, apex] += square
    blocks[:, apex, 0] += -outer / hl - _wide(a) * square
    blocks[:, apex, 1] += outer / hl - _wide(b) * square
    blocks[:, 0, apex] += np.swapaxes(-outer / hl - _wide(a) * square, 1, 2)
    blocks[:, 1, apex] += np.swapaxes(outer / hl - _wide(b) * square, 1, 2)
    blocks[:, 0, 0] += _wide(a) * nu / hl + _wide(a**2) * square
    blocks[:, 1, 1] += -_wide(b) * nu / hl + _wide(b**2) * square
    blocks[:, 0, 1] += (_wide(b) * inner - _wide(a) * outer) / hl + _wide(a * b) * square


def _wide(values: NDArray) -> NDArray:
    return values[:, None, None]


def _sym(p: NDArray, q: NDArray) -> NDArray:
    return p[:, :, None] * q[:, None, :] + q[:, :, None] * p[:, None, :]


def wrapped(angle: NDArray) -> NDArray[np.float64]:
    """Angles brought to (-pi, pi]."""
    return angle - 2 * np.pi * np.round(angle / (2 * np.pi))
