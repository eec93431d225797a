"""What the three simulators share: options of time, scenes and resuming, and the run itself."""

from __future__ import annotations

import hashlib
import json
import logging
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from ddgcli import __version__
from ddgcli.cli import options
from ddgcli.cli.run import Run, describe
from ddgcli.errors import ParameterError, SceneError, SolveError
from ddgcli.evolve.account import Account
from ddgcli.evolve.effects import EffectTable
from ddgcli.evolve.frames import joined_frame, joined_mesh
from ddgcli.evolve.loop import Model, Schedule, Snapshot, evolve
from ddgcli.mesh.fields import AnnotatedMesh, Frame

TRAJECTORIES = (".vtkhdf", ".h5")

_TIME = (
    click.option(
        "--steps", type=click.IntRange(min=1), help="Steps to take; overrides the scene's duration."
    ),
    click.option("--duration", type=options.POSITIVE, help="Length of the run [s]."),
    click.option("--dt", "step", type=options.POSITIVE, help="Time step [s]."),
    click.option("--frame-every", type=options.POSITIVE, help="Time between frames [s]."),
    click.option("--tolerance", type=options.POSITIVE, help="Adaptive steps: largest error of a step."),
    click.option("--integrator", metavar="NAME", help="Time scheme."),
)
_RESUME = click.option(
    "--resume", metavar="RUN.part", type=click.Path(), help="Go on from its last whole frame."
)
_SCENE = (
    click.option("--effect", "effect_lines", multiple=True, metavar="'NAME KEY=VALUE ...'",
                 help="Without a scene file: an effect, its parameters in TOML. Repeatable."),
    click.option("--effects", "list_effects", is_flag=True, help="List the effects and their parameters."),
    click.option("--schema", is_flag=True, help="Print the JSON Schema of scenes, for editors."),
    click.option("--dry-run", is_flag=True, help="Check everything and print what would be assembled."),
)  # fmt: skip


def time_options(command: Callable) -> Callable:
    """--steps, --duration, --dt, ... gathered in one `overrides: dict`; and --resume."""

    def gathered(*args: Any, **kwargs: Any) -> Any:
        names = ("steps", "duration", "step", "frame_every", "tolerance", "integrator")
        overrides = {name: kwargs.pop(name) for name in names}
        if overrides["steps"] and overrides["duration"]:
            raise ParameterError("give either --steps or --duration")
        return command(*args, overrides={k: v for k, v in overrides.items() if v is not None}, **kwargs)

    gathered.__name__, gathered.__doc__ = command.__name__, command.__doc__
    gathered.__click_params__ = getattr(command, "__click_params__", [])  # type: ignore[attr-defined]
    for option in reversed((*_TIME, _RESUME)):
        gathered = option(gathered)
    return gathered


def scene_options(command: Callable) -> Callable:
    """--effect, --effects, --schema, --dry-run."""
    for option in reversed(_SCENE):
        command = option(command)
    return command


# ---------------------------------------------------------------- scenes


def quick_scene(mesh: str, role: str, lines: tuple[str, ...], extra: Mapping[str, Any] | None = None) -> str:
    """TOML of the scene that `COMMAND MESH --effect ...` means.

    Parameters
    ----------
    mesh : str
    role : str
    lines : tuple of str
        "NAME" or "NAME key=value key=value".
    extra : mapping
        More keys of the object.
    """
    text = [
        'format = "ddgcli-scene/1"',
        "",
        "[[object]]",
        f"name = {_toml(Path(mesh).stem)}",
        f'role = "{role}"',
    ]
    text += [f"mesh = {_toml(str(Path(mesh).absolute()))}"]
    text += [f"{key} = {_toml(value)}" for key, value in (extra or {}).items()]
    repeated = [line.split(None, 1)[0] for line in lines if line.split()]
    for line in lines:
        if not line.split():
            raise ParameterError("--effect needs the name of an effect")
        name, _, rest = line.strip().partition(" ")
        header = f"[[effects.{name}]]" if repeated.count(name) > 1 else f"[effects.{name}]"
        text += ["", header, *_assignments(rest, line)]
    return "\n".join(text) + "\n"


