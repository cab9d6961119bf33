"""Imports skill libraries again, with the code that they have now; the modules are as before when that fails."""

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
    """A library as another one, with new code. What the block raises takes the modules back.

    Instances of the other one, and all that they start later, keep the code that they have.

    :param packages: of its libraries; those that use them are imported again too. None: all.
    :raises UnknownName: the library has no such package.
    :raises ConfigurationError: the new code cannot be imported, or lacks a skill that was loaded, or one of its skills
        cannot be loaded any more.
    """
    unknown = [name for name in packages if name not in library.libraries]
    if unknown:
        known = ", ".join(library.libraries) or "none"
        raise UnknownName(f"no library {', '.join(map(repr, unknown))} was loaded; there are: {known}")
    changed = _with_users(packages or library.libraries, library.libraries)
    before = _modules_of(changed)
    _forget(before)
    done = False
    try:
        yield _loaded_again(library)
        done = True
    finally:
        if not done:
            _forget(_modules_of(changed))
            _bring_back(before)


def _loaded_again(library: SkillLibrary) -> SkillLibrary:
    fresh = SkillLibrary(library.wmi)
    fresh.import_libraries(library.libraries)
    fresh.load(library.listed)
    failed = [f"{name}: {why}" for name, why in fresh.not_imported.items() if name not in library.not_imported]
    failed += [why for name, why in fresh.skipped.items() if name not in library.skipped]
    if failed:
        raise ConfigurationError("; ".join(failed))
    return fresh


def _with_users(packages: Iterable[str], libraries: Iterable[str]) -> list[str]:
    """Packages, and those of some libraries that have imported something of them."""
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
    homes = {v.__name__ for v in values if isinstance(v, ModuleType)}
    homes |= {v.__module__ for v in values if isinstance(v, (type, FunctionType))}
    return any(_is_in(home, packages) for home in homes)


def _modules_of(packages: Sequence[str]) -> dict[str, ModuleType]:
    return {name: module for name, module in sys.modules.items() if _is_in(name, packages)}


def _is_in(module: str, packages: Sequence[str]) -> bool:
    return any(f"{module}.".startswith(f"{package}.") for package in packages)


def _forget(modules: dict[str, ModuleType]) -> None:
    """The next import of the modules reads their sources, also when these were changed within the same second."""
    for name, module in modules.items():
        sys.modules.pop(name, None)
        if module.__spec__ is not None and module.__spec__.cached:
            with suppress(OSError):
                Path(module.__spec__.cached).unlink(missing_ok=True)
    importlib.invalidate_caches()
    linecache.checkcache()


def _bring_back(modules: dict[str, ModuleType]) -> None:
    sys.modules.update(modules)
    for name, module in modules.items():
        parent, _, child = name.rpartition(".")
        if parent in sys.modules:
            setattr(sys.modules[parent], child, module)
