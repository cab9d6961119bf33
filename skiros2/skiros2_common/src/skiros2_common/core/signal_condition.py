"""The condition on a signal: a live value of a topic is within limits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

from skiros2_common.core.condition import ConditionBase
from skiros2_common.core.condition_record import Cost
from skiros2_common.core.errors import Refused, SkirosError, WrongValue
from skiros2_common.core.failure_kind import FailureKind
from skiros2_common.core.params import ParamHandler
from skiros2_common.core.signals import (
    LimitMonitor,
    Signal,
    SignalBounds,
    SignalLimits,
    SignalSource,
    Violation,
    find_signal,
)
from skiros2_common.core.world_element import Element

if TYPE_CHECKING:
    from skiros2_common.core.world_model_port import WorldModelPort

#: A number, the key of a parameter with one, or None.
Bound = float | str | None


@dataclass(eq=False)
class _Watch:
    """A signal that is being monitored for a running node.

    :param subject: the id of the element in the parameter.
    :param stop: ends the subscription.
    """

    source: SignalSource
    wake: Callable[[], None]
    subject: str = ""
    signal: Signal | None = None
    monitor: LimitMonitor | None = None
    stop: Callable[[], None] = lambda: None


class ConditionSignal(ConditionBase):
    """True while a signal of an element is within limits. Only as a hold-condition.

    Each value is compared as it arrives, in the thread of the source; a violation wakes the task. A signal that is not
    published, has no number, or does not exist violates the condition too.

    :param signal: the class of the signal, or its label. It belongs to the element, or to one of its parts
        (`skiros:hasA`).
    :param subj: key of the parameter with the element.
    :param minimum, maximum: see `SignalLimits`; or the key of a parameter.
    :param duration, hysteresis, timeout: see `SignalLimits`.
    :param kind: whether the skill may be tried again when the signal was not within limits.
    :raises WrongValue: the limits are unusable; names all problems.
    """

    volatile = True
    cost = Cost.CODE
    planned_as = "ignored"
    element_ids = ConditionBase.ids_in_parameters

    def __init__(
        self,
        clabel: str,
        signal: str,
        subj: str,
        minimum: Bound = None,
        maximum: Bound = None,
        duration: float = 0.0,
        hysteresis: float = 0.0,
        timeout: float = 0.5,
        kind: FailureKind = FailureKind.RETRYABLE,
    ) -> None:
        super().__init__(clabel, subj, True)
        self.failure_kind = kind
        self._signal_name = signal
        self._bounds: dict[str, Bound] = {"minimum": minimum, "maximum": maximum}
        self._keys = {name: bound for name, bound in self._bounds.items() if isinstance(bound, str)}
        low, high = (None if isinstance(bound, str) else bound for bound in (minimum, maximum))
        self._limits = SignalLimits(low, high, duration, hysteresis, timeout)
        problems = [p for p in self._limits.problems() if not (self._keys and p.startswith("it has neither"))]
        if problems:
            raise WrongValue(f"condition {clabel!r}: {'; '.join(problems)}")
        self._watch: _Watch | None = None
        self._violation: Violation | None = None
        self._signal_bounds: SignalBounds | None = None
        self._problem = ""

    # -- the running node --------------------------------------------------------------------------------------

    def watch(
        self, ph: ParamHandler, wmi: WorldModelPort, signals: SignalSource, wake: Callable[[], None]
    ) -> Callable[[], None]:
        watch = self._watch = _Watch(signals, wake)
        self._violation, self._signal_bounds, self._problem = None, None, ""

        def stop() -> None:
            watch.stop()
            watch.stop = lambda: None
            if self._watch is watch:
                self._watch = None

        self._subscribe(watch, ph, wmi)
        return stop

    def _subscribe(self, watch: _Watch, ph: ParamHandler, wmi: WorldModelPort) -> None:
        """Subscribes to the signal of the element that is in the parameter now, with the present limits."""
        watch.stop()
        watch.stop, watch.signal, watch.monitor = lambda: None, None, None
        self._problem = ""
        try:
            element = self._raw_element(self._subject_key, ph)
            watch.subject = element.id if element is not None else ""
            if element is None or not element.id:
                raise WrongValue(f"parameter {self._subject_key!r} is {self._name(self._subject_key)}")
            found = find_signal(self._signal_name, wmi.get_branch(element.id, "skiros:hasA"), wmi)
            signal = watch.signal = Signal.of(found)
            monitor = watch.monitor = LimitMonitor(self._present_limits(ph), watch.source.now())
            self._signal_bounds = SignalBounds(found.id, monitor.limits)
        except SkirosError as error:
            self._problem = str(error)
            return

        def receive(value: float, arrival: float, problem: str) -> None:
            if monitor.update(value, arrival, problem):
                watch.wake()

        watch.stop = watch.source.subscribe(signal, receive)

    def _present_limits(self, ph: ParamHandler) -> SignalLimits:
        """The limits with the values of their parameters.

        :raises WrongValue: these are unusable.
        """
        if not self._keys:
            return self._limits
        bounds: dict[str, Any] = dict(self._bounds)
        for name, key in self._keys.items():
            bounds[name] = self._param_value(key, ph)
            if bounds[name] is None:
                raise WrongValue(f"the {name} is parameter {key!r}, which is unset")
        fixed = self._limits
        limits = SignalLimits(**bounds, duration=fixed.duration, hysteresis=fixed.hysteresis, timeout=fixed.timeout)
        problems = limits.problems()
        if problems:
            raise WrongValue("; ".join(problems))
        return limits

    def holds(self, ph: ParamHandler, wmi: WorldModelPort) -> bool:
        """Whether the signal has not violated its limits since the last call.

        :raises Refused: the condition is not a hold-condition of a running node.
        """
        watch = self._watch
        if watch is None:
            raise Refused(f"condition {self._label!r} is on a signal, which is only checked while the skill runs")
        element = self._raw_element(self._subject_key, ph)
        if self._problem or (element.id if element is not None else "") != watch.subject:
            self._subscribe(watch, ph, wmi)
        if watch.monitor is None:
            return False
        if self._keys:
            try:
                watch.monitor.limits = self._present_limits(ph)
            except WrongValue as error:
                self._problem = str(error)
                return False
        violation = self._violation = watch.monitor.violation(watch.source.now())
        if self._signal_bounds is not None:
            violated = violation.stamp if violation is not None else 0.0
            self._signal_bounds = SignalBounds(self._signal_bounds.signal, watch.monitor.limits, violated)
        return violation is None

    def signal_bounds(self) -> list[SignalBounds]:
        bounds = self._signal_bounds
        return [bounds] if bounds is not None else []

    # -- descriptions ------------------------------------------------------------------------------------------

    def fact(self) -> str:
        unit = self._watch.signal.unit if self._watch is not None and self._watch.signal is not None else ""
        return f"{self._signal_name} of {self._name(self._subject_key)} is {self._limits_text(unit)}"

    def _limits_text(self, unit: str = "") -> str:
        """The limits, with the parameters' values at the last evaluation, before it with their keys."""
        bounds = [
            f"{word} {self._bound_text(bound)} {unit}".rstrip()
            for word, bound in (("at least", self._bounds["minimum"]), ("at most", self._bounds["maximum"]))
            if bound is not None
        ]
        lasting = f", except for less than {self._limits.duration:g} s" if self._limits.duration else ""
        return " and ".join(bounds) + lasting

    def _bound_text(self, bound: float | str) -> str:
        value = self._checked.get(bound, bound) if isinstance(bound, str) else bound
        return f"{value:g}" if isinstance(value, (int, float)) else str(value)

    def found(self, ph: ParamHandler, wmi: WorldModelPort) -> str:
        watch = self._watch
        if watch is not None and self._violation is not None and watch.signal is not None:
            return self._violation.text(watch.signal)
        return self._problem

    def ontology_names(self) -> list[tuple[str, str]]:
        return [("class", self._signal_name)] if ":" in self._signal_name else []

    @property
    def element_keys(self) -> list[str]:
        return [self._subject_key]

    def faults(self, stage: str) -> list[str]:
        return [] if stage == "hold" else ["is on a signal, which is only checked while the skill runs"]

    # -- other forms -------------------------------------------------------------------------------------------

    def _signature(self) -> tuple[Any, ...]:
        return (self._subject_key, self._signal_name, *self._bounds.values(), self._limits)

    def getKeys(self) -> list[str]:
        return [self._subject_key, *self._keys.values()]

    def remap(self, initial_key: str, target_key: str) -> None:
        super().remap(initial_key, target_key)
        self._keys = {name: target_key if key == initial_key else key for name, key in self._keys.items()}
        self._bounds = {**self._bounds, **self._keys}

    def toElement(self) -> Element:
        element = super().toElement()
        element.setProperty("skiros:appliedOnType", self._signal_name)
        element.setProperty("skiros:desiredValue", self._limits_text())
        return element

    def copy(self) -> Self:
        copy = super().copy()
        copy._watch, copy._violation, copy._signal_bounds, copy._problem = None, None, None, ""
        return copy
