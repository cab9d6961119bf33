"""Deterministic re-run: ticks the trees of a recording in this process, without ROS nodes.

Each progress message stands for one tick. All recorded inputs before it are applied first: changes of the world model
by others, answers of action servers, signals, cancel requests, the clock. After the tick, the tree must match the
progress message; at the end, the tasks must have made the recorded changes of the world model.

Message times do not determine the exact order and times of events. After a divergence, alternatives are tried; see
`skiros2_bags.testing.orders`.
"""

from __future__ import annotations

import bisect
import contextlib
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import TracebackType

import actionlib
import rospy

from skiros2_bags.core.bag_file import BagError
from skiros2_bags.core.diff import summary
from skiros2_bags.core.run import check
from skiros2_bags.testing.declared import Declared
from skiros2_bags.testing.fake_action_clients import LAG, RECORDER_LAG, RecordedActions
from skiros2_bags.testing.field_tolerances import FieldTolerances
from skiros2_bags.testing.orders import WINDOW, Ordering, alternatives
from skiros2_bags.testing.plans import PlanComparison, compare_plans, recorded_plans
from skiros2_bags.testing.recorded_world import (
    add_reasoners,
    change_operations,
    input_operations,
    scene_before,
    world_model_with,
)
from skiros2_bags.testing.recording import (
    ActionMessage,
    ClockTick,
    Event,
    RecordedTask,
    Recording,
    SignalMessage,
    TaskProgress,
    WorldChange,
    recorded_tasks,
    tick_times,
)
from skiros2_bags.testing.rerun_task import RerunManager, RerunTask, pushed_by, written_by
from skiros2_bags.testing.stored import read_stored
from skiros2_bags.testing.writes import WriteDifference, Writes
from skiros2_common.core.operations import Change
from skiros2_common.ros.connections import ServerWatch
from skiros2_runs.core.compare import Divergence
from skiros2_skill.testing.fake_clock import FakeClock
from skiros2_skill.testing.faults import replaced

#: The most event orders tried by default. Each takes at most as long as the first pass. The recorded runs in
#: tests/bags need 1 each, those of the simulated demo on a busy machine up to 15.
MAX_ORDERS = 40


@dataclass(frozen=True)
class Settings:
    """Settings of a re-run.

    :param workspace: folder of additional ontologies for the scene; None for the recorded parameter `workspace_dir` of
        the world model.
    :param played: labels of primitives that are replaced by their recorded progress, besides those whose class says so
        (`PrimitiveBase.replays_progress`).
    :param tolerances: see `FieldTolerances`.
    :param max_orders: the most orders of nearly simultaneous events to try.
    :param plans: whether the plans are made again and compared; takes seconds.
    """

    workspace: Path | None = None
    played: frozenset[str] = frozenset()
    tolerances: FieldTolerances = field(default_factory=FieldTolerances)
    max_orders: int = MAX_ORDERS
    plans: bool = False


@dataclass(frozen=True)
class ReplayResult:
    """The result of a re-run.

    :param divergence: the first one; None without one.
    :param orders: the number of event orders that were tried.
    :param declared: how the declarations of skills in use differ from the recorded ones, a line each.
    :param not_compared: what a re-run of this bag does not compare, a line each.
    :param plans: see `PlanComparison`.
    :param missing: with a divergence: which messages the bag lacks, a line each; they may be its cause.
    :param stored_orders: how many orders a re-run of this bag needed when that was stored; None: it was not.
    :param tolerances: of which fields, for people.
    """

    divergence: Divergence | None
    orders: int = 1
    declared: tuple[str, ...] = ()
    not_compared: tuple[str, ...] = ()
    plans: PlanComparison = field(default_factory=PlanComparison)
    missing: tuple[str, ...] = ()
    stored_orders: int | None = None
    tolerances: str = ""

    @property
    def is_as_recorded(self) -> bool:
        return self.divergence is None and not self.declared and not self.plans.worse

    def __str__(self) -> str:
        lines = [f"declared differently: {line}" for line in self.declared]
        lines += [f"planned worse: {line}" for line in self.plans.worse]
        lines += [str(self.divergence)] if self.divergence is not None else [] if lines else ["as recorded"]
        lines += [f"the bag is incomplete: {line}" for line in self.missing]
        lines += [f"planned differently, not worse: {line}" for line in self.plans.different]
        lines += [f"{self.orders} event orders were tried"] if self.orders > 1 else []
        if self.stored_orders is not None and self.orders > self.stored_orders:
            lines.append(f"warning: {self.stored_orders} were enough when that was stored")
        lines.append(f"tolerances: {self.tolerances}")
        return "\n".join([*lines, *(f"not compared: {line}" for line in self.not_compared)])


