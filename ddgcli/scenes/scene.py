"""Scenes: a document checked against the sections that a simulator, its objects and its effects contribute.

Every refusal is one line: `FILE: line N: what is wrong; did you mean ...; what is allowed there`.
"""

from __future__ import annotations

import copy
import logging
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Literal, NoReturn

from pydantic import Field, create_model

from ddgcli.errors import ParameterError, SceneError
from ddgcli.scenes.sections import Document, Key, Section, checked, located
from ddgcli.scenes.units import quantity
from ddgcli.simulation.effects import Effect, EffectTable, nearest
from ddgcli.simulation.model import MAX_STEP_COUNT, Schedule, warn_of_other_frames

FORMAT = "ddgcli-scene/1"
# effects that have models -> the key that names one
MODEL_KEYS = {"bending": "model", "stretching": "model", "viscosity": "kind"}
TIME_RANGE = (1e-150, 1e150)  # seconds, whose squares stay within the floating-point range
log = logging.getLogger("ddgcli")


class TimeSection(Section):
    """[time]"""

    duration: quantity("s", "length of the run", gt=0) = 1.0  # type: ignore[valid-type]
    step: quantity("s", "time step", gt=0) | None = None  # type: ignore[valid-type]
    tolerance: quantity("", "adaptive steps: largest error of a step", gt=0) | None = None  # type: ignore[valid-type]
    frame_every: quantity("s", "time between frames", gt=0) | None = None  # type: ignore[valid-type]
    integrator: str = Field(description="scheme; its own parameters are keys beside it")
    on_failure: Literal["shrink", "stop"] = Field("shrink", description="what to do with a step that fails")


class ObjectSection(Section):
    """Keys of every [[object]]."""

    name: str = Field(description="name, unique in the scene")
    role: str


@dataclass(frozen=True)
class SceneKind:
    """Schema of the scenes of one simulator: its objects, integrators and effects.

    Parameters
    ----------
    command : str
    roles : dict of str to ObjectSection type
    integrators : dict of str to Section type
        Each with its parameters in [time].
    integrator : str
        Where the scene names none.
    effects : EffectTable
    default_step : float
        Seconds, where the scene gives neither step nor tolerance.
    elsewhere : dict of str to str
        Names of effects, roles or integrators of other simulators -> the command that has them.
    """

    command: str
    roles: dict[str, type[ObjectSection]]
    integrators: dict[str, type[Section]]
    integrator: str
    effects: EffectTable
    default_step: float = 0.01
    elsewhere: Mapping[str, str] | None = None


