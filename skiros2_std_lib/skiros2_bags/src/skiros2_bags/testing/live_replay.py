"""Recorded goals and changes of the world, given to real nodes; what these do is recorded again and compared."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

import actionlib
import rospy

from skiros2_bags.core.errors import BagError
from skiros2_bags.testing.lab import Lab
from skiros2_bags.testing.past_world import operations_of, requests_of
from skiros2_bags.testing.recording import Acted, Changed, Event, Events, Recording, Told, tree
from skiros2_common.core.errors import TimedOut
from skiros2_common.ros.listeners import wait_for_listeners
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_world_model.core.apply_change import apply_change
from skiros2_world_model.core.changes import RESET, Change, snapshot_number
from skiros2_world_model.core.scene import Scene
from skiros2_world_model.ros.wire import msg2change, msg2shared_element, operation2msg

#: What was done in so many seconds may take this many times as long, and `PATIENCE` more (s).
SLOWER, PATIENCE = 3.0, 20.0


class Observer:
    """Takes down what some managers and the world model tell, as a recorder does.

    :param managers: their names.
    """

    def __init__(self, managers: Sequence[str]) -> None:
        self._lock = threading.Lock()
        self._orders = itertools.count()
        self._events: list[Event] = []
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
        """Whether all that is listened to is there."""
        return all(s.get_num_connections() for s in self._subscribers)

    def has_heard(self, snapshot_id: str) -> bool:
        """Whether the change that led to a state of the world model has come, or a later one."""
        number = snapshot_number(snapshot_id)
        return any(event.change.number >= number for event in self.events.changes)

    def _on_change(self, message: Any) -> None:
        with self._lock:
            self._events.append(Changed(next(self._orders), time.time(), msg2change(message, "scene")))

    def _on_progress(self, message: Any, manager: str) -> None:
        if message.progress:
            nodes, task = tree(message.progress), message.progress[0].task_id
            with self._lock:
                self._events.append(Told(next(self._orders), time.time(), manager, task, nodes))


class Player:
    """Gives the recorded goals and changes to the nodes, in their order.

    A goal is sent as soon as all goals have ended that had ended before it in the recording; what comes between goals
    has the same time after the last one.

    :param goals: those to be sent.
    :param changes: those to be made.
    :param apply: makes the changes of one request.
    """

    def __init__(
        self,
        recording: Recording,
        goals: Sequence[Acted],
        changes: Sequence[Changed],
        apply: Callable[[Sequence[Changed]], None],
        lab: Lab,
    ) -> None:
        self._recording = recording
        self._goals = {goal.order: goal for goal in goals}
        self._changes = {request[0].order: request for request in requests_of(changes)}
        self._apply = apply
        self._lab = lab
        self._clients: dict[str, Any] = {}
        self._sent: dict[str, Any] = {}

    def connect(self) -> None:
        """Waits for the servers of all goals."""
        for goal in self._goals.values():
            if goal.action not in self._clients:
                kind = _action_of(goal)
                client = self._clients[goal.action] = actionlib.ActionClient(goal.action, kind)
                if not client.wait_for_server(rospy.Duration.from_sec(PATIENCE)):
                    raise TimedOut(f"no server of {goal.action} within {PATIENCE:g} s")
                wait_for_listeners(client.pub_goal)

    def play(self) -> None:
        """Plays all, and waits for the ends of the goals.

        :raises TimedOut: something does not end.
        """
        cancels = [e for e in self._recording.acted if e.part == "cancel"]
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
            if isinstance(event, Changed):
                self._apply(self._changes[event.order])
            elif isinstance(event, Acted) and event.goal_id in self._sent:
                self._sent[event.goal_id].cancel()
        for goal in self._goals.values():
            if self._recording.result(goal) is not None:
                self._wait_for(lambda goal=goal: self._is_done(goal), f"the end of goal {goal.goal_id}")

    def close(self) -> None:
        for client in self._clients.values():
            client.stop()

    def _ended_before(self, goal: Acted) -> bool:
        """Whether all goals have ended that had ended before this one was sent."""
        results = {other.goal_id: self._recording.result(other) for other in self._goals.values()}
        earlier = [g for g in self._goals.values() if (r := results[g.goal_id]) is not None and r.order < goal.order]
        return all(self._is_done(other) for other in earlier)

    def _is_done(self, goal: Acted) -> bool:
        handle = self._sent.get(goal.goal_id)
        return handle is not None and handle.get_comm_state() == actionlib.CommState.DONE

    def _wait_for(self, condition: Callable[[], bool], what: str) -> None:
        results = ((goal, self._recording.result(goal)) for goal in self._goals.values())
        longest = max((result.time - goal.time for goal, result in results if result is not None), default=0.0)
        self._lab.wait_for(condition, what, SLOWER * longest + PATIENCE)


class SceneFollower:
    """Makes recorded changes in a world model that is a node.

    :param node: its name.
    """

    def __init__(self, node: str = "/wm") -> None:
        self._node = node
        self._transact = rospy.ServiceProxy(f"{node}/transaction", srvs.WmTransaction)

    def apply(self, request: Sequence[Changed]) -> None:
        """Makes the changes of a request, as far as they are not made already."""
        scene = self.scene()
        operations = [operation2msg(o) for event in request for o in operations_of(event.change, scene)]
        if operations:
            self._transact(request[0].change.author, "", operations)

    def scene(self) -> Scene:
        """The scene as it is now."""
        return fetched_scene(self._node)


def fetched_scene(node: str) -> Scene:
    """The scene of a world model that is a node."""
    answer = rospy.ServiceProxy(f"{node}/snapshot", srvs.WmSnapshot)("")
    elements = tuple(msg2shared_element(m, 0) for m in answer.elements)
    scene = Scene()
    apply_change(scene, Change(0, "", "", 0.0, "", RESET, "scene", elements))
    return scene


def _action_of(goal: Acted) -> Any:
    import roslib.message

    name = goal.content._type.removesuffix("Goal") + "Action"
    kind = roslib.message.get_message_class(name)
    if kind is None:
        raise BagError(f"goal {goal.goal_id} to {goal.action}: this system has no {name}")
    return kind
