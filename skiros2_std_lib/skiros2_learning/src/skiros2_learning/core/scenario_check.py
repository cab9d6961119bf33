"""Checks scenario files against themselves, their scenes and their skills, for all mistakes at once."""

from __future__ import annotations

import copy
from collections.abc import Collection, Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import yaml

from skiros2_common.core.errors import ConfigurationError, WrongValue
from skiros2_common.core.names import nearest
from skiros2_common.core.yaml_text import YamlText, read_yaml
from skiros2_common.tools.libraries import find_libraries
from skiros2_learning.core.evaluation import check_execution
from skiros2_learning.core.platforms import Step
from skiros2_learning.core.scenario import (
    NO_SCENE,
    Scenario,
    ScenarioError,
    load_scenario,
    parse_scenario,
    unassigned_variables,
)
from skiros2_learning.core.sections import Mistake

#: The path of a part in the file.
_Path = tuple[str | int, ...]

#: With mistakes in these, nothing can be compared with scene and skills.
_NEEDED = ("platform", "execution", "plugins")
#: What takes the place of parts with mistakes: of variables and objectives by name, of all steps, of the name.
_STAND_INS: dict[str, Any] = {"variables": {"range": [0.0, 1.0]}, "objectives": {"rewards": [{"reward": "success"}]}}
_NO_STEP, _NO_NAME = {"skill": ""}, "scenario"
#: How often parts with mistakes are removed: others may depend on them.
_ATTEMPTS = 8
_KEYS = {"scenario", *(each.name for each in fields(Scenario))} - {"name", "source", "original"}
_STEP_KEYS = {each.name for each in fields(Step)}


def load_checked(file: Path) -> Scenario:
    """Reads a scenario file, and checks it against its scene and the skills of its execution.

    :raises ScenarioError: it has mistakes; the text names all of them, but for those of values that depend on others
        with mistakes.
    :raises ConfigurationError: it cannot be read.
    """
    try:
        scenario = load_scenario(file)
    except ScenarioError as error:
        raise ScenarioError(str(file), _Remainder(error, file.resolve()).mistakes(), error.text) from None
    try:
        check_execution(scenario)
    except ScenarioError as error:
        raise ScenarioError(str(file), _causes(error.mistakes, read_yaml(error.text)), error.text) from None
    return scenario


def _causes(mistakes: Collection[Mistake], data: Any) -> list[Mistake]:
    """Returns the mistakes without consequences of others: an unknown skill may be of a library that is missing, and
    the variables of a step without a name have that of its skill."""
    found = [*mistakes]
    if any(path[:1] == ("libraries",) for path, _ in found):
        found = [each for each in found if not (_names_skill(each[0]) and isinstance(_part(data, each[0]), str))]
    if any(_names_skill(path) and _part(data, (*path[:-1], "name")) is None for path, _ in found):
        unassigned = {("variables", name) for name in unassigned_variables(data)}
        found = [each for each in found if each[0] not in unassigned]
    return found


def _names_skill(path: _Path) -> bool:
    return path[:1] == ("task",) and path[2:] in (("skill",), ("label",))


def _part(data: Any, path: _Path) -> Any:
    """Returns the part of the data with a path; None if there is none."""
    for key in path:
        if isinstance(data, Mapping):
            data = data.get(key)
        elif isinstance(data, list) and isinstance(key, int) and key < len(data):
            data = data[key]
        else:
            return None
    return data


