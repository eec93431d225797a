"""Scenes run in tests without files."""

from ddgcli.evolve.account import Account
from ddgcli.evolve.loop import evolve
from ddgcli.io.scene_file import parse_scene
from ddgcli.models.scene import resolve
from ddgcli.models.shell import model
from ddgcli.models.shell.scene import KIND


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
