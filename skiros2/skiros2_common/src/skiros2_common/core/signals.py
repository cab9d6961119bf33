"""Signals: live numbers of topics, such as the force at a wrist, and the limits that conditions set for them.

A signal is an element of the world model (`skiros:Signal`). A `SignalSource` delivers its values. A `LimitMonitor`
compares them with limits as they arrive, and keeps a violation until somebody has read it.
"""

from __future__ import annotations

import math
import re
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.names import is_of_class
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import OntologyPort

#: The class of the elements that describe signals, and their properties.
SIGNAL = "skiros:Signal"
TOPIC, FIELD, UNIT = "skiros:SignalTopic", "skiros:MessageField", "skiros:Unit"

#: Receives a value, its time of arrival (s, by the source's clock), and why there is no value ("": there is one).
#: Called by the source's thread.
Receive = Callable[[float, float, str], None]

_STEP = re.compile(r"(\w+)((?:\[\w+\])?)")


class FieldPath:
    """A number in a message: names of fields, with an optional index, such as `wrench.force.z` or `effort[joint_2]`.

    An index is a number, or a name in the list `name` of the same message, as in `sensor_msgs/JointState`. Of a vector
    (x, y, z), the number is the Euclidean norm; of a list, the value with the largest magnitude. "" is the message
    itself.

    :raises WrongValue: the text is no such path.
    """

    def __init__(self, text: str) -> None:
        self.text = text
        steps = [_STEP.fullmatch(step) for step in text.split(".")] if text else []
        if None in steps:
            raise WrongValue(f"{text!r} is not a path of fields, such as wrench.force.z or effort[2]")
        self._steps = [(step[1], step[2][1:-1]) for step in steps if step is not None]

    def read(self, message: Any) -> float:
        """Returns the number in a message; may be NaN.

        :raises WrongValue: the message has no such field, or no number there.
        """
        value = message
        try:
            for name, index in self._steps:
                owner, value = value, getattr(value, name)
                if index:
                    value = value[int(index) if index.isdigit() else list(owner.name).index(index)]
            return _number(value)
        except (AttributeError, LookupError, TypeError, ValueError):
            kind = getattr(type(message), "_type", type(message).__name__)
            raise WrongValue(f"a message of type {kind} has no number at {self.text!r}") from None


def _number(value: Any) -> float:
    if all(hasattr(value, axis) for axis in "xyz"):
        return math.hypot(value.x, value.y, value.z)
    if isinstance(value, (Sequence, memoryview)) or hasattr(value, "tolist"):
        return float(max(value, key=lambda item: math.inf if math.isnan(item) else abs(item)))
    return float(value)


@dataclass(frozen=True)
class Signal:
    """A signal as its element describes it.

    :param name: of the element, for people.
    :param topic: relative to the namespace of the node that reads it.
    :param path: of the number in a message.
    :param unit: of the values; may be "".
    """

    name: str
    topic: str
    path: str
    unit: str = ""

    @classmethod
    def of(cls, element: Element) -> Signal:
        """Reads an element.

        :raises WrongValue: it lacks a topic, or a value is unusable; names all problems.
        """
        topic, path, unit = (element.value_of(key) for key in (TOPIC, FIELD, UNIT))
        problems = [] if isinstance(topic, str) and topic.strip() else [f"{TOPIC} is {topic!r}, expected a topic"]
        try:
            FieldPath(str(path or ""))
        except WrongValue as error:
            problems.append(f"{FIELD}: {error}")
        if problems:
            raise WrongValue(f"signal {element!r}: {'; '.join(problems)}")
        return cls(repr(element), str(topic).strip(), str(path or ""), str(unit or ""))

    def text(self, value: float) -> str:
        """A value with the unit."""
        return f"{value:.4g} {self.unit}".rstrip()


def find_signal(name: str, branch: Sequence[Element], wmi: OntologyPort) -> Element:
    """Finds the signal of an element.

    :param name: its class, such as `skiros:WristForce`, or its label.
    :param branch: the element with its parts, the element first.
    :raises WrongValue: there is none, or there are several.
    """
    signals = [e for e in branch if is_of_class(e.type, SIGNAL, wmi)]
    found = [e for e in signals if e.label == name or (":" in name and is_of_class(e.type, name, wmi))]
    if len(found) == 1:
        return found[0]
    if found:
        raise WrongValue(f"{branch[0]!r} has several signals {name}: {', '.join(map(repr, found))}")
    raise WrongValue(f"{branch[0]!r} has no signal {name}; it has: {', '.join(map(repr, signals)) or 'none'}")


