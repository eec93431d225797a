"""`ddgcli shell-sim`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import click

from ddgcli.cli import options, simulate
from ddgcli.cli.options import Common
from ddgcli.cli.run import Run


@click.command(
    "shell-sim",
    epilog="Which: newmark (second order) unless motion is stiff and detail unwanted, then "
    "implicit-euler; verlet where its stable step is long enough. See docs/shell-sim.md and "
    "docs/accuracy/shell-sim.md.",
)
@options.scene_arg
@options.common
@simulate.time_options
@simulate.scene_options
@click.option(
    "--pin", "pinned", type=int, multiple=True, metavar="ID", help="Quick form: hold a vertex. Repeatable."
)
@click.option("--material", metavar="NAME", help="Quick form: material preset.")
@click.option(
    "--set", "settings", multiple=True, metavar="KEY=VALUE", help="Quick form: a key of the object, in TOML."
)
def command(
    scene_path: str | None,
    common: Common,
    overrides: dict[str, Any],
    resume: str | None,
    effect_lines: tuple[str, ...],
    list_effects: bool,
    schema: bool,
    dry_run: bool,
    pinned: tuple[int, ...],
    material: str | None,
    settings: tuple[str, ...],
) -> None:
    """Move thin elastic shells: SCENE (.toml, or a mesh for the quick form) in, a trajectory out.

    \b
    Examples:
      ddgcli shell-sim hat.toml -o hat.vtkhdf
      ddgcli shell-sim sheet.obj --effect stretching --effect bending --effect gravity --pin 0 -o run.vtkhdf
    """
    from ddgcli.models.shell.scene import KIND

    if list_effects:
        simulate.print_effects(KIND.effects, common.as_json)
        return
    if schema:
        simulate.print_schema(KIND)
        return
    run = Run("shell-sim", common, formats=simulate.formats(), **overrides)
    run.note_input(scene_path or resume or "", "")
    quick = {"effect_lines": effect_lines, "pinned": pinned, "material": material, "settings": settings}
    lines, extra = quick_lines(quick)
    document, recorded = simulate.scene_document(scene_path, "shell", lines, extra, resume)
    _run(run, document, scene_path, {**recorded, **overrides}, resume, dry_run)


def quick_lines(given: Mapping[str, Any]) -> tuple[tuple[str, ...], dict[str, Any]]:
    """Lines of effects and keys of the object that the options of the quick form mean."""
    pinned, material = given.get("pinned"), given.get("material")
    lines = (*given.get("effect_lines", ()), *([f"pin vertices={list(pinned)}"] if pinned else []))
    named = {"material": material} if material else {}
    return lines, {**named, **simulate.toml_settings(given.get("settings", ()))}


def _run(
    run: Run, document: Any, path: str | None, overrides: dict[str, Any], resume: str | None, dry_run: bool
) -> None:
    from ddgcli.evolve.account import Account
    from ddgcli.models.scene import resolve
    from ddgcli.models.shell import model, report
    from ddgcli.models.shell.scene import KIND

    scene = resolve(document, KIND, overrides)
    account = Account()
    found = model.contexts(scene, simulate.mesh_reader(run, document))
    shells = {name: context for name, (context, _) in found.items()}
    schedule = scene.schedule()
    meshes = [context.mesh for context in shells.values()]
    resolved, digest = simulate.fingerprint(
        document, scene.resolved(), {n: sha for n, (_, sha) in found.items()}
    )
    simulate.describe_input(run, path or "", meshes, digest)
    simulate.refuse_changed(resume, resolved)
    if dry_run:
        simulate.print_dry_run(run, scene, report.assembled(scene, shells, schedule, account))
        return
    with run.timed("compute"):
        models = model.build(scene, shells, account)
    outcome = simulate.simulate(
        run, models, meshes, schedule, account, moving=True, resume=resume,
        attributes={"input_sha256": digest, "overrides": overrides, "folder": document.folder},
        texts={"scene_source": document.source, "scene_resolved": resolved},
    )  # fmt: skip
    names = [effect.name for effect, _, _ in scene.effects]
    results, accuracy = report.summary(outcome, shells, names)
    results["effects"], results["seconds_by_part"] = simulate.shares(account, list(dict.fromkeys(names)))
    simulate.draw(run, outcome, "strain")
    run.finish(results, accuracy, converged=not outcome.failure)
