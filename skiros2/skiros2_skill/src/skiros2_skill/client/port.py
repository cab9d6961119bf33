"""What the commands need of a skill manager: one over ROS (`manager.py`), or one in this process."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from typing import Any, Protocol

from skiros2_common.core.errors import SkirosError
from skiros2_common.core.explanation import Explanation
from skiros2_runs.core.progress import NodeMessage
from skiros2_skill.client.description import Skill, Step, Why
from skiros2_skill.core.start_preview import StartPreview
from skiros2_world_model.core.world_model_client import WorldModelClient

log = logging.getLogger(__name__)

#: The task id in a command for all tasks, or for a new one.
ALL = NEW = -1
#: The task id in a request for the last tasks that have ended.
ENDED = -2


class Feedback(Protocol):
    """The progress of a task; see `NodeMessage`."""

    @property
    def task_id(self) -> int: ...
    @property
    def progress(self) -> Sequence[NodeMessage]: ...


class RunPort(Protocol):
    """A task that was requested."""

    @property
    def task(self) -> int:
        """The id of the task; -1 before it is known, and when it was refused."""

    def wait(self, timeout: float | None = None) -> bool:
        """Waits for the end, at most `timeout` s. Returns whether it has ended or was refused."""

    def cancel(self) -> None:
        """Requests the preemption of the task. Returns at once."""

    def result(self) -> Any:
        """Waits for the end. Returns an `ExecuteSkillsResult`, or an object with its fields."""

    def succeeded(self) -> bool:
        """Waits for the end. Returns whether the task has succeeded."""

    def explanations(self) -> list[Explanation]:
        """Waits for the end. Returns why nodes failed, the last failure at the end."""


class ManagerPort(Protocol):
    """A skill manager. Each call raises `SkirosError` when the manager refuses or does not answer."""

    @property
    def name(self) -> str:
        """Its name, with a slash."""

    @property
    def author(self) -> str:
        """The client."""

    @property
    def world_model(self) -> WorldModelClient | None:
        """Its world model; None: that of its namespace, over ROS."""

    def read_skills(self) -> list[Skill]:
        """Returns the offered skills."""

    def command(self, action: str, task_id: int, skills: Sequence[Step] = ()) -> int:
        """Sends a command; see `ManagerClient.command`."""

    def preview(self, skills: Sequence[Step]) -> StartPreview:
        """Returns what a start of skills in sequence would do now; changes nothing."""

    def run(self, skills: Sequence[Step], monitor_cb: Callable[[Any], None]) -> RunPort:
        """Runs skills in sequence as a new task. `monitor_cb` is called with each `Feedback`, in another thread."""

    def why(self, task_id: int = -1) -> Why:
        """Returns why a task or its nodes failed; -1: the last task that failed or was refused."""

    def safety(self) -> Any:
        """Returns the `SafetyStatus` of the robot."""


def explain(manager: ManagerPort, run: RunPort) -> list[Explanation]:
    """Returns why nodes of an ended run failed, with the authors of changes as far as the manager knows them.

    :raises SkirosError: the result cannot be read.
    """
    if run.task >= 0 and not run.succeeded():
        try:
            return manager.why(run.task).explanations
        except SkirosError as error:
            log.debug("%s", error)
    return run.explanations()