def replay(bag: Path, settings: Settings) -> ReplayResult:
    """Re-runs all tasks of a bag, with the tolerance that is stored with it unless another one is given.

    :raises BagError: the bag lacks required messages.
    :raises SkirosError: the re-run fails.
    """
    recording = Recording(bag)
    stored = read_stored(bag)
    if stored is not None and settings.tolerances == FieldTolerances():
        settings = replace(settings, tolerances=stored.tolerances)
    if settings.workspace is None:
        folder = str(recording.parameters.get("/wm/workspace_dir", ""))
        settings = replace(settings, workspace=Path(folder) if folder and Path(folder).is_dir() else None)
    return replace(rerun(recording, settings), stored_orders=stored.orders if stored is not None else None)


def rerun(recording: Recording, settings: Settings) -> ReplayResult:
    """Re-runs all tasks of a recording.

    After a divergence, orders that get further are kept and varied, until there is no divergence, no alternative, or
    `settings.max_orders` have been tried.

    :raises BagError: the bag lacks required messages.
    """
    runs = recorded_tasks(recording)
    if not runs:
        raise BagError(f"{recording.path}: no progress of tasks; expected a topic /MANAGER/monitor")
    ordering = Ordering()
    best = _attempt(recording, runs, settings, ordering)
    orders = 1
    others = alternatives(recording, ordering, best.event)
    while best.divergence is not None and orders < settings.max_orders:
        is_late = not best.late <= ordering.late
        other = replace(ordering, late=ordering.late | best.late) if is_late else next(others, None)
        if other is None:
            break
        orders += 1
        found = _attempt(recording, runs, settings, other)
        if found.divergence is None or found.event.order > best.event.order or is_late:
            best, ordering = found, other
            others = alternatives(recording, ordering, best.event)
    plans, not_planned = PlanComparison(), list[str]()
    if settings.plans:
        plans = compare_plans(recording, settings.workspace)
        not_planned += plans.not_compared
    elif number := len(recorded_plans(recording)):
        not_planned = [f"{number} plan{'s' * (number > 1)}: with --plans they are made again"]
    checked = check(recording.run) if best.divergence is not None else []
    missing = tuple(finding.text for finding in checked if not finding.holds)
    not_compared = (*best.not_compared, *not_planned)
    return ReplayResult(
        best.divergence, orders, best.declared, not_compared, plans, missing, tolerances=best.tolerances
    )


@dataclass(frozen=True)
class _Attempt:
    """A pass: the event at which it ended, and what it has found; see `ReplayResult`."""

    event: Event
    divergence: Divergence | None
    declared: tuple[str, ...]
    not_compared: tuple[str, ...]
    late: frozenset[int]
    tolerances: str


def _attempt(recording: Recording, runs: list[RecordedTask], settings: Settings, ordering: Ordering) -> _Attempt:
    orders = dict(ordering.orders)
    events = sorted(recording.events, key=lambda e: orders.get(e.order, e.order))
    with RerunPass(recording, runs, settings, ordering) as run:
        divergence = None
        for event in events:
            divergence = run.play(event)
            if divergence is not None:
                break
        else:
            event = replace(events[-1], order=math.inf)  # type: ignore[arg-type]
            divergence = run.end()
        not_compared, late = run.not_compared(), frozenset(run.late)
        return _Attempt(event, divergence, run.declared_differently(), not_compared, late, run.tolerances)


