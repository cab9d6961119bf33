"""A whole system in one process: a world model, robots that run skills, and an executor of goals."""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from types import TracebackType

from skiros2_common.core.errors import ConfigurationError, SkirosError, UnknownName
from skiros2_common.core.explanation import cause_of
from skiros2_common.core.params import Param, ParamTypes
from skiros2_common.core.signals import LocalSignals
from skiros2_common.core.world_element import Element
from skiros2_local.progress import progress_of
from skiros2_runs.core.progress import NodeMessage
from skiros2_skill.core.library.library import SkillLibrary
from skiros2_skill.core.lint.linter import log_faults
from skiros2_skill.core.runtime.history import History, Record
from skiros2_skill.core.runtime.request import SkillRequest, TaskRefused, TaskStarter
from skiros2_skill.core.runtime.scheduler import Scheduler
from skiros2_skill.core.runtime.task import Task
from skiros2_skill.ros.registration import Registration
from skiros2_task.core.commands import End
from skiros2_task.core.engines import EngineProcesses, Limits
from skiros2_task.core.executor import GoalExecutor
from skiros2_task.core.goal_execution import Ended, Goal, GoalExecution
from skiros2_task.core.plan import Step
from skiros2_task.core.planners import engine_planner
from skiros2_task.core.planning import TaskPlanner, Verdict
from skiros2_task.core.step_record import StepRecord
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.world_model import WorldModel

#: Receives the progress of each node of a task, parents before children, in a ticking thread of its robot.
OnProgress = Callable[[Sequence[NodeMessage]], None]

#: The longest search for a plan (s).
_PLANNING_TIME = 30.0


class LocalRobot:
    """A robot of the scene with its skills: what a skill manager is with ROS.

    :param model: the world model.
    :param label: of the robot's element, with its prefix, such as `demo:mobile_manipulator`.
    :param libraries: Python packages with skills.
    :param skills: class names of the skills to load.
    :param on_progress: see `OnProgress`.
    :raises ConfigurationError: a package, a skill or the robot does not exist.
    """

    def __init__(
        self, model: WorldModel, label: str, libraries: Sequence[str], skills: Sequence[str], on_progress: OnProgress
    ) -> None:
        prefix, _, name = label.rpartition(":")
        #: The name of its manager, with the slash that a node's name has.
        self.name = f"/{name}"
        self._wmi = LocalWorldModel(self.name, model)
        self._on_progress = on_progress
        library = SkillLibrary(self._wmi, log_faults)
        library.import_libraries(libraries)
        library.load(skills)
        self._registration = Registration(self._wmi, prefix, name, self.name)
        self._registration.register(library.implementations())
        self._history = History()
        self._ends: dict[int, Ended] = {}
        self._lock = threading.Lock()
        self.scheduler = Scheduler(on_progress=self._report, signals=LocalSignals())
        self._wmi.add_listener(self.scheduler.on_change)
        self._starter = TaskStarter(
            library, self._wmi, self.scheduler, self._history, lambda: self._registration.robot
        )

    @property
    def element(self) -> str:
        """The id of its element."""
        return self._registration.robot_id

    def start(self, skill: str, label: str, params: dict[str, object], ended: Ended, author: str = "") -> int:
        """Starts a skill. Returns the id of its task. Any thread.

        :param skill: its type.
        :param label: of the implementation; "": any.
        :param ended: called once at the end, in a ticking thread.
        :raises TaskRefused: the request is wrong; the text says why.
        """
        given = {key: Param(key, "", value, ParamTypes.Required) for key, value in params.items()}
        task = self._starter.make(author, [SkillRequest(skill, label, given)])
        with self._lock:
            self._ends[task.id] = ended
        self.scheduler.start(task.id)
        return task.id

    def stop(self, task_id: int) -> None:
        """Preempts a task, unless it has ended."""
        try:
            self.scheduler.preempt(task_id)
        except UnknownName:
            return

    def why(self, task_id: int = -1) -> Record:
        """Returns the record of a task; by default of the last one that failed or was refused.

        :raises UnknownName: there is none.
        """
        return self._history.get(task_id)

    def close(self) -> None:
        """Preempts all tasks and ends the threads."""
        self._wmi.remove_listener(self.scheduler.on_change)
        self.scheduler.stop()

    def _report(self, task: Task) -> None:
        record = self._history.end(task) if task.ended.is_set() else None
        try:
            self._on_progress(progress_of(task, self.name))
        finally:
            if record is not None:
                with self._lock:
                    ended = self._ends.pop(task.id, None)
                if ended is not None:
                    message = cause_of(record.explanations, record.message) if record.failed else record.message
                    ended(not record.failed, message, record.explanations)


