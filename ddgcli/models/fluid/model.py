"""Fluids of a scene as models for the loop: one for each, since nothing couples them."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshError
from ddgcli.models.fluid import parts
from ddgcli.models.fluid.context import FluidContext
from ddgcli.models.fluid.space import FlowSpace, harmonic_count, require_flow
from ddgcli.scenes.scene import Key, Scene
from ddgcli.scenes.shapes import place
from ddgcli.simulation.account import Account
from ddgcli.simulation.effects import Effect
from ddgcli.simulation.time_loop import Model, Observation, StepRejected

log = logging.getLogger("ddgcli")

FOLDED = 1.0  # change of the velocity along a side times dt over its length, beyond which loops fold
RISE = 1e-6  # relative rise of the kinetic energy at which a step by circulation is shortened
SETTLED = 1e-10  # relative change left by the iteration of the midpoint rule
# most harmonic flows kept as a dense basis
MOST_HARMONIC = 2_000


@dataclass(frozen=True, eq=False)
class FluidState:
    """A flow at one time.

    Parameters
    ----------
    vorticity : (n,) ndarray
        Integrated over the vertices' cells.
    coefficients : (b,) ndarray
        Of the harmonic flows.
    dye : (n,) ndarray, or (0,) without dye
    """

    vorticity: NDArray[np.float64]
    coefficients: NDArray[np.float64]
    dye: NDArray[np.float64]


def contexts(
    scene: Scene, read: Callable[[str], Any], load: Callable[[str], NDArray]
) -> dict[str, tuple[FluidContext, str]]:
    """Context of every fluid and the SHA-256 of its mesh file, by name."""
    found = {}
    for number, section in enumerate(scene.objects):
        try:
            placed = place(section, read)
            require_flow(placed.mesh)
        except ValueError as error:
            scene.refuse(("object", number), f"object {section.name!r}: {error}")
        period = np.zeros(3)
        if section.grid is not None:
            size = np.array(section.grid.size) * section.scale
            period[:2] = [size[k] if axis in section.grid.periodic else 0.0 for k, axis in enumerate("xy")]
        context = FluidContext(section.name, placed.mesh, placed.vertex, placed.face, period, load)
        found[section.name] = context, placed.sha256
    return found


def parts_of(scene: Scene, context: FluidContext) -> list[Any]:
    """What the scene's effects make for one fluid."""

    def make(effect: Effect, parameters: Any, key: Key) -> list[Any]:
        wanted = getattr(parameters, "object", None)
        if wanted is not None:
            scene.find(wanted, (*key, "object"), ("fluid",))
            if wanted != context.name:
                return []
        return effect.build(parameters, context)

    return [part for made in scene.build(make) for part in made]


def _one(made: list[Any], kind: type) -> Any:
    return next((part for part in made if isinstance(part, kind)), None)


def build(scene: Scene, fluids: dict[str, FluidContext], account: Account) -> dict[str, FluidModel]:
    """One model for each fluid; what no effect asks for is not made."""
    return {
        name: FluidModel(scene, number, context, account)
        for number, (name, context) in enumerate(fluids.items())
    }


