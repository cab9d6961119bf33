"""The sources of stops: their configuration, and how they read messages. A message is any object with its fields."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from typing import Any

from skiros2_common.core.errors import FOREIGN_ERRORS, ConfigurationError
from skiros2_common.core.property import format_value
from skiros2_skill.core.runtime.history import one_line
from skiros2_skill.core.runtime.safety import Safety, SourceRules
from skiros2_skill.core.runtime.safety_guard import DEFAULT_POLICIES, Policy

BOOL, DIAGNOSTICS = "std_msgs/Bool", "diagnostic_msgs/DiagnosticArray"

#: The levels of `diagnostic_msgs/DiagnosticStatus`, from 0.
LEVELS = ("ok", "warn", "error", "stale")

#: The seconds of silence after which a required source counts as stopped, and of quiet after which a stop ends.
TIMEOUT, CLEAR_DELAY = 1.0, 0.5

#: How many failing parts a reason names.
_MAX_PARTS = 3

_KEYS = {"name", "topic", "type", "field", "kind", "stop_values", "ok_values", "names", "level", "required", "timeout"}
_KEYS |= {"clear_delay"}


@dataclass
class Source:
    """A topic that reports stops.

    :param type: of the messages, as `package/Type`.
    :param path: of the value in a message, such as `status.mode`; of a part with fields, all are read.
    :param stop_values: values that mean a stop; None: all but `ok_values` do.
    :param names: patterns of the names of diagnostics.
    :param level: the lowest level of diagnostics that is a stop.
    """

    rules: SourceRules
    topic: str
    type: str
    path: str = ""
    stop_values: Sequence[Any] | None = None
    ok_values: Sequence[Any] = ()
    names: Sequence[str] = ("*",)
    level: int = 2
    _failing: dict[str, str] = field(default_factory=dict)  # diagnostics, by name

    def read(self, message: Any) -> str:
        """Returns why the robot is stopped; "" if it is not. A message that cannot be read is a stop. One thread."""
        try:
            return self._read_diagnostics(message) if self.type == DIAGNOSTICS else self._read_field(message)
        except FOREIGN_ERRORS as error:  # any: a stop that is not understood is a stop
            return one_line(f"unreadable message: {type(error).__name__}: {error}")

    def _read_field(self, message: Any) -> str:
        leaves = _leaves(self.path, value_at(message, self.path))
        return _joined([one_line(f"{name} is {value}") for name, value in leaves if self._is_stop(value)])

    def _is_stop(self, value: Any) -> bool:
        if isinstance(value, float) and not math.isfinite(value):
            return True
        return value in self.stop_values if self.stop_values is not None else value not in self.ok_values

    def _read_diagnostics(self, message: Any) -> str:
        for status in message.status:
            if not any(fnmatchcase(status.name, pattern) for pattern in self.names):
                continue
            if status.level in range(self.level):
                self._failing.pop(status.name, None)
            else:
                known = status.level in range(len(LEVELS))
                level = LEVELS[status.level] if known else f"unknown level {status.level}"
                text = one_line(f"{status.name}: {status.message}")
                self._failing[status.name] = f"{text} ({level})"
        return _joined(list(self._failing.values()))


@dataclass(frozen=True)
class Recovery:
    """The call that clears a stop.

    :param call: the name of the service or action; "": nothing.
    :param type: `package/Type` of the service, or `package/TypeAction`.
    """

    call: str = ""
    type: str = "std_srvs/Trigger"

    @property
    def is_action(self) -> bool:
        return self.type.endswith("Action")


@dataclass(frozen=True)
class SafetySettings:
    """The safety behaviour of a skill manager; without sources, nothing stops its robot."""

    sources: Sequence[Source] = ()
    policies: Mapping[Safety, Policy] = field(default_factory=lambda: dict(DEFAULT_POLICIES))
    recovery: Recovery = Recovery()


#: Finds the class of a message ("msg") or a service ("srv") by `package/Type`; None if there is none.
FindType = Callable[[str, str], "type | None"]


def read_settings(
    sources: Any, policies: Mapping[str, Any], recovery: Any, find_type: FindType, resolve: Callable[[str], str]
) -> SafetySettings:
    """Reads the configuration of a manager.

    :param sources: a list of dictionaries; see docs/safety.md.
    :param policies: by kind of stop; missing ones are the defaults.
    :param recovery: a dictionary with `call` and `type`, both optional.
    :param resolve: returns the full name of a topic.
    :raises ConfigurationError: the text names all problems.
    """
    problems: list[str] = []
    read: list[Source] = []
    if not isinstance(sources, list):
        problems.append(f"safety_sources is {format_value(sources)}, expected a list of dictionaries")
        sources = []
    for index, entry in enumerate(sources):
        place = f"safety_sources[{index}]"
        own: list[str] = []
        source = _source(entry, own, find_type, resolve)
        problems += [f"{place}: {problem}" for problem in own]
        if source is not None:
            if source.rules.name in {one.rules.name for one in read}:
                problems.append(f"{place}: the name {source.rules.name!r} is used twice; set another 'name'")
            other = next((s.type for s in read if s.topic == source.topic and s.type != source.type), "")
            if other:
                problems.append(f"{place}: topic {source.topic} has type {other} in another source")
            read.append(source)
    chosen = dict(DEFAULT_POLICIES)
    for kind, value in policies.items():
        if value in [*Policy]:
            chosen[Safety(kind)] = Policy(value)
        else:
            problems.append(f"on_{kind} is {format_value(value)}, expected {' or '.join(Policy)}")
    own = []
    found = _recovery(recovery, own, find_type)
    problems += [f"recovery: {problem}" for problem in own]
    if problems:
        raise ConfigurationError("; ".join(problems))
    return SafetySettings(read, chosen, found)


def _source(entry: Any, problems: list[str], find_type: FindType, resolve: Callable[[str], str]) -> Source | None:
    """Reads one source; None if it has problems, which are added to the list."""
    if not isinstance(entry, dict):
        problems.append(f"expected a dictionary with the key 'topic', got {format_value(entry)}")
        return None
    unknown = sorted(set(map(str, entry)) - _KEYS)
    if unknown:
        problems.append(f"unknown keys {', '.join(unknown)}; there are: {', '.join(sorted(_KEYS))}")
    topic = _text(entry, "topic", "", problems)
    if not topic and not problems:
        problems.append("'topic' is missing")
    type_ = _text(entry, "type", BOOL, problems)
    is_bool, is_diagnostics = type_ == BOOL, type_ == DIAGNOSTICS
    kind = _one_of(entry, "kind", [s.value for s in Safety if s is not Safety.RUNNING], _default_kind(type_), problems)
    required = entry.get("required", False)
    if not isinstance(required, bool):
        problems.append(f"'required' is {format_value(required)}, expected true or false")
    timeout = _seconds(entry, "timeout", TIMEOUT, problems)
    if "timeout" in entry and required is not True:
        problems.append("'timeout' has an effect only with 'required: true'")
    elif timeout == 0.0:
        problems.append("'timeout' is 0, expected a number of seconds above 0")
    clear_delay = _seconds(entry, "clear_delay", CLEAR_DELAY, problems)
    path = _text(entry, "field", "data" if is_bool else "", problems)
    stops = _list(entry, "stop_values", [True] if is_bool and "ok_values" not in entry else None, problems)
    oks = _list(entry, "ok_values", None, problems)
    names = _list(entry, "names", ["*"], problems) or []
    level = _one_of(entry, "level", ["warn", "error"], "error", problems)
    cls = find_type(type_, "msg")
    if cls is None:
        problems.append(f"there is no message type {type_!r}; is its package installed?")
    if is_diagnostics:
        problems += [f"{key!r} is not for diagnostics" for key in ("field", "stop_values", "ok_values") if key in entry]
        if not names or not all(isinstance(name, str) for name in names):
            problems.append("'names' is to be a list of patterns of names")
    else:
        problems += [f"{key!r} is for {DIAGNOSTICS} only" for key in ("names", "level") if key in entry]
        if (stops is None) == (oks is None):
            problems.append("expected either 'stop_values' or 'ok_values'")
        if not path:
            problems.append("'field' is missing")
        elif cls is not None:
            problems += _field_problems(cls, path)
    if problems:
        return None
    name = _text(entry, "name", topic, problems)
    rules = SourceRules(name, Safety(kind), timeout if required else None, clear_delay)
    return Source(rules, resolve(topic), type_, path, stops, oks or (), [*names], LEVELS.index(level))


def _default_kind(type_: str) -> str:
    return {BOOL: Safety.EMERGENCY_STOP.value, DIAGNOSTICS: Safety.FAULT.value}.get(type_, "")


def _recovery(entry: Any, problems: list[str], find_type: FindType) -> Recovery:
    if not isinstance(entry, dict) or set(entry) - {"call", "type"}:
        problems.append(f"expected a dictionary with 'call' and 'type', got {format_value(entry)}")
        return Recovery()
    found = Recovery(_text(entry, "call", "", problems), _text(entry, "type", Recovery.type, problems))
    if not problems and find_type(found.type, "msg" if found.is_action else "srv") is None:
        problems.append(f"there is no service or action type {found.type!r}; is its package installed?")
    return found


def _text(entry: Mapping[str, Any], key: str, default: str, problems: list[str]) -> str:
    value = entry.get(key, default)
    if isinstance(value, str):
        return value
    problems.append(f"{key!r} is {format_value(value)}, expected a text")
    return default


def _one_of(entry: Mapping[str, Any], key: str, allowed: Sequence[str], default: str, problems: list[str]) -> str:
    value = entry.get(key, default)
    if value in allowed:
        return str(value)
    problems.append(f"{key!r} is {format_value(value)}, expected one of: {', '.join(allowed)}")
    return default


def _seconds(entry: Mapping[str, Any], key: str, default: float, problems: list[str]) -> float:
    value = entry.get(key, default)
    if isinstance(value, int | float) and not isinstance(value, bool) and 0.0 <= value < math.inf:
        return float(value)
    problems.append(f"{key!r} is {format_value(value)}, expected a number of seconds from 0")
    return default


def _list(entry: Mapping[str, Any], key: str, default: list[Any] | None, problems: list[str]) -> list[Any] | None:
    value = entry.get(key, default)
    if value is None or (isinstance(value, list) and value):
        return value
    problems.append(f"{key!r} is {format_value(value)}, expected a list of values")
    return default


def _field_problems(cls: type, path: str) -> Iterator[str]:
    try:
        value_at(cls(), path)
    except AttributeError as error:
        yield f"'field' is {path!r}: {error}"


def value_at(message: Any, path: str) -> Any:
    """Returns the value at a path of fields, separated by dots.

    :raises AttributeError: there is no such field.
    """
    for name in path.split("."):
        known = getattr(message, "__slots__", ())
        if name not in known:
            there = f"there are: {', '.join(known)}" if known else "it has no fields"
            raise AttributeError(f"{type(message).__name__} has no field {name!r}; {there}")
        message = getattr(message, name)
    return message


def _leaves(path: str, value: Any) -> Iterator[tuple[str, Any]]:
    """The plain values of a part of a message, with their paths."""
    slots = getattr(value, "__slots__", None)
    if slots is not None:
        for name in slots:
            yield from _leaves(f"{path}.{name}", getattr(value, name))
    elif isinstance(value, list | tuple):
        for index, one in enumerate(value):
            yield from _leaves(f"{path}[{index}]", one)
    else:
        yield path, value


def _joined(parts: Sequence[str]) -> str:
    more = [f"{len(parts) - _MAX_PARTS} more"] if len(parts) > _MAX_PARTS else []
    return "; ".join([*parts[:_MAX_PARTS], *more])
