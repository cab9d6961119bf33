"""The running system as the window sees it: a port, with an adapter over ROS and one in process."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from skiros2_skill.command_line.description import Skill
from skiros2_skill.core.diagnosis.inspection import NodeStatus
from skiros2_world_model.core.ontology import Ontology
from skiros2_world_model.core.reader import SceneReader
from skiros2_world_model.core.world_model_client import WorldModelAbstractInterface

#: The kinds of parts.
MASTER, WORLD_MODEL, MANAGER, TASK_MANAGER = "ROS master", "world model", "robot", "task manager"


@dataclass(frozen=True)
class Part:
    """A part of the system, and whether it is there.

    :param kind: one of those above.
    :param name: the node's name, or the master's address.
    :param since: since when it is so (s since the epoch); 0.0: it was never there.
    :param text: for people, where there is more to say.
    """

    kind: str
    name: str
    is_up: bool
    since: float
    text: str = ""


class Manager(Protocol):
    """A skill manager. Every method may take time and is called by jobs only; each may raise `SkirosError` with the
    manager's text when it refuses, or does not answer."""

    @property
    def name(self) -> str:
        """Its node name. Takes no time."""

    def skills(self) -> list[Skill]:
        """The skills that it offers."""

    def command(self, action: str, task_id: int, skills: Sequence[Any] = ()) -> int:
        """Sends a command; returns the id of the task.

        :param action: `start` (a paused task goes on; with id -1 a new one of the skills begins), `preempt`, `pause` or
            `tick_once` (with id -1 and skills: a new one, ticked once and paused).
        :param skills: of a new task, run one after the other: each a `skiros2_skill.command_line.assignments.Step`, or
            what has its `type`, `label` and `params` (texts of JSON).
        """

    def tasks(self, task_id: int = -1) -> list[Sequence[Any]]:
        """The tasks that have not ended, ordered by id: of each the `SkillProgress` of each node."""

    def why(self, task_id: int) -> Any:
        """Why a task failed: `text` for people, and `json`, a list of `Explanation`."""

    def inspect(self, task_id: int, node_id: int) -> NodeStatus:
        """What a node of a task that has not ended is now: its parameters, and whether its conditions hold."""

    def breakpoint(self, action: str, kind: str = "", pattern: str = "", when: str = "", number: int = 0) -> Any:
        """`add`, `remove` or `list` breakpoints. Returns the number, and the list of those that there are."""


class Planner(Protocol):
    """The task manager. Called by jobs only; raises `SkirosError` when it refuses or does not answer."""

    def achieve(self, goals: str, told: Callable[[Any], None], wish: str = "", seconds: float = 0.0) -> Any:
        """Has goals planned and carried out; blocks until that has ended and returns an `AchieveResult`.

        :param told: called, in any thread, with each `AchieveFeedback`.
        """

    def cancel(self) -> None:
        """Ends what `achieve` is at, from another thread. Nothing, when nothing is under way."""


class System(Protocol):
    """What runs. All but `close` take no time; where a part is not there, it is None or missing."""

    @property
    def parts(self) -> Sequence[Part]:
        """What is up and what is not: the master, the world model, the task manager, and each manager that is or was
        there."""

    @property
    def world(self) -> WorldModelAbstractInterface | None:
        """The world model, for calls that may take time: writing, queries, files, history. For jobs only. None: it was
        not there yet. One that has gone raises `WmException` when it is called."""

    @property
    def scene(self) -> SceneReader | None:
        """The scene as it is known here, which is read in the window's thread without waiting: the context is "scene".
        What it reads may be newer than the last `WorldChanged`. Its last state stays when the world model has gone."""

    @property
    def ontology(self) -> Ontology | None:
        """The ontologies as they are known here, likewise."""

    @property
    def managers(self) -> dict[str, Manager]:
        """The managers that are up, by node name."""

    @property
    def planner(self) -> Planner | None:
        """The task manager; None when it is not up."""

    def mark(self, eid: str) -> None:
        """Views of the scene beside this window (rviz) let the user move this element; "": none."""

    def close(self) -> None:
        """Follows the system no more. Does not wait."""


def part_of(system: System, kind: str, name: str = "") -> Part | None:
    """The part of that kind, and of that name if one is given; None: it was never there."""
    return next((p for p in system.parts if p.kind == kind and name in ("", p.name)), None)