class FluidModel:
    """A fluid put together: its space, its parts, and its steps."""

    def __init__(self, scene: Scene, number: int, context: FluidContext, account: Account) -> None:
        self.context, self.account, self.time = context, account, scene.time
        made = parts_of(scene, context)
        self.harmonic = _one(made, parts.Harmonic)
        self.walls = _one(made, parts.Walls)
        self.viscosity = _one(made, parts.Viscosity)
        dye = _one(made, parts.Dye)
        try:
            self.space = FlowSpace(context.mesh, self._harmonic_flows(), lambda: account.within("solver"))
        except MeshError as error:
            scene.refuse(("object", number), f"object {context.name!r}: {error}")
        self._require_walls(scene)
        self.evolve = self.harmonic is not None and self.harmonic.evolve
        self.diffusion = self._diffusion()
        self.transport: Any = None
        if scene.time.integrator == "circulation":
            from ddgcli.models.fluid.circulation import CirculationAdvection

            self.circulation = CirculationAdvection(self.space)
            self.transport = self.circulation.transport
            self.advect = self._by_circulation
        else:
            self.advect = self._by_midpoint if scene.time.scheme == "midpoint" else self._by_runge_kutta
        if dye is not None and self.transport is None:
            from ddgcli.models.fluid.transport import Transport

            self.transport = Transport(self.space)
        self._require_coefficients(scene)
        self.start = self._start([p for p in made if isinstance(p, parts.Initial)], dye)

    # ------------------------------------------------------------------ assembly

    def _harmonic_flows(self) -> NDArray[np.float64]:
        topology, count = self.context.mesh.topology, harmonic_count(self.context.mesh)
        if self.harmonic is None:
            if count:
                log.info(
                    "%s has %d harmonic flows; they exist where the scene names the effect harmonic",
                    self.context.name, count,
                )  # fmt: skip
            return np.zeros((0, topology.n_edges))
        if count > MOST_HARMONIC:
            raise MeshError(
                f"the surface has {count} harmonic flows, more than {MOST_HARMONIC}; leave the effect out"
            )
        from ddgcli.algorithms.hodge.harmonic import harmonic_basis

        return harmonic_basis(self.context.mesh, "normal").forms

    def _require_walls(self, scene: Scene) -> None:
        if self.walls is not None and self.walls.no_slip and self.viscosity is None:
            scene.refuse(
                ("effects", "boundary"),
                "boundary kind no-slip needs the effect viscosity with nu > 0; without it there is free slip",
            )
        if self.walls is not None and self.walls.no_slip and self.harmonic is None:
            count = harmonic_count(self.context.mesh)
            if count:
                log.warning(
                    "%s has %d harmonic flows (round its handles and holes), which walls without slip drive; "
                    "the scene leaves them out, and the flow is wrong: add the effect harmonic = {}",
                    self.context.name, count,
                )  # fmt: skip
        open_ = not self.context.mesh.topology.is_closed
        slips = self.walls is None or not self.walls.no_slip
        if self.viscosity is not None and open_ and slips and self.viscosity.kind != "hodge":
            scene.refuse(
                ("effects", "viscosity"),
                f"viscosity kind {self.viscosity.kind} on a surface with boundary needs boundary no-slip; "
                "with free slip there is kind hodge",
            )

    def _require_coefficients(self, scene: Scene) -> None:
        given = None if self.harmonic is None else self.harmonic.coefficients
        if given is not None and len(given) != len(self.space.harmonic):
            scene.refuse(
                ("effects", "harmonic"),
                f"effect harmonic gives {len(given)} coefficients; the surface {self.context.name!r} has "
                f"{len(self.space.harmonic)} harmonic flows",
            )

    def _diffusion(self) -> Any:
        if self.viscosity is None:
            return None
        from ddgcli.models.fluid.diffusion import VelocityDiffusion, VorticityDiffusion

        no_slip = self.walls is not None and self.walls.no_slip
        if self.viscosity.kind == "hodge" and not no_slip:
            return VorticityDiffusion(self.space, self.viscosity.nu)
        moving = None if self.walls is None else self.walls.moving
        return VelocityDiffusion(self.space, self.viscosity.nu, self.viscosity.kind, moving)

    def _start(self, initial: list[Any], dye: Any) -> FluidState:
        space = self.space
        vorticity, coefficients = np.zeros(space.n), np.zeros(len(space.harmonic))
        for part in initial:
            more, harmonic = part.make(space)
            vorticity, coefficients = vorticity + more, coefficients + harmonic
        if self.harmonic is not None and self.harmonic.coefficients is not None:
            coefficients = coefficients + np.array(self.harmonic.coefficients)
        return FluidState(vorticity, coefficients, np.zeros(0) if dye is None else dye.amount)

    def model(self) -> Model[FluidState]:
        """The joint to the time loop."""
        fourth = self.diffusion is None and self.advect == self._by_runge_kutta
        return Model(
            self.start, self.advance, self.observe, self.pack, self.unpack,
            distance=self.distance, order=4 if fourth else 2,
        )  # fmt: skip

    # ------------------------------------------------------------------ steps

    def advance(self, state: FluidState, time: float, dt: float) -> FluidState:
        """Half of the viscosity, the transport, the other half: second order in time."""
        account = self.account
        if self.diffusion is not None:
            with account.within("viscosity"):
                state = self._diffused(state, 0.5 * dt)
        carried = self.advect(state, dt)
        if len(state.dye):
            with account.within("dye"):
                carried = replace(carried, dye=self._carried_dye(state, carried, dt))
        if self.diffusion is not None:
            with account.within("viscosity"):
                carried = self._diffused(carried, 0.5 * dt)
        if not (np.isfinite(carried.vorticity).all() and np.isfinite(carried.coefficients).all()):
            raise StepRejected("not finite")
        return carried

    def _diffused(self, state: FluidState, dt: float) -> FluidState:
        vorticity, coefficients = self.diffusion.step(state.vorticity, state.coefficients, dt)
        return replace(state, vorticity=vorticity, coefficients=coefficients)

    def _by_runge_kutta(self, state: FluidState, dt: float) -> FluidState:
        from ddgcli.models.fluid.conservative import RK4_LIMIT, runge_kutta

        vorticity, coefficients, courant = runge_kutta(
            self.space, state.vorticity, state.coefficients, dt, self.evolve
        )
        if not courant <= RK4_LIMIT:
            raise StepRejected("stability", value=courant)
        return replace(state, vorticity=vorticity, coefficients=coefficients)

    def _by_midpoint(self, state: FluidState, dt: float) -> FluidState:
        from ddgcli.models.fluid.conservative import midpoint

        vorticity, coefficients, change = midpoint(
            self.space, state.vorticity, state.coefficients, dt, self.evolve
        )
        if not change <= SETTLED:
            raise StepRejected("midpoint iteration", value=change)
        return replace(state, vorticity=vorticity, coefficients=coefficients)

    def _by_circulation(self, state: FluidState, dt: float) -> FluidState:
        vorticity, coefficients, folded, rise = self.circulation.step(
            state.vorticity, state.coefficients, dt, self.evolve, FOLDED
        )
        if not folded <= FOLDED:
            raise StepRejected("loops fold", value=folded)
        from ddgcli.models.fluid.circulation import SMALL

        if folded > SMALL and not rise <= RISE:
            raise StepRejected("energy rises", value=rise)
        return replace(state, vorticity=vorticity, coefficients=coefficients)

    def _side_flux(self, state: FluidState) -> NDArray[np.float64]:
        return self.space.side_flux(self.space.stream_function(state.vorticity), state.coefficients)

    def _carried_dye(self, before: FluidState, after: FluidState, dt: float) -> NDArray[np.float64]:
        """Dye at the points that the flow of mid-step carries to the vertices."""
        from ddgcli.models.fluid.circulation import corner_of

        space, transport = self.space, self.transport
        flux = 0.5 * (self._side_flux(before) + self._side_flux(after))
        used = np.flatnonzero(space.mesh.topology.referenced_vertex)
        face, corner = corner_of(space, used)
        moved = transport.backwards(transport.corners(flux), face, np.eye(3)[corner], dt)
        amount = np.array(before.dye)
        amount[used] = np.einsum("ij,ij->i", before.dye[space.faces[moved.face]], moved.barycentric)
        return amount

    # ------------------------------------------------------------------ what it shows

    def distance(self, a: FluidState, b: FluidState) -> float:
        """L2 distance of the vorticities, relative to the start's (after rest to that of `b`)."""
        space = self.space
        apart = np.sqrt(space.enstrophy(a.vorticity - b.vorticity))
        scale = np.sqrt(space.enstrophy(self.start.vorticity) or space.enstrophy(b.vorticity)) or 1.0
        turned = np.linalg.norm(a.coefficients - b.coefficients)
        size = np.linalg.norm(self.start.coefficients) or np.linalg.norm(b.coefficients) or 1.0
        return float(apart / scale + turned / size)

    def observe(self, state: FluidState) -> Observation:
        """Vorticity, stream function, velocity, dye; energies and circulations."""
        space, context = self.space, self.context
        phi = space.stream_function(state.vorticity)
        side_flux = space.side_flux(phi, state.coefficients)
        edge_flux = space.edge_flux(phi, state.coefficients)
        planar = space.face_velocity(side_flux)
        vertex = {
            "vorticity": state.vorticity * space.inverse_mass,
            "stream_function": space.centred(phi),
            "velocity": self._vertex_velocity(context.to_space(planar)),
        }
        if len(state.dye):
            vertex["dye"] = state.dye
        largest = float(np.abs(side_flux).max(initial=0.0))
        scalar: dict[str, Any] = {
            "kinetic_energy": space.kinetic_energy(phi, state.vorticity, state.coefficients),
            "enstrophy": space.enstrophy(state.vorticity),
            "total_vorticity": float(state.vorticity.sum()),
            "absolute_vorticity": float(np.abs(state.vorticity).sum()),
            "divergence": float(np.abs(side_flux.sum(axis=1)).max(initial=0.0)) / (largest or 1.0),
        }
        if len(state.dye):
            scalar["total_dye"] = float(state.dye @ space.mass)
        for name, values in (
            ("harmonic_coefficients", state.coefficients),
            ("boundary_circulation", space.boundary_circulation(state.vorticity, edge_flux)),
        ):
            if len(values):
                scalar[f"{name}_{context.name}"] = values
        return Observation(None, vertex, scalar)

    def _vertex_velocity(self, face_vectors: NDArray) -> NDArray[np.float64]:
        """(n, 3) means of the faces' velocities, by area."""
        space = self.space
        weighted = space.area[:, None] * face_vectors
        summed = np.stack(
            [
                np.bincount(space.faces.ravel(), weights=np.repeat(w, 3), minlength=space.n)
                for w in weighted.T
            ],
            axis=1,
        )
        return summed * (space.inverse_mass / 3.0)[:, None]

    def pack(self, state: FluidState) -> dict[str, NDArray]:
        """The state as arrays of fixed shape."""
        arrays = {"vorticity": state.vorticity, "coefficients": state.coefficients, "dye": state.dye}
        return {name: values for name, values in arrays.items() if len(values)}

    def unpack(self, arrays: dict[str, NDArray]) -> FluidState:
        none = np.zeros(0)
        return FluidState(arrays["vorticity"], arrays.get("coefficients", none), arrays.get("dye", none))
