"""Read scenes from a file, from a mesh with options or from a trajectory; print effects and schemas."""

from __future__ import annotations

import hashlib
import json
import re
import tomllib
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ddgcli.cli.input_facts import input_facts
from ddgcli.cli.run import Run
from ddgcli.errors import ParameterError, SceneError, encodable
from ddgcli.simulation.effects import EffectTable
from ddgcli.simulation.frames import joined_mesh

if TYPE_CHECKING:
    from ddgcli.io.mesh_file import MeshInput
    from ddgcli.io.scene_file import SceneDocument
    from ddgcli.scenes.scene import Scene, SceneKind
    from ddgcli.scenes.sections import Document


STANDARD_INPUT = "-"


def quick_scene(mesh: str, role: str, lines: tuple[str, ...], extra: Mapping[str, Any] | None = None) -> str:
    """TOML of the scene of `COMMAND MESH --effect ...`.

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
        f"name = {_toml('input' if mesh == STANDARD_INPUT else encodable(Path(mesh).stem))}",
        f'role = "{role}"',
    ]
    text += [f"mesh = {_toml(mesh if mesh == STANDARD_INPUT else str(Path(mesh).absolute()))}"]
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
            f"--effect {line!r}: write key=value pairs after the name instead of {rest.strip()!r}"
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
    """Keys of --set KEY=VALUE; a value that is not TOML is text."""
    values: dict[str, Any] = {}
    for setting in settings:
        key, equals, value = setting.partition("=")
        if not equals or not key.strip():
            raise ParameterError(f"--set {setting!r}: write KEY=VALUE")
        try:
            values[key.strip()] = tomllib.loads(f"v = {value}")["v"]
        except tomllib.TOMLDecodeError:
            values[key.strip()] = value
    return values


def _toml(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)


def scene_document(
    path: str | None,
    role: str,
    lines: tuple[str, ...],
    extra: Mapping[str, Any],
    resume: str | None,
    input_format: str | None = None,
) -> tuple[SceneDocument, dict[str, Any]]:
    """Scene document, and the time options recorded by the run to resume.

    A `.toml`, or what has this `input_format`, is a scene; anything else is a mesh for the quick form. With
    `resume` and no path, the scene comes from the trajectory. Paths in a scene on standard input start in the
    current folder.
    """
    from ddgcli.io.scene_file import parse_scene, read_scene

    recorded: dict[str, Any] = {}
    if resume is not None:
        from ddgcli.io.trajectories.trajectory import Trajectory

        with Trajectory(resume) as partial_run:
            recorded = json.loads(partial_run.attributes.get("overrides", "{}"))
            if path is None:
                return parse_scene(
                    partial_run.text("scene_source"), "", partial_run.attributes.get("folder", ".")
                ), recorded
    if path is None:
        raise ParameterError("give a scene file or a mesh (or --effects, --schema)")
    if path == STANDARD_INPUT and input_format is None:
        raise ParameterError(
            "-: standard input needs `input_format`: `input_format=toml` for a scene, or the format of a mesh"
        )
    if path.endswith(".toml") or (input_format or "").lower().lstrip(".") == "toml":
        if lines or extra:
            raise ParameterError(
                f"{path}: --effect, --pin and --set build a scene from a mesh; write them into the scene"
            )
        return read_scene(path), recorded
    return parse_scene(quick_scene(path, role, lines, extra), "", "."), recorded


def describe_input(run: Run, path: str, meshes: list[Any], sha256: str = "") -> None:
    """Fill the `input` block with the union of all meshes of the scene."""
    mesh, _ = joined_mesh(meshes)
    run.set_input(path, sha256, **input_facts(mesh))


def mesh_reader(run: Run, document: Document) -> Callable[[str], MeshInput]:
    """Reader of mesh files relative to the scene; `--input-format` is that of the quick form's mesh."""
    from_options = not document.path

    @cache  # standard input has one reading
    def checked(source: MeshInput) -> MeshInput:
        from ddgcli.cli.input_warnings import warn_of_flat_faces

        warn_of_flat_faces(source.face)
        return source

    def read(name: str) -> MeshInput:
        from ddgcli.io.mesh_file import read_mesh
        from ddgcli.io.output_file import check_place

        if from_options and name == STANDARD_INPUT:
            with run.clock.timed("read"):
                return checked(read_mesh(name, run.common.input_format))
        path = str(Path(document.folder) / name)
        for output in run.common.outputs:
            check_place(output, inputs=(path,))
        with run.clock.timed("read"):
            return checked(read_mesh(path, run.common.input_format if from_options else None))

    return read