@dataclass(frozen=True)
class Scene:
    """A checked scene, every default filled in.

    Parameters
    ----------
    kind : SceneKind
    time : TimeSection
        Also carries the parameters of its integrator.
    objects : tuple of ObjectSection
    effects : tuple of (Effect, Section, Key)
        In the order of the file, with the place of their parameters.
    document : Document
    has_default_integrator : bool
        Neither the scene nor the command line names an integrator or a parameter of one.
    """

    kind: SceneKind
    time: Any
    objects: tuple[Any, ...]
    effects: tuple[tuple[Effect, Any, Key], ...]
    document: Document
    has_default_integrator: bool = False

    def with_integrator(self, name: str) -> Scene:
        """The scene with another integrator in place of the default, whose parameters have their defaults."""
        values = self.time.model_dump(include=set(TimeSection.model_fields) - {"integrator"})
        time = time_model(self.kind.integrators[name]).model_validate({**values, "integrator": name})
        return replace(self, time=time, has_default_integrator=False)

    def refuse(self, key: Key, message: str) -> NoReturn:
        """Raise SceneError that points at a key."""
        raise SceneError(located(self.document, key, message), mesh=self._mesh_path(key))

    def _mesh_path(self, key: Key) -> str | None:
        """Mesh file of the object that a key belongs to, or that the effect of the key names."""
        if len(key) < 2 or key[0] != "object":
            effect = next((parameters for _, parameters, place in self.effects if place == key), None)
            name = getattr(effect, "object", None)
            return next((self._file(o) for o in self.objects if name is not None and o.name == name), None)
        return self._file(self.objects[int(key[1])])

    def _file(self, section: Any) -> str | None:
        path = getattr(section, "mesh", None)
        return path and str(Path(self.document.path).parent / path)

    @property
    def only_mesh_path(self) -> str | None:
        """Mesh file of the only object of the scene that is not an obstacle; None where there are several."""
        main_objects = [section for section in self.objects if section.role != "obstacle"]
        return self._file(main_objects[0]) if len(main_objects) == 1 else None

    def find(self, name: str, key: Key, roles: tuple[str, ...] = ()) -> Any:
        """The object of that name; SceneError at `key` if there is none."""
        names = [o.name for o in self.objects if not roles or o.role in roles]
        if name not in names:
            expected = f"{' or '.join(roles)} " if roles else ""
            self.refuse(
                key,
                f"no {expected}object {name!r}{nearest(name, names)} (there: {', '.join(names) or 'none'})",
            )
        return next(o for o in self.objects if o.name == name)

    def has_effect(self, *names: str) -> bool:
        """Whether the scene has an effect of one of these names."""
        return any(effect.name in names for effect, _, _ in self.effects)

    def schedule(self) -> Schedule:
        """Schedule of steps and frames."""
        time = self.time
        if time.integrator == "static":
            steps = getattr(time, "load_steps", 1)
            return Schedule(time.duration / steps, steps, 1, None, time.on_failure)
        if time.tolerance is not None:
            frame_interval = min(time.frame_every or time.duration / 50, time.duration)
            count = math.ceil(time.duration / frame_interval - 1e-9)
            first = min(time.step or frame_interval / 10, frame_interval)
            return Schedule(time.duration / count, count, 1, time.tolerance, time.on_failure, first)
        steps = max(1, round(time.duration / time.step))
        every = max(1, round(time.frame_every / time.step) if time.frame_every else math.ceil(steps / 50))
        return Schedule(time.step, steps, every, None, time.on_failure)

    def resolved(self) -> dict[str, Any]:
        """The scene with every default filled in, as plain data."""
        effects: dict[str, Any] = {}
        for effect, parameters, key in self.effects:
            values = parameters.model_dump(mode="json")
            if len(key) > 2:
                effects.setdefault(effect.name, []).append(values)
            else:
                effects[effect.name] = values
        return {
            "format": FORMAT,
            "time": self.time.model_dump(mode="json"),
            "object": [o.model_dump(mode="json", exclude_none=True) for o in self.objects],
            "effects": effects,
        }

    def build(self, make: Callable[[Effect, Any, Key], Any]) -> list[Any]:
        """`make` of every effect; a ValueError or an overflow in it names the effect's line."""
        results = []
        for effect, parameters, key in self.effects:
            try:
                results.append(make(effect, parameters, key))
            except SceneError:
                raise
            except OverflowError:  # of a power of Python floats
                remedy = "use smaller numbers or other units"
                self.refuse(key, f"{effect.name}: its coefficients are beyond 1e308; {remedy}")
            except ValueError as error:
                self.refuse(key, f"{effect.name}: {error}")
        return results


def resolve(document: Document, kind: SceneKind, overrides: Mapping[str, Any] | None = None) -> Scene:
    """Check a document and fill its defaults.

    Parameters
    ----------
    document : Document
    kind : SceneKind
    overrides : mapping, optional
        Keys of [time] from the command line, `steps`, and `model`: texts "EFFECT=NAME".

    Returns
    -------
    Scene

    Raises
    ------
    SceneError
        The first mistake, with its line.
    """
    overrides = dict(overrides or {})
    document = _with_models(document, kind, overrides.pop("model", None) or ())
    data = document.data
    _check_top(document)
    objects = _objects(document, kind)
    stated = dict(overrides)
    time = _time(document, kind, overrides)
    roles = {o.role for o in objects}
    effects = _effects(document, kind, roles)
    if data.get("format", FORMAT) != FORMAT:
        raise SceneError(
            located(document, ("format",), f"format {data['format']!r} is not known; write {FORMAT!r}")
        )
    scene = Scene(kind, time, objects, effects, document, _is_default(document, kind, overrides, time))
    _check_clock(scene, {name for name, value in stated.items() if value is not None})
    return scene


def _with_models(document: Document, kind: SceneKind, models: Sequence[str]) -> Document:
    """The document with other models of its effects, each "EFFECT=NAME"."""
    if not models:
        return document
    data = copy.deepcopy(dict(document.data))
    for text in models:
        effect, equals, name = text.partition("=")
        key, table = MODEL_KEYS.get(effect), data.get("effects", {}).get(effect)
        if not equals or key is None or effect not in kind.effects.entries:
            effects = ", ".join(e for e in MODEL_KEYS if e in kind.effects.entries)
            raise ParameterError(
                f"{text!r}: write EFFECT=NAME; effects with models: {effects}", parameter="model"
            )
        if table is None:
            raise ParameterError(f"{text!r}: the scene has no effect {effect}; add it", parameter="model")
        for one in table if isinstance(table, list) else [table]:
            one[key] = name
    return replace(document, data=data)  # type: ignore[type-var]


