"""One pass through a recording in which its trees are ticked again."""

from __future__ import annotations

import contextlib
import math
import time
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType

import actionlib
import rospy

from skiros2_bags.core.normal import Tolerance, change_differences, summary
from skiros2_bags.testing.action_stand_ins import Actions
from skiros2_bags.testing.divergence import Divergence
from skiros2_bags.testing.past_reasoners import add_reasoners
from skiros2_bags.testing.past_world import input_operations, scene_before, world_of
from skiros2_bags.testing.recording import Acted, Changed, Event, Recording, Ticked, Told
from skiros2_bags.testing.rerun_manager import RerunManager
from skiros2_bags.testing.rerun_task import RerunTask
from skiros2_bags.testing.task_runs import TaskRun, changes_of_tasks
from skiros2_bags.testing.tick_times import tick_times
from skiros2_common.ros.action_server_watch import ServerWatch
from skiros2_skill.testing.fake_clock import FakeClock
from skiros2_skill.testing.replace import replaced
from skiros2_world_model.core.changes import Change


class Rerun:
    """A context manager; `play` takes the events one after the other.

    :param workspace: folder of further ontologies.
    :param played: labels of primitives that do what was told of them.
    :param shifts: orders of progress messages, and how much their ticks are moved (s).
    """

    def __init__(
        self,
        recording: Recording,
        runs: Sequence[TaskRun],
        workspace: Path | None,
        played: frozenset[str],
        tolerance: Tolerance,
        shifts: Mapping[int, float],
    ) -> None:
        self._exit = contextlib.ExitStack()
        self._tolerance = tolerance
        self._shifts = shifts
        self._begin = recording.events[0].time
        self._runs = {message.order: run for run in runs for message in run.told}
        self._times = {
            message.order: tick for run in runs for message, tick in zip(run.told, tick_times(run.told), strict=True)
        }
        self._own = {event.order: event for event in changes_of_tasks(recording, runs)}
        self._first = min(run.begin for run in runs)
        self._inputs = input_operations(recording)
        scene = scene_before(recording, self._first)
        self.model = world_of(scene, workspace)
        add_reasoners(self.model)
        self.actions = Actions(recording, tolerance)
        # From the begin of the bag: seconds of the epoch are too large for nanoseconds, by which the clock tells looks
        # apart.
        self.clock = FakeClock(0.0)
        self._is_simulated = any(isinstance(e, Ticked) for e in recording.events)
        self._made: list[Change] = []
        self.managers = {
            name: RerunManager(name, self.model, self.actions, played) for name in {run.manager for run in runs}
        }
        self._tasks: dict[int, RerunTask] = {}
        self._cancelled: set[str] = set()

    def __enter__(self) -> Rerun:
        enter = self._exit.enter_context
        enter(self.clock)
        enter(replaced(time, "time", lambda: self._begin + self.clock.now))
        enter(replaced(actionlib, "SimpleActionClient", self.actions.client))
        enter(replaced(ServerWatch, "is_connected", lambda watch: watch._client.is_connected()))
        if self._is_simulated:
            enter(replaced(rospy.core, "is_initialized", lambda: True))
            enter(replaced(rospy.rostime, "_rostime_current", rospy.rostime._rostime_current))  # set while it plays
        self.model.add_listener(self._on_change)
        for manager in self.managers.values():
            manager.load()
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._exit.close()

    # -- the events --------------------------------------------------------------------------------------------------

    def play(self, event: Event) -> Divergence | None:
        """Plays one event. Returns what is not as recorded after it."""
        if isinstance(event, Ticked):
            if self._is_simulated:
                rospy.rostime._set_rostime(rospy.Time.from_sec(event.now))
        elif event.order < self._first:
            return None
        elif isinstance(event, Changed):
            if event.order not in self._own:
                self.model.transact(self._inputs[event.order], event.change.author)
        elif isinstance(event, Acted):
            if event.part == "cancel":
                self._cancel(event)
        elif isinstance(event, Told) and event.order in self._runs:
            return self._tick(event)
        return None

    def end(self) -> Divergence | None:
        """What is left over at the end."""
        wrong = self._wrong_change()
        if wrong is not None:
            return wrong
        left = [_subject(change) for change in self._made]
        for event in self._own.values():
            if _subject(event.change) not in left:
                what = f"the world model, by {event.change.author}"
                return Divergence(self._where(event), what, summary(event.change), "nothing")
            left.remove(_subject(event.change))
        return (
            Divergence("at the end", "the world model", "no further change", f"a change of {left[0]}") if left else None
        )

    # -- inside ------------------------------------------------------------------------------------------------------

    def _tick(self, told: Told) -> Divergence | None:
        run = self._runs[told.order]
        manager = self.managers[run.manager]
        now = self._times[told.order] + self._shifts.get(told.order, 0.0) - self._begin
        self.clock.advance(max(0.0, now - self.clock.now))
        self.actions.sender = run.manager
        task = self._tasks.get(id(run))
        if task is None:
            task = self._tasks[id(run)] = RerunTask(run, manager, self._tolerance)
        due = [e.change for e in list(self._own.values())[len(self._made) :] if e.order < told.order]
        self.actions.answer(task.told, told, task.nodes_at(told))
        wrong = task.tick(told, due)
        if wrong is None and not self.actions.wrong:
            return None
        earlier = self._wrong_change()
        if earlier is not None:
            return earlier
        where = f"{self._where(told)}, tick {run.told.index(told) + 1} of {run}"
        context = task.context(told)
        if self.actions.wrong:
            return Divergence(where, *self.actions.wrong[0], context)
        assert wrong is not None
        return Divergence(where, *wrong, context)

    def _cancel(self, event: Acted) -> None:
        if not event.action.endswith("/execute"):
            return
        for task in self._tasks.values():
            goal = task.run.goal
            if goal is not None and goal.action == event.action and event.goal_id in ("", goal.goal_id):
                task.preempt()

    def _on_change(self, change: Change) -> None:
        if self.actions.sender and change.author in self.managers and self.managers[change.author].is_ticking:
            self._made.append(change)

    def _wrong_change(self) -> Divergence | None:
        """The first change that is another one than recorded, of those that were made in both.

        Those of an element are compared in their order; which of several elements a tick writes first may differ.
        """
        made: dict[str, list[Change]] = defaultdict(list)
        for change in self._made:
            made[_subject(change)].append(change)
        for event in self._own.values():
            waiting = made[_subject(event.change)]
            got = waiting.pop(0) if waiting else None
            differences = change_differences(event.change, got, self._tolerance) if got is not None else []
            if differences:
                what = f"the world model, by {event.change.author}"
                return Divergence(self._where(event), what, summary(event.change), "\n".join(differences))
        return None

    def _where(self, event: Event) -> str:
        return f"{event.time - self._begin:.3f} s" if not math.isinf(event.order) else "at the end"


def _subject(change: Change) -> str:
    """What a change is about."""
    return ", ".join([e.id for e in change.elements] or [str(sorted(r.items())) for r in change.relations])