def print_effects(table: EffectTable, as_json: bool) -> None:
    """Print every effect, its cost, and its parameters with units and defaults."""
    listing = {name: _effect_entry(table, name, line) for name, (_, line) in table.entries.items()}
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
            numbers = f"{p['numbers']} numbers" if p["numbers"] else ""
            unit = ", ".join(filter(None, (p["unit"], numbers)))
            unit = f" [{unit}]" if unit else ""
            choices = f" ({' | '.join(map(str, p['choices']))})" if p["choices"] else ""
            click.echo(f"    {key}{unit}{choices}: {p['description'] or '-'}; {default}")


def _effect_entry(table: EffectTable, name: str, line: str) -> dict[str, Any]:
    effect = table.load(name)
    schema = effect.parameters.model_json_schema()  # type: ignore[attr-defined]
    parameters = {}
    for key, entry in schema.get("properties", {}).items():
        branches = [entry, *entry.get("anyOf", [])]
        parameters[key] = {
            "unit": next((b["unit"] for b in branches if "unit" in b), ""),
            "numbers": next((len(b["prefixItems"]) for b in branches if "prefixItems" in b), None),
            "choices": next((b["enum"] for b in branches if "enum" in b), []),
            "default": entry.get("default"),
            "required": key in schema.get("required", []),
            "description": next((b["description"] for b in branches if b.get("description")), ""),
        }
    return {"summary": line, "cost": effect.cost, "roles": list(effect.roles), "parameters": parameters}


def print_schema(kind: SceneKind) -> None:
    """Print the JSON Schema of the simulator's scenes."""
    from ddgcli.scenes.schema import json_schema

    click.echo(json.dumps(json_schema(kind), indent=2, ensure_ascii=False))


def print_dry_run(run: Run, scene: Scene, assembled: dict[str, Any], prediction: dict[str, Any]) -> None:
    """Print the resolved scene, what would be assembled, the predicted cost, and the warnings so far."""
    from ddgcli.cli.forecast.prediction import as_text
    from ddgcli.cli.summary import block_lines, plain

    content = plain(
        {
            "command": run.command,
            "dry_run": True,
            "scene": scene.resolved(),
            "assembled": assembled,
            "results": prediction,
            "warnings": run.print_warnings(),
        }
    )
    if run.common.as_json:
        click.echo(json.dumps(content, ensure_ascii=False))
        return
    lines = ["assembled", *block_lines(content["assembled"], "  ", run.common.full)]
    lines += ["results", *(f"  {line}" for line in as_text(content["results"], run.common.full))]
    click.echo("\n".join([json.dumps(content["scene"], indent=2, ensure_ascii=False), *lines]))


def fingerprint(resolved: dict[str, Any], meshes: Mapping[str, str]) -> tuple[str, str]:
    """Resolved scene as JSON, and its SHA-256 with the mesh files; both must be unchanged to resume a run."""
    content = {"scene": resolved, "mesh_sha256": dict(meshes)}
    text = encodable(json.dumps(content, sort_keys=True, ensure_ascii=False))
    return text, hashlib.sha256(text.encode()).hexdigest()


def check_unchanged(resume: str | None, resolved: str, *, noun: str = "scene") -> None:
    """Raise SceneError if the trajectory to resume comes from another scene, or other options or meshes.

    Parameters
    ----------
    resume : str or None
        The trajectory.
    resolved : str
        The text of `fingerprint`.
    noun : {"scene", "options"}
        What the user wrote: a scene, or options of the command line.
    """
    if resume is None:
        return
    from ddgcli.io.trajectories.trajectory import Trajectory

    with Trajectory(resume) as partial_run:
        before, now = json.loads(partial_run.text("scene_resolved")), json.loads(resolved)
    if before == now:
        return
    if before["scene"] == now["scene"]:
        raise SceneError(
            f"{resume}: a mesh file has changed since the run; resume with that file or start a new run"
        )
    where = _first_difference(before["scene"], now["scene"])
    those = "that scene" if noun == "scene" else "those options"
    verb = "differs from that" if noun == "scene" else "differ from those"
    raise SceneError(
        f"{resume}: the {noun} {verb} of the run ({where}); resume with {those} or start a new run"
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
