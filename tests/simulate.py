"""Scenes of the tests, and runs of them without files."""

from ddgcli.evolve.account import Account
from ddgcli.evolve.loop import evolve
from ddgcli.io.scene_file import parse_scene
from ddgcli.models.scene import resolve
from ddgcli.models.shell import model
from ddgcli.models.shell.scene import KIND

# a square sheet that hangs by two corners, `cells` each way
HANGING_SHEET = """
[time]
duration = 0.04
step = 4e-3
[[object]]
name = "sheet"
role = "shell"
grid = {{ size = [1, 1], cells = [{cells}, {cells}] }}
material = "cotton"
[effects]
stretching = {{ model = "edges" }}
gravity = {{ acceleration = [0, 0, -9.81] }}
pin = {{ vertices = [0, {cells}] }}
"""


def shell_run(text, read=None, **overrides):
    """(snapshots, contexts, account) of a shell scene's text."""
    scene = resolve(parse_scene(text), KIND, overrides)
    contexts = {name: context for name, (context, _) in model.contexts(scene, read).items()}
    account = Account()
    models = model.build(scene, contexts, account)
    return list(evolve(models, scene.schedule(), account)), contexts, account


def scalar(snapshots, name, part="s"):
    """A scalar of every frame."""
    return [snapshot.observations[part].scalar[name] for snapshot in snapshots]