def _assignments(rest: str, line: str) -> list[str]:
    """`key = value` lines of "key=value key=value", split where a key begins outside brackets and quotes."""
    import re
    import tomllib

    starts, depth, quote = [], 0, ""
    for k, c in enumerate(rest):
        if quote:
            quote = "" if c == quote else quote
        elif c in "\"'":
            quote = c
        elif c in "[{":
            depth += 1
        elif c in "]}":
            depth -= 1
        elif depth == 0 and (k == 0 or rest[k - 1] in " ,\t") and re.match(r"[A-Za-z_]\w*\s*=", rest[k:]):
            starts.append(k)
    pieces = [rest[a:b].strip().rstrip(",") for a, b in zip(starts, [*starts[1:], len(rest)])]
    if rest.strip() and (not starts or rest[: starts[0]].strip()):
        raise ParameterError(
            f"--effect {line!r}: after the name come key=value pairs; found {rest.strip()!r}"
        )
    for piece in pieces:
        try:
            tomllib.loads(piece)
        except tomllib.TOMLDecodeError as error:
            raise ParameterError(
                f'--effect {line!r}: {piece!r} is not TOML; quote texts: key="text"'
            ) from error
    return pieces


def toml_settings(settings: tuple[str, ...]) -> dict[str, Any]:
    """Keys of --set KEY=VALUE; a value that is not TOML is taken as text."""
    import tomllib

    found: dict[str, Any] = {}
    for setting in settings:
        key, equals, value = setting.partition("=")
        if not equals or not key.strip():
            raise ParameterError(f"--set {setting!r}: write KEY=VALUE")
        try:
            found[key.strip()] = tomllib.loads(f"v = {value}")["v"]
        except tomllib.TOMLDecodeError:
            found[key.strip()] = value
    return found


def _toml(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)


def scene_document(
    path: str | None, role: str, lines: tuple[str, ...], extra: Mapping[str, Any], resume: str | None
) -> tuple[Any, dict[str, Any]]:
    """The document to run and the time options recorded by the run that is resumed.

    A `.toml` is a scene; anything else is a mesh for the quick form. With --resume and no path, the
    scene that the trajectory holds.
    """
    from ddgcli.io.scene_file import parse_scene, read_scene

    recorded: dict[str, Any] = {}
    if resume is not None:
        from ddgcli.io.trajectory import Trajectory

        with Trajectory(resume) as part:
            recorded = json.loads(part.attributes.get("overrides", "{}"))
            if path is None:
                return parse_scene(
                    part.text("scene_source"), "", part.attributes.get("folder", ".")
                ), recorded
    if path is None:
        raise ParameterError("give a scene file or a mesh (or --effects, --schema)")
    if path.endswith(".toml"):
        if lines or extra:
            raise ParameterError(
                f"{path}: --effect, --pin and --set build a scene from a mesh; write them into the scene"
            )
        return read_scene(path), recorded
    return parse_scene(quick_scene(path, role, lines, extra), "", "."), recorded


def describe_input(run: Run, path: str, meshes: list[Any]) -> None:
    """The `input` block: all meshes of the scene as one."""
    mesh, _ = joined_mesh(meshes)
    run.input = {"path": path, **describe(mesh)}


def mesh_reader(run: Run, document: Any) -> Callable[[str], Any]:
    """Read a mesh file relative to the scene."""

    def read(name: str) -> Any:
        from ddgcli.io.mesh_file import read_mesh

        with run.timed("read"):
            return read_mesh(str(Path(document.folder) / name))

    return read


