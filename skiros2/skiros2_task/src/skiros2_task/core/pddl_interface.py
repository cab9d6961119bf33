"""Names of SkiROS2's PDDL module, for existing code that imports it. The import warns.

Plans are requested from the task manager (`skiros2_task.ros.task_manager_interface`), or made in process by
`skiros2_task.core.planning.TaskPlanner`.
"""

from __future__ import annotations

import logging
import warnings
from pathlib import Path

from skiros2_task.core.actions import Action
from skiros2_task.core.engines import DOMAIN_FILE, PROBLEM_FILE
from skiros2_task.core.formula import Atom as GroundPredicate
from skiros2_task.core.formula import ForAll as ForallPredicate
from skiros2_task.core.formula import Predicate
from skiros2_task.core.store import FOLDER

__all__ = ["Action", "ForallPredicate", "GroundPredicate", "PddlInterface", "Predicate"]

_WARNING = (
    "skiros2_task.core.pddl_interface is for existing imports only; "
    "request plans with skiros2_task.ros.task_manager_interface.TaskManagerInterface"
)
warnings.warn(_WARNING, DeprecationWarning, stacklevel=2)
logging.getLogger(__name__).warning("%s", _WARNING)


class PddlInterface:
    """Reads the PDDL of the last goal that a task manager of this user has planned for.

    :param workspace: the folder of the files.
    """

    def __init__(self, workspace: str | Path = FOLDER) -> None:
        self._folder = Path(workspace).expanduser()

    def printDomain(self) -> str:
        """Returns the domain.

        :raises FileNotFoundError: no goal was planned for.
        """
        return (self._folder / DOMAIN_FILE).read_text(encoding="utf-8")

    def printProblem(self) -> str:
        """Returns the problem.

        :raises FileNotFoundError: no goal was planned for.
        """
        return (self._folder / PROBLEM_FILE).read_text(encoding="utf-8")