def _check_clock(scene: Scene, overridden: set[str]) -> None:
    """Refuse runs with too many steps; warn if steps and frames do not hit the times that the scene names."""
    time = scene.time

    def refuse(key: str, value: str, reason: str) -> NoReturn:
        if key not in overridden:
            scene.refuse(("time", key), f"{key} = {value} {reason}")
        # no line of the scene holds it
        raise ParameterError(f"{value} {reason}", parameter=key)

    each = (time.frame_every or time.duration / 50) if time.tolerance is not None else time.step
    count = time.duration / each
    if not count <= MAX_STEP_COUNT:
        what = "step" if time.tolerance is None else "frame_every"
        if what not in overridden and "duration" in overridden:
            refuse("duration", f"{time.duration:g} s", f"is {count:.3g} times {what}; shorten it")
        refuse(what, f"{each:g} s", f"makes {count:.3g} of them; lengthen it")
    for what in ("step", "frame_every", "duration"):
        span = getattr(time, what)
        if span is not None and not TIME_RANGE[0] < span < TIME_RANGE[1]:
            refuse(what, f"{span:g} s", "squared leaves the floating-point range; write 1e-149 to 1e149")
    schedule = scene.schedule()
    if time.integrator == "static":
        return
    if time.tolerance is not None:
        warn_of_other_frames(time.frame_every, schedule, time.duration, " s")
        return
    if time.step > time.duration * (1 + 1e-6):
        if "step" in overridden:
            raise ParameterError(
                f"{time.step:g} is longer than the duration of {time.duration:g}; "
                f"give {time.duration:g} or less",
                parameter="step",
            )
        scene.refuse(
            ("time", "step"),
            f"step = {time.step:g} s is longer than the duration of {time.duration:g} s; "
            f"write step = {time.duration:g} or less, or a longer duration",
        )
    end = schedule.steps * schedule.dt
    if abs(end - time.duration) > 1e-6 * time.duration:
        log.warning("duration %g s is not a whole number of steps of %g s: the run ends at %g s",
                    time.duration, schedule.dt, end)  # fmt: skip
    warn_of_other_frames(time.frame_every, schedule, end, " s")


def _check_top(document: Document) -> None:
    allowed = {"format": str, "time": dict, "object": list, "effects": dict}
    for name, value in document.data.items():
        if name not in allowed:
            hint = nearest(name, list(allowed))
            message = f"unknown key {name!r}{hint}; a scene has format, [time], [[object]], [effects]"
            raise SceneError(located(document, (name,), message))
        if not isinstance(value, allowed[name]):
            expected = {dict: f"a table [{name}]", list: f"an array of tables [[{name}]]", str: "text"}[
                allowed[name]
            ]
            raise SceneError(located(document, (name,), f"{name} must be {expected}"))


def _time(document: Document, kind: SceneKind, overrides: dict[str, Any]) -> Any:
    written = dict(document.data.get("time", {}))
    steps = overrides.pop("steps", None)
    values = {**written, **{k: v for k, v in overrides.items() if v is not None}}
    if overrides.get("step") is not None and overrides.get("tolerance") is None:
        values.pop("tolerance", None)
    values.setdefault("integrator", kind.integrator)
    name = values["integrator"]
    if not isinstance(name, str) or name not in kind.integrators:
        hint = nearest(str(name), list(kind.integrators))
        message = f"no integrator {name!r}{hint}; {kind.command} has {', '.join(kind.integrators)}"
        raise SceneError(located(document, ("time", "integrator"), message))
    default = values.get("step") is None and values.get("tolerance") is None
    if default:
        values["step"] = kind.default_step
    _leave_out_other_scheme(kind, str(written.get("integrator", kind.integrator)), name, values)
    model = time_model(kind.integrators[name])
    time = checked(document, ("time",), model, values, "[time]")
    if steps is not None:
        if steps < 1:
            raise ParameterError(f"must be 1 or more, not {steps}", parameter="steps")
        if time.tolerance is not None:
            raise ParameterError(
                "`steps` counts steps of one length, but a tolerance chooses their lengths: give `duration`, "
                "or `step` without `tolerance`"
            )
        time = time.model_copy(update={"duration": steps * (time.step or kind.default_step)})
    elif default and time.step > time.duration:
        time = time.model_copy(update={"step": time.duration})
    return time


