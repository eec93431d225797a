"""Costs of kernels, written by `python -m benchmarks.costs`.

Since the last whole measurement some were corrected by the rows of docs/benchmarks/size.md and by single runs
on a loaded machine, and PROBE_SECONDS with them: measure all of them again on a quiet one.
"""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["COEFFICIENTS", "PROBE_SECONDS", "Cost"]


class Cost(NamedTuple):
    """Cost of a kernel on n elements: seconds a + b (n / 1e5)^p, and MiB c + d (n / 1e5)."""

    seconds: float
    seconds_per_1e5: float
    exponent: float
    mib: float
    mib_per_1e5: float


PROBE_SECONDS = 0.0032  # of `prediction.probe` where the table was measured

COEFFICIENTS: dict[str, Cost] = {
    "info": Cost(0.1, 0.27, 1.2, 1.48, 24.7),
    "write vtu": Cost(0.00701, 0, 1.05, 4.146, 16.47),
    "write npz": Cost(0.008963, 0, 1.05, 0.6674, 20.86),
    "write ply": Cost(0, 0, 1.05, 0.5268, 20.98),
    "write text": Cost(0.0005943, 0, 1.05, 1.508, 19.92),
    "info tetrahedra": Cost(0.1239, 1.921, 1.4, 0.2869, 62.37),
    "picture": Cost(3.243, 2.86, 1.05, 526.4, 0),
    "repair": Cost(0.6295, 0.04784, 1.05, 27.67, 23.19),
    "curvature cotan": Cost(0.2663, 0.1232, 1.05, 11.58, 34.68),
    "curvature normal-cycle": Cost(0.2315, 0.2293, 1.05, 10.61, 48.65),
    "curvature corrected": Cost(0.2496, 0.2173, 1.05, 10.79, 51.29),
    "curvature quadric": Cost(0.2358, 0.85, 1.05, 18.9, 43.52),
    "curvature normal-cycle radius": Cost(0, 0.5772, 1.05, 40.26, 115.5),
    "curvature corrected radius": Cost(0, 0.6284, 1.05, 38.45, 95.32),
    "curvature quadric radius": Cost(0.03157, 0.1995, 1.05, 26.39, 122.7),
    "curvature quadric auto": Cost(0.3083, 1.217, 1.05, 18.1, 43.19),
    "delaunay": Cost(0.02, 0.1, 1.15, 1.757, 28.57),
    "delaunay refine": Cost(0.6, 6, 1.05, 25, 190),
    "delaunay overlay": Cost(0.3, 0.4, 1.05, 9, 42),
    "delaunay dual": Cost(0.35, 0.1, 1.05, 8.3, 77),
    "delaunay condition": Cost(0, 1.565, 1.15, 29.46, 97.35),
    "laplacian": Cost(0.2547, 0.121, 1.05, 8.126, 24.4),
    "laplacian matrix": Cost(0.09864, 0, 1.05, 7.922, 14.77),
    "laplacian poisson": Cost(0.1, 0.56, 1.25, 30.29, 72),
    "laplacian eigen": Cost(0.2906, 1.949, 1.1, 25.79, 148.2),
    "laplacian eigenpair": Cost(0.0012, 0.042, 1.1, 0.04846, 1.487),
    "laplacian smooth": Cost(0.306, 4.927, 1.15, 25.24, 108.8),
    "laplacian discrete-conformal": Cost(0.38, 0.5, 1.05, 38, 66.27),
    "laplacian conformal": Cost(0.3382, 0.3253, 1.15, 26.49, 88.06),
    "laplacian harmonic": Cost(0.2678, 0.3234, 1.05, 25.72, 63.96),
    "laplacian form-eigen": Cost(0.3049, 22.62, 1.05, 19.05, 1881),
    "laplacian evolution": Cost(0.2644, 4.425, 1.05, 25.34, 54.61),
    "hodge": Cost(0.31, 0.4, 1.05, 22, 28),
    "hodge field": Cost(0.417, 5.909, 1.05, 26.97, 278.4),
    "dec": Cost(0.2, 1.65, 1.05, 8.6, 197),
    "geodesic exact": Cost(0.14, 2, 1.12, 2.933, 46.13),
    "geodesic heat": Cost(0.3405, 0.8693, 1.3, 30.96, 128),
    "geodesic fast-marching": Cost(0.12, 0.35, 1.05, 2.2, 45.08),
    "geodesic dijkstra": Cost(0.1922, 0.3691, 1.05, 21.19, 12.09),
    "geodesic exact solve": Cost(0.08, 2.5, 1.1, 21.28, 37.91),
    "geodesic heat solve": Cost(0.0009379, 0.1396, 1.05, 27.24, 128),
    "geodesic fast-marching solve": Cost(0.01204, 0.1556, 1.05, 20.91, 31.48),
    "geodesic dijkstra solve": Cost(0.02044, 0.005749, 1.05, 20.02, 8.443),
    "geodesic log-map": Cost(0.0436, 0.8586, 1.05, 21.4, 63.26),
    "geodesic transport": Cost(0.0808, 0.3847, 1.05, 21.57, 52.88),
    "willmore-flow": Cost(0.4866, 2.702, 1.05, 31.95, 223.8),
    "willmore-flow quadratic step": Cost(0.01726, 1.862, 1.15, 34.36, 259.8),
    "shell-sim": Cost(0.4, 3.4, 1.2, 25, 150),
    "shell-sim implicit step": Cost(0.015, 5, 1.15, 6.51, 1169),
    "shell-sim explicit step": Cost(0.002834, 0.08669, 1.05, 25, 150),
    "fluid-sim": Cost(0.2095, 0.8682, 1.2, 5.864, 116.9),
    "fluid-sim circulation step": Cost(0, 0.6823, 1.05, 11.5, 247.4),
    "fluid-sim conservative step": Cost(0, 0.1049, 1.05, 3.074, 133.2),
    "fluid-sim energy step": Cost(0, 0.1119, 1.05, 5.015, 124.9),
    "fluid-sim covector step": Cost(0.001817, 1.808, 1.05, 7.984, 259.8),
    "view": Cost(0.06, 0, 1.05, 0.1582, 0),
    "write vtu tetrahedra": Cost(0.004086, 0, 1.05, 0.1378, 63.74),
    "write npz tetrahedra": Cost(0.108, 0, 1.05, 0, 64.06),
    "laplacian tetrahedra": Cost(0.3643, 3.499, 1.05, 21.1, 277.5),
    "laplacian poisson tetrahedra": Cost(0, 0.5751, 1.15, 21.11, 277.9),
    "laplacian eigen tetrahedra": Cost(0, 5.582, 1.1, 0, 526.2),
    "laplacian eigenpair tetrahedra": Cost(0, 0.09694, 1.1, 0, 2.037),
    "view tetrahedra": Cost(0.0299, 0.3045, 1.05, 0, 41.85),
    "info curve": Cost(0.04802, 0.3245, 1.05, 0.449, 21.6),
    "curvature curve": Cost(0.08483, 0.1225, 1.05, 0.2747, 36.23),
    "curve-flow curve": Cost(0.5031, 2.448, 1.05, 28.21, 333.8),
    "curve-flow step curve": Cost(0.01107, 1.213, 1.05, 28.59, 369),
    "laplacian poisson multigrid": Cost(0.3228, 3.079, 1.15, 45.84, 40),
    "willmore-flow mean-curvature step": Cost(0.012, 0.4325, 1.05, 22.12, 203.5),
    "hodge tetrahedra": Cost(0.3861, 10.32, 1.05, 20.59, 116.2),
    "hodge field tetrahedra": Cost(0.4579, 16.86, 1.05, 22.75, 459),
    "dec tetrahedra": Cost(0.1477, 13.85, 1.05, 8.893, 996.5),
    "curvature further results": Cost(0.04535, 0.1309, 1.05, 14.6, 46.97),
    "shell-sim midedge step": Cost(0.19, 24, 1.15, 21.91, 3294),
    "shell-sim pairs step": Cost(0.09459, 0.4116, 1.05, 23.31, 1058),
    "shell-sim iterative implicit step": Cost(0.3, 6.5, 1.35, 110, 222),
    "shell-sim iterative midedge step": Cost(1.01, 12, 1.15, 19.85, 2145),
    "curvature noise": Cost(0.6097, 1.4, 1.05, 54.04, 100),
    "curvature normal-voting": Cost(0.4429, 0.5428, 1.05, 13.9, 93.87),
    "curvature normal-voting radius": Cost(0.03407, 0.1994, 1.05, 30.32, 124.6),
    "curvature offset": Cost(0.581, 7.834, 1.05, 40.6, 379.8),
    "geodesic point": Cost(0.462, 0.7747, 1.05, 26.66, 46.57),
    "geodesic field": Cost(1.331, 0, 1.05, 9.183, 63.48),
    "willmore-flow descent step": Cost(0.1405, 3.862, 1.05, 39.47, 344.5),
    "willmore-flow newton step": Cost(0.1655, 3.048, 1.05, 31.14, 352.3),
    "shell-sim iteration": Cost(0.02083, 2.181, 1.15, 8.77, 2705),
    "view frame": Cost(0, 0.03608, 1.05, 0.03154, 3.902),
    "picture of a run": Cost(4.513, 0, 1.05, 235.9, 18.07),
    "picture curve": Cost(1.286, 3.923, 1.05, 40.41, 131.8),
    "geodesic job": Cost(0.7428, 0.0662, 1.05, 18.03, 1.803),
    "shell-sim modes": Cost(0.4608, 66.39, 1.15, 20.15, 3362),
    "tradeoff curvature": Cost(0.3, 55, 1.05, 46.26, 209.2),
    "tradeoff delaunay": Cost(2.2, 30, 1.05, 32.41, 1237),
    "tradeoff laplacian": Cost(2.4, 46, 1.05, 27.58, 3228),
    "tradeoff geodesic": Cost(1.551, 89.55, 1.05, 32.94, 812.5),
    "tradeoff willmore-flow": Cost(22.14, 228.5, 1.05, 74.18, 31.61),
    "willmore-flow remeshing": Cost(0.1223, 6.998, 1.05, 35.75, 338.6),
    "willmore-flow conformal": Cost(0.9, 107.5, 1.05, 29.69, 1283),
    "shell-sim midedge iteration": Cost(0.03702, 9.795, 1.15, 13.91, 6200),
    "laplacian form-eigen tetrahedra": Cost(0.8407, 1607, 2, 0, 8213),
    "geodesic vector-heat": Cost(0.3586, 2.371, 1.05, 32.94, 101.4),
    "fluid-sim tetrahedra": Cost(0.1409, 12.9, 1.2, 4.654, 539.9),
    "fluid-sim energy step tetrahedra": Cost(0.02002, 1.457, 1.05, 4.967, 540.1),
    "fluid-sim circulation step tetrahedra": Cost(0.04598, 3.068, 1.05, 4.168, 551.8),
    "fluid-sim covector step tetrahedra": Cost(0.007737, 2.122, 1.05, 4.444, 554.5),
    "shell-sim buckling": Cost(0.4389, 57.95, 1.15, 26.05, 1346),
    "shell-sim avi": Cost(0, 3.5, 1.05, 25, 600),
}
