"""The presenter of the live plots: signals of the shown task's robot, with the limits of its hold-conditions."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

from skiros2_common.core.errors import SkirosError
from skiros2_common.core.forward_clock import now
from skiros2_common.core.manager_names import matching_name
from skiros2_common.core.names import id_order
from skiros2_common.core.operations import SCENE
from skiros2_common.core.signals import SIGNAL, Signal, SignalSource
from skiros2_common.core.world_element import Element
from skiros2_gui.app.problems import error_text
from skiros2_gui.app.window import Window
from skiros2_gui.run.presenter import RunPresenter
from skiros2_gui.run.signal_trace import GAP, LONGEST, Line, SignalTrace
from skiros2_live.core.signals import manager_above, owner, read_signal
from skiros2_runs.core.frame import Frame
from skiros2_runs.core.task_run import TaskRun
from skiros2_runs.core.values import SignalBound, TaskBounds

#: The time spans to choose from (s).
SPANS = (10.0, 20.0, LONGEST)

#: The most signals of a robot that are plotted without being chosen; those with limits come in addition.
_MAX_UNASKED = 6


@dataclass
class Limit:
    """A limit as it is drawn: a line from its begin to its end.

    :param bound: the limit as the manager reported it last.
    :param run: when the node that has the condition started (s since the epoch).
    :param begin, end: s since the epoch; `end` is inf while the node runs.
    """

    bound: SignalBound
    run: float
    begin: float
    end: float = math.inf

    def is_of(self, bound: SignalBound, run: float) -> bool:
        """Returns whether it is that limit of that run of a node, whatever its value."""
        own, other = self.bound, bound
        return self.run == run and all(getattr(own, name) == getattr(other, name) for name in _LIMIT_NAMES)


_LIMIT_NAMES = ("node", "condition", "signal", "side")


@dataclass
class PlottedSignal:
    """A signal of the scene.

    :param signal: None if the element cannot be used.
    :param problem: why it cannot; "" if it can.
    :param robot: the manager of the robot that has it; "" for none.
    """

    eid: str
    label: str
    signal: Signal | None
    problem: str
    robot: str
    trace: SignalTrace = field(default_factory=SignalTrace)
    stop: Callable[[], None] | None = None

    @property
    def unit(self) -> str:
        return self.signal.unit if self.signal is not None else ""


class SignalPlots:
    """Used in the window's thread. Subscribes to topics only between `show` and `hide`.

    :param clock: returns the time (s since the epoch).
    :ivar span: the time span of the plots (s).
    """

    def __init__(self, window: Window, run: RunPresenter, clock: Callable[[], float] = now) -> None:
        self._window = window
        self._run = run
        self._clock = clock
        self._signals: dict[str, PlottedSignal] = {}
        self._wishes: dict[str, bool] = {}
        self._limits: list[Limit] = []
        self._limits_of: TaskRun | None = None
        self._has_last_limits = False  # whether they were read after the task had ended
        self._is_asking = False
        self._is_shown = False
        self._paused_at: float | None = None
        self._paused_lines: dict[str, Line] = {}
        self.problem = ""
        self.span = SPANS[1]

    # -- what is drawn ---------------------------------------------------------------------------------------------

    @property
    def signals(self) -> list[PlottedSignal]:
        """The signals of the scene; those of the shown task's robot come first."""
        robot = self._run.robot
        return sorted(self._signals.values(), key=lambda s: (s.robot != robot, s.robot, id_order(s.eid)))

    @property
    def end(self) -> float:
        """The time of the right edge (s since the epoch)."""
        return self._clock() if self._paused_at is None else self._paused_at

    @property
    def is_paused(self) -> bool:
        return self._paused_at is not None

    def is_chosen(self, eid: str) -> bool:
        """Returns whether a signal is plotted: as the user has chosen, by default those of the shown task's robot."""
        return self._wishes[eid] if eid in self._wishes else eid in self._default()

    def panels(self) -> dict[str, list[PlottedSignal]]:
        """Returns the chosen signals by unit, one plot for each."""
        found: dict[str, list[PlottedSignal]] = {}
        for signal in self.signals:
            if signal.signal is not None and self.is_chosen(signal.eid):
                found.setdefault(signal.unit, []).append(signal)
        return found

    def limits(self, eid: str) -> list[Limit]:
        """Returns the limits of a signal in the shown time."""
        begin, end = self.end - self.span, self.end
        return [m for m in self._limits if m.bound.signal == eid and m.end >= begin and m.begin <= end]

    def line(self, signal: PlottedSignal) -> Line:
        """Returns times (s since the epoch) and values of a signal in the shown time, with NaN at gaps."""
        if signal.eid in self._paused_lines:
            return self._paused_lines[signal.eid]
        return signal.trace.line(self.end - self.span, self.end)

    def status(self, signal: PlottedSignal) -> str:
        """Describes the last value of a signal, or why there is none."""
        if signal.signal is None:
            return signal.problem
        value, stamp = signal.trace.last
        if signal.trace.problem:
            return signal.trace.problem
        age = self.end - stamp
        if age == math.inf:
            return f"no message on {signal.signal.topic} yet"
        if value != value:
            return "not a number (NaN)"
        text = signal.signal.text(value)
        return text if age < max(GAP, self.span / 10.0) else f"{text}, no message for {age:.1f} s"

    # -- what the user does ----------------------------------------------------------------------------------------

    def choose(self, eid: str, is_wanted: bool) -> None:
        """Adds a signal to the plots, or removes it."""
        self._wishes[eid] = is_wanted
        self._subscribe()

    def pause(self, is_paused: bool) -> None:
        """Stops the plots at the present time, or continues. Values are collected meanwhile."""
        now = self._clock()
        self._paused_at = now if is_paused else None
        traces = self._signals.values() if is_paused else ()
        self._paused_lines = {s.eid: s.trace.line(now - LONGEST, now) for s in traces}

    def show(self) -> None:
        """The plots are visible."""
        self._is_shown = True
        self.refresh()

    def hide(self) -> None:
        """The plots are hidden: unsubscribes."""
        self._is_shown = False
        self._subscribe()

    def refresh(self) -> None:
        """Reads signals and limits again. To be called periodically while the plots are visible."""
        if self._is_shown:
            self._read_signals()
            self._subscribe()
            self._ask_limits()

    # -- signals ---------------------------------------------------------------------------------------------------

    def _read_signals(self) -> None:
        scene = self._window.system.scene
        if scene is None:
            return
        try:
            found = {e.id: e for e in scene.matching(Element(SIGNAL), SCENE)}
            owner_of = partial(owner, scene)
            robots = {eid: manager_above(element, owner_of) for eid, element in found.items()}
            owners = {eid: owner_of(eid) for eid in found}
        except SkirosError as error:  # the world model is down and the ontologies are unknown
            self.problem = error_text(error)
            return
        self.problem = ""
        for eid in [eid for eid in self._signals if eid not in found]:
            _end(self._signals.pop(eid))
        managers = list(self._window.system.managers)
        times = Counter(element.label for element in found.values())
        for eid, element in found.items():
            read = read_signal(element, matching_name(robots[eid], managers), self._run.robot)
            new = PlottedSignal(eid, element.label or eid, read.signal, read.problem, read.robot)
            if times[element.label] > 1 and (above := owners[eid]) is not None:
                new.label = f"{new.label} of {above.label or above.id}"
            known = self._signals.get(eid)
            if known is None or (known.signal, known.problem, known.robot) != (new.signal, new.problem, new.robot):
                if known is not None:
                    _end(known)
                self._signals[eid] = new
            else:
                known.label = new.label

    def _default(self) -> set[str]:
        """The ids of the signals that are plotted unless the user decides otherwise."""
        robot, limited = self._run.robot, {limit.bound.signal for limit in self._limits}
        own = [s.eid for s in self.signals if s.robot == robot or not s.robot]
        return {*own[:_MAX_UNASKED], *limited}

    def _subscribe(self) -> None:
        """Subscribes to the chosen signals, and to no others."""
        source = self._window.system.signals
        for signal in self._signals.values():
            is_wanted = self._is_shown and signal.signal is not None and self.is_chosen(signal.eid)
            if not is_wanted or source is None:
                _end(signal)
            elif signal.stop is None and signal.signal is not None:
                signal.stop = source.subscribe(signal.signal, partial(_receive, source, signal.trace))

    # -- limits ----------------------------------------------------------------------------------------------------

    def _ask_limits(self) -> None:
        """Reads the limits of the shown task from its manager, once more after it has ended."""
        run = self._run.task
        if run is not self._limits_of:
            self._limits_of, self._limits, self._has_last_limits = run, [], False
        manager = self._window.system.managers.get(run.robot) if run is not None and self._run.bag is None else None
        if run is None or manager is None or self._is_asking or self._has_last_limits:
            return
        self._is_asking = True
        has_ended = run.is_finished
        self._window.jobs.run(
            lambda: manager.signal_bounds(run.task_id),
            lambda bounds: self._take(run, has_ended, bounds),
            self._fail,
            queue=run.robot,
        )

    def _take(self, run: TaskRun, has_ended: bool, found: TaskBounds) -> None:
        self._is_asking = False
        if run is not self._limits_of:
            return
        self._has_last_limits = has_ended
        self.problem = ""
        latest, now = run.latest, self._clock()
        for bound in found.bounds:
            began, ended = _times(latest, bound.node, has_ended)
            if began is not None and ended > now - LONGEST:
                self._add(bound, began, now)
        for limit in self._limits:
            began, ended = _times(latest, limit.bound.node, has_ended)
            if limit.end == math.inf:
                limit.end = ended if began == limit.run else now
        self._limits = [limit for limit in self._limits if limit.end > now - LONGEST]

    def _add(self, bound: SignalBound, run: float, now: float) -> None:
        """Adds or updates the line of a limit; a changed value begins a new line."""
        same = [limit for limit in self._limits if limit.is_of(bound, run)]
        if same and same[-1].bound.value == bound.value:
            same[-1].bound = bound
            return
        if same:
            same[-1].end = now
        self._limits.append(Limit(bound, run, now if same else run))

    def _fail(self, error: Exception) -> None:
        self._is_asking = False
        self.problem = f"The limits are not known: {error_text(error)}"


def _times(frame: Frame, node: int, is_finished: bool) -> tuple[float | None, float]:
    """Returns when a node started and ended (s since the epoch); None if it has not started, inf while it runs."""
    index = frame.shape.index_by_id.get(node)
    began = frame.began(index) if index is not None else None
    if index is None or began is None:
        return None, frame.time
    ended = float(frame.rows["ended"][index])
    if not math.isnan(ended):
        return began, frame.start + ended
    return began, frame.time if is_finished else math.inf


def _receive(source: SignalSource, trace: SignalTrace, value: float, arrival: float, problem: str) -> None:
    """Called in threads of the source."""
    trace.add(value, now() - max(0.0, source.now() - arrival), problem)


def _end(signal: PlottedSignal) -> None:
    if signal.stop is not None:
        signal.stop()
        signal.stop = None
