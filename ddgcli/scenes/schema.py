"""The JSON Schema of a simulator's scenes, for editors: made from the sections, all effects loaded."""

from __future__ import annotations

from typing import Any

from ddgcli.scenes.scene import FORMAT, SceneKind, time_model


def json_schema(kind: SceneKind) -> dict[str, Any]:
    """JSON Schema (draft 2020-12) of the scenes of one simulator.

    Parameters
    ----------
    kind : SceneKind

    Returns
    -------
    dict
    """
    definitions: dict[str, Any] = {}

    def section(model: Any, title: str) -> dict[str, Any]:
        schema = model.model_json_schema(ref_template="#/$defs/{model}")
        definitions.update(schema.pop("$defs", {}))
        return {**schema, "title": title}

    times = [
        _with_integrator(section(time_model(kind.integrators[name]), f"time, {name}"), name)
        for name in kind.integrators
    ]
    first = next(iter(kind.roles))
    objects = [
        _without(section(model, f"object of role {role}"), "name", *(["role"] if role == first else []))
        for role, model in kind.roles.items()
    ]
    effects = {}
    for name in kind.effects:
        effect = kind.effects.load(name)
        one = section(effect.parameters, f"effect {name}")
        effects[name] = {"anyOf": [one, {"type": "array", "items": one}]} if effect.repeatable else one
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"scene of ddgcli {kind.command}",
        "type": "object",
        "additionalProperties": False,
        "required": ["object"],
        "properties": {
            "format": {"const": FORMAT},
            "time": {"anyOf": times},
            "object": {"type": "array", "minItems": 1, "items": {"anyOf": objects}},
            "effects": {"type": "object", "additionalProperties": False, "properties": effects},
        },
        "$defs": definitions,
    }


def _with_integrator(schema: dict[str, Any], name: str) -> dict[str, Any]:
    schema["properties"]["integrator"] = {"const": name}
    return _without(schema, "integrator")


def _without(schema: dict[str, Any], *names: str) -> dict[str, Any]:
    """Keys that the scene fills in are not required."""
    return {**schema, "required": [key for key in schema.get("required", []) if key not in names]}
