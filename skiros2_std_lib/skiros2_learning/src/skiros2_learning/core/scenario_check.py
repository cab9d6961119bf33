"""Checks scenario files against themselves, their scenes and their skills, for all mistakes at once."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from skiros2_common.core.errors import ConfigurationError, WrongValue
from skiros2_common.core.yaml_text import read_yaml
from skiros2_learning.core.evaluation import check_execution
from skiros2_learning.core.scenario import Scenario, ScenarioError, load_scenario, parse_scenario
from skiros2_learning.core.sections import Mistake

#: With mistakes in these, nothing can be compared with scene and skills.
_NEEDED = ("scenario", "version", "platform", "execution", "scene", "libraries", "plugins", "task")
#: What takes the place of variables and objectives with mistakes.
_STAND_INS: dict[str, Any] = {"variables": {"range": [0.0, 1.0]}, "objectives": {"rewards": [{"reward": "success"}]}}
#: How often parts with mistakes are removed: others may depend on them.
_ATTEMPTS = 4


def load_checked(file: Path) -> Scenario:
    """Reads a scenario file, and checks it against its scene and the skills of its execution.

    :raises ScenarioError: it has mistakes; the text names all of them, but for those of values that depend on others
        with mistakes.
    :raises ConfigurationError: it cannot be read.
    """
    try:
        scenario = load_scenario(file)
    except ScenarioError as error:
        remainder = _Remainder(error.text, file.resolve().parent)
        raise ScenarioError(str(file), [*error.mistakes, *remainder.mistakes()], error.text) from None
    try:
        check_execution(scenario)
    except ScenarioError as error:
        raise ScenarioError(str(file), error.mistakes, error.text) from None
    return scenario


class _Remainder:
    """A scenario without its parts that have mistakes.

    :param text: of the file; "" if it is not YAML.
    """

    def __init__(self, text: str, folder: Path) -> None:
        self._data = copy.deepcopy(read_yaml(text))
        self._replaced: set[tuple[str | int, ...]] = set()
        self._removed: set[tuple[str | int, ...]] = set()
        self._scenario: Scenario | None = None
        for _ in range(_ATTEMPTS if isinstance(self._data, dict) else 0):
            try:
                self._scenario = parse_scenario(yaml.safe_dump(self._data), folder)
            except ScenarioError as error:
                if False in {self._remove(path) for path, _ in error.mistakes}:
                    return
            else:
                return

    def mistakes(self) -> list[Mistake]:
        """Returns the mistakes in the remaining parts, if there are enough of them."""
        if self._scenario is None:
            return []
        try:
            check_execution(self._scenario)
        except ScenarioError as error:
            return [each for each in error.mistakes if self._has(each[0])]
        except ConfigurationError as error:
            return [((), str(error))]
        return []

    def _has(self, path: tuple[str | int, ...]) -> bool:
        is_removed = any(path[: len(part)] == part for part in self._removed)
        return not is_removed and not (len(path) > 2 and path[:2] in self._replaced)

    def _remove(self, path: tuple[str | int, ...]) -> bool:
        """Removes or replaces the part with a mistake. Returns whether it is dispensable."""
        if not path or path[0] in _NEEDED:
            return False
        name, parts = str(path[0]), self._data.get(path[0])
        if name not in _STAND_INS:
            self._data.pop(name, None)
            self._removed.add((name,))
        elif len(path) == 1 or not isinstance(parts, dict):
            self._data[name] = {name: _STAND_INS[name]}
            self._removed.add((name,))
        elif path[:2] not in self._replaced:
            parts[path[1]] = _STAND_INS[name]
            self._replaced.add(path[:2])
        else:
            parts.pop(path[1], None)
            self._removed.add(path[:2])
        return True


def plugins_of(file: str | Path) -> list[str]:
    """Returns the plug-ins that a scenario file names, without importing them; [] if it cannot be read."""
    try:
        data = read_yaml(Path(file).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, WrongValue):
        return []
    found = data.get("plugins") if isinstance(data, Mapping) else None
    return [str(each) for each in found] if isinstance(found, list) else []
