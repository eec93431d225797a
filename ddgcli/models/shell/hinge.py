"""Second derivatives of hinge angles in closed form, for the angles of `geometry.hinges`.

R. Tamstorf, E. Grinspun, "Discrete bending forces and their Jacobians", 2013.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.hinges import HingeFrame
from ddgcli.mechanics.pair_blocks import vertex_pairs, whole_elements
from ddgcli.mesh.vectors import cross


def angle_hessian(f: HingeFrame) -> NDArray[np.float64]:
    """Hessian of the hinge angle.

    Parameters
    ----------
    f : HingeFrame

    Returns
    -------
    (h, 12, 12) ndarray of float64
        In 1/length^2.
    """
    blocks = np.zeros((len(vertex_pairs(4)), 3, 3, len(f.h)))
    for pair, summand in angle_second_derivatives(f, np.ones(len(f.h))):
        blocks[vertex_pairs(4).index(pair)] += summand
    return whole_elements(4, blocks.transpose(0, 3, 1, 2))


def angle_second_derivatives(
    f: HingeFrame, factor: NDArray
) -> Iterator[tuple[tuple[int, int], NDArray[np.float64]]]:
    """Terms of the Hessian of the hinge angle times factors, by pairs of vertices.

    Rows belong to vertex a, columns to b. The diagonal blocks follow from these, because the angle is
    invariant under translation. The published blocks of one face factor as follows. Let h be its height over
    the hinge of length L and direction u, with foot (1 - s) tail + s head; n its normal, m a conormal,
    c = (1 - s, s, -1) and d = (1, -1, 0) over (tail, head, apex). Then its blocks are
    c c' (n m' + m n') / h^2 + c d' u n' / hL + d c' n u' / hL + d d' (n m' + m n') / 2 L^2.

    Parameters
    ----------
    f : HingeFrame
    factor : (h,) ndarray of float64

    Yields
    ------
    (a, b) : tuple of int
        a < b.
    block : (3, 3, h) ndarray of float64
    """
    edge = 0.5 * factor / f.length**2
    for n, h, s, apex, side in ((f.n, f.h, f.s, 2, 1.0), (f.nt, f.ht, f.st, 3, -1.0)):
        nm = n[:, None] * (side * cross(n, f.u))
        nm = nm + nm.transpose(1, 0, 2)
        un = (factor / (h * f.length) * f.u)[:, None] * n
        nu, bent, r = un.transpose(1, 0, 2), factor / h**2, 1 - s
        yield (0, 1), (r * s * bent - edge) * nm
        yield (0, 1), s * nu
        yield (0, 1), -r * un
        yield (0, apex), -r * bent * nm
        yield (0, apex), -nu
        yield (1, apex), -s * bent * nm
        yield (1, apex), nu


def wrapped(angle: NDArray) -> NDArray[np.float64]:
    """Angles wrapped to [-pi, pi].

    Parameters
    ----------
    angle : ndarray of float64
        In radians.

    Returns
    -------
    ndarray of float64
    """
    return angle - 2 * np.pi * np.round(angle / (2 * np.pi))
