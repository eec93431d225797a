"""Kirchhoff-Love shells by B-splines: limits of the benchmark shells that owe nothing to triangles.

Positions are tensor B-splines of the parameters (continuous curvature), the surface at rest is interpolated
by them, strains are Green's and the change of the second fundamental form, the material is St. Venant's with
plane stress: the theory that `stvk` and `midedge` discretise, by another method (J. Kiendl, K.-U. Bletzinger,
J. Linhard, R. Wuechner, "Isogeometric shell analysis with Kirchhoff-Love elements", Computer Methods in
Applied Mechanics and Engineering 198, 2009). Newton's method takes the stresses of the geometric stiffness
from the linearised step before (L. Leonetti, F. Liguori, D. Magisano, G. Garcea, 2018), which needs
fewer iterations where the membrane is stiff.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_interp_spline
from scipy.sparse import coo_array, csc_array
from scipy.sparse.linalg import splu

from benchmarks.common.shell_problems import PROBLEMS, ShellProblem, open_hemisphere

DEGREE, MAX_ITERATIONS, MAX_HALVINGS, TOLERANCE = 3, 16, 6, 1e-7
DERIVATIVES = ((1, 0), (0, 1), (2, 0), (0, 2), (1, 1))  # of the positions, in this order everywhere
ELEMENTS_AT_ONCE = 64


@dataclass(frozen=True)
class Side:
    """What holds one side of the parameter rectangle.

    Parameters
    ----------
    axis, end : int
        The side where the parameter `axis` is least (0) or largest (1).
    fixed : str
        Coordinates that do not move on the side.
    flat : str
        Coordinates whose derivative across the side does not change.
    """

    axis: int
    end: int
    fixed: str
    flat: str


@dataclass(frozen=True)
class Support:
    """Held sides, loads and graded knots of a problem.

    Parameters
    ----------
    sides : tuple of Side
    corners : tuple of (end 0, end 1, force)
        Point loads.
    line : tuple of float
        Force per length on the side where parameter 0 is largest.
    grading : tuple of (str, str)
        Where knots are denser along each axis: 'low', 'both' or 'none'.
    size, onto
        Other parameters than those of the triangles.
    """

    sides: tuple[Side, ...]
    corners: tuple[tuple[int, int, tuple[float, float, float]], ...] = ()
    line: tuple[float, float, float] = (0.0, 0.0, 0.0)
    grading: tuple[str, str] = ("none", "none")
    size: tuple[float, float] | None = None
    onto: Callable[[NDArray], NDArray] | None = None


SUPPORTS = {
    "cantilever, shear": Support((Side(0, 0, "xyz", "z"),), line=(0, 0, 4.0)),
    "open hemisphere": Support(
        (Side(0, 0, "y", "xz"), Side(0, 1, "x", "yz")),
        ((0, 0, (-200, 0, 0)), (1, 0, (0, 200, 0))), grading=("both", "low"),
        size=(5 * np.pi, 4 * np.pi), onto=open_hemisphere,
    ),
    "slit annular plate": Support((Side(0, 0, "xyz", "z"),), line=(0, 0, 0.8), grading=("both", "both")),
    "pinched cylinder": Support(
        (Side(1, 0, "xyz", "xz"), Side(0, 0, "x", "yz"), Side(0, 1, "z", "xy")),
        ((0, 1, (0, 0, -1000)),), grading=("low", "both"),
    ),
}  # fmt: skip


def spline_displacements(
    name: str, elements: tuple[int, int], steps: int = 20, degree: int = DEGREE
) -> NDArray[np.float64]:
    """Displacements (fractions, measured points) of a problem by name; `elements` along both parameters."""
    problem, support = PROBLEMS[name], SUPPORTS[name]
    bases = [
        basis(size, count, degree, grade)
        for size, count, grade in zip(support.size or problem.size, elements, support.grading, strict=True)
    ]
    shell = SplineShell(problem, support, bases)
    moves = np.zeros((len(problem.fractions), len(problem.measured)))
    for number in range(1, steps + 1):
        shell.advance(number / steps)
        for row in np.flatnonzero(np.abs(np.array(problem.fractions) * steps - number) < 1e-6):
            for k, (place, direction) in enumerate(problem.measured):
                moves[row, k] = shell.displacement(place) @ np.array(direction)
    return moves


def basis(size: float, count: int, degree: int, grading: str) -> BSpline:
    """All B-splines of `count` intervals of [0, size] as one vector-valued spline."""
    s = np.linspace(0, 1, count + 1)
    s = {
        "none": s, "low": 0.3 * s + 0.7 * s**2, "both": 0.3 * s + 0.7 * s**2 * (3 - 2 * s),
    }[grading]  # fmt: skip
    knots = size * np.concatenate([np.zeros(degree), s, np.ones(degree)])
    return BSpline(knots, np.eye(count + degree), degree)


class SplineShell:
    """A shell, its loads, and its state under a fraction of the loads."""

    def __init__(self, problem: ShellProblem, support: Support, bases: Sequence[BSpline]) -> None:
        self.bases = bases
        self.shape = tuple(b.c.shape[0] for b in bases)
        n = self.shape[0] * self.shape[1]
        self._number = np.arange(n).reshape(self.shape)
        self._elements(problem, support.onto or problem.onto)
        self.master, self.free = self._supports(support)
        self.load = self._loads(support)
        self.move = np.zeros((n, 3))
        self._last, self._fraction = (self.move, 0.0), 0.0
        self.stress: NDArray | None = None

    def _elements(self, problem: ShellProblem, onto: Callable[[NDArray], NDArray]) -> None:
        """Control points at rest; functions, derivatives, weights and material of every quadrature point."""
        degree = self.bases[0].k
        sites = [np.array([b.t[i + 1 : i + 1 + b.k].mean() for i in range(b.c.shape[0])]) for b in self.bases]
        q = np.stack(np.meshgrid(*sites, indexing="ij"), axis=-1)
        values = onto(q.reshape(-1, 2)).reshape(*self.shape, 3)
        for axis, (b, site) in enumerate(zip(self.bases, sites, strict=True)):
            line = make_interp_spline(site, np.moveaxis(values, axis, 0), k=degree, t=b.t)
            values = np.moveaxis(line.c, 0, axis)
        self.rest = values.reshape(-1, 3)
        gauss, weight = np.polynomial.legendre.leggauss(degree + 1)
        local, place, weights = [], [], []
        for b in self.bases:
            ends = b.t[degree:-degree]
            length = np.diff(ends)
            at = (ends[:-1, None] + 0.5 * length[:, None] * (gauss + 1)).ravel()
            every = np.stack([b(at, nu=k) for k in range(3)])
            first = np.repeat(np.arange(len(length)), degree + 1)
            local.append(
                np.stack([every[:, np.arange(len(at)), first + j] for j in range(degree + 1)], axis=-1)
            )
            place.append(np.arange(len(length)))
            weights.append((0.5 * length[:, None] * weight).ravel())
        e0, e1 = (len(p) for p in place)
        g, m = degree + 1, (degree + 1) ** 2
        along = [v.reshape(3, -1, g, g) for v in local]  # derivative, element, point, function
        products = [np.einsum("eqi,frj->efqrij", along[0][i], along[1][j]) for i, j in DERIVATIVES]
        self.functions = np.stack(products).reshape(5, e0 * e1, g * g, m).transpose(1, 2, 0, 3)
        corner = self._number[:e0, :e1].ravel()[:, None]
        self.nodes = corner + (np.arange(g)[:, None] * self.shape[1] + np.arange(g)).ravel()
        weighted = np.einsum("eq,fr->efqr", *(w.reshape(-1, g) for w in weights)).reshape(e0 * e1, -1)
        at_rest = self._derivatives(self.rest)
        self._rest_strain = strains(at_rest)
        self.material = material(at_rest, problem) * weighted[:, :, None, None]

    def _derivatives(self, control: NDArray) -> NDArray[np.float64]:
        """(elements, points, 5, 3) derivatives of the positions."""
        return self.functions @ control[self.nodes][:, None]

    def _supports(self, support: Support) -> tuple[NDArray[np.int64], int]:
        """Number of the unknown that each coordinate of a control point follows (-1: fixed), and how many."""
        n = self._number.size
        master = np.arange(3 * n).reshape(n, 3)
        for side in support.sides:
            rows = np.moveaxis(self._number, side.axis, 0)[:: 1 - 2 * side.end]
            for c in side.flat:
                k = "xyz".index(c)
                master[rows[1], k] = master[rows[0], k]
        for side in support.sides:
            rows = np.moveaxis(self._number, side.axis, 0)[:: 1 - 2 * side.end]
            for c in side.fixed:
                unknowns = master[rows[0], "xyz".index(c)]
                master[np.isin(master, unknowns[unknowns >= 0])] = -1
        if all(side.fixed == "y" or side.fixed == "x" for side in support.sides):
            master[master == master[0, 2]] = -1  # the translation that symmetry leaves
        flat = master.ravel()
        # a coordinate may follow one that itself follows another, at a corner of two sides
        for _ in range(2):
            flat = np.where(flat >= 0, flat[flat], -1)
        masters = np.unique(flat[flat >= 0])
        renumbered = np.full(3 * n, -1)
        renumbered[masters] = np.arange(len(masters))
        return np.where(flat >= 0, renumbered[flat], -1), len(masters)

    def _loads(self, support: Support) -> NDArray[np.float64]:
        force = np.zeros((self._number.size, 3))
        for first, second, vector in support.corners:
            force[self._number[-first, -second]] += vector
        b = self.bases[1]
        share = b.antiderivative()(b.t[-1]) - b.antiderivative()(b.t[0])
        force[self._number[-1]] += share[:, None] * np.array(support.line)
        return self._gathered(force.ravel())

    def _gathered(self, values: NDArray) -> NDArray[np.float64]:
        is_free = self.master >= 0
        return np.bincount(self.master[is_free], values[is_free], self.free).astype(np.float64)

    def displacement(self, place: tuple[float, float]) -> NDArray[np.float64]:
        """Displacement at parameters."""
        first, second = self.bases[0](place[0]), self.bases[1](place[1])
        return np.einsum("i,j,ijk->k", first, second, self.move.reshape(*self.shape, 3))

    def advance(self, fraction: float, halvings: int = 0) -> None:
        """Equilibrium under a fraction of the loads, from the state under a smaller one."""
        start = self.move, self._fraction
        if self._fraction > 0:
            ratio = (fraction - self._fraction) / (self._fraction - self._last[1])
            self.move = self.move + ratio * (self.move - self._last[0])
            self.stress = None
        if self._converges(fraction):
            self._last, self._fraction = start, fraction
        elif halvings < MAX_HALVINGS:
            self.move, self.stress = start[0], None
            self.advance(0.5 * (start[1] + fraction), halvings + 1)
            self.advance(fraction, halvings + 1)
        else:
            raise RuntimeError(f"Newton's method does not converge at the fraction {fraction:g}")

    def _converges(self, fraction: float) -> bool:
        """Newton's method from the state as it is."""
        for _ in range(MAX_ITERATIONS):
            force, matrix, change = self._system()
            step = splu(matrix).solve(fraction * self.load - force)
            moved = np.where(self.master >= 0, step[self.master], 0.0).reshape(-1, 3)
            self.move = self.move + moved
            self.stress = change(moved)
            length = np.abs(moved).max()
            if not length < np.abs(self.rest).max():
                return False
            if length < TOLERANCE * np.abs(self.move).max():
                return True
        return False

    def _system(self):
        """Forces, stiffness, and the stresses after a linearised step."""
        derivatives = self._derivatives(self.rest + self.move)
        strain = strains(derivatives) - self._rest_strain
        slope = strain_slopes(derivatives)
        stress = np.einsum("eqij,eqj->eqi", self.material, strain)
        stress_before = stress if self.stress is None else self.stress
        count, m = len(self.nodes), self.nodes.shape[1]
        element_force, blocks = np.zeros((count, m, 3)), np.zeros((count, 3 * m, 3 * m))
        for begin in range(0, count, ELEMENTS_AT_ONCE):
            some = slice(begin, begin + ELEMENTS_AT_ONCE)
            functions, s = self.functions[some], slope[some]
            pulled = np.einsum("eqi,eqidk->eqdk", stress[some], s)
            element_force[some] = np.einsum("eqdm,eqdk->emk", functions, pulled)
            flat = s.reshape(*s.shape[:3], 15)
            hessian = np.swapaxes(flat, 2, 3) @ self.material[some] @ flat
            hessian = hessian + strain_curvature(derivatives[some], stress_before[some])
            spread = np.einsum("eqdm,kl->eqdkml", functions, np.eye(3))
            e, q = spread.shape[:2]
            spread = spread.reshape(e, q, 15, 3 * m)
            right = hessian @ spread
            blocks[some] = np.swapaxes(spread.reshape(e, -1, 3 * m), 1, 2) @ right.reshape(e, -1, 3 * m)

        def change(moved: NDArray) -> NDArray[np.float64]:
            more = np.einsum("eqidk,eqdk->eqi", slope, self._derivatives(moved))
            return np.einsum("eqij,eqj->eqi", self.material, strain + more)

        unknown = self.master[(3 * self.nodes[:, :, None] + np.arange(3)).reshape(count, -1)]
        force = np.bincount(unknown[unknown >= 0], element_force.reshape(count, -1)[unknown >= 0], self.free)
        i = np.broadcast_to(unknown[:, :, None], blocks.shape)
        j = np.broadcast_to(unknown[:, None, :], blocks.shape)
        both = (i >= 0) & (j >= 0)
        matrix = coo_array((blocks[both], (i[both], j[both])), shape=(self.free, self.free))
        return force, csc_array(matrix), change


