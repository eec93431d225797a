"""Simulations as iterators of frames, with results at their end."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

from numpy.typing import NDArray

from ddgcli.errors import ParameterError, SolveError
from ddgcli.io.arrays import read_array
from ddgcli.io.mesh_file import MeshInput, read_mesh
from ddgcli.io.scene_file import SceneDocument, read_scene
from ddgcli.library.arguments import checked_arguments
from ddgcli.library.result import Measurement
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.fields import TrajectoryFrame
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.fluid.fluid_scene import FluidScene
from ddgcli.models.fluid.scene import KIND as FLUID
from ddgcli.models.shell.scene import KIND as SHELL
from ddgcli.models.shell.shell_scene import ShellScene
from ddgcli.representation import short_repr
from ddgcli.scenes.scene import resolve
from ddgcli.scenes.scene_model import SceneModel
from ddgcli.simulation.account import Account
from ddgcli.simulation.frames import joined_frame, joined_mesh, mesh_of_frame
from ddgcli.simulation.outcome import Outcome
from ddgcli.simulation.recording import Recorder
from ddgcli.simulation.time_loop import Snapshot, evolve

__all__ = ["Simulation", "simulate"]


@dataclass(frozen=True, eq=False)
class End:
    """What is computed after the last frame.

    Parameters
    ----------
    results, accuracy : dict
    failure_reason : str
        Why the result is unreliable, or "".
    vertex, face : dict of str to ndarray
        Further arrays of the last frame.
    """

    results: dict[str, Any]
    accuracy: dict[str, Any]
    failure_reason: str = ""
    vertex: dict[str, NDArray] = field(default_factory=dict)
    face: dict[str, NDArray] = field(default_factory=dict)

    __repr__ = short_repr


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
        Frames of a complete run, including the one at the start.
    snapshots : iterator of Snapshot
        Snapshots of the time loop.
    end_of : callable Outcome -> End
        Computes the results of the run after its last frame.
    changing_vertices : bool
        Whether frames have different numbers of vertices.

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
    end_of: Callable[[Outcome], End]
    changing_vertices: bool = False
    _measurement: Measurement | None = field(default=None, init=False)

    __repr__ = short_repr

    def __post_init__(self) -> None:
        self._recorder = Recorder(Outcome(mesh=self.mesh), picture=False)

    def __reduce__(self) -> NoReturn:
        raise TypeError("a Simulation holds functions and is not pickled; pass its scene or its end")

    def __iter__(self) -> Iterator[TrajectoryFrame]:
        return self

    def __next__(self) -> TrajectoryFrame:
        try:
            snapshot = next(self.snapshots)
        except StopIteration:
            self._judged()
            raise
        except BaseException as error:
            self._recorder.outcome.failure = str(error) or type(error).__name__
            raise
        trajectory_frame = joined_frame(snapshot)
        self._recorder.add(trajectory_frame, snapshot)
        return trajectory_frame

    def finish(self) -> Measurement:
        """Run to the end, from the last frame that was taken.

        Returns
        -------
        Measurement
            `mesh`, `vertex` and `face` of the last frame, with what the command line adds to it (strains,
            stresses); `results` and `accuracy` (drifts, residuals) of the run as its summary has them.
            `converged` is False, with a warning of the reason, where the command line ends with exit 1.

        Raises
        ------
        SolveError
            A step failed, also with shorter steps.

        Examples
        --------
        >>> import ddgcli as ddg
        >>> shell = {"role": "shell", "grid": {"size": [1, 1], "cells": [2, 2]}, "material": "paper"}
        >>> run = ddg.simulate({"object": [shell], "effects": {"gravity": {}}}, duration=0.1)
        >>> end = run.finish()
        >>> end.converged, end.accuracy["energy_drift"] < 1e-9
        (True, True)
        """
        for _ in self:
            pass
        return self._judged()

    def _judged(self) -> Measurement:
        """The last frame with the results, which are computed once."""
        if self._measurement is None:
            outcome = self._recorder.outcome
            if outcome.failure:
                raise SolveError(outcome.failure)
            self._recorder.finish()
            outcome.status = "complete"
            end, last = self.end_of(outcome), outcome.end
            self._measurement = Measurement(
                mesh_of_frame(self.mesh, last), {**last.vertex, **end.vertex}, {**last.face, **end.face},
                results=end.results, accuracy=end.accuracy, converged=not end.failure_reason,
            )  # fmt: skip
        return self._measurement


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
    modes: int | None = None,
    buckling: int | None = None,
) -> Simulation:
    """Run the scene of a shell or a fluid, frame by frame.

    Parameters
    ----------
    scene : path of a `.toml` scene, or mapping
        A mapping has the keys of a scene file; meshes in it are relative to the current folder.
    steps : int, optional
        Number of steps, instead of a duration.
    duration, step, frame_every : float, optional
        Length of the run, time step, and time between frames, in seconds; they replace those of the scene.
    integrator : str, optional
        Time scheme.
    tolerance : float, optional
        Adaptive steps: largest error of a step.
    modes, buckling : int, optional
        Number of vibration modes about the start (of `static`: the equilibrium), and of buckling modes, that
        `finish` returns (`mode_000`, ..., `frequencies`, `load_factors`); without time steps.

    Returns
    -------
    Simulation
        Iterator of frames: `time` in seconds, `points` (n, 3) (None where the surface does not move),
        `vertex` (arrays such as `velocity`, `strain`, `vorticity`) and `scalar` (energies, momenta).
        `finish` runs to the end and returns the last frame with the results and accuracy of the run.

    Raises
    ------
    SceneError
        A mistake in the scene, with its line.
    SolveError
        During iteration: a step failed, also with shorter steps. The frames before it are valid.

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
    account = Account()
    model = _scene_model(
        document,
        {name: value for name, value in overrides.items() if value is not None},
        {name: k for name, k in (("modes", modes), ("buckling", buckling)) if k is not None},
        account,
    )

    def end_of(outcome: Outcome) -> End:
        reason = model.failure_reason(outcome)
        vertex, face = model.final(outcome)
        return End(*model.summary(outcome), reason, vertex, {**face, **model.face()})

    mesh, schedule = joined_mesh(list(model.meshes.values()))[0], model.schedule()
    snapshots = evolve(model.models(), schedule, account)
    return Simulation(mesh, model.scene.resolved(), schedule.n_frames, snapshots, end_of, model.splits)


def _scene_model(
    document: SceneDocument, overrides: Mapping[str, Any], counts: Mapping[str, int], account: Account
) -> SceneModel:
    """The shells of a document, with the numbers of modes to compute, or its fluids."""
    folder, is_fluid = Path(document.folder), _is_fluid(document)
    for name, count in counts.items():
        if is_fluid:
            raise ParameterError("is for shells; leave it out", parameter=name)
        if count < 1:
            raise ParameterError(f"must be 1 or more, not {count}", parameter=name)

    def read(name: str) -> MeshInput:
        return read_mesh(str(folder / name))

    def read_values(name: str) -> NDArray:
        return read_array(str(folder / name))

    scene = resolve(document, FLUID if is_fluid else SHELL, overrides)
    if is_fluid:
        return FluidScene(scene, account, read, read_values)
    return ShellScene(scene, account, read, read_values, **counts)


def _is_fluid(document: SceneDocument) -> bool:
    """Whether an object of a document has a role that only fluids have."""
    written = document.data.get("object")
    objects = written if isinstance(written, list) else []
    roles = set(FLUID.roles) - set(SHELL.roles)
    return any(isinstance(table, dict) and table.get("role") in roles for table in objects)
