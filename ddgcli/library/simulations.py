"""Simulations as iterators of frames."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ddgcli.io.arrays import read_array
from ddgcli.io.mesh_file import read_mesh
from ddgcli.io.scene_file import SceneDocument, read_scene
from ddgcli.library.arguments import checked_arguments
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.fields import TrajectoryFrame
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.fluid import model as fluid_model
from ddgcli.models.fluid.scene import KIND as FLUID
from ddgcli.models.shell import model as shell_model
from ddgcli.models.shell.scene import KIND as SHELL
from ddgcli.scenes.scene import Scene, resolve
from ddgcli.simulation.account import Account
from ddgcli.simulation.frames import joined_frame, joined_mesh
from ddgcli.simulation.model import Model
from ddgcli.simulation.time_loop import Snapshot, evolve

__all__ = ["Simulation", "simulate"]


@dataclass(eq=False)
class Simulation:
    """A simulation that runs while its frames are taken.

    Parameters
    ----------
    mesh : TriangleMesh, TetMesh or CurveSet
        All objects that move or carry a flow as one mesh, at the start.
    scene : dict
        The scene with every default filled in, or the options of a flow.
    n_frames : int
        Frames of a run that comes to its end, the first at the start.
    snapshots : iterator of Snapshot
        Of the time loop.
    changing_vertices : bool
        Whether frames have different numbers of vertices.
    stopped : str
        Why the run ended before its time, once it has; else "".

    Examples
    --------
    >>> import ddgcli as ddg
    >>> shell = {"role": "shell", "grid": {"size": [1, 1], "cells": [2, 2]}, "material": "paper"}
    >>> scene = {"time": {"duration": 0.1, "step": 0.01}, "object": [shell], "effects": {"gravity": {}}}
    >>> run = ddg.simulate(scene)
    >>> isinstance(run, ddg.Simulation), run.n_frames, [frame.time for frame in run][-1]
    (True, 11, 0.1)
    """

    mesh: TriangleMesh | TetMesh | CurveSet
    scene: dict[str, Any]
    n_frames: int
    snapshots: Iterator[Snapshot]
    changing_vertices: bool = False
    stopped: str = ""

    def __iter__(self) -> Iterator[TrajectoryFrame]:
        return self

    def __next__(self) -> TrajectoryFrame:
        snapshot = next(self.snapshots)
        self.stopped = snapshot.stopped
        return joined_frame(snapshot)


@checked_arguments
def simulate(
    scene: str | os.PathLike[str] | Mapping[str, Any],
    *,
    steps: int | None = None,
    duration: float | None = None,
    step: float | None = None,
    frame_every: float | None = None,
    integrator: str | None = None,
    tolerance: float | None = None,
) -> Simulation:
    """Run the scene of a shell or a fluid, frame by frame.

    Parameters
    ----------
    scene : path of a `.toml` scene, or mapping
        A mapping has the keys of a scene file; meshes in it are relative to the current folder.
    steps : int, optional
        Steps to take, in the place of a duration.
    duration, step, frame_every : float, optional
        Length of the run, time step, and time between frames, in seconds; they replace those of the scene.
    integrator : str, optional
        Time scheme.
    tolerance : float, optional
        Adaptive steps: largest error of a step.

    Returns
    -------
    Simulation
        Iterator of frames: `time` in seconds, `points` (n, 3) (None where the surface does not move),
        `vertex` (arrays such as `velocity`, `strain`, `vorticity`) and `scalar` (energies, momenta).

    Raises
    ------
    SceneError
        A mistake in the scene, with its line.
    SolveError
        While frames are taken: a step failed for good. The frames before it are valid.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> shell = {"role": "shell", "grid": {"size": [1, 1], "cells": [2, 2]}, "material": "paper"}
    >>> scene = {"object": [shell], "effects": {"gravity": {"acceleration": [0, 0, -10]}}}
    >>> for frame in ddg.simulate(scene, duration=0.5, step=0.01):
    ...     height = frame.points[:, 2].mean()
    >>> round(float(height), 6)  # -g t^2 / 2
    -1.25
    """
    document = SceneDocument(dict(scene)) if isinstance(scene, Mapping) else read_scene(os.fspath(scene))
    overrides = {
        "steps": steps,
        "duration": duration,
        "step": step,
        "frame_every": frame_every,
        "integrator": integrator,
        "tolerance": tolerance,
    }
    checked = resolve(
        document,
        FLUID if _is_fluid(document) else SHELL,
        {name: value for name, value in overrides.items() if value is not None},
    )
    account = Account()
    checked, models, meshes = (_fluids if checked.kind is FLUID else _shells)(checked, account)
    schedule = checked.schedule()
    mesh = joined_mesh(meshes)[0]
    return Simulation(mesh, checked.resolved(), schedule.n_frames, evolve(models, schedule, account))


def _is_fluid(document: SceneDocument) -> bool:
    """Whether an object of a document has a role that only fluids have."""
    written = document.data.get("object")
    objects = written if isinstance(written, list) else []
    roles = set(FLUID.roles) - set(SHELL.roles)
    return any(isinstance(table, dict) and table.get("role") in roles for table in objects)


def _shells(scene: Scene, account: Account) -> tuple[Scene, dict[str, Model], list[Any]]:
    """The scene, models and meshes of its shells."""
    folder = Path(scene.document.folder)
    contexts = shell_model.contexts(scene, lambda name: read_mesh(str(folder / name)))
    shells = {name: context for name, (context, _) in contexts.items()}
    return scene, shell_model.build(scene, shells, account), [context.mesh for context in shells.values()]


def _fluids(scene: Scene, account: Account) -> tuple[Scene, dict[str, Model], list[Any]]:
    """The scene with the integrator of its meshes, models and meshes of its fluids."""
    folder = Path(scene.document.folder)
    contexts = fluid_model.contexts(
        scene, lambda name: read_mesh(str(folder / name)), lambda name: read_array(str(folder / name))
    )
    fluids = {name: context for name, (context, _) in contexts.items()}
    scene = fluid_model.with_default_integrator(scene, fluids.values())
    models = fluid_model.build(scene, fluids, account)
    return scene, {name: one.model() for name, one in models.items()}, [c.mesh for c in fluids.values()]
