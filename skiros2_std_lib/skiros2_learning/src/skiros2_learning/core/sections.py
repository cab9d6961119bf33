"""Reads nested data, such as a YAML file, and collects all mistakes in them instead of stopping at the first."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from typing import Any, TypeVar

from skiros2_common.core.names import nearest

T = TypeVar("T")
_NO_DEFAULT: Any = object()


class Section:
    """A mapping in the data. Each method takes one key; `end` reports the keys that nobody has taken.

    A method that finds a mistake adds it to `problems` and returns a usable value of its type.

    :param where: path of the section, for the texts; "" for the whole.
    :param problems: shared by all sections of the data.
    """

    def __init__(self, data: Any, where: str, problems: list[str]) -> None:
        self.where = where
        self.problems = problems
        self._taken: set[str] = set()
        if data is None:
            data = {}
        if not isinstance(data, Mapping):
            self.problem("", f"expected keys and values, got {data!r}")
            data = {}
        self._data: dict[str, Any] = {str(key): value for key, value in data.items()}

    def problem(self, key: str, text: str) -> None:
        """Adds a mistake at a key; "": of the section."""
        self.problems.append(f"{self._path(key) or 'scenario'}: {text}")

    def __contains__(self, key: str) -> bool:
        return key in self._data

    def keys(self) -> list[str]:
        """All keys, taken or not."""
        return list(self._data)

    def take(self, key: str, default: Any = _NO_DEFAULT) -> Any:
        """Returns the value of a key as it is."""
        self._taken.add(key)
        if self._data.get(key) is None:
            if default is _NO_DEFAULT:
                self.problem(key, "missing")
                return None
            return default
        return self._data[key]

    def text(self, key: str, default: Any = _NO_DEFAULT) -> str:
        value = self.take(key, default)
        if value is None:
            return ""
        if not isinstance(value, str):
            self.problem(key, f"expected a text, got {value!r}")
            return ""
        return value

    def choice(self, key: str, known: Collection[str], default: Any = _NO_DEFAULT) -> str:
        """Returns one of the known words; the first one after a mistake."""
        value = self.take(key, default)
        if value in known:
            return str(value)
        if value is not None:
            self.problem(key, f"unknown: {value!r}; {near(str(value), known)}")
        return next(iter(known))

    def number(
        self,
        key: str,
        default: Any = _NO_DEFAULT,
        low: float = -math.inf,
        high: float = math.inf,
        above: float = -math.inf,
    ) -> float:
        """Returns a finite number from `low` to `high`, greater than `above`."""
        return self._number(key, self.take(key, default), low, high, above)

    def whole(self, key: str, default: Any = _NO_DEFAULT, low: int = 0, high: float = math.inf) -> int:
        """Returns an integer from `low` to `high`."""
        value = self.take(key, default)
        if isinstance(value, bool) or not isinstance(value, int):
            if value is not None:
                self.problem(key, f"expected an integer, got {value!r}")
            return low
        return int(self._number(key, value, low, high, -math.inf))

    def flag(self, key: str, default: bool) -> bool:
        value = self.take(key, default)
        if not isinstance(value, bool):
            self.problem(key, f"expected true or false, got {value!r}")
            return default
        return value

    def items(self, key: str, default: Any = _NO_DEFAULT) -> list[Any]:
        """Returns a list."""
        value = self.take(key, default)
        if value is None:
            return []
        if not isinstance(value, list | tuple):
            self.problem(key, f"expected a list, got {value!r}")
            return []
        return list(value)

    def numbers(self, key: str, count: int, default: Any = _NO_DEFAULT) -> list[float]:
        """Returns a list of `count` finite numbers."""
        values = self.items(key, default)
        if values and len(values) != count:
            self.problem(key, f"expected {count} numbers, got {len(values)}")
        found = [self._number(key, value, -math.inf, math.inf, -math.inf) for value in values]
        return found if len(found) == count else [0.0] * count

    def texts(self, key: str, default: Any = _NO_DEFAULT) -> list[str]:
        """Returns a list of texts."""
        values = self.items(key, default)
        wrong = [value for value in values if not isinstance(value, str)]
        if wrong:
            self.problem(key, f"expected texts, got {wrong!r}")
        return [value for value in values if isinstance(value, str)]

    def section(self, key: str) -> Section:
        """Returns the section at a key; an empty one without it."""
        return Section(self.take(key, {}), self._path(key), self.problems)

    def take_all(self) -> dict[str, Any]:
        """Returns all keys with their values."""
        self._taken |= set(self._data)
        return dict(self._data)

    def sections(self) -> Iterator[tuple[str, Section]]:
        """Yields all keys with their sections."""
        for key in self._data:
            yield key, self.section(key)

    def listed(self, key: str, default: Any = _NO_DEFAULT) -> Iterator[Section]:
        """Yields the sections of the list at a key."""
        for index, data in enumerate(self.items(key, default)):
            yield Section(data, f"{self._path(key)}[{index}]", self.problems)

    def end(self) -> None:
        """Reports the keys that were not taken."""
        for key in self._data:
            if key not in self._taken:
                self.problem(key, f"unknown key; {near(key, self._taken)}")

    def _path(self, key: str) -> str:
        return ".".join(part for part in (self.where, key) if part)

    def _number(self, key: str, value: Any, low: float, high: float, above: float) -> float:
        usable = low if math.isfinite(low) else above + 1.0 if math.isfinite(above) else 0.0
        if value is None:
            return usable
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            self.problem(key, f"expected a finite number, got {value!r}")
            return usable
        if not low <= value <= high or value <= above:
            wanted = [f"at least {low:g}"] if math.isfinite(low) else []
            wanted += [f"more than {above:g}"] if math.isfinite(above) else []
            wanted += [f"at most {high:g}"] if math.isfinite(high) else []
            self.problem(key, f"expected {' and '.join(wanted)}, got {value:g}")
            return usable
        return float(value)


def near(name: str, known: Collection[str]) -> str:
    """Returns a hint: the known names nearest to an unknown one, or all."""
    close = nearest(name, known)
    return f"near: {', '.join(close)}" if close else f"there are: {', '.join(sorted(known)) or 'none'}"
