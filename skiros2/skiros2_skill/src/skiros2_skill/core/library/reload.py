"""Reloads skill libraries with their present source. A failure restores the old modules."""

from __future__ import annotations

import importlib
import linecache
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FunctionType, ModuleType

from skiros2_common.core.errors import ConfigurationError, UnknownName
from skiros2_skill.core.library.library import SkillLibrary


@contextmanager
def reloading(library: SkillLibrary, packages: Sequence[str] = ()) -> Iterator[SkillLibrary]:
    """Yields a library with reloaded code. An exception in the `with` block restores the old modules.

    Instances of the old library, and skills that they start, keep the old code.

    :param packages: of the library; packages that use them are reloaded too. Empty: all.
    :raises UnknownName: the library has no such package.
    :raises ConfigurationError: the new code cannot be imported, lacks a loaded skill, or has one that cannot be loaded.
    """
    unknown = [name for name in packages if name not in library.libraries]
    if unknown:
        known = ", ".join(library.libraries) or "none"
        raise UnknownName(f"no library {', '.join(map(repr, unknown))} was loaded; there are: {known}")
    changed = _with_users(packages or library.libraries, library.libraries)
    before = _modules_of(changed)
    _unload(before)
    done = False
    try:
        yield _load_again(library)
        done = True
    finally:
        if not done:
            _unload(_modules_of(changed))
            _restore(before)


def _load_again(library: SkillLibrary) -> SkillLibrary:
    fresh = SkillLibrary(library.wmi, library.on_load)
    fresh.import_libraries(library.libraries)
    fresh.load(library.listed)
    failed = [f"{name}: {why}" for name, why in fresh.not_imported.items() if name not in library.not_imported]
    failed += [why for name, why in fresh.skipped.items() if name not in library.skipped]
    if failed:
        raise ConfigurationError("; ".join(failed))
    return fresh


def _with_users(packages: Iterable[str], libraries: Iterable[str]) -> list[str]:
    """Packages, with the libraries that import from them, directly or indirectly."""
    found = list(dict.fromkeys(packages))
    remaining = [name for name in libraries if name not in found]
    while True:
        users = [name for name in remaining if _uses(name, found)]
        if not users:
            return found
        found += users
        remaining = [name for name in remaining if name not in users]


def _uses(library: str, packages: Sequence[str]) -> bool:
    values = [value for module in _modules_of([library]).values() for value in vars(module).values()]
    modules = {v.__name__ for v in values if isinstance(v, ModuleType)}
    modules |= {v.__module__ for v in values if isinstance(v, (type, FunctionType))}
    return any(_is_in(module, packages) for module in modules)


def _modules_of(packages: Sequence[str]) -> dict[str, ModuleType]:
    return {name: module for name, module in sys.modules.items() if _is_in(name, packages)}


def _is_in(module: str, packages: Sequence[str]) -> bool:
    return any(f"{module}.".startswith(f"{package}.") for package in packages)


def _unload(modules: dict[str, ModuleType]) -> None:
    """Makes the next import read the sources, even if they have changed within the same second."""
    for name, module in modules.items():
        sys.modules.pop(name, None)
        if module.__spec__ is not None and module.__spec__.cached:
            with suppress(OSError):
                Path(module.__spec__.cached).unlink(missing_ok=True)
    importlib.invalidate_caches()
    linecache.checkcache()


def _restore(modules: dict[str, ModuleType]) -> None:
    sys.modules.update(modules)
    for name, module in modules.items():
        parent, _, child = name.rpartition(".")
        if parent in sys.modules:
            setattr(sys.modules[parent], child, module)
