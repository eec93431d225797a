"""Start-up: parts of numpy are imported at their first use.

scipy evaluates `from numpy import *`, which imports numpy's test tools, its generator of Fortran wrappers and
masked arrays: a third of the start-up time of a command on a small mesh.
"""

from __future__ import annotations

import functools
import importlib.util
import sys
from typing import Any

import click

DEFERRED_MODULES = (
    "numpy.f2py",
    "numpy.ma",
    "numpy.polynomial",
    "numpy.testing",
    "numpy.typing",
)


def defer_imports(names: tuple[str, ...] = DEFERRED_MODULES) -> None:
    """Replaces modules that are not loaded yet by modules that load at the first access to an attribute."""
    for name in names:
        if name in sys.modules:
            continue
        parent_name, _, child = name.rpartition(".")
        spec = importlib.util.find_spec(name)
        if spec is None or spec.loader is None:
            continue
        spec.loader = importlib.util.LazyLoader(spec.loader)
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        spec.loader.exec_module(module)
        setattr(sys.modules[parent_name], child, module)


def with_deferred_imports(command: click.Command) -> click.Command:
    """The command, which calls `defer_imports` before it starts; its help page imports no numpy at all."""
    callback = command.callback
    if callback is None or hasattr(callback, "defers_imports"):
        return command

    @functools.wraps(callback)
    def deferring(*arguments: Any, **options: Any) -> Any:
        defer_imports()
        return callback(*arguments, **options)

    deferring.defers_imports = True  # type: ignore[attr-defined]
    command.callback = deferring
    return command
