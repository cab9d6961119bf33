"""What is told inside the window: what other threads have heard of the system, and what the user has chosen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class WorldChanged:
    """The scene has changed, and can be read.

    :param changes: what has changed, in order (`skiros2_world_model.core.changes.Change`).
    :param is_new: all may be other than before: it was loaded anew, or the world model is another one.
    :param ontology: the ontologies may be other than before, too.
    """

    changes: tuple[Any, ...] = ()
    is_new: bool = False
    ontology: bool = False


@dataclass(frozen=True)
class Progressed:
    """A task of a manager has come to this.

    :param manager: its node name.
    :param nodes: of each node a `SkillProgress`, or what has its fields, each before its children, the root first.
    :param stamp: when it was heard (s since the epoch).
    """

    manager: str
    nodes: Sequence[Any]
    stamp: float

    @property
    def task(self) -> int:
        """The task's id."""
        return int(self.nodes[0].id)


@dataclass(frozen=True)
class ManagersChanged:
    """Managers have come or gone, or offer other skills."""


@dataclass(frozen=True)
class ConnectionChanged:
    """A part of the system has come up or gone."""


@dataclass(frozen=True)
class ElementSelected:
    """The user has selected an element in some tab. "": none."""

    eid: str
    by: object = None


@dataclass(frozen=True)
class TaskStarted:
    """The user has started a task, or wants to see it.

    :param manager: the node name of its manager.
    :param to_front: the tab that shows it is to come to the front.
    """

    manager: str
    task: int
    to_front: bool = False


@dataclass(frozen=True)
class ProblemHeard:
    """Something went wrong that no job of the window was at.

    :param what: what was being done, in words.
    :param text: what is wrong, for people.
    """

    what: str
    text: str


@dataclass(frozen=True)
class NodeEnded:
    """This process is no ROS node any more: somebody has told it to end, or another node has taken its name.

    :param reason: in ROS's words.
    """

    reason: str


@dataclass(frozen=True, eq=False)
class AchieveTold:
    """The task manager has told how a goal of this window goes on.

    :param feedback: an `AchieveFeedback`.
    """

    goal: str
    feedback: Any


Event = (
    WorldChanged
    | Progressed
    | ManagersChanged
    | ConnectionChanged
    | ElementSelected
    | TaskStarted
    | AchieveTold
    | ProblemHeard
    | NodeEnded
)
