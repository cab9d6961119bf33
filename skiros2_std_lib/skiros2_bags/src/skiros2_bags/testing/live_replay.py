"""Plays recorded goals and changes of the world model to running nodes, and records what the nodes do."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

import actionlib
import rospy

from skiros2_bags.core.errors import BagError
from skiros2_bags.testing.recorded_world import change_operations, group_requests
from skiros2_bags.testing.recording import (
    ActionMessage,
    Event,
    Events,
    Recording,
    TaskProgress,
    WorldChange,
)
from skiros2_bags.testing.replay_system import ReplaySystem
from skiros2_common.core.errors import TimedOut
from skiros2_common.ros.connections import wait_for_subscribers
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_runs.core.runs import Runs
from skiros2_world_model.core.changes import RESET, Change, snapshot_number
from skiros2_world_model.core.replica import apply_change
from skiros2_world_model.core.scene import Scene
from skiros2_world_model.ros.wire import msg2change, msg2shared_element, operation2msg

#: Timeout of a step: a multiple of its recorded duration, plus seconds.
SLOWDOWN, TIMEOUT = 3.0, 20.0


class RunObserver:
    """Records the progress of managers and the changes of the world model.

    :param managers: their names.
    """

    def __init__(self, managers: Sequence[str]) -> None:
        self._lock = threading.Lock()
        self._orders = itertools.count()
        self._events: list[Event] = []
        self._runs = Runs()
        self._subscribers = [rospy.Subscriber("/wm/monitor", msgs.WmMonitor, self._on_change, queue_size=1000)]
        for name in managers:
            self._subscribers.append(
                rospy.Subscriber(
                    f"{name}/monitor", msgs.TreeProgress, self._on_progress, callback_args=name, queue_size=1000
                )
            )

    @property
    def events(self) -> Events:
        with self._lock:
            return Events(self._events)

    @property
    def is_connected(self) -> bool:
        """Whether all publishers are connected."""
        return all(s.get_num_connections() for s in self._subscribers)

    def has_received(self, snapshot_id: str) -> bool:
        """Whether a state of the world model, or a later one, has been received."""
        number = snapshot_number(snapshot_id)
        return any(event.change.number >= number for event in self.events.changes)

    def _on_change(self, message: Any) -> None:
        with self._lock:
            self._events.append(WorldChange(next(self._orders), time.time(), msg2change(message, "scene")))

    def _on_progress(self, message: Any, manager: str) -> None:
        now = time.time()
        with self._lock:
            recorded = self._runs.record(manager, message.progress, now)
            if recorded is not None and recorded.is_new_tick:
                self._events.append(TaskProgress(next(self._orders), now, recorded.run, recorded.run.latest))


class Player:
    """Plays the recorded goals and changes to the nodes, in order.

    A goal is sent once all goals have ended that had ended before it in the recording. Changes and cancel requests keep
    their recorded time after the last goal.

    :param goals: the goals to send.
    :param changes: the changes to make.
    :param apply: makes the changes of one request.
    """

    def __init__(
        self,
        recording: Recording,
        goals: Sequence[ActionMessage],
        changes: Sequence[WorldChange],
        apply: Callable[[Sequence[WorldChange]], None],
        system: ReplaySystem,
    ) -> None:
        self._recording = recording
        self._goals = {goal.order: goal for goal in goals}
        self._changes = {request[0].order: request for request in group_requests(changes)}
        self._apply = apply
        self._system = system
        self._clients: dict[str, Any] = {}
        self._sent: dict[str, Any] = {}

    def connect(self) -> None:
        """Waits for the action servers of all goals."""
        for goal in self._goals.values():
            if goal.action not in self._clients:
                kind = _action_of(goal)
                client = self._clients[goal.action] = actionlib.ActionClient(goal.action, kind)
                if not client.wait_for_server(rospy.Duration.from_sec(TIMEOUT)):
                    raise TimedOut(f"no server of {goal.action} within {TIMEOUT:g} s")
                wait_for_subscribers(client.pub_goal)

    def play(self) -> None:
        """Plays all events, and waits for the end of all goals.

        :raises TimedOut: a goal does not end.
        """
        cancels = [e for e in self._recording.action_messages if e.part == "cancel"]
        inputs: list[Event] = [*self._goals.values(), *(r[0] for r in self._changes.values()), *cancels]
        anchor, anchored_at = 0.0, time.monotonic()
        for event in sorted(inputs, key=lambda e: e.order):
            if event.order in self._goals:
                goal = self._goals[event.order]
                self._wait_for(lambda goal=goal: self._ended_before(goal), f"the goals before {goal.goal_id}")
                self._sent[goal.goal_id] = self._clients[goal.action].send_goal(goal.content)
                anchor, anchored_at = event.time, time.monotonic()
                continue
            if anchor:
                time.sleep(max(0.0, anchored_at + event.time - anchor - time.monotonic()))
            if isinstance(event, WorldChange):
                self._apply(self._changes[event.order])
            elif isinstance(event, ActionMessage) and event.goal_id in self._sent:
                self._sent[event.goal_id].cancel()
        for goal in self._goals.values():
            if self._recording.result(goal) is not None:
                self._wait_for(lambda goal=goal: self._is_done(goal), f"the end of goal {goal.goal_id}")

    def close(self) -> None:
        for client in self._clients.values():
            client.stop()

    def _ended_before(self, goal: ActionMessage) -> bool:
        """Whether all goals have ended that ended before a goal was sent in the recording."""
        results = {other.goal_id: self._recording.result(other) for other in self._goals.values()}
        earlier = [g for g in self._goals.values() if (r := results[g.goal_id]) is not None and r.order < goal.order]
        return all(self._is_done(other) for other in earlier)

    def _is_done(self, goal: ActionMessage) -> bool:
        handle = self._sent.get(goal.goal_id)
        return handle is not None and handle.get_comm_state() == actionlib.CommState.DONE

    def _wait_for(self, condition: Callable[[], bool], what: str) -> None:
        results = ((goal, self._recording.result(goal)) for goal in self._goals.values())
        longest = max((result.time - goal.time for goal, result in results if result is not None), default=0.0)
        self._system.wait_for(condition, what, SLOWDOWN * longest + TIMEOUT)


class WorldModelWriter:
    """Makes recorded changes in a world model node.

    :param node: its name.
    """

    def __init__(self, node: str = "/wm") -> None:
        self._node = node
        self._transact = rospy.ServiceProxy(f"{node}/transaction", srvs.WmTransaction)

    def apply(self, request: Sequence[WorldChange]) -> None:
        """Makes the changes of a request that are not in the scene yet."""
        scene = self.scene()
        operations = [operation2msg(o) for event in request for o in change_operations(event.change, scene)]
        if operations:
            self._transact(request[0].change.author, "", operations)

    def scene(self) -> Scene:
        """Fetches the current scene."""
        answer = rospy.ServiceProxy(f"{self._node}/snapshot", srvs.WmSnapshot)("")
        elements = tuple(msg2shared_element(m, 0) for m in answer.elements)
        scene = Scene()
        apply_change(scene, Change(0, "", "", 0.0, "", RESET, "scene", elements))
        return scene


def _action_of(goal: ActionMessage) -> Any:
    import roslib.message

    name = goal.content._type.removesuffix("Goal") + "Action"
    kind = roslib.message.get_message_class(name)
    if kind is None:
        raise BagError(f"goal {goal.goal_id} to {goal.action}: this system has no {name}")
    return kind
