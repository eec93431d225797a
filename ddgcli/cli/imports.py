"""Start-up: parts of numpy and scipy are imported at their first use.

scipy evaluates `from numpy import *`, which imports numpy's test tools, its generator of Fortran wrappers and
masked arrays: a third of the start-up time of a command on a small mesh. `scipy.spatial` imports linear
algebra and special functions, which its k-d tree does not need.
"""

from __future__ import annotations

import functools
import importlib.util
import sys
import types
from contextlib import suppress
from importlib.machinery import PathFinder
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
# numpy's docstrings of compiled functions, a tenth of its import time; no command shows them
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
    if _SpatialFinder not in sys.meta_path:
        sys.meta_path.insert(0, _SpatialFinder)


class _SpatialFinder:
    """Finds `scipy.spatial` for the import system, which imports scipy itself at its own first use."""

    @staticmethod
    def find_spec(name: str, path: Any = None, target: Any = None) -> Any:
        if name != "scipy.spatial":
            return None
        spec = PathFinder.find_spec(name, path, target)
        if spec is not None and spec.loader is not None:
            spec.loader = _SpatialLoader(spec.loader)  # type: ignore[assignment]
        return spec


class _SpatialLoader:
    """Leaves the package unloaded."""

    def __init__(self, loader: Any) -> None:
        self.loader = loader

    @staticmethod
    def create_module(_: Any) -> None:
        """The import system makes the module."""

    def exec_module(self, module: types.ModuleType) -> None:
        module.__spec__.loader = self.loader  # type: ignore[union-attr]
        module.__class__ = _SpatialPackage


class _SpatialPackage(types.ModuleType):
    """`scipy.spatial` before it is loaded: the k-d tree alone is imported from its own module."""

    def __getattr__(self, name: str) -> Any:
        if name == "cKDTree":
            with suppress(ImportError):  # of a scipy that has it elsewhere
                return importlib.import_module("scipy.spatial._ckdtree").cKDTree
        self.__class__ = types.ModuleType  # type: ignore[assignment]
        self.__spec__.loader.exec_module(self)  # type: ignore[union-attr]
        return getattr(self, name)


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
