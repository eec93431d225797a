"""Option names for the messages of the core, which names parameters only.

The core writes a parameter between back quotes, alone or with a value, such as `` `method=exact` ``; the
command line writes `--method exact`. Steps that repair a mesh, `` `repair=orient` ``, become the command.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import click

from ddgcli.errors import QUOTED_MESH, QUOTED_PARAMETER, QUOTED_REPAIR, ParameterError

DICT_ENTRY, OPTION_VALUE = re.compile(r"^\{([^:}]+): ([^:}]+)\}$"), r"\1=\2"


def option_names(command: click.Command) -> dict[str, str]:
    """Long option of each parameter of a command: `{"heat_time": "--heat-time"}`."""
    names = {}
    for parameter in command.params:
        if isinstance(parameter, click.Option) and parameter.name:
            names[parameter.name] = max(parameter.opts, key=len)
            names |= {word.lstrip("-").replace("-", "_"): word for word in parameter.opts if word[:2] == "--"}
    return names


def with_option_names(message: str, names: Mapping[str, str]) -> str:
    """The message with every quoted parameter that is an option written as that option.

    A value of a dict, `` `fixed={3: 0.5}` ``, becomes `--fix 3=0.5`.
    """

    def option(match: re.Match[str]) -> str:
        name, value = match.groups()
        if name not in names:
            return match.group(0)
        if value is None:
            return names[name]
        return f"{names[name]} {DICT_ENTRY.sub(OPTION_VALUE, value)}"

    return QUOTED_PARAMETER.sub(option, message)


def with_repair_command(message: str, mesh: Sequence[str] = (), *, tetrahedra: bool = False) -> str:
    """The message with quoted steps of a repair, `` `repair=orient fill_holes=9` ``, as a command.

    Steps of `repair_cells` take tetrahedra as they are. A quoted `boundary_mesh` or `refined_mesh=DEGREES`
    becomes the command that writes it.

    Parameters
    ----------
    message : str
    mesh : sequence of str, optional
        Path of the mesh and the options for reading it; `MESH` where they are unknown.
    tetrahedra : bool
        Whether it holds tetrahedra: the repair is that of their boundary, which another command writes.
    """
    words = list(mesh) or ["MESH"]
    stem = "" if words[0] in ("MESH", "-") else f"{Path(words[0]).stem}-"
    words[0] = "MESH" if words[0] == "-" else words[0]

    def command(match: re.Match[str]) -> str:
        before, read, extension = "", words, ".vtu" if match.group(1) else ".ply"
        if tetrahedra and not match.group(1):
            surface = f"{stem}surface.ply"
            before, read = f"{shlex.join(['ddgcli', 'info', *words, '-o', surface])} && ", [surface]
        steps = (step.partition("=") for step in match.group(2).split())
        options = [
            word for name, _, value in steps for word in (f"--{name.replace('_', '-')}", value) if word
        ]
        return before + shlex.join(["ddgcli", "repair", *read, *options, "-o", f"{stem}repaired{extension}"])

    return QUOTED_MESH.sub(partial(_mesh_command, words), QUOTED_REPAIR.sub(command, message))


def _mesh_command(words: Sequence[str], match: re.Match[str]) -> str:
    """Command that writes the boundary or the refinement of a mesh that these words read."""
    name, value = match.groups()
    if name == "boundary_mesh":
        return shlex.join(["ddgcli", "info", *([value] if value else words), "-o", "surface.ply"])
    return shlex.join(["ddgcli", "delaunay", *words, "--refine", value, "-o", "finer.npz"])


def error_text(error: Exception, names: Mapping[str, str]) -> str:
    """Message of an exception; a `ParameterError` that names its parameter begins with the option."""
    if isinstance(error, ParameterError) and error.parameter:
        name = names.get(error.parameter, error.parameter)
        return f"{name}: {with_option_names(error.message, names)}"
    return with_option_names(str(error), names)
