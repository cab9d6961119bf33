"""The skill library of a manager: implementations by type and label, and their instances."""

from __future__ import annotations

import builtins
import logging
from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeAlias

from skiros2_common.core.errors import FOREIGN_ERRORS, ConfigurationError, SkirosError, UnknownName
from skiros2_common.core.names import full_name, nearest
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.source_location import error_location, format_error_line
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_common.tools.plugin_loader import PluginLoader
from skiros2_skill.core.library.description import Described, Descriptions, class_location, is_named
from skiros2_skill.core.tree.compound import SkillBase

log = logging.getLogger(__name__)


class Implementation:
    """A class that implements a skill, with a pool of free instances.

    `declared` is an instance that never runs; it has the description.
    """

    def __init__(self, cls: type, wmi: WorldModelPort | None, library: SkillLibrary) -> None:
        self._cls = cls
        self._wmi = wmi
        self._library = library
        #: The Python module that defines the class.
        self.module = cls.__module__
        self.declared: Any = self._create()
        self.type, self.label = str(self.declared.type), str(self.declared.label)
        self.is_compound = isinstance(self.declared, SkillBase)
        #: Whether it is a compound with an `execute` of its own.
        self.runs_after_children = self.is_compound and type(self.declared).execute is not SkillBase.execute
        self._free: list[Any] = []
        self._running: list[None] = []  # an entry for each; like `_free`, it needs no lock: append and pop are atomic

    @property
    def busy(self) -> bool:
        """Whether an instance is running."""
        return bool(self._running)

    @property
    def cls(self) -> builtins.type:
        return self._cls

    def acquire(self) -> Any:
        """Returns an instance for exclusive use until it is released.

        :raises ConfigurationError: no instance can be created.
        """
        try:
            return self._free.pop()
        except IndexError:
            return self._create()

    def release(self, instance: Any) -> None:
        """Returns an instance to the pool."""
        if self.is_compound:
            instance.expands_into = None
        self._free.append(instance)

    def count(self, change: int) -> None:
        """Changes the number of running instances by 1 or -1."""
        if change > 0:
            self._running.append(None)
        else:
            self._running.pop()

    def _create(self) -> Any:
        """Creates and loads an instance.

        :raises ConfigurationError: the class cannot be loaded; the text has the reason.
        """
        name = f"{self._cls.__module__}.{self._cls.__name__}"
        try:
            instance = self._cls()
            loaded = instance.init(self._wmi, self._library)
        except FOREIGN_ERRORS as error:
            file, line = error_location(error, self.module) or class_location(self._cls)
            text = str(error) if isinstance(error, SkirosError) else format_error_line(error)
            raise ConfigurationError(f"skill {name} cannot be loaded: {file}, line {line}: {text}") from error
        if loaded is False:
            file, line = class_location(self._cls)
            raise ConfigurationError(f"skill {name} cannot be loaded: {file}, line {line}: its onInit returned False")
        instance.save_declared()
        return instance


OnLoad: TypeAlias = "Callable[[SkillLibrary, Sequence[type]], None]"


