"""Start-up: parts of numpy and scipy are imported at their first use.

scipy evaluates `from numpy import *`, which imports numpy's test tools, its generator of Fortran wrappers and
masked arrays: a third of the start-up time of a command on a small mesh. `scipy.spatial` imports linear
algebra and special functions, which its k-d tree does not need.
"""

from __future__ import annotations

import functools
import importlib.util
import os
import sys
import threading
import types
from contextlib import suppress
from importlib.abc import Loader
from importlib.machinery import ModuleSpec, PathFinder
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
        if importlib.util.find_spec(name) is None:
            continue
        module = _MaskedArrays(name) if name == "numpy.ma" else _DeferredModule(name)
        sys.modules[name] = module
        setattr(sys.modules[parent_name], child, module)
    sys.modules.setdefault("scipy.spatial", _SpatialPackage("scipy.spatial"))
    if _LoadedModuleFinder not in sys.meta_path:
        sys.meta_path.insert(0, _LoadedModuleFinder)


class _DeferredModule(types.ModuleType):
    """Placeholder in `sys.modules`, which imports its module at the first access to an attribute.

    The import system imports the whole module at that access, under its own locks: no code meets a module
    that is half loaded, unless ordinary imports would show it to that code too.
    """

    _placeholder_lock = threading.Lock()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._loaded(), name)

    def __dir__(self) -> list[str]:
        return dir(self._loaded())

    def _is_deferred(self) -> bool:
        return sys.modules.get(self.__name__) is self

    def _loaded(self) -> types.ModuleType:
        with self._placeholder_lock:
            if self._is_deferred():
                del sys.modules[self.__name__]
        return importlib.import_module(self.__name__)


class _LoadedModuleFinder:
    """Loads a deferred package before its submodules, and finds those that the package has loaded.

    The import system reads `sys.modules` before it calls finders: without this one it would load such a
    submodule twice, or before its package.
    """

    @staticmethod
    def find_spec(name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        package = sys.modules.get(name.rpartition(".")[0])
        if isinstance(package, _DeferredModule):
            package._loaded()
        module = sys.modules.get(name)
        return None if module is None or target is not None else ModuleSpec(name, _LoadedModule(module))


class _LoadedModule(Loader):
    """Loader of a module that is loaded."""

    def __init__(self, module: types.ModuleType) -> None:
        self.module, self.spec = module, module.__spec__

    def create_module(self, _: ModuleSpec) -> types.ModuleType:
        return self.module

    def exec_module(self, module: types.ModuleType) -> None:
        module.__spec__ = self.spec  # which the import system has replaced


class _SpatialPackage(_DeferredModule):
    """`scipy.spatial`: the k-d tree alone is loaded from its own file."""

    _placeholder_lock = threading.Lock()  # the package never loads while that file does

    def __getattr__(self, name: str) -> Any:
        if name == "__path__":  # which `from scipy.spatial import cKDTree` reads
            return _spatial_folders()
        if name == "cKDTree" and self._is_deferred():
            importlib.import_module("scipy.sparse")  # which the tree's module imports; outside the lock
            with self._placeholder_lock, suppress(ImportError):  # of a scipy that has it elsewhere
                if self._is_deferred():
                    return _tree_class()
        return super().__getattr__(name)


def _spatial_folders() -> list[str]:
    import scipy

    return [os.path.join(folder, "spatial") for folder in scipy.__path__]


@functools.cache
def _tree_class() -> Any:
    """The class `cKDTree`, without its package."""
    spec = PathFinder.find_spec("scipy.spatial._ckdtree", _spatial_folders())
    if spec is None or spec.loader is None:
        raise ImportError(name="scipy.spatial._ckdtree")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    sys.modules.pop(spec.name, None)  # it registers itself; the import of the package makes it an attribute
    return module.cKDTree


class _MaskedArrays(_DeferredModule):
    """`numpy.ma`: before it is loaded, no array is masked.

    `np.unique` and `np.median` test that, and loading takes a tenth of a command on a small mesh.
    """

    def __getattr__(self, name: str) -> Any:
        if name in ("is_masked", "isMaskedArray") and self._is_deferred():
            return lambda _: False
        return super().__getattr__(name)


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
