"""Start-up: parts of numpy are imported at their first use.

scipy evaluates `from numpy import *`, which imports numpy's test tools, its generator of Fortran wrappers and
masked arrays: a third of the start-up time of a command on a small mesh.
"""

from __future__ import annotations

import functools
import importlib.util
import sys
import types
from typing import Any

import click

from ddgcli.cli.allocation import keep_freed_memory

DEFERRED_MODULES = (
    "numpy.f2py",
    "numpy.ma",
    "numpy.polynomial",
    "numpy.random",
    "numpy.testing",
    "numpy.typing",
)
# numpy's texts of `help` for compiled functions, a tenth of its import; a command shows none of them
UNUSED_MODULES = ("numpy._core._add_newdocs", "numpy._core._add_newdocs_scalars")


def defer_imports(names: tuple[str, ...] = DEFERRED_MODULES) -> None:
    """Replaces modules that are not loaded yet by modules that load at the first access to an attribute."""
    if "numpy" not in sys.modules:
        sys.modules.update((name, types.ModuleType(name)) for name in UNUSED_MODULES)
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
        if name == "numpy.ma":
            _answer_unloaded(module)
        setattr(sys.modules[parent_name], child, module)


def _answer_unloaded(masked_arrays: types.ModuleType) -> None:
    """Let numpy test whether an array is masked without loading `numpy.ma`: before that, none is.

    `np.unique` and `np.median` do so, and loading takes a tenth of a command on a small mesh.
    """
    lazy_class = type(masked_arrays)

    class UnloadedMaskedArrays(lazy_class):  # type: ignore[misc, valid-type]
        def __getattribute__(self, name: str) -> Any:
            if name in ("is_masked", "isMaskedArray"):
                return lambda _: False
            object.__setattr__(self, "__class__", lazy_class)
            return getattr(self, name)

    object.__setattr__(masked_arrays, "__class__", UnloadedMaskedArrays)


def with_deferred_imports(command: click.Command) -> click.Command:
    """The command, which calls `keep_freed_memory` and `defer_imports` before it starts.

    Its help page imports no numpy at all.
    """
    callback = command.callback
    if callback is None or hasattr(callback, "defers_imports"):
        return command

    @functools.wraps(callback)
    def deferring(*arguments: Any, **options: Any) -> Any:
        keep_freed_memory()
        defer_imports()
        return callback(*arguments, **options)

    deferring.defers_imports = True  # type: ignore[attr-defined]
    command.callback = deferring
    return command
