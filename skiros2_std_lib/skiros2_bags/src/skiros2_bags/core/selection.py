"""Which topics are recorded: what a run needs, and no pictures."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

from skiros2_bags.core.contract_types import MONITOR, PROGRESS
from skiros2_common.core.errors import WrongValue

#: Heard from the start, before anybody publishes them.
NAMED = ("/wm/monitor", "/skill_managers/description", "/tf", "/tf_static", "/clock", "/rosout")

#: The recorder's own topic of the parameters: a JSON object of all of them, whenever they have changed.
PARAMETERS = "/recorder/parameters"

#: Actions of the task manager, likewise.
TASK_MANAGER_ACTIONS = ("/tm/task_plan", "/tm/achieve")

#: Types whose topics are recorded as soon as they are there.
TYPES = (
    MONITOR,
    PROGRESS,
    "rosgraph_msgs/Clock",
    "sensor_msgs/JointState",
    "skiros2_sim_msgs/Contacts",
    "tf2_msgs/TFMessage",
)

#: Copies of what is recorded elsewhere.
COPIES = ("/rosout_agg",)

#: Properties whose values are the names of actions of drivers (contract, "Interfaces of robots").
ACTION_PROPERTIES = ("skiros:NavigationExe", "skiros:MotionExe", "skiros:CartesianGoalAction", "skiros:DriverAddress")

#: What the topics of an action are called, and how their types end.
_ACTION_TYPES = {"goal": "ActionGoal", "feedback": "ActionFeedback", "result": "ActionResult"}
ACTION_PARTS = (*_ACTION_TYPES, "cancel", "status")

_NAME = re.compile(r"/?[A-Za-z][A-Za-z0-9_]*(/[A-Za-z][A-Za-z0-9_]*)*")


@dataclass(frozen=True)
class Selection:
    """What is recorded of all topics there are.

    :param also: further ones, whose whole names match.
    :param without: left out, whatever else says that they are recorded.
    """

    also: re.Pattern[str] | None = None
    without: re.Pattern[str] | None = None

    def named(self, robots: Iterable[str]) -> list[str]:
        """The topics to listen to before they are there.

        :param robots: the names of skill managers, with or without their leading slash.
        """
        names = [f"/{name.strip('/')}" for name in robots]
        actions = [*TASK_MANAGER_ACTIONS, *(f"{name}/execute" for name in names)]
        topics = [*NAMED, *(f"{name}/monitor" for name in names), *action_topics(actions)]
        return [topic for topic in dict.fromkeys(topics) if not self._is_left_out(topic)]

    def chosen(self, topics: Iterable[tuple[str, str]]) -> list[str]:
        """Those of the topics that are recorded.

        :param topics: the name and type of each.
        """
        known = dict(topics)
        return [topic for topic, kind in known.items() if self._is_wanted(topic, kind, known)]

    def _is_wanted(self, topic: str, kind: str, known: dict[str, str]) -> bool:
        if self._is_left_out(topic) or topic in COPIES:
            return False
        if kind in TYPES or topic in NAMED or (self.also is not None and self.also.fullmatch(topic)):
            return True
        name, _, part = topic.rpartition("/")
        if part in _ACTION_TYPES:
            return kind.endswith(_ACTION_TYPES[part])
        return part in ACTION_PARTS and known.get(f"{name}/goal", "").endswith("ActionGoal")

    def _is_left_out(self, topic: str) -> bool:
        return self.without is not None and self.without.fullmatch(topic) is not None


def action_topics(actions: Iterable[str]) -> list[str]:
    """The topics of some actions."""
    return [f"{name}/{part}" for name in actions for part in ACTION_PARTS]


def is_graph_name(name: object) -> bool:
    """Whether something is a name that topics can have."""
    return isinstance(name, str) and _NAME.fullmatch(name) is not None


def pattern(text: str) -> re.Pattern[str] | None:
    """What topics are to match; None for "".

    :raises WrongValue: it is no regular expression.
    """
    try:
        return re.compile(text) if text else None
    except re.error as error:
        raise WrongValue(f"{text!r} is no regular expression: {error}") from None
