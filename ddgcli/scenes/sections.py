"""Sections of a scene, and one-line errors with the place of a mistake: `FILE: line N: what is wrong`."""

from __future__ import annotations

from typing import Any, Protocol

from pydantic import BaseModel, ConfigDict, ValidationError

from ddgcli.errors import SceneError
from ddgcli.simulation.effects import nearest

Key = tuple[str | int, ...]


class Section(BaseModel):
    """A table of a scene: every key declared, nothing else allowed, types as written."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class Document(Protocol):
    """A scene document as `io.scene_file` reads it."""

    @property
    def data(self) -> dict[str, Any]: ...
    @property
    def path(self) -> str: ...
    @property
    def folder(self) -> str: ...
    @property
    def source(self) -> str: ...
    def line(self, key: Key) -> int | None: ...


def located(document: Document, key: Key, message: str) -> str:
    """Message with the file and the line of a mistake: `FILE: line N: message`.

    Parameters
    ----------
    document : Document
    key : tuple
        Place in the document.
    message : str

    Returns
    -------
    str
        The message alone for a scene that no file holds (the quick form).
    """
    if not document.path:
        return message
    line = document.line(key)
    return f"{document.path}: {f'line {line}: ' if line else ''}{message}"


def checked(document: Document, key: Key, model: type[Section], table: dict[str, Any], where: str) -> Any:
    """Section of a table of a scene.

    Parameters
    ----------
    document : Document
    key : tuple
        Place in the document.
    model : type of Section
    table : dict
    where : str
        Name of the place, for the message.

    Returns
    -------
    Section

    Raises
    ------
    SceneError
        For the first mistake in the table.
    """
    try:
        return model.model_validate(table)
    except ValidationError as error:
        mistakes = error.errors()
        order = sorted(
            range(len(mistakes)),
            key=lambda i: (
                mistakes[i]["type"] != "extra_forbidden",
                document.line((*key, *mistakes[i]["loc"])) or 0,
                i,
            ),
        )
        mistake = mistakes[order[0]]
        loc = tuple(p for p in mistake["loc"] if not _is_branch(p))
        if mistake["type"] == "extra_forbidden" and _is_branch(mistake["loc"][-1]):  # a key named as a type
            loc = (*loc, mistake["loc"][-1])
        raise SceneError(located(document, (*key, *loc), _sentence(mistake, loc, model, where))) from error


ARRAY_MISTAKES = ("list_type", "too_short", "too_long")  # answered with what the key holds


def _is_branch(location: str | int) -> bool:
    """Whether pydantic named a branch of a union rather than a key."""
    return isinstance(location, str) and (
        "[" in location or location in ("str", "int", "float", "bool", "none")
    )


def _sentence(mistake: Any, loc: Key, model: type[BaseModel], where: str) -> str:
    kind, value = mistake["type"], mistake.get("input")
    name = ".".join(str(p) for p in loc) or where
    context = mistake.get("ctx", {})
    shape = f" ({text})" if kind in ARRAY_MISTAKES and (text := _description(model, loc)) else ""
    if kind == "extra_forbidden":
        allowed = _keys_at(model, loc[:-1])
        hint = nearest(str(loc[-1]), allowed)
        return f"unknown key {loc[-1]!r} in {where}{hint}; allowed: {', '.join(allowed) or 'none'}"
    if kind == "missing":
        return f"{where} needs the key {name!r}; allowed: {', '.join(_keys_at(model, loc[:-1]))}"
    if kind == "literal_error":
        allowed = [p.strip("' ") for p in context["expected"].replace(" or ", ", ").split(",")]
        hint = nearest(str(value), allowed)
        return f"{name} = {value!r} is not known in {where}{hint}; allowed: {', '.join(allowed)}"
    if kind == "value_error":
        return f"{name} of {where}: {context['error']}" if loc else f"{where}: {context['error']}"
    if kind in ("greater_than", "greater_than_equal", "less_than", "less_than_equal"):
        relation = {"greater_than": "greater than", "greater_than_equal": "at least",
                    "less_than": "less than", "less_than_equal": "at most"}[kind]  # fmt: skip
        return f"{name} of {where} must be {relation} {next(iter(context.values())):g}, found {value}"
    if kind in ("too_short", "too_long"):
        least, most = context.get("min_length"), context.get("max_length")
        count = f"least {least}" if kind == "too_short" else f"most {most}"
        return f"{name} of {where} must have at {count} entries{shape}, found {value!r}"
    expected = {"int_type": "a whole number", "bool_type": "true or false", "string_type": "text",
              "list_type": "an array", "dict_type": "a table", "model_type": "a table",
              "int_from_float": "a whole number", "model_attributes_type": "a table"}.get(kind)  # fmt: skip
    if expected:
        return f"{name} of {where} must be {expected}{shape}, found {value!r}"
    return f"{name} of {where}: {mistake['msg']}, found {value!r}"


def _description(model: type[BaseModel], loc: Key) -> str:
    """Description of the key at `loc`; "" within arrays, and for keys without one."""
    current: Any = model
    text = ""
    for location in loc:
        field = getattr(current, "model_fields", {}).get(location)
        current, text = (_inner_model(field.annotation), field.description or "") if field else (None, "")
    return text


def _keys_at(model: type[BaseModel], loc: Key) -> list[str]:
    """Keys that the table at `loc` may have."""
    current: Any = model
    for location in loc:
        if isinstance(location, str) and location in getattr(current, "model_fields", {}):
            current = _inner_model(current.model_fields[location].annotation)
    return list(getattr(current, "model_fields", {}))


def _inner_model(annotation: Any) -> Any:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    for argument in getattr(annotation, "__args__", ()):
        section = _inner_model(argument)
        if section is not None:
            return section
    return None
