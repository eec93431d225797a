"""Axisymmetric vesicles of least bending energy, by a spectral method that shares nothing with the flows."""

import numpy as np
from numpy.polynomial import legendre
from scipy.optimize import minimize

N_MODES, N_NODES = 8, 64


def integration_matrix(s):
    """(k, k) integrals from 0 to the Gauss nodes s in [0, 1], of polynomials by their values at these."""
    k = len(s)
    vander = legendre.legvander(2.0 * s - 1.0, k)
    integral = np.empty((k, k))
    integral[:, 0] = s
    integral[:, 1:] = (vander[:, 2:] - vander[:, :-2]) / (2.0 * (2.0 * np.arange(1, k) + 1.0))
    return integral @ np.linalg.inv(vander[:, :-1])


class Profile:
    """Mirror-symmetric closed profiles with area 4 pi, by coefficients a of the tangent angle.

    psi(s) = pi s + sum a_k sin(2 k pi s) over the arc length s in [0, 1], r and z its integrals, times the
    length that the area requires.
    """

    def __init__(self):
        s, w = legendre.leggauss(N_NODES)
        self.s, self.w = 0.5 * (s + 1.0), 0.5 * w
        k = 2.0 * np.pi * np.arange(1, N_MODES + 1)
        self.waves, self.slopes = np.sin(np.outer(self.s, k)), k * np.cos(np.outer(self.s, k))
        self.cumulate = integration_matrix(self.s)

    def curve(self, a):
        """Tangent angle, r, its derivative by a, length and its derivative."""
        psi = np.pi * self.s + self.waves @ a
        r = self.cumulate @ np.cos(psi)
        by_r = -self.cumulate @ (np.sin(psi)[:, None] * self.waves)
        length = np.sqrt(2.0 / (self.w @ r))
        return psi, r, by_r, length, -0.25 * length**3 * (self.w @ by_r)

    def energy(self, a, c):
        """int (H - c)^2 and its derivative."""
        psi, r, by_r, length, by_length = self.curve(a)
        q = np.pi + self.slopes @ a + np.sin(psi) / r
        by_q = self.slopes + (np.cos(psi) / r)[:, None] * self.waves - (np.sin(psi) / r**2)[:, None] * by_r
        p = 0.5 * q - c * length
        inner = (p**2)[:, None] * by_r + (2.0 * r * p)[:, None] * (0.5 * by_q - c * by_length)
        return 2.0 * np.pi * (self.w @ (r * p**2)), 2.0 * np.pi * (self.w @ inner)

    def volume(self, a):
        """Reduced volume and its derivative."""
        psi, r, by_r, length, by_length = self.curve(a)
        total = self.w @ (r**2 * np.sin(psi))
        inner = (2.0 * r * np.sin(psi))[:, None] * by_r + (r**2 * np.cos(psi))[:, None] * self.waves
        return 0.75 * length**3 * total, 0.75 * (
            3.0 * length**2 * by_length * total + length**3 * (self.w @ inner)
        )


def vesicle(reduced_volume, prolate, spontaneous_curvature=0.0):
    """int (H - c)^2 of the vesicle of area 4 pi on the prolate or the oblate branch, H = (k1 + k2)/2.

    Returns
    -------
    float
    (N_NODES, 2) ndarray
        r and z along the profile.
    """
    profile, c = Profile(), spontaneous_curvature
    a = np.zeros(N_MODES)
    a[0] = 0.25 if prolate else -0.25
    for v in np.linspace(0.8, reduced_volume, 4):
        fit = minimize(
            profile.energy, a, (c,), jac=True, method="SLSQP", options={"maxiter": 300, "ftol": 1e-12},
            constraints={
                "type": "eq", "fun": lambda a, v=v: profile.volume(a)[0] - v,
                "jac": lambda a: profile.volume(a)[1],
            },
        )  # fmt: skip
        a = fit.x
    assert abs(profile.volume(a)[0] - reduced_volume) < 1e-8, fit.message
    psi, r, _, length, _ = profile.curve(a)
    return fit.fun, length * np.stack([r, profile.cumulate @ np.sin(psi)], axis=1)
