"""Interface between a scene with its physics and what runs it: the command line and the library."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol

from ddgcli.scenes.scene import Scene
from ddgcli.simulation.model import Model, Schedule
from ddgcli.simulation.outcome import Outcome

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ddgcli.mesh.periodic import Periods

ReadMesh = Callable[[str], Any]  # path to content of a mesh file
ReadArray = Callable[[str], "NDArray"]


class SceneModel(Protocol):
    """The objects of a scene: from their meshes to models, and from the frames to results."""

    scene: Scene  # with the defaults that depend on the meshes
    meshes: dict[str, Any]
    sha256: dict[str, str]
    moving: bool
    splits: bool  # whether vertices may split, so that each frame has a mesh of its own

    @property
    def energy_label(self) -> str:
        """What the energies of the frames are, with their unit."""
        ...

    @property
    def periods(self) -> Periods | None:
        """Periods of the objects, where a grid is periodic."""
        ...

    def assembled(self, schedule: Schedule) -> dict[str, Any]:
        """Properties of the models that a dry run prints."""
        ...

    def cost_facts(self) -> dict[str, Any]:
        """Properties of the scene that determine its cost."""
        ...

    def linear_solver(self) -> str | None:
        """Solver of the linear systems of the steps, as the run chooses it; None where they have none."""
        ...

    def parts_of_step(self, schedule: Schedule) -> float:
        """Measured steps that a step of the schedule is worth, by what is stable at the start."""
        ...

    def models(self) -> dict[str, Model]: ...
    def face(self) -> dict[str, Any]:
        """Constant arrays on faces."""
        ...

    def schedule(self) -> Schedule: ...
    def final(self, outcome: Outcome) -> tuple[dict[str, Any], dict[str, Any]]:
        """(vertex, face) arrays of the last frame, for meshes."""
        ...

    @property
    def final_names(self) -> tuple[str, ...]:
        """Names that arrays of `final` may have."""
        ...

    def obstacle_poses(self, time: float) -> dict[str, NDArray]:
        """(12,) rotation by rows and translation of each moving obstacle from its start."""
        ...

    def failure_reason(self, outcome: Outcome) -> str:
        """Reason why the result is unreliable, or ""."""
        ...

    def summary(self, outcome: Outcome) -> tuple[dict[str, Any], dict[str, Any]]:
        """(`results`, `accuracy`)."""
        ...
