"""`ddgcli fluid-sim`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from ddgcli.cli import options, simulate
from ddgcli.cli.options import Common
from ddgcli.cli.run import Run


@click.command(
    "fluid-sim",
    epilog="Which: conservative for accuracy; circulation for steps many cells long. See "
    "docs/fluid-sim.md and docs/accuracy/fluid-sim.md.",
)
@options.scene_arg
@options.common
@simulate.time_options
@simulate.scene_options
@click.option("--vorticity", metavar="ARRAY", help="Quick form: vertex array, .npy or expression in x, y, z.")
@click.option("--flow", metavar="NAME", help="Quick form: an initial flow by name.")
@click.option("--viscosity", metavar="NU", help="Quick form: kinematic viscosity [m^2/s].")
def command(
    scene_path: str | None,
    common: Common,
    overrides: dict[str, Any],
    resume: str | None,
    effect_lines: tuple[str, ...],
    list_effects: bool,
    schema: bool,
    dry_run: bool,
    vorticity: str | None,
    flow: str | None,
    viscosity: str | None,
) -> None:
    """Move an incompressible fluid on a surface: SCENE (.toml, or a mesh for the quick form) in.

    \b
    Examples:
      ddgcli fluid-sim taylor_vortices.toml -o taylor.vtkhdf
      ddgcli fluid-sim sphere.obj --vorticity '5*z' --duration 2 --dt 0.02 -o run.vtkhdf
      ddgcli fluid-sim torus.ply --flow vortex-pair --effect harmonic --viscosity 1e-3
    """
    from ddgcli.models.fluid.scene import KIND

    if list_effects:
        simulate.print_effects(KIND.effects, common.as_json)
        return
    if schema:
        simulate.print_schema(KIND)
        return
    run = Run("fluid-sim", common, **overrides)
    quick = {"effect_lines": effect_lines, "vorticity": vorticity, "flow": flow, "viscosity": viscosity}
    document, recorded = simulate.scene_document(scene_path, "fluid", *quick_lines(quick), resume)
    _run(run, document, scene_path, {**recorded, **overrides}, resume, dry_run)


def quick_lines(given: Mapping[str, Any]) -> tuple[tuple[str, ...], dict[str, Any]]:
    """Lines of effects that the options of the quick form mean; the object has no keys of its own there."""
    flows = {key: given[key] for key in ("vorticity", "flow") if given.get(key) is not None}
    lines = [f"initial {key}={json.dumps(value)}" for key, value in flows.items()]
    if given.get("viscosity") is not None:
        lines.append(f"viscosity nu={_number(given['viscosity'])}")
    return (*lines, *given.get("effect_lines", ())), {}


def _run(
    run: Run, document: Any, path: str | None, overrides: dict[str, Any], resume: str | None, dry_run: bool
) -> None:
    from ddgcli.evolve.account import Account
    from ddgcli.models.fluid import model, report
    from ddgcli.models.fluid.scene import KIND
    from ddgcli.models.scene import resolve

    scene = resolve(document, KIND, overrides)
    account = Account()
    found = model.contexts(scene, simulate.mesh_reader(run, document), _array_reader(document))
    fluids = {name: context for name, (context, _) in found.items()}
    schedule = scene.schedule()
    meshes = [context.mesh for context in fluids.values()]
    simulate.describe_input(run, path or "", meshes)
    resolved, digest = simulate.fingerprint(
        document, scene.resolved(), {n: sha for n, (_, sha) in found.items()}
    )
    simulate.refuse_changed(resume, resolved)
    with run.timed("compute"):
        built = model.build(scene, fluids, account)
    if dry_run:
        simulate.print_dry_run(run, scene, report.assembled(scene, built, schedule, account))
        return
    outcome = simulate.simulate(
        run, {name: fluid.model() for name, fluid in built.items()}, meshes, schedule, account, moving=False,
        resume=resume, attributes={"input_sha256": digest, "overrides": overrides, "folder": document.folder},
        texts={"scene_source": document.source, "scene_resolved": resolved}, face=report.face_arrays(meshes),
    )  # fmt: skip
    results, accuracy = report.summary(outcome.series, outcome.last, built)
    names = list(dict.fromkeys(effect.name for effect, _, _ in scene.effects))
    results["steps"] = outcome.steps
    results["effects"], results["seconds_by_part"] = simulate.shares(account, names)
    run.plot(lambda target: _draw(target, meshes, outcome))
    run.finish(results, accuracy, converged=not outcome.failure)


def _number(text: str) -> str:
    """A number as it is, anything else (a number with a unit) as a text of TOML."""
    try:
        return repr(float(text))
    except ValueError:
        return json.dumps(text)


def _array_reader(document: Any) -> Any:
    """Read a .npy relative to the scene."""

    def read(name: str) -> Any:
        from ddgcli.io.arrays import read_array

        return read_array(str(Path(document.folder) / name))

    return read


def _draw(path: str, meshes: list[Any], outcome: Any) -> None:
    import numpy as np

    from ddgcli.evolve.frames import joined_mesh
    from ddgcli.mesh.triangle_mesh import TriangleMesh
    from ddgcli.models.fluid.report import wraps
    from ddgcli.plots.surface import draw_surface

    mesh, _ = joined_mesh(meshes)
    last = outcome.last
    reach = float(np.abs(last.vertex["vorticity"]).max(initial=0.0)) or 1.0  # vortices are small and count
    shown = np.flatnonzero(~wraps(meshes))
    draw_surface(
        path,
        TriangleMesh.from_arrays(mesh.points, mesh.faces[shown]),
        last.vertex["vorticity"],
        label="vorticity [1/s]",
        title=f"t = {last.time:.4g} s",
        signed=True,
        limits=(-reach, reach),
    )
