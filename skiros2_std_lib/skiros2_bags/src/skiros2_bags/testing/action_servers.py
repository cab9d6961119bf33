"""Action servers of a replay: they answer goals like the recorded servers, after the recorded times."""

from __future__ import annotations

import logging
import threading
from typing import Any

import actionlib
import roslib.message

from skiros2_bags.testing.fake_action_clients import diff_messages
from skiros2_bags.testing.recording import ActionMessage, Recording
from skiros2_runs.core.tolerance import Tolerance

log = logging.getLogger(__name__)


class ActionServers:
    """Servers for some actions of a recording. The goals of each action are answered in order.

    :param actions: names of the actions.
    :param tolerance: of numbers in goals.
    """

    def __init__(self, recording: Recording, actions: set[str], tolerance: Tolerance) -> None:
        self._recording = recording
        self._tolerance = tolerance
        self._lock = threading.Lock()
        self._pending = {name: recording.goals(name) for name in sorted(actions)}
        self._timers: list[threading.Timer] = []
        self._ended: set[str] = set()  # the ids of goals
        #: Differences between received and recorded goals: (subject, recorded, received).
        self.mismatches: list[tuple[str, str, str]] = []
        self._servers = [self._server(name, goals[0]) for name, goals in self._pending.items() if goals]

    def close(self) -> None:
        """Cancels all pending answers."""
        with self._lock:
            timers, self._timers = self._timers, []
        for timer in timers:
            timer.cancel()

    # -- called in threads of ROS ------------------------------------------------------------------------------------

    def _server(self, name: str, goal: ActionMessage) -> Any:
        kind = roslib.message.get_message_class(goal.content._type.removesuffix("Goal") + "Action")
        server = actionlib.ActionServer(
            name, kind, lambda handle: self._on_goal(name, handle), self._on_cancel, auto_start=False
        )
        server.start()
        return server

    def _on_goal(self, name: str, handle: Any) -> None:
        with self._lock:
            expected = self._pending[name].pop(0) if self._pending[name] else None
        if expected is None:
            self._add_mismatch(f"a goal to {name}", "no further goal", str(handle.get_goal()))
            handle.set_rejected(None, "the recording has no further goal")
            return
        for field, wanted, found in diff_messages(expected.content, handle.get_goal(), self._tolerance):
            self._add_mismatch(f"a goal to {name}, field {field}", wanted, found)
            break
        handle.set_accepted()
        answers = [e for e in self._recording.action_messages if e.action == name and e.goal_id == expected.goal_id]
        with self._lock:
            for event in answers:
                if event.part in ("feedback", "result"):
                    timer = threading.Timer(max(0.0, event.time - expected.time), self._answer, (handle, event))
                    timer.daemon = True
                    self._timers.append(timer)
                    timer.start()

    def _answer(self, handle: Any, event: ActionMessage) -> None:
        if event.part == "feedback":
            if handle.get_goal_id().id not in self._ended:
                handle.publish_feedback(event.content)
            return
        goal_id = handle.get_goal_id().id
        with self._lock:
            if goal_id in self._ended:
                return
            self._ended.add(goal_id)
        statuses = actionlib.GoalStatus
        ends = {
            statuses.SUCCEEDED: handle.set_succeeded,
            statuses.PREEMPTED: handle.set_canceled,
            statuses.RECALLED: handle.set_canceled,
        }
        ends.get(event.status, handle.set_aborted)(event.content, event.text)

    def _on_cancel(self, handle: Any) -> None:
        goal_id = handle.get_goal_id().id
        with self._lock:
            if goal_id in self._ended:
                return
            self._ended.add(goal_id)
        handle.set_canceled(None, "cancelled")

    def _add_mismatch(self, what: str, expected: str, got: str) -> None:
        with self._lock:
            self.mismatches.append((what, expected, got))
