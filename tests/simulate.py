"""Scenes of the tests, and runs of them without files."""

from ddgcli.io.scene_file import parse_scene
from ddgcli.models.shell import model
from ddgcli.models.shell.scene import KIND
from ddgcli.scenes.scene import resolve
from ddgcli.simulation.account import Account
from ddgcli.simulation.time_loop import evolve

# a square cloth that hangs by two corners, `cells` each way
HANGING_CLOTH = """
[time]
duration = 0.04
step = 4e-3
[[object]]
name = "cloth"
role = "shell"
grid = {{ size = [1, 1], cells = [{cells}, {cells}] }}
material = "cotton"
[effects]
stretching = {{ model = "edges" }}
gravity = {{ acceleration = [0, 0, -9.81] }}
pin = {{ vertices = [0, {cells}] }}
"""

# a cloth that falls on a floor, with every kind of term
FALLING_CLOTH = """\
format = "ddgcli-scene/1"
[time]
duration = 0.1
step = 5e-3
frame_every = 0.01
integrator = "{integrator}"
[[object]]
name = "cloth"
role = "shell"
grid = {{ size = [1, 1], cells = [5, 5] }}
material = "rubber"
position = [0, 0, 0.02]
[[object]]
name = "floor"
role = "obstacle"
plane = {{ point = [0, 0, 0], normal = [0, 0, 1] }}
[effects]
stretching = {{}}
bending = {{}}
gravity = {{}}
damping = {{ mass = 1 }}
contact = {{ pairs = [["cloth", "floor"]], friction = 0.5 }}
"""


def scene_file(folder, integrator="newmark", text=FALLING_CLOTH):
    """The path of a scene, written to a folder."""
    path = folder / "scene.toml"
    path.write_text(text.format(integrator=integrator))
    return path


def shell_run(text, read=None, **overrides):
    """(snapshots, contexts, account) of a shell scene's text."""
    scene, contexts, models, account = shell_models(text, read, **overrides)
    return list(evolve(models, scene.schedule(), account)), contexts, account


def shell_models(text, read=None, **overrides):
    """(scene, contexts, models, account) of a shell scene's text."""
    scene = resolve(parse_scene(text), KIND, overrides)
    contexts = {name: context for name, (context, _) in model.contexts(scene, read).items()}
    account = Account()
    return scene, contexts, model.build(scene, contexts, account), account


def scalar(snapshots, name, name_in_scene="s"):
    """A scalar of every frame."""
    return [snapshot.observations[name_in_scene].scalar[name] for snapshot in snapshots]