class _Remainder:
    """A scenario without its parts that have mistakes. A misspelt key counts as the nearest one.

    :param error: the mistakes of the file.
    """

    def __init__(self, error: ScenarioError, file: Path) -> None:
        self._file = file
        self._scenario: Scenario | None = None
        self._replaced: set[_Path] = set()
        self._removed: set[_Path] = set()
        #: Names of steps without some of their keys.
        self._incomplete: set[str] = set()
        self._data: Any = copy.deepcopy(read_yaml(error.text))
        #: The paths in the file of misspelt keys, by the right ones.
        self._given = _correct(self._data)
        self._corrected = copy.deepcopy(self._data)
        self._found = [*error.mistakes]
        if not isinstance(self._data, dict):
            return
        pending = self._parse()
        kept = {*self._given.values(), *YamlText(error.text).repeated}
        self._found = [*(each for each in error.mistakes if each[0] in kept), *pending]
        for _ in range(_ATTEMPTS):
            if not pending or False in {self._remove(path) for path, _ in pending}:
                return
            pending = self._parse()

    def mistakes(self) -> list[Mistake]:
        """Returns the mistakes of the file, and those of the remainder in scene and skills."""
        found = _causes([*self._found, *self._compared()], self._corrected)
        return [(self._path_in_file(path), text) for path, text in found]

    def _compared(self) -> list[Mistake]:
        if self._scenario is None:
            return []
        try:
            check_execution(self._scenario)
        except ScenarioError as error:
            return [each for each in error.mistakes if self._has(each[0])]
        except ConfigurationError as error:
            return [((), str(error))]
        return []

    def _parse(self) -> list[Mistake]:
        try:
            scenario = parse_scenario(yaml.safe_dump(self._data), self._file.parent)
        except ScenarioError as error:
            return [*error.mistakes]
        self._scenario = replace(scenario, scene=NO_SCENE) if ("scene",) in self._removed else scenario
        return []

    def _path_in_file(self, path: _Path) -> _Path:
        for right, given in self._given.items():
            if path[: len(right)] == right:
                return (*given, *path[len(right) :])
        return path

    def _has(self, path: _Path) -> bool:
        if any(path[: len(part)] == part for part in self._removed):
            return False
        if len(path) == 2 and path[0] == "variables" and _part(self._corrected, path) is None:
            return str(path[1]).rpartition(".")[0] not in self._incomplete  # a value that is missing
        return not (len(path) > 2 and path[:2] in self._replaced)

    def _remove(self, path: _Path) -> bool:
        """Removes or replaces the part with a mistake. Returns whether it is dispensable."""
        if not path or path[0] in _NEEDED:
            return False
        name, parts = str(path[0]), self._data.get(path[0])
        if name == "scenario":
            self._data[name] = _NO_NAME
        elif name == "scene":
            self._remove_scene()
        elif name == "task":
            self._remove_step(path)
        elif name not in _STAND_INS:
            self._data.pop(name, None)
            self._removed.add((name,))
        elif len(path) == 1 or not isinstance(parts, dict):
            step = self._data["task"][0] if isinstance(self._data.get("task"), list) else {}
            prefix = step.get("name", step.get("skill")) if isinstance(step, dict) else ""
            self._data[name] = {f"{prefix}.{name}": _STAND_INS[name]}
            self._removed.add((name,))
        elif path[:2] not in self._replaced:
            parts[path[1]] = _STAND_INS[name]
            self._replaced.add(path[:2])
        else:
            parts.pop(path[1], None)
            self._removed.add(path[:2])
        return True

    def _remove_scene(self) -> None:
        libraries, named = self._data.get("libraries"), str(self._data.get("scene") or "")
        if isinstance(libraries, list):  # they may be beside it
            find_libraries(map(str, libraries), (self._file.parent / named).parent)
        self._data["scene"] = str(self._file)  # there is such a file
        self._removed.add(("scene",))

    def _remove_step(self, path: _Path) -> None:
        steps, step = self._data.get("task"), _part(self._data, path[:2])
        if len(path) == 1 or not isinstance(steps, list):
            self._data["task"] = [_NO_STEP]
            self._removed.add(("task",))
        elif len(path) > 2 and path[2] != "skill":
            step.pop(path[2], None)
            self._incomplete.add(str(step.get("name", step.get("skill"))))
        else:
            name = step.get("name") if isinstance(step, dict) else None
            steps[int(path[1])] = {**_NO_STEP, "name": name or f"step {path[1]}"}
            self._removed.add(path[:2])


def _correct(data: Any) -> dict[_Path, _Path]:
    """Corrects the misspelt keys of a scenario and its steps, and returns their paths by the right ones."""
    found: dict[_Path, _Path] = {}
    if not isinstance(data, dict):
        return found
    _correct_keys(data, _KEYS, (), found)
    for i, step in enumerate(data["task"] if isinstance(data.get("task"), list) else ()):
        if isinstance(step, dict):
            _correct_keys(step, _STEP_KEYS, ("task", i), found)
    return found


def _correct_keys(data: dict[Any, Any], known: Collection[str], path: _Path, found: dict[_Path, _Path]) -> None:
    for key in [key for key in data if key not in known]:
        right = next(iter(nearest(str(key), known, 1)), None)
        if right is not None and data.get(right) is None:
            data[right] = data.pop(key)
            found[*path, right] = (*path, key)


def plugins_of(file: str | Path) -> list[str]:
    """Returns the plug-ins that a scenario file names, without importing them; [] if it cannot be read."""
    try:
        data = read_yaml(Path(file).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, WrongValue):
        return []
    found = data.get("plugins") if isinstance(data, Mapping) else None
    return [str(each) for each in found] if isinstance(found, list) else []