class SignalSource(Protocol):
    """Delivers the values of signals."""

    def now(self) -> float:
        """The time (s) of the clock by which values arrive."""

    def subscribe(self, signal: Signal, receive: Receive) -> Callable[[], None]:
        """Delivers the values of a signal, the last known one at once, until the returned function is called.

        Does not block. `receive` must return quickly.
        """


class LocalSignals:
    """A `SignalSource` in this process, for tests and simulations: `publish` delivers a message in the calling thread.

    Also the base of the source over ROS. A topic is of interest while somebody subscribes to it.
    """

    def __init__(self) -> None:
        self._lock = threading.Condition()
        self._topics: dict[str, SignalTopic] = {}

    def now(self) -> float:
        return time.monotonic()

    def subscribe(self, signal: Signal, receive: Receive) -> Callable[[], None]:
        name, reader = self.full_name(signal.topic), _Reader(FieldPath(signal.path), receive)
        with self._lock:
            topic = self._topics.setdefault(name, SignalTopic())
            topic.readers.append(reader)
            last = topic.last
            self._lock.notify_all()
        if last is not None:
            reader.deliver(*last)

        def release() -> None:
            with self._lock:
                if reader in topic.readers:
                    topic.readers.remove(reader)
                    topic.released_at = time.monotonic()
                    self._lock.notify_all()

        return release

    def full_name(self, topic: str) -> str:
        """The name by which a topic is known."""
        return "/" + topic.lstrip("/")

    def publish(self, topic: str, message: Any) -> None:
        """Delivers a message, or a number to signals without a path."""
        self.deliver(self._topics.setdefault(self.full_name(topic), SignalTopic()), message)

    def deliver(self, topic: SignalTopic, message: Any) -> None:
        """Delivers a message to the readers of a topic."""
        last = (message, self.now())
        with self._lock:
            topic.last = last
            readers = list(topic.readers)
        for reader in readers:
            reader.deliver(*last)

    def topics(self) -> list[str]:
        """The sorted names of the topics that somebody subscribes to."""
        with self._lock:
            return sorted(name for name, topic in self._topics.items() if topic.readers)


@dataclass(frozen=True, eq=False)
class _Reader:
    path: FieldPath
    receive: Receive

    def deliver(self, message: Any, arrival: float) -> None:
        try:
            value, problem = self.path.read(message), ""
        except WrongValue as error:
            value, problem = math.nan, str(error)
        self.receive(value, arrival, problem)


@dataclass(eq=False)
class SignalTopic:
    """A topic with its readers.

    :param last: the last message and its time of arrival.
    :param released_at: when its last reader was removed (s, monotonic).
    """

    readers: list[_Reader] = field(default_factory=list)
    last: tuple[Any, float] | None = None
    released_at: float = 0.0


# -- limits ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class SignalLimits:
    """When a signal violates a condition.

    :param minimum, maximum: the allowed range; None: no limit.
    :param duration: how long (s) the value must be outside the limits.
    :param hysteresis: how far inside the limits a value must be to end that time, in the signal's unit.
    :param timeout: the longest time (s) without a message; inf: any.
    """

    minimum: float | None = None
    maximum: float | None = None
    duration: float = 0.0
    hysteresis: float = 0.0
    timeout: float = 0.5

    def problems(self) -> list[str]:
        """Describes the mistakes in the limits."""
        found = []
        low, high = self.minimum, self.maximum
        if low is None and high is None:
            found.append("it has neither a minimum nor a maximum")
        for name, bound in (("minimum", low), ("maximum", high)):
            if bound is not None and not (_is_number(bound) and math.isfinite(bound)):
                found.append(f"the {name} is {bound!r}, expected a number")
        for name, number in (("duration", self.duration), ("hysteresis", self.hysteresis)):
            if not (_is_number(number) and 0.0 <= number < math.inf):
                found.append(f"the {name} is {number!r}, expected a number from 0")
        if not (_is_number(self.timeout) and self.timeout > 0.0):
            found.append(f"the timeout is {self.timeout!r}, expected seconds")
        if not found and low is not None and high is not None and low + 2.0 * self.hysteresis >= high:
            found.append(f"no value is between {low:g} and {high:g}, by a hysteresis of {self.hysteresis:g}")
        return found

    def excess(self, value: float, margin: float = 0.0) -> str:
        """The limit that a value exceeds, as "above 30"; "" if it is inside all of them by a margin."""
        if self.maximum is not None and value > self.maximum - margin:
            return f"above {self.maximum:g}"
        if self.minimum is not None and value < self.minimum + margin:
            return f"below {self.minimum:g}"
        return ""


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


@dataclass(frozen=True)
class SignalBounds:
    """The limits that a condition sets for a signal while it is watched.

    :param signal: the id of the signal's element.
    :param violated: when the signal left the limits (s since the epoch); 0.0: it has not.
    """

    signal: str
    limits: SignalLimits
    violated: float = 0.0


