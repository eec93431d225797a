"""Steady viscous flows by Newton's method on the operators of `fluid-sim`: where its runs end.

The unknowns are those of `VelocityDiffusion`; the equations state that its rate and that of `conservative`
add up to zero. A run may then take a step from the solution to confirm that it stays.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import block_array, csr_array, diags_array
from scipy.sparse.linalg import splu

from ddgcli.io.scene_file import parse_scene
from ddgcli.models.fluid.diffusion import Diffusion, VelocityDiffusion
from ddgcli.models.fluid.model import FluidModel, build, contexts
from ddgcli.models.fluid.scene import KIND
from ddgcli.models.fluid.state import FluidState
from ddgcli.operators.dec import d0
from ddgcli.scenes.scene import resolve
from ddgcli.simulation.account import Account

MAX_NEWTON_ITERATIONS = 30
NEWTON_TOLERANCE = 1e-11


def _no_file(path: str) -> Any:
    raise ValueError(f"{path!r}: scenes of this benchmark name no files")


def model_of(text: str) -> FluidModel:
    """The first fluid of a scene."""
    scene = resolve(parse_scene(text), KIND, {})
    fluids = {name: context for name, (context, _) in contexts(scene, _no_file, _no_file).items()}
    return next(iter(build(scene, fluids, Account()).values()))


@dataclass(eq=False)
class SteadyFlow:
    """Newton's method for one fluid with walls without slip."""

    model: FluidModel

    def __post_init__(self) -> None:
        self.space = space = self.model.setting.space
        friction = self.model.sources.friction
        if not isinstance(friction, Diffusion) or not isinstance(friction.scheme, VelocityDiffusion):
            raise ValueError("the fluid needs viscosity and walls without slip")
        self.scheme = friction.scheme
        derivative = d0(space.mesh.topology).astype(np.float64)
        flows = csr_array(space.harmonic.T)
        self.basis = derivative[:, space.free]
        if flows.shape[1]:
            self.basis = block_array([[self.basis, flows]]).tocsr()
        self.lift = np.zeros(derivative.shape[0]) if space.lift is None else derivative @ space.lift
        m, corner = len(space.faces), np.arange(len(space.faces))
        self.mean = csr_array(
            (np.full(3 * m, 1.0 / 3.0), (np.repeat(corner, 3), space.faces.ravel())), shape=(m, space.n)
        )
        self.side = [
            csr_array((space.side_sign[:, j], (corner, space.side_edge[:, j])), shape=(m, len(self.lift)))
            for j in (0, 2)
        ]

    def solve(self, nu: float, x: NDArray | None = None) -> NDArray[np.float64]:
        """Stream function inside and harmonic coefficients; `x` is the first guess."""
        scheme, basis = self.scheme, self.basis
        weight = scheme.active * self.space.inverse_mass
        x = np.zeros(basis.shape[1]) if x is None else np.array(x)
        first, last = self.side
        for _ in range(MAX_NEWTON_ITERATIONS):
            omega = weight * (scheme.curl @ x + scheme.moving)
            mean, flux = self.mean @ omega, basis @ x + self.lift
            slope = self.mean @ diags_array(weight) @ scheme.curl
            push = first.T @ (-0.5 * mean * (last @ flux)) + last.T @ (0.5 * mean * (first @ flux))
            change = -0.5 * first.T @ (
                diags_array(mean) @ last @ basis + diags_array(last @ flux) @ slope
            ) + 0.5 * last.T @ (diags_array(mean) @ first @ basis + diags_array(first @ flux) @ slope)
            residual = basis.T @ push - nu * (scheme.curl.T @ omega)
            jacobian = basis.T @ change - nu * (scheme.curl.T @ diags_array(weight) @ scheme.curl)
            factor = splu(
                jacobian.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )  # fmt: skip
            step = -factor.solve(residual)
            size, largest = max(float(np.abs(x).max()), 1e-2), float(np.abs(step).max())
            x += step * min(1.0, 0.5 * size / largest)
            if largest < NEWTON_TOLERANCE * size:
                return x
        raise RuntimeError(f"Newton's method stopped at a change of {largest:.3g}")

    def state(self, x: NDArray) -> FluidState:
        """The state of `fluid-sim` with these unknowns."""
        inside = len(self.space.free)
        vorticity = self.scheme.active * (self.scheme.curl @ x + self.scheme.moving)
        return self.model.start.replaced(vorticity=vorticity, coefficients=x[inside:])

    def stream_function(self, x: NDArray) -> NDArray[np.float64]:
        """(n,) with its values on the boundary; without the harmonic flows."""
        phi = np.zeros(self.space.n) if self.space.lift is None else np.array(self.space.lift)
        phi[self.space.free] += x[: len(self.space.free)]
        return phi