def _is_default(document: Document, kind: SceneKind, overrides: Mapping[str, Any], time: Any) -> bool:
    """Whether no integrator and no parameter of the default one is named."""
    is_named = "integrator" in document.data.get("time", {}) or overrides.get("integrator") is not None
    own = set(kind.integrators[kind.integrator].model_fields)
    return not is_named and not own & time.model_fields_set


def _leave_out_other_scheme(kind: SceneKind, written: str, name: str, values: dict[str, Any]) -> None:
    """Parameters beside the scene's integrator go with it where the command line names another."""
    if written == name or written not in kind.integrators:
        return
    for key in kind.integrators[written].model_fields:
        if key in values and key not in kind.integrators[name].model_fields:
            log.info("%s of %s is left out with it", key, written)
            del values[key]


@cache
def time_model(own: type[Section]) -> type[Section]:
    """Section [time] with the parameters of one integrator.

    Parameters
    ----------
    own : type of Section
        The parameters of the integrator.

    Returns
    -------
    type of Section
    """
    fields = {name: (info.annotation, info) for name, info in own.model_fields.items()}
    annotations = {name: (own.__annotations__.get(name, info[0]), info[1]) for name, info in fields.items()}
    return create_model("Time", __base__=TimeSection, **annotations)  # type: ignore[call-overload]


def _objects(document: Document, kind: SceneKind) -> tuple[Any, ...]:
    written = document.data.get("object", [])
    if not written:
        raise SceneError(located(document, (), f"no [[object]]; a scene of {kind.command} needs one"))
    main_role = next(iter(kind.roles))
    if all(isinstance(table, dict) and table.get("role") == "obstacle" for table in written):
        message = f"every [[object]] is an obstacle; a scene of {kind.command} needs one of role {main_role}"
        raise SceneError(located(document, ("object", 0), message))
    objects: list[Any] = []
    for k, table in enumerate(written):
        key: Key = ("object", k)
        if not isinstance(table, dict):
            raise SceneError(located(document, key, "object must be an array of tables [[object]]"))
        role = table.get("role", main_role)
        if not isinstance(role, str) or role not in kind.roles:
            other = (kind.elsewhere or {}).get(str(role))
            hint = f"; {role!r} belongs to {other}" if other else nearest(str(role), list(kind.roles))
            message = f"no role {role!r}{hint}; {kind.command} has {', '.join(kind.roles)}"
            raise SceneError(located(document, (*key, "role"), message))
        table = {"name": f"object{k}" if len(written) > 1 else role, **table, "role": role}
        section = checked(document, key, kind.roles[role], table, f"[[object]] of role {role}")
        if section.name in [o.name for o in objects]:
            message = f"two objects are called {section.name!r}; give each its own name"
            raise SceneError(located(document, (*key, "name"), message))
        objects.append(section)
    return tuple(objects)


def _effects(document: Document, kind: SceneKind, roles: set[str]) -> tuple[tuple[Effect, Any, Key], ...]:
    effects: list[tuple[Effect, Any, Key]] = []
    for name, value in document.data.get("effects", {}).items():
        key: Key = ("effects", name)
        if name not in kind.effects.entries:
            other = (kind.elsewhere or {}).get(name)
            message = (
                kind.effects.unknown(name)
                if other is None
                else (f"effect {name!r} belongs to {other}; {kind.command} has {', '.join(kind.effects)}")
            )
            raise SceneError(located(document, key, message))
        effect = kind.effects.load(name)
        if not roles & set(effect.roles):
            message = (
                f"effect {name!r} acts on objects of role {' or '.join(effect.roles)}, and the scene has none"
            )
            raise SceneError(located(document, key, message))
        is_repeated = isinstance(value, list)
        if is_repeated and not effect.repeatable:
            message = f"effect {name!r} is allowed only once, as one table"
            raise SceneError(located(document, (*key, 0), message))
        for k, table in enumerate(value if is_repeated else [value]):
            place: Key = (*key, k) if is_repeated else key
            if not isinstance(table, dict):
                message = f"effect {name!r} must be a table such as {name} = {{ ... }}, found {table!r}"
                raise SceneError(located(document, place, message))
            effects.append(
                (effect, checked(document, place, effect.parameters, table, f"effect {name!r}"), place)
            )
    return tuple(effects)