class LocalGoal:
    """A goal in execution.

    :ivar steps: the steps of the plan, and those that have started, in the order of their numbers.
    :ivar events: what has happened, such as the reason of a new plan; at the end the result.
    :ivar reached: whether the goal holds; False while it is executed.
    """

    def __init__(self) -> None:
        self.steps: list[StepRecord] = []
        self.events: list[str] = []
        self.reached = False
        self._ended = threading.Event()
        self._cancel: Callable[[], None] = lambda: None

    @property
    def has_ended(self) -> bool:
        """Whether it is reached, cancelled or given up."""
        return self._ended.is_set()

    @property
    def message(self) -> str:
        """The last event, at the end the result."""
        return self.events[-1] if self.events else ""

    def cancel(self) -> None:
        """Stops the running steps and ends the goal."""
        self._cancel()

    def wait(self, timeout: float | None = None) -> LocalGoal:
        """Waits for the end, at most `timeout` s. Returns itself."""
        self._ended.wait(timeout)
        return self

    def _change(self, execution: GoalExecution, message: str = "") -> None:
        records = execution.machine.records
        self.steps = [records[number] for number in sorted(records)]
        event = message or execution.machine.message
        if event != self.message:
            self.events.append(event)

    def _end(self, execution: GoalExecution, end: End) -> None:
        self._change(execution, end.message)
        self.reached = end.verdict in (Verdict.PLANNED, Verdict.NOTHING_TO_DO)
        self._ended.set()


class LocalSystem:
    """A system in this process. A context manager.

    :param scene: Turtle file; the ontologies (`*.owl*`) in its folder are loaded.
    :param on_progress: see `OnProgress`.
    :raises SkirosError: the scene cannot be loaded.
    """

    def __init__(self, scene: Path, on_progress: OnProgress = lambda nodes: None) -> None:
        self.model = WorldModel(source_ontologies(), scene.parent)
        self.model.load_initial(scene.name)
        #: The world model, for the user of this system.
        self.world = LocalWorldModel("user", self.model)
        self.robots: dict[str, LocalRobot] = {}
        self._on_progress = on_progress
        self._processes = EngineProcesses()
        planning = LocalWorldModel("task_manager", self.model)
        engine = engine_planner(self._processes)
        self.planner = TaskPlanner(planning, engine, Limits(_PLANNING_TIME), running=self._running)
        self._executor = GoalExecutor(self.planner, self)
        planning.add_listener(self._executor.world_changed)

    def __enter__(self) -> LocalSystem:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Cancels all goals, preempts all tasks and ends all threads and processes."""
        self._executor.close()
        for robot in self.robots.values():
            robot.close()
        self._processes.close()

    def add_robot(self, label: str, libraries: Sequence[str], skills: Sequence[str]) -> LocalRobot:
        """Starts a robot of the scene; see `LocalRobot`."""
        robot = LocalRobot(self.model, label, libraries, skills, self._on_progress)
        if robot.name in self.robots:
            robot.close()
            raise ConfigurationError(f"there is a robot {robot.name} already")
        self.robots[robot.name] = robot
        return robot

    def _running(self, _: Collection[str]) -> dict[str, str]:
        return {robot.name: robot.element for robot in self.robots.values()}

    def element(self, label: str) -> Element:
        """Returns the thing with a label.

        :raises UnknownName: there is not exactly one.
        """
        things = [thing for thing in self.world.resolve_elements(Element("sumo:Object")) if thing.label]
        found = [element for element in things if element.label == label]
        if len(found) != 1:
            labels = sorted(element.label for element in things)
            raise UnknownName(f"{len(found)} elements are labelled {label!r}; there are: {', '.join(labels)}")
        return found[0]

    def achieve(self, text: str, on_change: Callable[[LocalGoal], None] = lambda goal: None) -> LocalGoal:
        """Starts to plan and execute a goal. Does not block.

        :param text: see `skiros2_task.core.goal_text`.
        :param on_change: called after each change of a step and at the end, in the executor's thread.
        """
        goal = LocalGoal()

        def changed(execution: GoalExecution) -> None:
            goal._change(execution)
            on_change(goal)

        def ended(execution: GoalExecution, end: End) -> None:
            goal._end(execution, end)
            on_change(goal)

        execution = self._executor.achieve(Goal(text), changed, ended)
        goal._cancel = lambda: self._executor.cancel(execution)
        return goal

    def attach(self, step: Step, run: str, known: Callable[[bool], None], ended: Ended) -> Callable[[], None]:
        """See `StepRunner`. The steps of an earlier process have ended with it."""
        known(False)
        return lambda: None

    def start(self, step: Step, ended: Ended, run: str = "") -> Callable[[], None]:
        """Starts a step of a plan; see `StepRunner`."""
        call = step.call
        robot = self.robots.get(call.manager) or self.robots.get(f"/{call.manager}")
        if robot is None:
            ended(False, f"no robot {call.manager} runs; there are: {', '.join(self.robots) or 'none'}", ())
            return lambda: None
        try:
            task_id = robot.start(call.type, call.label, dict(call.arguments), ended, "task_manager")
        except TaskRefused as refused:
            ended(False, cause_of(refused.record.explanations, str(refused)), refused.record.explanations)
            return lambda: None
        except SkirosError as error:
            ended(False, str(error), ())
            return lambda: None
        return lambda: robot.stop(task_id)
