"""The context that the parts of a window share: the system, jobs, tasks, problems and the event bus."""

from __future__ import annotations

from skiros2_gui.app.context import WindowContext
from skiros2_gui.app.events import EventQueue
from skiros2_gui.app.jobs import Jobs
from skiros2_gui.app.problems import Problems
from skiros2_gui.app.system import System
from skiros2_gui.app.tasks import TaskList


class Window(WindowContext):
    """The context of one window. Used in the window's thread only, except `post`.

    :param event_queue: the queue that the system puts its events into.
    """

    def __init__(self, system: System, jobs: Jobs, problems: Problems, event_queue: EventQueue) -> None:
        super().__init__(system, jobs, problems, event_queue)
        self.tasks = TaskList(self)
