"""A whole system in one process: a world model, robots that run skills, and an executor of goals."""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

from skiros2_common.core.errors import ConfigurationError, SkirosError, UnknownName
from skiros2_common.core.explanation import cause_of
from skiros2_common.core.operations import SCENE
from skiros2_common.core.params import Param, ParamTypes
from skiros2_common.core.signals import LocalSignals
from skiros2_common.core.world_element import Element
from skiros2_common.tools.libraries import find_libraries
from skiros2_local.progress import progress_of
from skiros2_runs.core.progress import NodeMessage
from skiros2_skill.core.library.library import SkillLibrary
from skiros2_skill.core.lint.linter import log_findings
from skiros2_skill.core.runtime.history import History, Record, outputs_of
from skiros2_skill.core.runtime.request import SkillRequest, TaskRefused, TaskStarter
from skiros2_skill.core.runtime.scheduler import Scheduler
from skiros2_skill.core.runtime.task import Task
from skiros2_skill.ros.registration import Registration
from skiros2_task.core import goal_report
from skiros2_task.core.commands import End
from skiros2_task.core.engines import EngineProcesses, Limits
from skiros2_task.core.executor import GoalExecutor
from skiros2_task.core.goal_execution import Began, Ended, Goal, GoalExecution
from skiros2_task.core.goal_report import GoalProgress, GoalResult
from skiros2_task.core.plan import Step
from skiros2_task.core.planners import engine_planner
from skiros2_task.core.planning import TaskPlanner, Verdict
from skiros2_task.core.step_record import StepRecord
from skiros2_world_model.core.journal import Journal
from skiros2_world_model.core.knowledge_base import KnowledgeBase
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.rdf import read_triples
from skiros2_world_model.core.world_model import WorldModel

#: Receives the progress of each node of a task, parents before children, in a ticking thread of its robot.
OnProgress = Callable[[Sequence[NodeMessage]], None]

#: The library that trees use by type; its skills are not loaded unless they are named.
STANDARD_SKILLS = "skiros2_std_skills"

#: The longest search for a plan (s).
_PLANNING_TIME = 30.0


@dataclass(frozen=True)
class TaskRequest:
    """Skills to run in sequence, as one task.

    :param ended: called once at the end with the record and the final parameters, in a ticking thread.
    :param on_progress: called with the progress of this task; see `OnProgress`.
    :param goal: of which it is a step; "": none.
    """

    skills: Sequence[SkillRequest]
    author: str
    ended: Callable[[Record, dict[str, Param]], None]
    on_progress: OnProgress = lambda nodes: None
    goal: str = ""


class LocalRobot:
    """A robot of the scene with its skills: what a skill manager is with ROS.

    :param model: the world model.
    :param label: of the robot's element, with its prefix, such as `demo:mobile_manipulator`.
    :param libraries: Python packages with skills. Trees also find the skills of `skiros2_std_skills`.
    :param skills: class names of the skills to load; None: all of the libraries, except the standard skills.
    :param on_progress: see `OnProgress`.
    :param records: of its tasks in an earlier process.
    :raises ConfigurationError: a package, a skill or the robot does not exist.
    """

    def __init__(
        self,
        model: WorldModel,
        label: str,
        libraries: Sequence[str],
        skills: Sequence[str] | None,
        on_progress: OnProgress,
        records: Sequence[Record] = (),
    ) -> None:
        prefix, _, name = label.rpartition(":")
        #: The name of its manager, with the slash that a node's name has.
        self.name = f"/{name}"
        self.world = LocalWorldModel(self.name, model)
        self._on_progress = on_progress
        self.library = SkillLibrary(self.world, log_findings)
        self.library.import_libraries([*dict.fromkeys([*libraries, STANDARD_SKILLS])])
        own = [name for library in libraries if library != STANDARD_SKILLS for name in self.library.names_in(library)]
        self.library.load(own if skills is None else skills)
        self._registration = Registration(self.world, prefix, name, self.name)
        with model.unrecorded():
            self._registration.register(self.library.implementations())
        self._history = History(records=records)
        self._requests: dict[int, TaskRequest] = {}
        self._lock = threading.Lock()
        first_id = 1 + max((record.task_id for record in records), default=-1)
        self.scheduler = Scheduler(on_progress=self._report, signals=LocalSignals(), first_id=first_id)
        self.world.add_listener(self.scheduler.on_change)
        self.starter = TaskStarter(
            self.library, self.world, self.scheduler, self._history, lambda: self._registration.robot
        )

    @property
    def element(self) -> str:
        """The id of its element."""
        return self._registration.robot_id

    @property
    def records(self) -> list[Record]:
        """The records of its ended and refused tasks, oldest first."""
        return self._history.records

    def start(
        self, skill: str, label: str, params: dict[str, object], ended: Ended, author: str = "", goal: str = ""
    ) -> int:
        """Starts a skill. Returns the id of its task. Any thread.

        :param skill: its type.
        :param label: of the implementation; "": any.
        :param ended: called once at the end, in a ticking thread.
        :param goal: of which it is a step; "": none.
        :raises TaskRefused: the request is wrong; the text says why.
        """
        given = {key: Param(key, "", value, ParamTypes.Required) for key, value in params.items()}

        def end(record: Record, outputs: dict[str, Param]) -> None:
            message = cause_of(record.explanations, record.message) if record.failed else record.message
            ended(not record.failed, message, record.explanations)

        return self.start_task(TaskRequest([SkillRequest(skill, label, given)], author, end, goal=goal))

    def start_task(self, request: TaskRequest) -> int:
        """Starts a task. Returns its id. Any thread.

        :raises TaskRefused: the request is wrong; the text says why.
        """
        task = self.starter.make(request.author, request.skills, request.goal)
        with self._lock:
            self._requests[task.id] = request
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
        self.world.remove_listener(self.scheduler.on_change)
        self.scheduler.stop()

    def _report(self, task: Task) -> None:
        record = self._history.end(task) if task.ended.is_set() else None
        with self._lock:
            request = self._requests.get(task.id) if record is None else self._requests.pop(task.id, None)
        progress = progress_of(task, self.name)
        try:
            self._on_progress(progress)
            if request is not None:
                request.on_progress(progress)
        finally:
            if record is not None and request is not None:
                request.ended(record, outputs_of(task))