#: The kinds of a violation.
LIMIT, STALE, NOT_A_NUMBER, UNREADABLE = "limit", "stale", "not a number", "unreadable"


@dataclass(frozen=True)
class Violation:
    """Why a signal violates its limits.

    :param kind: `LIMIT`, `STALE`, `NOT_A_NUMBER` or `UNREADABLE`.
    :param value: the last value; None if none has arrived.
    :param detail: the exceeded limit, such as `above 30`, or why a message cannot be read.
    :param seconds: how long the value has been outside the limits, or the signal silent.
    :param stamp: when it was found (s since the epoch).
    """

    kind: str
    value: float | None
    detail: str
    seconds: float
    stamp: float

    def text(self, signal: Signal) -> str:
        """The violation for people, with the signal, the value and its unit, the limit and the time."""
        clock = f"{time.strftime('%H:%M:%S', time.localtime(self.stamp))}.{int(self.stamp % 1.0 * 1000):03d}"
        if self.kind == STALE:
            last = f"last value {signal.text(self.value)}" if self.value is not None else "none since the start"
            return f"{signal.name} has sent no message on {signal.topic} for {self.seconds:.3g} s at {clock} ({last})"
        if self.kind == NOT_A_NUMBER:
            return f"{signal.name} was not a number (NaN) at {clock}"
        if self.kind == UNREADABLE:
            return f"{signal.name} on {signal.topic}: {self.detail}, at {clock}"
        lasting = f" for {self.seconds:.3g} s" if self.seconds else ""
        limit = f"{self.detail} {signal.unit}".rstrip()
        return f"{signal.name} was {signal.text(self.value or 0.0)} at {clock}, {limit}{lasting}"


#: Tolerance of durations (s), for differences of times.
_ROUNDING = 1e-9


class LimitMonitor:
    """Compares the values of a signal with limits. Thread-safe.

    A violation stays until it was returned by `violation`, and ends then with the first value that is inside the limits
    by the hysteresis.

    :param start: when the first message is expected (s, by the clock of the values), less the timeout.
    """

    def __init__(self, limits: SignalLimits, start: float) -> None:
        self._lock = threading.Lock()
        self._limits = limits
        self._last = start
        self._value: float | None = None
        self._out_since: float | None = None
        self._violation: Violation | None = None
        self._is_reported = False

    @property
    def value(self) -> float | None:
        """The last value; None before the first message."""
        return self._value

    @property
    def limits(self) -> SignalLimits:
        return self._limits

    @limits.setter
    def limits(self, limits: SignalLimits) -> None:
        with self._lock:
            self._limits = limits

    def update(self, value: float, arrival: float, problem: str = "") -> bool:
        """Handles a value. Returns whether a violation begins with it.

        :param arrival: when the message arrived (s).
        :param problem: why the message has no value; "" if it has one.
        """
        with self._lock:
            known = self._violation
            if known is not None and self._is_reported:
                known = None if self._may_end(known, value, problem) else known
            self._violation = known
            self._last, self._value = arrival, value
            if problem:
                return self._begin(UNREADABLE, problem)
            if math.isnan(value):
                return self._begin(NOT_A_NUMBER)
            margin = self._limits.hysteresis if self._out_since is not None else 0.0
            if not self._limits.excess(value, margin):
                self._out_since = None
                return False
            if self._out_since is None or self._out_since > arrival:
                self._out_since = arrival
            return self._check_duration(arrival)

    def violation(self, now: float) -> Violation | None:
        """Returns the violation at a time (s), None if there is none. Also finds that messages are missing."""
        with self._lock:
            if self._violation is None:
                if now - self._last > self._limits.timeout:
                    self._begin(STALE, seconds=now - self._last)
                elif self._out_since is not None:
                    self._check_duration(now)
            self._is_reported = self._violation is not None
            return self._violation

    # -- while the lock is held ----------------------------------------------------------------------------------

    def _may_end(self, known: Violation, value: float, problem: str) -> bool:
        if problem or math.isnan(value):
            return False
        return known.kind != LIMIT or not self._limits.excess(value, self._limits.hysteresis)

    def _check_duration(self, now: float) -> bool:
        assert self._out_since is not None and self._value is not None
        excess = self._limits.excess(self._value)
        seconds = now - self._out_since
        return bool(excess) and seconds >= self._limits.duration - _ROUNDING and self._begin(LIMIT, excess, seconds)

    def _begin(self, kind: str, detail: str = "", seconds: float = 0.0) -> bool:
        if self._violation is not None:
            return False
        self._violation = Violation(kind, self._value, detail, seconds, time.time())
        self._is_reported = False
        return True
