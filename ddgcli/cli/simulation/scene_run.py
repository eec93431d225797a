"""Run a scene: shared by all simulators that read scene files."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ddgcli.cli.forecast.check_cost import predict_run, refuse_run
from ddgcli.cli.forecast.prediction import Prediction, as_results, with_divided_steps
from ddgcli.cli.forecast.use import InputSize
from ddgcli.cli.run import Run
from ddgcli.cli.simulation.options import SceneCall
from ddgcli.cli.simulation.plot import Picture, draw_run
from ddgcli.cli.simulation.scene_input import (
    check_unchanged,
    describe_input,
    fingerprint,
    mesh_reader,
    print_dry_run,
    print_effects,
    print_schema,
    scene_document,
)
from ddgcli.cli.simulation.simulate import Job, check_job, formats, simulate
from ddgcli.io.trajectories.layout_check import PERIODS
from ddgcli.scenes.obstacle_meshes import obstacle_meshes
from ddgcli.scenes.scene import Scene, SceneKind, resolve
from ddgcli.scenes.scene_model import ReadArray, ReadMesh, SceneModel
from ddgcli.scenes.sections import Document
from ddgcli.simulation.account import Account, time_shares
from ddgcli.simulation.model import Schedule
from ddgcli.simulation.outcome import Outcome

if TYPE_CHECKING:
    from numpy.typing import NDArray


log = logging.getLogger("ddgcli")


def run_scene(
    call: SceneCall,
    kind: SceneKind,
    build: Callable[[Scene, Account, ReadMesh, ReadArray], SceneModel],
    picture: Callable[[Any, Outcome], Picture],
    lines: tuple[str, ...],
    extra: dict[str, Any],
) -> None:
    """Run the scene of a call, or print its effects, schema or dry run.

    Parameters
    ----------
    call : SceneCall
    kind : SceneKind
    build : callable (scene, account, read_mesh, read_array) -> SceneModel
    picture : callable (scene model, outcome) -> Picture
    lines, extra : tuple of str, dict
        Effects and keys of the object in the quick form.
    """
    if call.list_effects:
        print_effects(kind.effects, call.common.as_json)
        return
    if call.schema:
        print_schema(kind)
        return
    run = Run(kind.command, call.common, formats=formats(), **call.overrides)
    run.set_input(call.path or call.resume or "", "")
    role = next(iter(kind.roles))
    document, recorded = scene_document(call.path, role, lines, extra, call.resume, call.common.input_format)
    overrides = {**recorded, **call.overrides}
    scene, account = resolve(document, kind, overrides), Account()
    run.name_mesh(scene.only_mesh_path)
    if not scene.effects:
        log.warning("the scene has no effects, so nothing acts on its objects; --effects lists the effects")
    read = mesh_reader(run, document)
    simulator = build(scene, account, read, array_reader(document))
    scene = simulator.scene
    meshes = list(simulator.meshes.values())
    resolved, digest = fingerprint(scene.resolved(), simulator.sha256)
    describe_input(run, call.path or call.resume or "", meshes, digest)
    check_unchanged(call.resume, resolved)
    size = scene_size(meshes, simulator.schedule())
    facts = {"integrator": scene.time.integrator, **simulator.cost_facts()}
    prediction = run.predict(size, facts)
    recorded_input = {"input_sha256": digest, "overrides": overrides, "folder": document.folder}
    scene_texts = {"scene_source": document.source, "scene_resolved": resolved}
    with run.clock.timed("compute"):
        job = _job(simulator, account, call.resume, recorded_input, scene_texts, read)
    check_job(run, job)
    if call.common.dry_run and prediction is not None:
        _dry_run(run, simulator, job, size, facts, prediction)
        return
    outcome = simulate(run, job)
    results, accuracy = simulator.summary(outcome)
    names = list(dict.fromkeys(effect.name for effect, _, _ in scene.effects))
    results["effects"], results["seconds_by_part"] = time_shares(account, names, outcome.seconds)

    def draw(path: str) -> None:
        labels = {**time_label(scene), "energy": simulator.energy_label}
        look = replace(picture(simulator, outcome), periods=simulator.periods, **labels)
        draw_run(path, outcome, look, run.common, job.obstacles_at)

    run.plot(draw)
    run.finish(results, accuracy, converged=not (outcome.failure or outcome.failure_reason))


def _job(
    simulator: SceneModel,
    account: Account,
    resume: str | None,
    recorded_input: dict[str, Any],
    scene_texts: dict[str, Any],
    read: ReadMesh,
) -> Job:
    """The models of a scene, and what a run of them records."""
    scene, meshes = simulator.scene, list(simulator.meshes.values())
    return Job(
        simulator.models(), meshes, simulator.schedule(), account, simulator.moving, resume,
        {**recorded_input, **_frame_facts(simulator)}, scene_texts, simulator.face(),
        obstacle_meshes(scene.objects, meshes, read), simulator.obstacle_poses,
        simulator.failure_reason, simulator.final, simulator.final_names, simulator.splits, simulator.splits,
    )  # fmt: skip


def _dry_run(
    run: Run, simulator: SceneModel, job: Job, size: InputSize, facts: dict[str, Any], prediction: Prediction
) -> None:
    """Print the cost of a run, by what is known once its models exist, and by its first steps."""
    scene = simulator.scene
    if solver := simulator.linear_solver():
        prediction = predict_run(run, size, facts | {"solver": solver}, prediction)
        refuse_run(run, size, prediction)
    prediction = with_divided_steps(prediction, simulator.parts_of_step(job.schedule))
    assembled = simulator.assembled(job.schedule)
    from ddgcli.cli.simulation.first_steps import with_first_iterations, with_first_steps

    if scene.time.integrator == "static":  # whose steps are equilibria
        prediction = with_first_iterations(prediction, job)
    else:
        prediction = with_first_steps(prediction, job, at_least_table=bool(facts.get("contact")))
    print_dry_run(run, scene, assembled, as_results(prediction, size))


def _frame_facts(simulator: SceneModel) -> dict[str, Any]:
    """Attributes of a trajectory that pictures of its frames need."""
    periods = simulator.periods
    labels = {**time_label(simulator.scene), "energy_label": simulator.energy_label}
    if periods is None:
        return labels
    return {**labels, PERIODS: {name: period.tolist() for name, period in periods.of_object.items()}}


def time_label(scene: Scene) -> dict[str, Any]:
    """`time_name` and `time_unit` of frames whose time is no time: load factors of `arc_length`."""
    if not getattr(scene.time, "arc_length", None):
        return {}
    if scene.time.duration == 1.0:
        return {"time_name": "load factor", "time_unit": ""}
    return {"time_name": "load factor × duration", "time_unit": "s"}


def scene_size(meshes: list[Any], schedule: Schedule) -> InputSize:
    """Elements of all objects, steps and frames."""
    volume = any(hasattr(mesh, "tetrahedra") for mesh in meshes)
    elements = sum(len(mesh.tetrahedra if hasattr(mesh, "tetrahedra") else mesh.faces) for mesh in meshes)
    size = InputSize(
        "tetrahedra" if volume else "surface", elements, steps=schedule.steps, frame_count=schedule.n_frames,
        adaptive=schedule.tolerance is not None,
    )  # fmt: skip
    surfaces = [mesh for mesh in meshes if not hasattr(mesh, "tetrahedra") and len(mesh.faces)]
    if volume or not surfaces:
        return size
    return replace(size, component_elements=max(_largest_component(mesh) for mesh in surfaces))


def _largest_component(mesh: Any) -> int:
    """Faces of the largest component of a surface."""
    import numpy as np

    return int(np.bincount(mesh.topology.vertex_component.take(mesh.faces[:, 0])).max())


def array_reader(document: Document) -> ReadArray:
    """Reader of array files relative to the scene."""

    def read(name: str) -> NDArray:
        from ddgcli.io.arrays import read_array

        return read_array(str(Path(document.folder) / name))

    return read