def strains(d: NDArray) -> NDArray[np.float64]:
    """(..., 6): half metric (11, 22, twice 12) and second form less its sign (11, 22, twice 12)."""
    first, second = d[..., 0, :], d[..., 1, :]
    n = np.cross(first, second)
    n /= np.linalg.norm(n, axis=-1, keepdims=True)
    bend = np.einsum("...k,...dk->...d", n, d[..., 2:, :])
    return np.stack(
        [
            0.5 * (first * first).sum(-1), 0.5 * (second * second).sum(-1), (first * second).sum(-1),
            -bend[..., 0], -bend[..., 1], -2 * bend[..., 2],
        ],
        axis=-1,
    )  # fmt: skip


def crosses(v: NDArray) -> NDArray[np.float64]:
    """Matrices of the cross product with vectors from the left."""
    x, y, z = np.moveaxis(v, -1, 0)
    o = np.zeros_like(x)
    return np.stack([np.stack(r, -1) for r in ((o, -z, y), (z, o, -x), (-y, x, o))], -2)


def normal_frame(d: NDArray) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Normal, length of the cross product, and the derivatives of that by both tangents."""
    c = np.cross(d[..., 0, :], d[..., 1, :])
    size = np.linalg.norm(c, axis=-1)
    return c / size[..., None], size, -crosses(d[..., 1, :]), crosses(d[..., 0, :])


def strain_slopes(d: NDArray) -> NDArray[np.float64]:
    """(..., 6, 5, 3) derivatives of the strains by the derivatives of the positions."""
    n, size, by_first, by_second = normal_frame(d)
    slope = np.zeros((*d.shape[:-2], 6, 5, 3))
    slope[..., 0, 0, :], slope[..., 1, 1, :] = d[..., 0, :], d[..., 1, :]
    slope[..., 2, 0, :], slope[..., 2, 1, :] = d[..., 1, :], d[..., 0, :]
    for k, factor in enumerate((-1.0, -1.0, -2.0)):
        h = d[..., 2 + k, :]
        by_cross = (h - (h * n).sum(-1, keepdims=True) * n) / size[..., None]
        slope[..., 3 + k, 0, :] = factor * np.einsum("...c,...ck->...k", by_cross, by_first)
        slope[..., 3 + k, 1, :] = factor * np.einsum("...c,...ck->...k", by_cross, by_second)
        slope[..., 3 + k, 2 + k, :] = factor * n
    return slope


def strain_curvature(d: NDArray, stress: NDArray) -> NDArray[np.float64]:
    """(..., 15, 15) second derivatives of the strains, times stresses."""
    n, size, by_first, by_second = normal_frame(d)
    eye, out = np.eye(3), np.zeros((*d.shape[:-2], 5, 3, 5, 3))
    for (i, j), k in {(0, 0): 0, (1, 1): 1, (0, 1): 2, (1, 0): 2}.items():
        out[..., i, :, j, :] += stress[..., k, None, None] * eye
    factor = -stress[..., 3:] * np.array([1.0, 1.0, 2.0])
    h = np.einsum("...d,...dk->...k", factor, d[..., 2:, :])
    f = (h * n).sum(-1)[..., None, None]
    outer = n[..., :, None] * n[..., None, :]
    mixed = h[..., :, None] * n[..., None, :]
    by_cross = (-mixed - np.swapaxes(mixed, -1, -2) - f * eye + 3 * f * outer) / size[..., None, None] ** 2
    slopes = (by_first, by_second)
    for i in range(2):
        for j in range(2):
            out[..., i, :, j, :] += np.swapaxes(slopes[i], -1, -2) @ by_cross @ slopes[j]
    twist = crosses((h - f[..., 0] * n) / size[..., None])
    out[..., 0, :, 1, :] -= twist
    out[..., 1, :, 0, :] += twist
    for i in range(2):
        turn = (eye - outer) @ slopes[i] / size[..., None, None]
        for k in range(3):
            term = factor[..., k, None, None] * turn
            out[..., 2 + k, :, i, :] += term
            out[..., i, :, 2 + k, :] += np.swapaxes(term, -1, -2)
    return out.reshape(*d.shape[:-2], 15, 15)


def material(d: NDArray, problem: ShellProblem) -> NDArray[np.float64]:
    """(..., 6, 6) stiffness of the six strains per unit of the parameters' area."""
    metric = np.einsum("...ik,...jk->...ij", d[..., :2, :], d[..., :2, :])
    inverse, pairs = np.linalg.inv(metric), ((0, 0), (1, 1), (0, 1))
    plane = np.zeros((*d.shape[:-2], 3, 3))
    for row, (a, b) in enumerate(pairs):
        for column, (c, e) in enumerate(pairs):
            plane[..., row, column] = problem.poisson * inverse[..., a, b] * inverse[..., c, e] + 0.5 * (
                1 - problem.poisson
            ) * (
                inverse[..., a, c] * inverse[..., b, e] + inverse[..., a, e] * inverse[..., b, c]
            )  # fmt: skip
    plane *= (problem.young / (1 - problem.poisson**2) * np.sqrt(np.linalg.det(metric)))[..., None, None]
    t, out = problem.thickness, np.zeros((*d.shape[:-2], 6, 6))
    out[..., :3, :3], out[..., 3:, 3:] = t * plane, t**3 / 12 * plane
    return out
