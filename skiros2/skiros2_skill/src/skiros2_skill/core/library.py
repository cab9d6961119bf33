"""The skills that a manager can run: descriptions, their implementations, and instances of these."""

from __future__ import annotations

import difflib
import logging
import threading
import traceback
from collections.abc import Iterable, Sequence
from typing import Any

from skiros2_common.core.errors import FOREIGN_ERRORS, ConfigurationError, SkirosError, UnknownName
from skiros2_common.core.names import full_name
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.tools.plugin_loader import PluginLoader
from skiros2_skill.core.compound import SkillBase
from skiros2_skill.core.lint import NOT_DESCRIBED, NOTE, Fault, Linter

log = logging.getLogger(__name__)


class Implementation:
    """A class that implements a skill, with the instances that are free.

    `declared` is an instance that never runs: it holds what the class declares.
    """

    def __init__(self, cls: type, wmi: Any, library: SkillLibrary) -> None:
        self._cls = cls
        self._wmi = wmi
        self._library = library
        self.declared: Any = self._make()
        self._free: list[Any] = []
        self._running = 0
        self._lock = threading.Lock()  # tasks may be ticked by several threads

    @property
    def type(self) -> str:
        return str(self.declared.type)

    @property
    def label(self) -> str:
        return str(self.declared.label)

    @property
    def is_compound(self) -> bool:
        return isinstance(self.declared, SkillBase)

    @property
    def busy(self) -> bool:
        """Whether an instance runs."""
        return self._running > 0

    @property
    def module(self) -> str:
        """The Python module that defines the class."""
        return self._cls.__module__

    def acquire(self) -> Any:
        """An instance that nobody else uses until it is released.

        :raises ConfigurationError: a new one cannot be made.
        """
        with self._lock:
            instance = self._free.pop() if self._free else None
        return instance if instance is not None else self._make()

    def release(self, instance: Any) -> None:
        """Gives an instance back."""
        if isinstance(instance, SkillBase):
            instance._expands_into = None
        with self._lock:
            self._free.append(instance)

    def count(self, change: int) -> None:
        """Notes that one more (1) or one less (-1) instance runs."""
        with self._lock:
            self._running += change

    def _make(self) -> Any:
        """A loaded instance.

        :raises ConfigurationError: the class cannot be loaded; the text tells why.
        """
        name = f"{self._cls.__module__}.{self._cls.__name__}"
        try:
            instance = self._cls()
            loaded = instance.init(self._wmi, self._library)
        except SkirosError as error:
            raise ConfigurationError(f"skill {name} cannot be loaded: {error}") from error
        except FOREIGN_ERRORS as error:
            place = traceback.extract_tb(error.__traceback__)[-1]
            raise ConfigurationError(
                f"skill {name} cannot be loaded: {place.filename}, line {place.lineno}: {type(error).__name__}: {error}"
            ) from error
        if loaded is False:
            raise ConfigurationError(f"skill {name} cannot be loaded: its onInit returned False")
        instance._note_declared()
        return instance


class FaultySkill(ConfigurationError):
    """A skill has faults that keep it from loading."""

    def __init__(self, faults: Sequence[Fault]) -> None:
        super().__init__("; ".join(map(str, faults)))
        self.faults = faults