def print_effects(table: EffectTable, as_json: bool) -> None:
    """--effects: every effect, its parameters with units and defaults, its cost."""
    listing = {name: _described(table, name, line) for name, (_, line) in table.entries.items()}
    if as_json:
        click.echo(json.dumps(listing, ensure_ascii=False))
        return
    for name, entry in listing.items():
        click.echo(f"{name}: {entry['summary']}")
        click.echo(f"    cost: {entry['cost']}; acts on: {', '.join(entry['roles'])}")
        for key, p in entry["parameters"].items():
            default = (
                "needed" if p["default"] is None and p["required"] else f"default {json.dumps(p['default'])}"
            )
            unit = f" [{p['unit']}]" if p["unit"] else ""
            choices = f" ({' | '.join(map(str, p['choices']))})" if p["choices"] else ""
            click.echo(f"    {key}{unit}{choices}: {p['description'] or '-'}; {default}")


def _described(table: EffectTable, name: str, line: str) -> dict[str, Any]:
    effect = table.load(name)
    schema = effect.parameters.model_json_schema()  # type: ignore[attr-defined]
    parameters = {}
    for key, entry in schema.get("properties", {}).items():
        branches = [entry, *entry.get("anyOf", [])]
        parameters[key] = {
            "unit": next((b["unit"] for b in branches if "unit" in b), ""),
            "choices": next((b["enum"] for b in branches if "enum" in b), []),
            "default": entry.get("default"),
            "required": key in schema.get("required", []),
            "description": entry.get("description", ""),
        }
    return {"summary": line, "cost": effect.cost, "roles": list(effect.roles), "parameters": parameters}


def print_schema(kind: Any) -> None:
    """--schema: the JSON Schema of the simulator's scenes."""
    from ddgcli.models.scene_schema import json_schema

    click.echo(json.dumps(json_schema(kind), indent=2, ensure_ascii=False))


def print_dry_run(run: Run, scene: Any, assembled: dict[str, Any]) -> None:
    """--dry-run: the resolved scene and what would be assembled."""
    content = {"command": run.command, "dry_run": True, "scene": scene.resolved(), "assembled": assembled}
    if run.common.as_json:
        from ddgcli.cli.report import plain

        click.echo(json.dumps(plain(content), ensure_ascii=False))
        return
    click.echo(json.dumps(content["scene"], indent=2, ensure_ascii=False))
    for name, value in assembled.items():
        click.echo(f"{name}: {value}")


# ---------------------------------------------------------------- runs


@dataclass(eq=False)
class Outcome:
    """What a run left behind.

    Parameters
    ----------
    frames : int
    first, last : Frame
    series : dict of str to (T, ...) ndarray
        Scalars of every frame.
    times : (T,) ndarray
    largest_strain : dict of str to float
        Largest absolute value over the run of every vertex array.
    stopped : str
        Why the model ended the run early, or "".
    failure : str
        Why it broke off, or "".
    steps : int
    smallest_step : float
    events : int
        Rejected and shortened steps.
    """

    frames: int = 0
    first: Frame | None = None
    last: Frame | None = None
    series: dict[str, NDArray] = field(default_factory=dict)
    times: NDArray = field(default_factory=lambda: np.zeros(0))
    largest: dict[str, float] = field(default_factory=dict)
    stopped: str = ""
    failure: str = ""
    interrupted: bool = False
    steps: int = 0
    smallest_step: float = np.inf
    events: int = 0


def trajectory_outputs(run: Run) -> tuple[list[str], list[str]]:
    """(trajectory paths, mesh paths) among the -o of the run."""
    paths = [p for p in run.common.outputs if Path(p).suffix.lower() in TRAJECTORIES]
    return paths, [p for p in run.common.outputs if p not in paths]


