"""The page of sample runs shows the commands that make its pictures, on inputs of the stated kind."""

import re
from pathlib import Path

from docs import willmore_samples

ROOT = Path(__file__).parents[2]


def test_the_page_shows_the_commands_of_its_pictures():
    text = (ROOT / "docs" / "willmore-samples.md").read_text(encoding="utf-8")
    commands = dict(re.findall(r"pictures/willmore-([\w-]+)\.png\)\n`(.*)`", text))
    assert commands == {name: willmore_samples.command_line(name) for name in willmore_samples.RUNS}
    for name in commands:
        assert (willmore_samples.PICTURES / f"willmore-{name}.png").exists()


def test_the_inputs_are_what_the_page_says():
    meshes = {name: make() for name, make in willmore_samples.INPUTS.items() if name != "torus.ply"}
    assert meshes["holed.ply"].topology.boundary_loops == 1
    assert meshes["tube.ply"].topology.boundary_loops == 2
    assert all(mesh.topology.is_manifold and mesh.topology.is_oriented for mesh in meshes.values())
    assert meshes["block.ply"].topology.genus == 2