class LocalGoal:
    """A goal in execution.

    :ivar steps: the steps of the plan, and those that have started, in the order of their numbers.
    :ivar events: what has happened, such as the reason of a new plan; at the end the result.
    :ivar reached: whether the goal holds; False while it is executed.
    :ivar progress: as the action `achieve` has it; None before the start.
    :ivar result: as the action `achieve` has it; None before the end.
    """

    def __init__(self) -> None:
        self.steps: list[StepRecord] = []
        self.events: list[str] = []
        self.reached = False
        self.progress: GoalProgress | None = None
        self.result: GoalResult | None = None
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
        self.progress = goal_report.progress_of(execution)
        self.steps = [records[number] for number in sorted(records)]
        event = message or execution.machine.message
        if event != self.message:
            self.events.append(event)

    def _end(self, execution: GoalExecution, end: End) -> None:
        self._change(execution, end.message)
        self.result = goal_report.result_of(execution, end)
        self.reached = end.verdict in (Verdict.PLANNED, Verdict.NOTHING_TO_DO)
        self._ended.set()


class LocalSystem:
    """A system in this process. A context manager.

    :param scene: Turtle file; the ontologies (`*.owl*`) in its folder are loaded.
    :param on_progress: see `OnProgress`.
    :param ontologies: further ontology files.
    :param journal: records the changes; the system recovers from it if the journal says so. None: no journal.
    :param recorded: the journal of another process, in place of an own one; see `WorldModel`.
    :raises SkirosError: the scene cannot be loaded.
    """

    def __init__(
        self,
        scene: str | Path,
        on_progress: OnProgress = lambda nodes: None,
        *,
        ontologies: Iterable[Path] = (),
        journal: Journal | None = None,
        recorded: Path | None = None,
    ) -> None:
        self.scene = Path(scene)
        if not self.scene.is_file():
            raise ConfigurationError(f"scene {scene}: there is no such file")
        folder = self.scene.absolute().parent
        knowledge_base = KnowledgeBase(source_ontologies(), folder)
        for file in ontologies:
            knowledge_base.update((), read_triples(file))
        self.model = WorldModel(
            workspace=folder, journal=journal, recorded=recorded, initial=[(SCENE, self.scene.name)],
            knowledge_base=knowledge_base,
        )  # fmt: skip
        #: The world model, for the user of this system.
        self.world = LocalWorldModel("user", self.model)
        self.robots: dict[str, LocalRobot] = {}
        self._on_progress = on_progress
        self.processes = EngineProcesses()
        planning = LocalWorldModel("task_manager", self.model)
        engine = engine_planner(self.processes)
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
        self.processes.close()

    def add_robot(
        self,
        label: str,
        libraries: Sequence[str],
        skills: Sequence[str] | None = None,
        records: Sequence[Record] = (),
    ) -> LocalRobot:
        """Starts a robot of the scene; see `LocalRobot`. Libraries beside the scene need not be installed."""
        find_libraries(libraries, self.scene.parent)
        robot = LocalRobot(self.model, label, libraries, skills, self._on_progress, records)
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

    def achieve(self, text: str | Goal, on_change: Callable[[LocalGoal], None] = lambda goal: None) -> LocalGoal:
        """Starts to plan and execute a goal. Does not block.

        :param text: see `skiros2_task.core.goal_text`; or a `Goal` with options.
        :param on_change: called after each change of a step and at the end, in the executor's thread.
        """
        goal = LocalGoal()
        wanted = Goal(text) if isinstance(text, str) else text

        def changed(execution: GoalExecution) -> None:
            goal._change(execution)
            on_change(goal)

        def ended(execution: GoalExecution, end: End) -> None:
            goal._end(execution, end)
            on_change(goal)

        execution = self._executor.achieve(wanted, changed, ended)
        goal._cancel = lambda: self._executor.cancel(execution)
        return goal

    def attach(
        self, step: Step, run: str, known: Callable[[bool], None], ended: Ended, began: Began | None = None
    ) -> Callable[[], None]:
        """See `StepRunner`. The steps of an earlier process have ended with it."""
        known(False)
        return lambda: None

    def start(
        self, step: Step, ended: Ended, run: str = "", began: Began | None = None, goal: str = ""
    ) -> Callable[[], None]:
        """Starts a step of a plan; see `StepRunner`."""
        call = step.call
        robot = self.robots.get(call.manager) or self.robots.get(f"/{call.manager}")
        if robot is None:
            ended(False, f"no robot {call.manager} runs; there are: {', '.join(self.robots) or 'none'}", ())
            return lambda: None
        try:
            task_id = robot.start(call.type, call.label, dict(call.arguments), ended, "task_manager", goal)
        except TaskRefused as refused:
            ended(False, cause_of(refused.record.explanations, str(refused)), refused.record.explanations)
            return lambda: None
        except SkirosError as error:
            ended(False, str(error), ())
            return lambda: None
        if began is not None:
            began(task_id)
        return lambda: robot.stop(task_id)
