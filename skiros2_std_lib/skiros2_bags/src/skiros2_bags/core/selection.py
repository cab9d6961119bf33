"""Selects the topics to record: all that a run needs, without camera images."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

from skiros2_bags.core.message import MONITOR, PROGRESS
from skiros2_common.core.errors import WrongValue

#: Subscribed to at the start, before anyone publishes them.
INITIAL_TOPICS = ("/wm/monitor", "/skill_managers/description", "/tf", "/tf_static", "/clock", "/rosout")

#: The recorder's topic with all ROS parameters as a JSON object, written when they change.
PARAMETERS = "/recorder/parameters"

#: Actions of the task manager, also subscribed to at the start.
TASK_MANAGER_ACTIONS = ("/tm/task_plan", "/tm/achieve")

#: Topics of these types are always recorded.
TYPES = (
    MONITOR,
    PROGRESS,
    "rosgraph_msgs/Clock",
    "sensor_msgs/JointState",
    "skiros2_sim_msgs/Contacts",
    "tf2_msgs/TFMessage",
)

#: Topics that repeat other topics.
DUPLICATES = ("/rosout_agg",)

#: Properties that contain the action names of drivers (contract, "Interfaces of robots").
ACTION_PROPERTIES = ("skiros:NavigationExe", "skiros:MotionExe", "skiros:CartesianGoalAction", "skiros:DriverAddress")

#: Name suffixes of the topics of an action, and suffixes of their types.
_ACTION_TYPES = {"goal": "ActionGoal", "feedback": "ActionFeedback", "result": "ActionResult"}
ACTION_PARTS = (*_ACTION_TYPES, "cancel", "status")

_NAME = re.compile(r"/?[A-Za-z][A-Za-z0-9_]*(/[A-Za-z][A-Za-z0-9_]*)*")


@dataclass(frozen=True)
class Selection:
    """The topics to record.

    :param also: pattern for additional topics, matched against the full name.
    :param without: pattern for excluded topics; overrides everything else.
    """

    also: re.Pattern[str] | None = None
    without: re.Pattern[str] | None = None

    def initial_topics(self, robots: Iterable[str]) -> list[str]:
        """Returns the topics to subscribe to before they exist.

        :param robots: the names of skill managers, with or without leading slash.
        """
        names = [f"/{name.strip('/')}" for name in robots]
        actions = [*TASK_MANAGER_ACTIONS, *(f"{name}/execute" for name in names)]
        topics = [*INITIAL_TOPICS, *(f"{name}/monitor" for name in names), *action_topics(actions)]
        return [topic for topic in dict.fromkeys(topics) if not self._is_excluded(topic)]

    def select(self, topics: Iterable[tuple[str, str]]) -> list[str]:
        """Returns the topics to record.

        :param topics: name and type of all existing topics.
        """
        known = dict(topics)
        return [topic for topic, kind in known.items() if self._is_selected(topic, kind, known)]

    def _is_selected(self, topic: str, kind: str, known: dict[str, str]) -> bool:
        if self._is_excluded(topic) or topic in DUPLICATES:
            return False
        if kind in TYPES or topic in INITIAL_TOPICS or (self.also is not None and self.also.fullmatch(topic)):
            return True
        name, _, part = topic.rpartition("/")
        if part in _ACTION_TYPES:
            return kind.endswith(_ACTION_TYPES[part])
        return part in ACTION_PARTS and known.get(f"{name}/goal", "").endswith("ActionGoal")

    def _is_excluded(self, topic: str) -> bool:
        return self.without is not None and self.without.fullmatch(topic) is not None


def action_topics(actions: Iterable[str]) -> list[str]:
    """Returns the topics of actions."""
    return [f"{name}/{part}" for name in actions for part in ACTION_PARTS]


def is_graph_name(name: object) -> bool:
    """Whether a value is a valid ROS graph name."""
    return isinstance(name, str) and _NAME.fullmatch(name) is not None


def pattern(text: str) -> re.Pattern[str] | None:
    """Compiles a pattern for topic names; None for "".

    :raises WrongValue: the text is not a regular expression.
    """
    try:
        return re.compile(text) if text else None
    except re.error as error:
        raise WrongValue(f"{text!r} is no regular expression: {error}") from None