def simulate(
    run: Run,
    models: Mapping[str, Model],
    meshes: list[Any],
    schedule: Schedule,
    account: Account,
    *,
    moving: bool,
    resume: str | None = None,
    attributes: Mapping[str, Any] | None = None,
    texts: Mapping[str, str] | None = None,
    face: Mapping[str, NDArray] | None = None,
) -> Outcome:
    """Run the models to the end: every frame into the trajectory asked for, the last one as a mesh.

    Parameters
    ----------
    run : Run
    models : mapping of str to Model
        In the order of `meshes`.
    meshes : list of TriangleMesh or IntrinsicMesh (with points)
    schedule : Schedule
    account : Account
        The one that the models book to.
    moving : bool
        Whether the surface moves.
    resume : str, optional
        The .part to go on from.
    attributes, texts : mappings
        For the group `ddgcli`.
    face : mapping of str to (m, ...) ndarray
        Constant arrays on faces of the joined mesh.
    """
    mesh, number = joined_mesh(meshes)
    trajectories, mesh_paths = trajectory_outputs(run)
    if len(trajectories) > 1:
        raise ParameterError("one run writes one trajectory; give one .vtkhdf or .h5")
    target = trajectories[0] if trajectories else (resume or "").removesuffix(".part") or None
    cell = {"object_id": number, **(face or {})} if len(meshes) > 1 else dict(face or {})
    outcome = Outcome()
    frames: list[Frame] = []
    start = None
    writer = None
    if target is not None:
        from ddgcli.io.trajectory import Header, Trajectory, TrajectoryWriter

        header = Header(mesh, moving, cell, {**_provenance(run), **(attributes or {})}, dict(texts or {}))
        if resume is not None:
            with Trajectory(resume) as part:
                start = (part.n_frames - 1, part.checkpoint())
                account.restore(part.effects)
                frames = [part.frame(k) for k in range(part.n_frames)]
            writer = TrajectoryWriter.resume(resume, target, header, schedule.frames)
        else:
            writer = TrajectoryWriter(target, header, schedule.frames)
    elif resume is not None:
        raise ParameterError(f"{resume}: cannot be resumed; its name must end in .part")
    keep = _Keeper(outcome, frames)
    status = "failed"
    try:
        with run.timed("compute"), _bar(run, schedule.frames - len(frames)) as advance_bar:
            for snapshot in _steps(models, schedule, account, start):
                with account.within("output"):
                    frame = joined_frame(snapshot)
                    keep.add(frame, snapshot)
                    if writer is not None:
                        rows = [(n, c, s) for n, (c, s) in _all_rows(account, models).items()]
                        log = [(e.step, e.time, e.kind, e.place, e.value, e.detail) for e in snapshot.events]
                        writer.append(frame, snapshot.checkpoint, rows, log)
                advance_bar()
        status = "complete"
    except SolveError as error:
        outcome.failure = str(error)
        logging.getLogger("ddgcli").warning("%s", error)
    except KeyboardInterrupt:
        status, outcome.interrupted = "interrupted", True
    finally:
        keep.finish()
        if writer is not None:
            with run.timed("write"):
                left = writer.close(status)
            if left is not None:
                run.outputs.append(left)
    if outcome.interrupted:
        where = f"; go on with --resume {run.outputs[-1]}" if writer is not None and run.outputs else ""
        click.echo(f"Interrupted: {outcome.frames} whole frames{where}", err=True)
        click.get_current_context().exit(130)
    if mesh_paths and outcome.last is not None:
        _write_last(run, mesh, outcome.last, cell, mesh_paths)
    return outcome


def _steps(
    models: Mapping[str, Model], schedule: Schedule, account: Account, start: Any
) -> Iterator[Snapshot]:
    return evolve(models, schedule, account, start)


def _all_rows(account: Account, models: Mapping[str, Model]) -> dict[str, tuple[int, float]]:
    """Every name has a row from the first frame on, so that the file keeps its layout."""
    rows = account.rows()
    for name in ("integrator", "solver", "output"):
        rows.setdefault(name, (0, 0.0))
    return rows


