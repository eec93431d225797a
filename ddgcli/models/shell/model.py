"""Models and systems of the shells of a scene, one for each group of coupled shells."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import counted
from ddgcli.mechanics.system import Motion, System
from ddgcli.mechanics.terms import (
    DeadLoad,
    FixedCoordinates,
    Memory,
    Potential,
    PrescribedMotion,
    ProportionalLoad,
    RampedLoad,
)
from ddgcli.mesh.requirements import unmet_need
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.shell.context import ShellContext
from ddgcli.models.shell.group_model import group_model
from ddgcli.models.shell.groups import Group, groups, terms_between
from ddgcli.models.shell.tensor_potential import TensorPotential
from ddgcli.scenes.scene import Scene
from ddgcli.scenes.sections import Key
from ddgcli.scenes.shapes import PlacedMesh, place
from ddgcli.simulation.account import Account
from ddgcli.simulation.effects import Effect
from ddgcli.simulation.model import Model

SIZE_RANGE = (1e-60, 1e60)  # m; Hessians of bending contain fourth powers of lengths
LEAST_MASS = 1e-140  # kg per vertex
log = logging.getLogger("ddgcli")


def contexts(scene: Scene, read: Callable[[str], Any]) -> dict[str, tuple[ShellContext, str]]:
    """Context of every shell of a scene, and the SHA-256 of its mesh file.

    Parameters
    ----------
    scene : Scene
    read : callable
        Reads a mesh file.

    Returns
    -------
    dict of str to (ShellContext, str)

    Raises
    ------
    SceneError
        If a mesh cannot be a shell; the error names its section of the scene.
    """
    by_name = {}
    obstacles = _obstacle_meshes(scene, read)
    for number, section in enumerate(scene.objects):
        if section.role != "shell":
            continue
        try:
            placement = place(section, read)
        except ValueError as error:
            scene.refuse(("object", number), f"object {section.name!r}: {error}")
        if not isinstance(placement.mesh, TriangleMesh):
            scene.refuse(
                ("object", number), f"object {section.name!r}: a periodic grid is not a shell; use fluid-sim"
            )
        context = ShellContext(section, placement.mesh, scene, placement.vertex, obstacles=obstacles)
        _require_sound(scene, number, context)
        by_name[section.name] = context, placement.sha256
    return by_name


def warn_of_unused_obstacles(scene: Scene) -> None:
    """Warn about obstacles that neither `contact` nor `attach` names.

    Parameters
    ----------
    scene : Scene
    """
    used: set[str] = set()
    for effect, parameters, _ in scene.effects:
        if effect.name == "contact":
            used.update(name for pair in parameters.pairs for name in pair)
        elif effect.name == "attach":
            used.add(parameters.to)
    for section in scene.objects:
        if section.role == "obstacle" and section.name not in used:
            log.warning(
                "no contact or attach names obstacle %r: shells pass through it; write it into contact.pairs",
                section.name,
            )


def _obstacle_meshes(scene: Scene, read: Callable[[str], Any]) -> dict[str, PlacedMesh]:
    """Meshes of the obstacles that are meshes."""
    meshes = {}
    for number, section in enumerate(scene.objects):
        if section.role == "obstacle" and section.mesh is not None:
            source = read(section.mesh)
            reason = unmet_need(source.mesh, "shell-sim") if isinstance(source.mesh, TriangleMesh) else None
            if not isinstance(source.mesh, TriangleMesh) or reason is not None:
                scene.refuse(
                    ("object", number), f"object {section.name!r}: {reason or 'a triangle mesh is needed'}"
                )
            meshes[section.name] = PlacedMesh(source.mesh, {}, source.sha256)
    return meshes


def _require_sound(scene: Scene, number: int, context: ShellContext) -> None:
    """Raise an error for a shell that cannot move: no faces, zero areas, masses that over- or underflow."""
    reason = unmet_need(context.mesh, "shell-sim")
    if reason is None and not (np.isfinite(context.mass).all() and (context.mass > 0).all()):
        reason = "a vertex has no finite mass; rescale the mesh"
    size = float(context.mesh.side_length.max(initial=0.0))
    if reason is None and not SIZE_RANGE[0] < size < SIZE_RANGE[1]:
        reason = f"the longest side measures {size:.3g}; shell-sim takes 1e-60 to 1e60: rescale"
    least = context.mass.min(initial=np.inf)
    if reason is None and not least > LEAST_MASS:
        reason = (
            f"a vertex weighs {least:.3g} kg, whose energies leave the floating-point range; "
            "change `thickness` or `density`"
        )
    if reason is not None:
        scene.refuse(("object", number), f"object {context.shell.name!r}: {reason}")
    loose = int((~context.mesh.topology.referenced_vertex).sum())
    if loose:
        text = counted(loose, "vertex belongs", "vertices belong")
        log.warning("%s to no face and cannot move", text)


def build(scene: Scene, shells: dict[str, ShellContext], account: Account) -> dict[str, Model]:
    """One model for each group of coupled shells.

    Parameters
    ----------
    scene : Scene
    shells : dict of str to ShellContext
    account : Account

    Returns
    -------
    dict of str to Model
    """
    return models(scene, shells, systems(scene, shells, account))


def systems(scene: Scene, shells: dict[str, ShellContext], account: Account) -> dict[str, System]:
    """Masses and terms of each group of coupled shells.

    Parameters
    ----------
    scene : Scene
    shells : dict of str to ShellContext
    account : Account

    Returns
    -------
    dict of str to System
    """
    return {group.name: _group_system(scene, group, account) for group in groups(scene, shells)}


def models(scene: Scene, shells: dict[str, ShellContext], systems: dict[str, System]) -> dict[str, Model]:
    """One model for each group of coupled shells, from its system.

    Parameters
    ----------
    scene : Scene
    shells : dict of str to ShellContext
    systems : dict of str to System

    Returns
    -------
    dict of str to Model
    """
    own: dict[str, Model] = {
        group.name: group_model(scene, group, systems[group.name]) for group in groups(scene, shells)
    }
    fractures = [section for effect, section, _ in scene.effects if effect.name == "fracture"]
    if not fractures:
        return own
    from ddgcli.models.shell.epochs import breaking_model, whole_model

    for group in groups(scene, shells):
        broken = [section for section in fractures if section.object in (None, *group.shells)]
        if not broken:
            own[group.name] = whole_model(own[group.name], shells)
            continue
        account = systems[group.name].account

        def build(epoch: Group, account: Account = account) -> tuple[System, Model[Motion]]:
            system = _group_system(scene, epoch, account)
            return system, group_model(scene, epoch, system)

        own[group.name] = breaking_model(scene, group, broken, build, account)
    return own


def terms_of(scene: Scene, context: ShellContext) -> list[Any]:
    """Terms that the effects of the scene make for one shell."""

    def make(effect: Effect, parameters: Any, key: Key) -> list[Any]:
        target = getattr(parameters, "object", None)
        shells = [o.name for o in scene.objects if o.role == "shell"]
        needs_object = hasattr(parameters, "object") and not effect.acts_on_all
        if target is None and len(shells) > 1 and needs_object:
            scene.refuse(
                key, f'{effect.name}: several shells; name one by object = "..." ({", ".join(shells)})'
            )
        if target is not None:
            scene.find(target, (*key, "object"), ("shell",))
            if target != context.shell.name:
                return []
        terms = effect.build(parameters, context)
        if terms and all(term.is_zero for term in terms):
            log.warning(
                "effect %s on %s has no strength: it changes nothing", effect.name, context.shell.name
            )
        terms = [_with_name(term, effect, parameters, key) for term in terms]
        context.terms.setdefault(effect.name, []).extend(terms)
        return terms

    context.terms.clear()
    # damping needs the elastic terms; attach and handle check that they do not share vertices with pins
    ranks = {"stretching": 0, "bending": 0, "attach": 2, "rigid": 2, "handle": 3}
    ordered = sorted(scene.effects, key=lambda entry: ranks.get(entry[0].name, 1))
    return [term for terms in replace(scene, effects=tuple(ordered)).build(make) for term in terms]


def _with_name(term: Any, effect: Effect, parameters: Any, key: Key) -> Any:
    """A pin or handle with the name of its reaction force (that of the section, else of the effect)."""
    if not isinstance(term, FixedCoordinates | PrescribedMotion):
        return term
    default = effect.name if len(key) < 3 else f"{effect.name}_{key[2]}"
    return replace(term, name=parameters.name or default)


def _ramped(terms: list[Any], time: Any) -> list[Any]:
    """Terms in which loads without a ramp grow with time, if the scene has load steps."""
    if getattr(time, "load_steps", 1) == 1:
        return terms
    times, factors = np.array([0.0, time.duration]), np.array([0.0, 1.0])

    def ramp(term: Any) -> Any:
        return ProportionalLoad(term, time.duration) if time.arc_length else RampedLoad(term, times, factors)

    ramps = {id(t): ramp(t) for t in terms if isinstance(t, Potential) and t.scaled is not None}
    return [_with_ramp(ramps.get(id(term), term), ramps) for term in terms]


def _with_ramp(term: Any, ramps: dict[int, Any]) -> Any:
    """The memory of a potential that was replaced by a ramp, with that ramp; any other term unchanged."""
    if not isinstance(term, Memory) or id(term.potential) not in ramps:
        return term
    memory: Any = term
    return replace(memory, potential=ramps[id(memory.potential)])


def make_system(scene: Scene, context: ShellContext, account: Account) -> System:
    """System of one shell: its masses, and the terms of the effects of the scene."""
    return System(context.mass, _own_terms(scene, context), account, np.asarray(context.mesh.points))


def _group_system(scene: Scene, group: Group, account: Account) -> System:
    """System of a group of shells: their masses, their own terms, and those that couple them."""
    if len(group.shells) == 1:
        return make_system(scene, next(iter(group.shells.values())), account)
    from ddgcli.mechanics.embedding import Rows, embedded_terms

    if scene.has_effect("rigid"):
        scene.refuse(
            ("effects", "rigid"), "rigid edges of shells that touch or are attached are not computed"
        )
    terms, ends = [], group.ends
    for start, context in zip(ends, group.shells.values()):
        rows = Rows(int(start), context.mesh.n_vertices, int(ends[-1]))
        terms += embedded_terms(_own_terms(scene, context), rows)
    mass = np.concatenate([context.mass for context in group.shells.values()])
    start = np.concatenate([np.asarray(context.mesh.points) for context in group.shells.values()])
    size = max(float(np.ptp(points, axis=0).max()) for points in group.split(start).values())
    return System(mass, [*terms, *terms_between(scene, group)], account, start, size)


def _own_terms(scene: Scene, context: ShellContext) -> list[Any]:
    """Terms of one shell, without those that couple it to others."""
    if getattr(scene.time, "arc_length", None) and scene.time.load_steps == 1:
        scene.refuse(("time", "arc_length"), "arc_length needs load_steps, the most steps along the path")
    terms = _ramped(terms_of(scene, context), scene.time)
    loose = ~context.mesh.topology.referenced_vertex
    if loose.any():
        terms.append(FixedCoordinates(np.repeat(loose[:, None], 3, axis=1), supports=False))
    _require_face_arrays(scene, context)
    masks = [term.mask for term in terms if isinstance(term, FixedCoordinates | PrescribedMotion)]
    fixed = np.logical_or.reduce(masks) if masks else np.zeros((1, 3), dtype=bool)
    if fixed.all():
        moved = any(isinstance(term, PrescribedMotion) for term in terms)
        motion = "moves as its handles and obstacles do" if moved else "does not move"
        log.warning("every vertex of %s is held: it %s", context.shell.name, motion)
    elif fixed.any() and any(_moves_nothing(term, fixed) for term in terms):
        log.warning("a load on %s acts on held vertices alone: it moves nothing", context.shell.name)
    return terms


def _moves_nothing(term: Any, fixed: NDArray) -> bool:
    """Whether a term is a dead force other than zero, and all of it acts on held coordinates."""
    load = term.potential if isinstance(term, RampedLoad | ProportionalLoad) else term
    return isinstance(load, DeadLoad) and not load.is_zero and not np.any(load.force[~fixed])


def _require_face_arrays(scene: Scene, context: ShellContext) -> None:
    """Raise an error for face arrays that the models of stretching and bending do not have."""
    elastic = [term for term in context.elastic if isinstance(term, TensorPotential)]
    strains = any(term.green_strain is not None for term in elastic)
    moments = any(term.moment_tensor is not None for term in elastic)
    for name in context.shell.face_arrays:
        if name.endswith("moment") and not moments:
            scene.refuse(("object",), f'face_arrays: {name} needs bending = {{ model = "midedge" }}')
        if not name.endswith("moment") and not strains:
            scene.refuse(("object",), f'face_arrays: {name} needs stretching = {{ model = "stvk" }}')
