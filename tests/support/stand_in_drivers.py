"""Drivers without a robot: each goal is answered at once, as a script says or as if all went well.

There is no physics in it: the tool is where it was sent, and what it closes on goes with it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
import rospy
from actionlib import CommState
from actionlib_msgs.msg import GoalStatus
from move_base_msgs.msg import MoveBaseResult

from control_msgs.msg import FollowJointTrajectoryResult, GripperCommandResult
from controller_manager_msgs.srv import SwitchControllerResponse
from skiros2_motion.core.geometry import Pose, composed
from skiros2_sim_msgs.msg import CartesianMotionGoal, CartesianMotionResult, Detection
from skiros2_sim_msgs.srv import DetectResponse
from skiros2_std_reasoners.core import spatial_data as space

#: The answer to a goal: how it ended, its result, and the driver's words.
Answer = tuple[int, Any, str]
SUCCEEDED, ABORTED = GoalStatus.SUCCEEDED, GoalStatus.ABORTED


class StandInDrivers:
    """All actions and services of one robot. Put `answer` before a goal to have it end otherwise.

    :param things: where things truly are, by id: pose in the map and width (m).
    :ivar goals: name of the action or service and goal or request, in the order in which they came.
    """

    def __init__(self, things: dict[str, tuple[Pose, float]]) -> None:
        self.goals: list[tuple[str, Any]] = []
        self.things = things
        self.held: str | None = None
        self.tool = Pose((0.0, 0.0, 1.0), (1.0, 0.0, 0.0, 0.0))
        self.missing: set[str] = set()
        self._scripted: dict[str, list[Callable[[Any], Any]]] = {}

    def answer(self, name: str, *answers: Callable[[Any], Any] | None) -> None:
        """Scripts the answers to the next goals of an action or requests of a service; None: as if all went well."""
        self._scripted.setdefault(name, []).extend(a or (lambda goal: self._usual(name, goal)) for a in answers)

    def take(self, name: str, goal: Any) -> Any:
        """What a driver says to a goal or request."""
        self.goals.append((name, goal))
        scripted = self._scripted.get(name)
        return scripted.pop(0)(goal) if scripted else self._usual(name, goal)

    def start(self, client: Client, goal: Any) -> None:
        """Takes the goal of an action."""
        client.end(self.take(client.name, goal))

    def cancel(self, client: Client) -> None:
        """Takes the cancellation of a goal."""
        self.goals.append((client.name, "cancel"))

    def sent_to(self, name: str) -> list[Any]:
        """The goals of one action, or requests of one service."""
        return [goal for there, goal in self.goals if there == name]

    def lose(self) -> None:
        """The held object falls from the gripper onto the tray below."""
        assert self.held is not None
        pose, width = self.things[self.held]
        x, y, _ = pose.position
        self.things[self.held] = (Pose((x, y, 0.545), pose.orientation), width)
        self.held = None

    # -- as if all went well -----------------------------------------------------------------------------------

    def _usual(self, name: str, goal: Any) -> Any:
        kind = name.rpartition("/")[2]
        return {
            "move_base": lambda: (SUCCEEDED, MoveBaseResult(), ""),
            "follow_joint_trajectory": lambda: (SUCCEEDED, FollowJointTrajectoryResult(), ""),
            "cartesian_motion": lambda: self._move(goal),
            "gripper_action": lambda: self._grip(goal.command.position),
            "switch_controller": lambda: SwitchControllerResponse(ok=True),
            "detect": self._detect,
        }[kind]()

    def _move(self, goal: CartesianMotionGoal) -> Answer:
        target = pose_of(goal.target.pose)
        self.tool = target if goal.target.header.frame_id == "map" else composed(self.tool, target)
        if self.held:
            self.things[self.held] = (self.tool, self.things[self.held][1])
        return SUCCEEDED, CartesianMotionResult(), ""

    def _grip(self, width: float) -> Answer:
        if width > 0:
            if self.held:
                self.lose()
            return SUCCEEDED, GripperCommandResult(position=width, reached_goal=True), ""
        near = [i for i, (p, _) in self.things.items() if math.dist(p.position, self.tool.position) < 0.02]
        self.held = near[0] if near else None
        there = self.things[self.held][1] if self.held else 0.0
        return SUCCEEDED, GripperCommandResult(position=there, stalled=there > 0, reached_goal=there == 0), ""

    def _detect(self) -> DetectResponse:
        response = DetectResponse(ok=True)
        for eid, (pose, _) in self.things.items():
            if eid in self.missing or eid == self.held:
                continue
            detection = Detection(id=eid, confidence=1.0)
            point, turn = detection.pose.pose.position, detection.pose.pose.orientation
            point.x, point.y, point.z = pose.position
            turn.x, turn.y, turn.z, turn.w = pose.orientation
            response.detections.append(detection)
        return response


class Client:
    """An action client as `PrimitiveActionClient` uses it."""

    def __init__(self, drivers: StandInDrivers, name: str) -> None:
        self._drivers, self.name = drivers, name
        self._answer: Answer = (GoalStatus.ACTIVE, None, "")
        self._done: Callable[[int, Any], None] = lambda status, result: None
        self.gh = SimpleNamespace(get_comm_state=lambda: CommState.ACTIVE)
        self.action_client = SimpleNamespace(ns=name, stop=lambda: None)

    def end(self, answer: Answer) -> None:
        """What the driver answers; a goal that is active still has none yet."""
        self._answer = answer
        if answer[0] != GoalStatus.ACTIVE:
            self._done(answer[0], answer[1])

    def send_goal(self, goal: Any, done_cb: Any, feedback_cb: Any) -> None:
        self._done = done_cb
        self._drivers.start(self, goal)

    def cancel_goal(self) -> None:
        self._drivers.cancel(self)

    cancel_all_goals = cancel_goal

    def stop_tracking_goal(self) -> None:
        self._done = lambda status, result: None

    def get_goal_status_text(self) -> str:
        return self._answer[2]

    def get_state(self) -> int:
        return self._answer[0]


class _Proxy:
    """A service as `PrimitiveServiceClient` uses it."""

    def __init__(self, drivers: StandInDrivers, name: str) -> None:
        self._drivers, self.resolved_name = drivers, name

    def __call__(self, request: Any) -> Any:
        return self._drivers.take(self.resolved_name, request)


class _Watch:
    """A server that is there."""

    def __init__(self, client: Client) -> None:
        self.name = client.action_client.ns

    def is_connected(self) -> bool:
        return True

    def time_since_status(self) -> float:
        return 0.0

    def time_without_result(self, handle: Any) -> float:
        return 0.0

    time_without_ack = time_without_result


def install(monkeypatch: pytest.MonkeyPatch, drivers: StandInDrivers) -> None:
    """Has the skills of this process talk to these drivers."""
    from skiros2_std_skills import action_client_primitive
    from skiros2_std_skills import drivers as module

    monkeypatch.setattr(module.actionlib, "SimpleActionClient", lambda name, kind: Client(drivers, name))
    monkeypatch.setattr(action_client_primitive, "ServerWatch", _Watch)
    monkeypatch.setattr(rospy, "ServiceProxy", lambda name, kind: _Proxy(drivers, name))


def pose_of(message: Any) -> Pose:
    """A pose message as a pose."""
    p, q = message.position, message.orientation
    return Pose((p.x, p.y, p.z), (q.x, q.y, q.z, q.w))


def true_things(wmi: Any, *elements: Any) -> dict[str, tuple[Pose, float]]:
    """Things where the world model has them."""
    from skiros2_std_reasoners.core.scene_poses import pose_in_scene

    return {e.id: (pose_in_scene(wmi, e)[1], space.numbers(e, space.SIZE)[0] or 0.0) for e in elements}
