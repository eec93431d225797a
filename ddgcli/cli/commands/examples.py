"""`ddgcli examples`."""

from __future__ import annotations

from importlib.resources.abc import Traversable
from pathlib import Path

import click

from ddgcli.cli import options
from ddgcli.cli.forecast.use import InputSize
from ddgcli.cli.options import CommonOptions
from ddgcli.cli.run import Run
from ddgcli.errors import OutputError

FOLDERS = {"sample_meshes": "ddgcli.samples.meshes", "sample_scenes": "ddgcli.samples.scenes"}


@click.command("examples", short_help="Copy the sample meshes and scenes into a folder.")
@click.argument("folder", metavar="DIR", type=click.Path())
@options.common_without_pictures
def command(folder: str, common: CommonOptions) -> None:
    """Copy the sample meshes and scenes to DIR/sample_meshes and DIR/sample_scenes.

    The commands of the README run in DIR afterwards. Files that exist already are kept.

    \b
    Example:
      ddgcli examples .
    """
    run = Run("examples", common, formats=())
    run.input = {"path": folder}
    for name in FOLDERS:
        run.plan_folder(str(Path(folder) / name))
    run.predict(InputSize("surface", 0))
    run.begin()
    copied: dict[str, int] = {}
    with run.clock.timed("write"):
        for name in FOLDERS:
            copied[name] = _copy(samples(name), Path(folder) / name)
    run.finish({"copied": copied}, {})


def _copy(sources: list[Traversable], target: Path) -> int:
    """Copy files that are not there yet; the number of copies."""
    from ddgcli.io.output_file import write_atomically

    try:
        target.mkdir(parents=True, exist_ok=True)
        missing = [source for source in sources if not (target / source.name).exists()]
        for source in missing:
            write_atomically(str(target / source.name), source.read_bytes())
    except OSError as error:
        raise OutputError(f"{target}: {error.strerror}; name another folder") from error
    return len(missing)


def samples(name: str) -> list[Traversable]:
    """Sample files of `sample_meshes` or `sample_scenes`: of the package, or of the source checkout."""
    import importlib.resources

    try:  # the package has no __init__.py: its folder may be several, and has no path
        folder: Traversable = importlib.resources.files(FOLDERS[name])
    except ModuleNotFoundError:
        folder = Path(__file__).parents[3] / name
    files = [file for file in folder.iterdir() if file.is_file() and not file.name.endswith((".py", ".pyc"))]
    return sorted(files, key=lambda file: file.name)