class SkillLibrary:
    """The implementations that were loaded, by type and label.

    :param wmi: the world model as the skills see it.
    """

    def __init__(self, wmi: Any) -> None:
        self.wmi = wmi
        self._loader = PluginLoader()
        self._by_type: dict[str, list[Implementation]] = {}
        self._linter = Linter((), wmi)
        self._faulty: dict[type, FaultySkill] = {}
        self._libraries: list[str] = []
        self._loaded: set[type] = set()

    # -- loading -----------------------------------------------------------------------------------------------

    def import_libraries(self, packages: Sequence[str]) -> None:
        """Finds the skill classes of Python packages and everything below them.

        :raises ConfigurationError: a package does not exist or cannot be imported.
        """
        for package in packages:
            for cls in self._loader.load(package, (PrimitiveBase, SkillBase)):
                self._linter.add(cls)
            self._libraries.append(package)

    def load(self, names: Iterable[str]) -> None:
        """Loads implementations by class name or `module.Class`. Those with faults are reported, and the rest loads.

        :raises ConfigurationError: no library has such a skill, or it cannot be loaded.
        """
        for name in names:
            cls = self.find(name)
            try:
                self._check(cls, tree=True)
                self.add(cls)
            except FaultySkill as error:
                log.error("skill %s is not loaded: %s", name, error)

    def find(self, name: str) -> type:
        """The class of that name, or `module.Class`, in the libraries.

        :raises ConfigurationError: no library has such a skill.
        """
        cls = self._loader.getPluginByName(name)
        if cls is None:
            raise ConfigurationError(self._no_such_class(name))
        return cls

    def add(self, cls: type) -> Implementation | None:
        """Loads the implementation that a class defines; None when it is loaded already.

        :raises ConfigurationError: it cannot be loaded, or another one has its type and label.
        :raises FaultySkill: its description or tree is wrong.
        """
        if cls in self._loaded:
            return None
        implementation = Implementation(cls, self.wmi, self)
        self._check(cls, tree=False)
        for other in self._by_type.get(implementation.type, ()):
            if other.label == implementation.label:
                raise ConfigurationError(
                    f"{cls.__module__}.{cls.__name__} and {other.module}.{other._cls.__name__} both implement "
                    f"{implementation.type} as {implementation.label!r}; labels have to differ"
                )
        self._by_type.setdefault(implementation.type, []).append(implementation)
        self._loaded.add(cls)
        log.debug("loaded %s-%s from %s", implementation.type, implementation.label, implementation.module)
        return implementation

    def _check(self, cls: type, tree: bool) -> None:
        """
        :raises FaultySkill: the skill's description or tree is wrong.
        """
        if cls in self._faulty:
            raise self._faulty[cls]
        self._linter.add(cls)
        faults = self._linter.lint(cls, tree)
        errors = [fault for fault in faults if fault.blocks and fault.code != NOT_DESCRIBED]  # loading tells that
        for fault in faults:
            if tree and fault.severity != NOTE and fault not in errors:
                log.warning("%s", fault)
        if errors:
            self._faulty[cls] = FaultySkill(errors)
            raise self._faulty[cls]

    # -- looking up --------------------------------------------------------------------------------------------

    def implementations(self) -> list[Implementation]:
        """All that are loaded, in the order they were."""
        return [i for some in self._by_type.values() for i in some]

    def candidates(self, stype: str, label: str) -> list[Implementation]:
        """The implementations of a type, with that label where one is given; those that do not run come first.

        What was not listed is loaded from the libraries.

        :raises UnknownName: there is none.
        """
        stype = full_name(stype)
        found = self._matching(stype, label)
        if not found:
            self._load_matching(stype, label)
            found = self._matching(stype, label)
        if not found:
            raise UnknownName(self._no_such_skill(stype, label))
        return sorted(found, key=lambda i: i.busy) if len(found) > 1 else found

    def by_label(self, label: str) -> Implementation:
        """The implementation with that label, of whatever type.

        :raises UnknownName: there is none, or there are several.
        """
        found = [i for i in self.implementations() if i.label == label]
        if len(found) != 1:
            labels = [i.label for i in self.implementations()]
            problem = "several skills are" if found else "no skill is"
            raise UnknownName(f"{problem} labelled {label!r}; loaded: {', '.join(labels) or 'none'}")
        return found[0]

    def _matching(self, stype: str, label: str) -> list[Implementation]:
        return [i for i in self._by_type.get(stype, ()) if not label or i.label == label]

    def _load_matching(self, stype: str, label: str) -> None:
        for cls in self._loader.list():
            if cls in self._loaded:
                continue
            try:
                implementation = Implementation(cls, self.wmi, self)
                if implementation.type == stype and (not label or implementation.label == label):
                    self._check(cls, tree=True)
                    self.add(cls)
            except ConfigurationError as error:
                log.debug("%s", error)

    def _no_such_class(self, name: str) -> str:
        known = sorted(c.__name__ for c in self._loader.list())
        near = difflib.get_close_matches(name, known, n=3)
        hint = f"; near: {', '.join(near)}" if near else ""
        failures = "".join(f"; {module} was skipped: {cause}" for module, cause in self._loader.failures.items())
        where = ", ".join(self._libraries) or "no library"
        return f"skill {name!r}: no class of that name in {where}{hint}{failures}"

    def _no_such_skill(self, stype: str, label: str) -> str:
        for error in self._faulty.values():
            names = {fault.skill for fault in error.faults}
            if f"{stype}-{label}" in names or (not label and any(name.startswith(f"{stype}-") for name in names)):
                return f"skill {stype}{f' labelled {label!r}' if label else ''} was not loaded: {error}"
        if label and self._by_type.get(stype):
            labels = ", ".join(repr(i.label) for i in self._by_type[stype])
            return f"skill {stype} has no implementation {label!r}; it has: {labels}"
        near = difflib.get_close_matches(stype, self._by_type, n=3)
        hint = f"near: {', '.join(near)}" if near else f"known types: {', '.join(sorted(self._by_type)) or 'none'}"
        return f"no skill of type {stype}{f' labelled {label!r}' if label else ''}; {hint}"
