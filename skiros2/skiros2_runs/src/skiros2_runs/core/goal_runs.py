"""Goals as tasks: the tree of a goal has the trees of its steps, in the order of the plans, below one root.

A goal is recorded as a task of `GOALS`, so that views show it like any other. A step is the skill that its task runs;
one that has not started, or whose task is not known, is a node without children.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from skiros2_common.core.manager_names import matching_name
from skiros2_runs.core.goal_progress import ACTIVE_PHASES
from skiros2_runs.core.progress import GOAL_TYPE, NodeMessage, status_text
from skiros2_runs.core.runs import Runs
from skiros2_runs.core.states import FAILURE, IDLE, RUNNING, SUCCESS, TaskState
from skiros2_runs.core.task_run import Recorded, TaskRun

#: Stands for the manager of tasks that are goals.
GOALS = "goals"

#: The phases of goals that were reached.
_REACHED = ("succeeded", "nothing_to_do")

_STATES = {"waiting": IDLE, "dropped": IDLE, "running": RUNNING, "succeeded": SUCCESS}
_ENDED = ("succeeded", "failed", "stopped")

#: The id of a step's node is a multiple of this; the ids of its descendants follow. Ids of managers have 16 bits.
_STEP_IDS = 1 << 16


@dataclass(slots=True)
class _Param:
    param: str


@dataclass(slots=True)
class _Node:
    """A `NodeMessage`."""

    task_id: int
    id: int
    parent_id: int
    type: str
    label: str
    state: int
    progress_code: int = 0
    progress_time: float = 0.0
    progress_message: str = ""
    processor: str = ""
    params: Sequence[Any] = ()
    robot: str = GOALS


@dataclass
class _Step:
    """A step with its nodes.

    :param data: as in a plan; `state`: as in `goal_progress`.
    :param run: its task; None if it is not known.
    :param source: the nodes of its task that `nodes` was made of.
    :param ids: the ids of its task's nodes, by those in the goal's tree.
    """

    data: Mapping[str, Any]
    state: Mapping[str, Any] = field(default_factory=dict)
    run: TaskRun | None = None
    source: Sequence[NodeMessage] = ()
    nodes: list[_Node] = field(default_factory=list)
    ids: dict[int, int] = field(default_factory=dict)

    @property
    def base(self) -> int:
        """The id of its node."""
        return int(self.data["number"]) * _STEP_IDS


@dataclass
class _Goal:
    number: int
    title: str
    data: Mapping[str, Any]
    steps: dict[int, _Step] = field(default_factory=dict)
    run: TaskRun | None = None
    nodes: list[_Node] = field(default_factory=list)  # of the last message


class GoalRuns:
    """Records the goals of a task manager. One thread at a time.

    :param runs: has the tasks of the steps, and gets the goals.
    """

    def __init__(self, runs: Runs) -> None:
        self._runs = runs
        self._goals: dict[str, _Goal] = {}
        self._count = 0
        self._steps: dict[TaskRun, tuple[_Goal, _Step]] = {}

    def update(self, goal_id: str, title: str, data: Mapping[str, Any], time: float) -> Recorded:
        """Records the progress of a goal.

        :param title: of the root.
        :param data: see `goal_progress`.
        :param time: s since the epoch.
        """
        self._forget()
        goal = self._goals.get(goal_id)
        if goal is None:
            self._count += 1
            goal = self._goals[goal_id] = _Goal(self._count, title, data)
        goal.data, goal.title = data, title
        for planned in sorted(data["plan"], key=lambda step: int(step["number"])):
            step = goal.steps.setdefault(int(planned["number"]), _Step(planned))
            step.state = data["steps"].get(str(planned["number"]), {})
            if step.run is None and "task" in step.state:
                found = self._find(str(planned["robot"]), step.state["task"], data["start"])
                if found is not None:
                    step.run = found
                    self._steps[found] = goal, step
        return self._record(goal, time)

    def step_recorded(self, run: TaskRun, time: float) -> Recorded | None:
        """Records a new tick of a task. Returns what has changed of its goal; None if it is not a step's.

        :param time: s since the epoch.
        """
        known = self._steps.get(run)
        if known is None:
            for goal in self._goals.values():
                for step in goal.steps.values():
                    is_open = step.run is None or step.run.is_lost  # its manager was only silent, and has returned
                    if is_open and step.state.get("task") == run.task_id and self._is_on(step, run.robot):
                        step.run = run
                        known = self._steps[run] = goal, step
        return self._record(known[0], time) if known is not None else None

    def goal_of(self, run: TaskRun) -> TaskRun | None:
        """Returns the goal of a step's task; None for other tasks."""
        known = self._steps.get(run)
        return known[0].run if known is not None else None

    def id_of(self, run: TaskRun) -> str:
        """Returns the id of a goal; "" for other tasks."""
        return next((goal_id for goal_id, goal in self._goals.items() if goal.run is run), "")

    def tasks(self, run: TaskRun) -> Iterator[TaskRun]:
        """Yields the tasks of a goal's steps, in the order of the steps; none for other tasks."""
        goal = next((goal for goal in self._goals.values() if goal.run is run), None)
        yield from (step.run for step in goal.steps.values() if step.run is not None) if goal is not None else ()

    def origin(self, run: TaskRun, node: int) -> tuple[TaskRun, int] | None:
        """Returns the task and the id of a node in a goal's tree; None if it is in no task. Others are their own."""
        if run.robot != GOALS:
            return run, node
        goal = next((goal for goal in self._goals.values() if goal.run is run), None)
        step = goal.steps.get(node // _STEP_IDS) if goal is not None else None
        if step is None or step.run is None or node not in step.ids:
            return None
        return step.run, step.ids[node]

    def robot_of(self, run: TaskRun, node: int) -> str:
        """Returns the manager of a node; "" for the root of a goal."""
        if run.robot != GOALS:
            return run.robot
        goal = next((goal for goal in self._goals.values() if goal.run is run), None)
        step = goal.steps.get(node // _STEP_IDS) if goal is not None else None
        return "" if step is None else step.run.robot if step.run is not None else str(step.data["robot"])

    # -- internals ---------------------------------------------------------------------------------------------

    def _find(self, robot: str, task: int, since: float) -> TaskRun | None:
        """Returns the newest run of a task; not one of an earlier task with its number."""
        found = (run for run in self._runs if run.task_id == task and matching_name(robot, [run.robot]))
        return next((run for run in reversed(list(found)) if run.latest.time >= since), None)

    def _is_on(self, step: _Step, robot: str) -> bool:
        return step.state.get("state") == "running" and bool(matching_name(str(step.data["robot"]), [robot]))

    def _forget(self) -> None:
        """Forgets goals and tasks that are no longer kept."""
        kept = set(self._runs)
        self._goals = {key: goal for key, goal in self._goals.items() if goal.run is None or goal.run in kept}
        self._steps = {run: known for run, known in self._steps.items() if run in kept or known[0].run in kept}

    def _record(self, goal: _Goal, time: float) -> Recorded:
        if goal.run is not None:
            time = max(time, goal.run.latest.time)  # messages of robots and the task manager may overtake each other
        nodes = [self._root(goal, time)]
        for step in goal.steps.values():
            nodes += _nodes_of(goal, step, time)
        for index, (old, new) in enumerate(zip(goal.nodes, nodes, strict=False)):
            if old is not new and old == new:
                nodes[index] = old  # counts as unchanged
        goal.nodes = nodes
        recorded = self._runs.record(GOALS, nodes, time)
        assert recorded is not None, "there is a root"
        goal.run = recorded.run
        return recorded

    def _root(self, goal: _Goal, time: float) -> _Node:
        data = goal.data
        phase, state, code = data["phase"], RUNNING, 0
        params: tuple[_Param, ...] = ()
        if phase not in ACTIVE_PHASES:
            state, code = (SUCCESS, 1) if phase in _REACHED else (FAILURE, -1)
            params = (_Param(status_text(TaskState.PREEMPTED)),) if phase == "cancelled" else ()
        else:
            runs = [step.run for step in goal.steps.values() if step.run is not None and not step.run.is_finished]
            if runs and all(run.state is TaskState.PAUSED for run in runs):
                params = (_Param(status_text(TaskState.PAUSED)),)
        age = max(0.0, time - data["start"]) if not code else 0.0
        text = data["message"] if code or phase != "running" else ""
        return _Node(goal.number, 0, -1, GOAL_TYPE, goal.title, state, code, age, text, params=params)


def _nodes_of(goal: _Goal, step: _Step, time: float) -> list[_Node]:
    """Returns the nodes of a step, its own first."""
    source = step.run.nodes if step.run is not None else ()
    if len(source) > 1:
        _convert(goal, step, source)
        first = step.nodes[0]
        state, text = step.state.get("state", ""), step.state.get("message", "")
        is_known = step.run is not None and not step.run.is_finished and goal.data["phase"] in ACTIVE_PHASES
        if state in _ENDED and first.state in (RUNNING, IDLE) and not is_known:  # its manager has disappeared
            return [_ended(first, state, text), *step.nodes[1:]]
        return step.nodes
    data, state = step.data, step.state.get("state", "waiting")
    text = step.state.get("message", "") or ("replaced by another plan" if state == "dropped" else "")
    age = time - step.state["began"] if state == "running" else 0.0
    label = str(data.get("label") or data.get("skill", ""))
    return [
        _Node(goal.number, step.base, 0, str(data.get("skill", "")), label, _STATES.get(state, FAILURE), 0, age, text)
    ]


def _ended(node: _Node, state: str, text: str) -> _Node:
    code = 1 if state == "succeeded" else -1
    return _Node(
        node.task_id, node.id, node.parent_id, node.type, node.label, _STATES.get(state, FAILURE), code,
        node.progress_time, text or node.progress_message, node.processor,
    )  # fmt: skip


def _convert(goal: _Goal, step: _Step, source: Sequence[NodeMessage]) -> None:
    """Makes `nodes` of the nodes of the step's task; those that are the same objects as before are kept."""
    if source is step.source:
        return
    root, top = source[0], source[1]

    def new_id(old: int) -> int:
        if old == root.id:
            return 0
        return step.base if old == top.id else step.base + 1 + old % (_STEP_IDS - 1)

    before, nodes, ids = step.source, [], {}
    for index, node in enumerate(source[1:]):
        number = new_id(node.id)
        ids[number] = node.id
        if index < len(step.nodes) and before[index + 1] is node:
            nodes.append(step.nodes[index])
            continue
        nodes.append(
            _Node(
                goal.number, number, new_id(node.parent_id), node.type, node.label, node.state, node.progress_code,
                node.progress_time, node.progress_message, node.processor,
            )
        )  # fmt: skip
    step.source, step.nodes, step.ids = source, nodes, ids