class SkillLibrary:
    """The loaded implementations, by type and label.

    :param wmi: the world model as the skills see it; None: they are only looked up.
    :param on_load: called with the library and the classes that it has loaded.
    """

    def __init__(self, wmi: WorldModelPort | None, on_load: OnLoad = lambda library, classes: None) -> None:
        self.wmi = wmi
        self.on_load = on_load
        #: The classes of the libraries, including those that are not loaded.
        self.descriptions = Descriptions(wmi)
        self._loader = PluginLoader()
        self._by_type: dict[str, list[Implementation]] = {}
        self._by_name: dict[tuple[str, str], list[Implementation]] = {}  # by type and label, as `_matching` finds them
        self._skipped: dict[type, str] = {}  # reason by class
        self._libraries: list[str] = []
        self._listed: list[str] = []
        self._loaded: dict[type, Implementation] = {}

    # -- loading -----------------------------------------------------------------------------------------------

    @property
    def libraries(self) -> list[str]:
        """The imported packages."""
        return [*self._libraries]

    @property
    def listed(self) -> list[str]:
        """The names given to `load`."""
        return [*self._listed]

    @property
    def not_imported(self) -> dict[str, str]:
        """The modules of the libraries that could not be imported, with the reasons."""
        return {module: str(failure) for module, failure in self._loader.failures.items()}

    @property
    def skipped(self) -> dict[str, str]:
        """The classes that could not be loaded, as `module.Class`, with the reasons."""
        return {_full_name(cls): why for cls, why in self._skipped.items()}

    def import_libraries(self, packages: Sequence[str]) -> None:
        """Imports Python packages with their submodules and collects the skill classes.

        :raises ConfigurationError: a package does not exist or cannot be imported.
        """
        for package in packages:
            try:
                self._loader.load(package, (PrimitiveBase, SkillBase))
            except ImportError as error:
                raise ConfigurationError(str(error)) from error
            self._libraries.append(package)
        for cls in self._loader:
            self.descriptions.add(cls)

    def load(self, names: Iterable[str]) -> None:
        """Loads implementations by class name or `module.Class`.

        A skill that cannot be loaded is logged and skipped.

        :raises ConfigurationError: no library has a class with one of these names.
        """
        names = list(names)
        found = [self._find(name) for name in names]
        unknown = [self._no_such_class(name) for name, cls in zip(names, found, strict=True) if cls is None]
        if unknown:
            raise ConfigurationError("; ".join(unknown))
        self._listed += names
        loaded = []
        for cls in dict.fromkeys(cls for cls in found if cls is not None):
            try:
                if self.add(cls) is not None:
                    loaded.append(cls)
            except ConfigurationError as error:
                log.error("%s; it is skipped", error)
        self.on_load(self, loaded)

    def find(self, name: str) -> type:
        """The class in the libraries with a name, or with `module.Class`.

        :raises ConfigurationError: no library has such a skill.
        """
        found = self._find(name)
        if found is None:
            raise ConfigurationError(self._no_such_class(name))
        return found

    def _find(self, name: str) -> type | None:
        return next((cls for cls in self._loader if is_named(cls, name)), None)

    def add(self, cls: type) -> Implementation | None:
        """Loads the implementation that a class defines. Returns None if it is loaded already.

        :raises ConfigurationError: it cannot be loaded, or another implementation has its type and label.
        """
        if cls in self._loaded:
            return None
        try:
            implementation = Implementation(cls, self.wmi, self)
            for other in self._by_type.get(implementation.type, ()):
                if other.label == implementation.label:
                    file, line = class_location(cls)
                    raise ConfigurationError(
                        f"skill {_full_name(cls)} cannot be loaded: {file}, line {line}: "
                        f"{_full_name(other.cls)} implements {implementation.type} as {implementation.label!r} too; "
                        "labels have to differ"
                    )
        except ConfigurationError as error:
            self._skipped[cls] = str(error)
            raise
        self._skipped.pop(cls, None)
        self._by_type.setdefault(implementation.type, []).append(implementation)
        self._by_name = {}
        self._loaded[cls] = implementation
        log.debug("loaded %s-%s from %s", implementation.type, implementation.label, implementation.module)
        return implementation

    def package_of(self, cls: type) -> str:
        """The package that a class was imported with."""
        names = [name for name in self._libraries if f"{cls.__module__}.".startswith(f"{name}.")]
        return max(names, key=len, default=cls.__module__)

    def names_in(self, package: str) -> list[str]:
        """The classes of skills in an imported package, loaded or not, as `module.Class`."""
        return [_full_name(cls) for cls in self._loader if f"{cls.__module__}.".startswith(f"{package}.")]

    # -- lookup ------------------------------------------------------------------------------------------------

    def implementations(self) -> list[Implementation]:
        """All loaded implementations, in the order of loading."""
        return [i for some in self._by_type.values() for i in some]

    def candidates(self, stype: str, label: str) -> list[Implementation]:
        """The implementations of a type, those that are not running first.

        If no loaded implementation matches, `label` is tried as a class name, then as the label of a class that is not
        loaded; matching classes are loaded from the libraries.

        :param label: "" for any.
        :raises UnknownName: there is none.
        """
        stype = full_name(stype)
        found = self._by_name.get((stype, label)) or self._matching(stype, label) or self._named(stype, label)
        if not found:
            self._load_matching(stype, label)
            found = self._matching(stype, label)
        if not found:
            raise UnknownName(self._no_such_skill(stype, label))
        return found if len(found) == 1 else sorted(found, key=lambda i: i.busy)

    def require_type(self, stype: str, label: str) -> None:
        """Checks that a type exists; the label may be unknown.

        :raises UnknownName: no library has a skill of that type.
        """
        try:
            self.candidates(stype, label)
        except UnknownName:
            if not label:
                raise
            self.candidates(stype, "")

    def by_label(self, label: str) -> Implementation:
        """The implementation with a label, of any type.

        :raises UnknownName: there is none, or there are several.
        """
        found = [i for i in self.implementations() if i.label == label]
        if len(found) != 1:
            labels = [i.label for i in self.implementations()]
            problem = "several skills are" if found else "no skill is"
            raise UnknownName(f"{problem} labelled {label!r}; loaded: {', '.join(labels) or 'none'}")
        return found[0]

    def _matching(self, stype: str, label: str) -> list[Implementation]:
        found = [i for i in self._by_type.get(stype, ()) if not label or i.label == label]
        if found:  # requests with unknown names leave nothing
            self._by_name[stype, label] = found
        return found

    def _named(self, stype: str, label: str) -> list[Implementation]:
        """The implementations of a type whose class has this name; they are loaded if needed."""
        classes = [cls for cls in self._loader if label and is_named(cls, label)]
        for cls in classes:
            described = self.descriptions.of(cls)
            if not isinstance(described, Described) or described.skill.type == stype:
                self._add_late(cls)
        return [i for cls in classes if (i := self._loaded.get(cls)) is not None and i.type == stype]

    def _load_matching(self, stype: str, label: str) -> None:
        for cls in self._loader:
            described = self.descriptions.of(cls)
            if not isinstance(described, Described) or described.skill.type != stype:
                continue
            if label in ("", described.skill.label):
                self._add_late(cls)

    def _add_late(self, cls: type) -> None:
        """Loads a class that was not given to `load`."""
        if cls in self._loaded or cls in self._skipped:
            return
        try:
            self.add(cls)
        except ConfigurationError as error:
            log.error("%s; it is skipped", error)
            return
        self.on_load(self, [cls])

    def _no_such_class(self, name: str) -> str:
        known = sorted(c.__name__ for c in self._loader)
        near = nearest(name, known)
        hint = f"; near: {', '.join(near)}" if near else ""
        failures = "".join(f"; {module} was skipped: {cause}" for module, cause in self._loader.failures.items())
        where = ", ".join(self._libraries) or "no library"
        return f"skill {name!r}: no class of that name in {where}{hint}{failures}"

    def _no_such_skill(self, stype: str, label: str) -> str:
        skipped = [why for cls, why in self._skipped.items() if is_named(cls, label) or self._declares(cls, stype)]
        if skipped:
            return f"skill {stype}{f' labelled {label!r}' if label else ''} was not loaded: {'; '.join(skipped)}"
        if label and self._by_type.get(stype):
            labels = ", ".join(repr(i.label) for i in self._by_type[stype])
            return f"skill {stype} has no implementation {label!r}; it has: {labels}"
        described = (self.descriptions.of(cls) for cls in self._loader)
        known = {*self._by_type, *(each.skill.type for each in described if isinstance(each, Described))}
        near = nearest(stype, known)
        hint = f"near: {', '.join(near)}" if near else f"known types: {', '.join(sorted(known)) or 'none'}"
        return f"no skill of type {stype}{f' labelled {label!r}' if label else ''}; {hint}"

    def _declares(self, cls: type, stype: str) -> bool:
        described = self.descriptions.of(cls)
        return isinstance(described, Described) and described.skill.type == stype


def _full_name(cls: type) -> str:
    return f"{cls.__module__}.{cls.__name__}"
