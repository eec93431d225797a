"""Option names for the messages of the core, which knows parameters only.

The core writes a parameter between back quotes, alone or with a value, such as `` `method=exact` ``; the
command line writes `--method exact`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

import click

from ddgcli.errors import ParameterError

QUOTED_PARAMETER = re.compile(r"`([a-z]\w*)(?:=([^`]*))?`")


def option_names(command: click.Command) -> dict[str, str]:
    """Long option of each parameter of a command: `{"heat_time": "--heat-time"}`."""
    names = {}
    for parameter in command.params:
        if isinstance(parameter, click.Option) and parameter.name:
            names[parameter.name] = max(parameter.opts, key=len)
            names |= {word.lstrip("-").replace("-", "_"): word for word in parameter.opts if word[:2] == "--"}
    return names


def with_option_names(message: str, names: Mapping[str, str]) -> str:
    """The message with every quoted parameter that is an option written as that option."""

    def option(match: re.Match[str]) -> str:
        name, value = match.groups()
        if name not in names:
            return match.group(0)
        return names[name] if value is None else f"{names[name]} {value}"

    return QUOTED_PARAMETER.sub(option, message)


def error_text(error: Exception, names: Mapping[str, str]) -> str:
    """Message of an exception; a `ParameterError` that names its parameter begins with the option."""
    if isinstance(error, ParameterError) and error.parameter:
        name = names.get(error.parameter, error.parameter)
        return f"{name}: {with_option_names(error.message, names)}"
    return with_option_names(str(error), names)