class _Keeper:
    """Gathers the scalars of the frames for the summary; keeps two frames, not all."""

    def __init__(self, outcome: Outcome, before: list[Frame]) -> None:
        self.outcome, self.rows, self.times = outcome, [], []  # type: ignore[var-annotated]
        for frame in before:
            self._note(frame)

    def _note(self, frame: Frame) -> None:
        outcome = self.outcome
        if outcome.first is None:
            outcome.first = frame
        outcome.last = frame
        outcome.frames += 1
        self.times.append(frame.time)
        self.rows.append(frame.scalar)
        for name, values in frame.vertex.items():
            if values.size and values.dtype.kind == "f":
                outcome.largest[name] = max(outcome.largest.get(name, 0.0), float(np.abs(values).max()))

    def add(self, frame: Frame, snapshot: Snapshot) -> None:
        self._note(frame)
        outcome = self.outcome
        outcome.steps, outcome.smallest_step = snapshot.steps, snapshot.smallest_step
        outcome.events += len(snapshot.events)
        outcome.stopped = snapshot.stopped

    def finish(self) -> None:
        names = self.rows[0] if self.rows else {}
        self.outcome.series = {n: np.array([row.get(n, np.nan) for row in self.rows]) for n in names}
        self.outcome.times = np.array(self.times)


@contextmanager
def _bar(run: Run, count: int) -> Iterator[Callable[[], None]]:
    """A progress bar over frames on standard error, where it is wanted."""
    wanted = run.common.progress
    if wanted is None:
        wanted = sys.stderr.isatty() and not run.common.quiet and count > 2
    if not wanted:
        yield lambda: None
        return
    with click.progressbar(length=count, label="frames", file=sys.stderr) as bar:
        yield lambda: bar.update(1)


def _provenance(run: Run) -> dict[str, Any]:
    return {"version": __version__, **{k: v for k, v in run.metadata.items() if k != "version"}}


def _write_last(run: Run, mesh: Any, last: Frame, cell: dict[str, NDArray], paths: list[str]) -> None:
    from ddgcli.io.mesh_file import write_mesh

    shown = mesh if last.points is None else mesh.moved(last.points)
    annotated = AnnotatedMesh(shown, vertex=last.vertex, face=cell, metadata=run.metadata)
    with run.timed("write"):
        for path in paths:
            write_mesh(path, annotated)
            run.outputs.append(path)


def shares(account: Account, effects: list[str]) -> tuple[dict[str, Any], dict[str, float]]:
    """(`results.effects`, seconds of everything): calls, seconds and share of each effect that ran."""
    total = sum(account.seconds.values()) or 1.0
    found = {
        name: {
            "seconds": account.seconds[name],
            "share": account.seconds[name] / total,
            "evaluations": account.calls[name],
        }
        for name in effects
        if account.calls.get(name)
    }
    for name in effects:
        found.setdefault(name, {"seconds": 0.0, "share": 0.0, "evaluations": 0})
    everything = {
        name: account.seconds.get(name, 0.0) for name in (*effects, "solver", "integrator", "output")
    }
    return found, {**everything, "total": sum(account.seconds.values())}


def fingerprint(document: Any, resolved: dict[str, Any], meshes: Mapping[str, str]) -> tuple[str, str]:
    """(resolved scene as JSON, SHA-256 of it with the mesh files): what must not change before --resume."""
    text = json.dumps({"scene": resolved, "mesh_sha256": dict(meshes)}, sort_keys=True, ensure_ascii=False)
    return text, hashlib.sha256(text.encode()).hexdigest()


def refuse_changed(resume: str | None, resolved: str) -> None:
    """SceneError when the trajectory to resume was made from another scene."""
    if resume is None:
        return
    from ddgcli.io.trajectory import Trajectory

    with Trajectory(resume) as part:
        before, now = json.loads(part.text("scene_resolved")), json.loads(resolved)
    if before == now:
        return
    where = _first_difference(before, now)
    raise SceneError(
        f"{resume}: the scene changed since this run began ({where}); resume with the old scene or start anew"
    )


def _first_difference(a: Any, b: Any, path: str = "") -> str:
    if isinstance(a, dict) and isinstance(b, dict):
        for key in dict.fromkeys([*a, *b]):
            if a.get(key) != b.get(key):
                return _first_difference(a.get(key), b.get(key), f"{path}.{key}" if path else str(key))
    if isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        for k, (p, q) in enumerate(zip(a, b)):
            if p != q:
                return _first_difference(p, q, f"{path}[{k}]")
    return f"{path}: {a!r} -> {b!r}"