class RerunPass:
    """One pass through a recording. A context manager; `play` takes the events in order."""

    def __init__(
        self, recording: Recording, runs: Sequence[RecordedTask], settings: Settings, ordering: Ordering
    ) -> None:
        self._exit = contextlib.ExitStack()
        self._tolerances = settings.tolerances
        self._time_shifts = dict(ordering.time_shifts)
        self._ordering = ordering
        self._begin = recording.events[0].time
        self._recorded = runs
        self._runs = {message.order: run for run in runs for message in run.progress}
        self._times = {
            message.order: tick
            for run in runs
            for message, tick in zip(run.progress, tick_times(run.progress), strict=True)
        }
        self._first = min(run.begin for run in runs)
        self._inputs = input_operations(recording)
        scene = scene_before(recording, self._first)
        self.model = world_model_with(scene, settings.workspace)
        add_reasoners(self.model)
        self._writes = Writes(recording, runs, settings.tolerances, scene)
        self.actions = RecordedActions(recording, settings.tolerances, ordering.lost)
        # Starts at 0: the resolution of a float with s since the epoch is too low for the clock's nanosecond steps.
        self.clock = FakeClock(0.0)
        self._clock_ticks = sorted((e.time, e.now) for e in recording.events if isinstance(e, ClockTick))
        names = {run.manager for run in runs}
        self.managers = {
            n: RerunManager(
                n,
                self.model,
                self.actions,
                settings.played,
                Declared(recording.declarations.get(n, "")),
                recording.parameters.get(f"{n}/libraries_list", ()),
            )
            for n in names
        }
        self._used: dict[str, set[str]] = {name: set() for name in names}
        for run in runs:
            frames = (message.frame for message in run.progress)
            self._used[run.manager].update(node.label for frame in frames for node in frame.nodes.values())
        self._tasks: dict[int, RerunTask] = {}
        self._maybe_late: list[WorldChange] = []

    def __enter__(self) -> RerunPass:
        enter = self._exit.enter_context
        enter(self.clock)
        enter(replaced(time, "time", lambda: self._begin + self.clock.now))
        enter(replaced(actionlib, "SimpleActionClient", self.actions.client))
        enter(replaced(ServerWatch, "is_connected", lambda watch: watch._client.is_connected()))
        if self._clock_ticks:
            enter(replaced(rospy.core, "is_initialized", lambda: True))
            enter(replaced(rospy.rostime, "_rostime_current", rospy.rostime._rostime_current))  # restored at the end
        self.model.add_listener(self._on_change)
        for manager in self.managers.values():
            manager.load()
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._exit.close()

    # -- the events --------------------------------------------------------------------------------------------------

    def play(self, event: Event) -> Divergence | None:
        """Applies one event. Returns a divergence; None without one."""
        if event.order < self._first:
            return None
        elif isinstance(event, WorldChange):
            is_waiting = event in self._writes.waiting
            if is_waiting and self._follows_played(event):
                self._maybe_late.append(event)
            if not self._writes.is_own(event):
                self.model.transact(self._inputs[event.order], event.change.author)
            elif event.order in self._ordering.late and is_waiting:
                # A write of a played primitive, recorded after the progress of its tick: the others are made by now.
                self.model.transact(change_operations(event.change, self.model.scene()), event.change.author)
                self._writes.drop(event)
        elif isinstance(event, SignalMessage):
            self.clock.advance(max(0.0, event.time - self._begin - self.clock.now))
            for manager in self.managers.values():
                manager.signals.publish(event.topic, event.message)
        elif isinstance(event, ActionMessage):
            if event.part == "cancel":
                self._cancel(event)
        elif isinstance(event, TaskProgress) and event.order in self._runs:
            return self._tick(event)
        return None

    def _follows_played(self, event: WorldChange) -> bool:
        """Whether a played primitive may have made a change, and the recorder of a busy machine received it later."""
        manager = self.managers[event.change.author]
        lag = event.time - manager.played_ended_at
        runs = (run for run in self._recorded if run.manager == manager.name)
        return lag <= WINDOW or (
            lag <= LAG and any(summary(event.change) in written_by(run, manager.is_played) for run in runs)
        )

    @property
    def late(self) -> list[int]:
        """The orders of changes that were not made, and that played primitives may have made; see `Ordering.late`."""
        differs = self._writes.difference  # a later change of the element was taken for it
        other = differs.event if differs is not None else None
        return [event.order for event in self._maybe_late if event in self._writes.waiting or event is other]

    def end(self) -> Divergence | None:
        """Compares what is missing at the end. Returns a divergence; None without one."""
        missing = self._writes.missing(lambda event: True)
        if missing is not None:
            return self._wrote_differently(missing, "at the end")
        unsent = self.actions.unsent(list(self.managers), self._first)
        return self._not_sent(unsent[0]) if unsent else None

    @property
    def tolerances(self) -> str:
        """See `ReplayResult.tolerances`."""
        return self._tolerances.text(self._writes.has_measured_poses)

    def declared_differently(self) -> tuple[str, ...]:
        """See `ReplayResult.declared`."""
        return tuple(line for name, m in self.managers.items() for line in m.declared_differently(self._used[name]))

    def not_compared(self) -> tuple[str, ...]:
        """See `ReplayResult.not_compared`."""
        found = [line for name, m in self.managers.items() for line in m.not_compared(self._used[name])]
        if any(run.evidence is None for run in self._recorded):
            found.append(
                "which conditions are evaluated, which hooks are called, with what values skills start: the recording "
                "does not have it; record the run again with --evidence"
            )
        if pushed := sorted({key for run in self._recorded for key in pushed_by(run, self._is_played(run))}):
            found.append(f"values of {', '.join(pushed)} that skills get: played skills have pushed them")
        found += self.actions.gaps
        if self._writes.has_measured_poses:
            found.append("written poses exactly: others have moved elements in this run")
        if self._writes.has_any and not all(run.has_writes for run in self._recorded):
            found.append("writes that change nothing: the world model publishes none")
        return tuple(dict.fromkeys(found))

    # -- internal ----------------------------------------------------------------------------------------------------

    def _not_sent(self, message: ActionMessage) -> Divergence:
        what = (
            "a goal to"
            if message.part == "goal"
            else f"a request to cancel {'a goal' if message.goal_id else 'all goals'} of"
        )
        return Divergence(self._where(message), f"{what} {message.action}", "sent", "not sent")

    def _tick(self, progress: TaskProgress) -> Divergence | None:
        run = self._runs[progress.order]
        manager = self.managers[run.manager]
        now = self._times[progress.order] + self._time_shifts.get(progress.order, 0.0)
        self.clock.advance(max(0.0, now - self._begin - self.clock.now))
        self._set_simulated_time(now)
        self.actions.sender = run.manager
        task = self._tasks.get(id(run))
        if task is None:
            task = self._tasks[id(run)] = RerunTask(run, manager, self._tolerances)
        has_result = progress.order in self._ordering.results
        states, counts = task.states_between(progress), self._ordering.counts
        self.actions.deliver_answers(task.progress, progress, states, has_result, counts)
        task.set_readings(progress, 0.0 if self._clock_ticks else self._begin)
        before = task.progress
        mismatch = task.tick(progress, self._due_changes(progress), progress.order in self._ordering.preempting)
        where = f"{self._where(progress)}, tick {run.progress.index(progress) + 1} of {run}"
        has_diverged = mismatch is not None or bool(self.actions.mismatches)
        wrote = self._writes.difference or self._writes.missing(
            (lambda event: event.time < before.time) if has_diverged else self._is_overdue(progress)
        )
        if wrote is not None:
            return self._wrote_differently(wrote, where)
        context = task.context(progress) if has_diverged else ()
        if self.actions.mismatches:
            return Divergence(where, *self.actions.mismatches[0], context)
        return Divergence(where, *mismatch, context) if mismatch is not None else None

    def _due_changes(self, progress: TaskProgress) -> Callable[[], list[Change]]:
        """Returns what lists the recorded changes that were not made yet by a tick; others are made during the tick."""
        return lambda: [event.change for event in self._writes.waiting if event.order < progress.order]

    def _set_simulated_time(self, now: float) -> None:
        """Sets it as of a recording time: when the progress arrives, the clock may be ahead of its tick."""
        number = bisect.bisect(self._clock_ticks, (now, math.inf))
        if number:
            rospy.rostime._set_rostime(rospy.Time.from_sec(self._clock_ticks[number - 1][1]))

    def _cancel(self, event: ActionMessage) -> None:
        if not event.action.endswith("/execute"):
            return
        for task in self._tasks.values():
            goal = task.run.goal
            if goal is not None and goal.action == event.action and event.goal_id in ("", goal.goal_id):
                task.preempt()

    def _on_change(self, change: Change) -> None:
        manager = self.managers.get(change.author)
        self._writes.apply(change, bool(self.actions.sender) and manager is not None and manager.is_ticking)

    def _is_overdue(self, progress: TaskProgress) -> Callable[[WorldChange], bool]:
        """Returns what decides whether a change should have been made when a tick has ended.

        It may be recorded long before the progress of its tick, and be made by a played primitive at its end.
        """

        def is_overdue(event: WorldChange) -> bool:
            author = event.change.author
            if event.time > progress.time - RECORDER_LAG or event.time <= self.managers[author].played_at + WINDOW:
                return False
            due = self._tick_of(event)
            return due is not None and due.time < progress.time - RECORDER_LAG

        return is_overdue

    def _tick_of(self, event: WorldChange) -> TaskProgress | None:
        """Returns the progress of the last tick that may have made a recorded change."""
        runs = (r for r in self._recorded if r.manager == event.change.author and r.begin <= event.order)
        found = [next((p for p in run.progress if p.order > event.order), None) for run in runs]
        return max((each for each in found if each is not None), key=lambda p: p.order, default=None)

    def _wrote_differently(self, found: WriteDifference, where: str) -> Divergence:
        if found.event is not None:
            due = self._tick_of(found.event)
            run = self._runs.get(due.order) if due is not None else None
            tick = f", tick {run.progress.index(due) + 1} of {run}" if run is not None and due is not None else ""
            where = f"{self._where(found.event)}{tick}"
        return Divergence(where, f"the world model, by {found.author}", found.expected, found.got)

    def _is_played(self, run: RecordedTask) -> Callable[[str], bool]:
        return self.managers[run.manager].is_played

    def _where(self, event: Event) -> str:
        return f"{event.time - self._begin:.3f} s" if not math.isinf(event.order) else "at the end"
