"""The presenter of the tab "Running": the shown task, live or at an earlier tick."""

from __future__ import annotations

import enum
import heapq
import weakref
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from skiros2_gui.app.events import RunRecorded, TasksChanged, TaskStarted
from skiros2_gui.app.tasks import PAUSE, RESUME
from skiros2_gui.app.window import Window
from skiros2_gui.run.breakpoints import Breakpoints
from skiros2_gui.run.node import NodeText, SelectedNode
from skiros2_gui.run.tree import RunTree
from skiros2_runs.core.frame import Frame
from skiros2_runs.core.states import TaskState
from skiros2_runs.core.task_run import TaskRun


class Redraw(enum.Flag):
    """The parts of the tab to redraw."""

    TASKS = enum.auto()
    TREE = enum.auto()
    STATES = enum.auto()
    NODE = enum.auto()
    BREAKPOINTS = enum.auto()
    ALL = TASKS | TREE | STATES | NODE | BREAKPOINTS


@dataclass(frozen=True)
class RunBag:
    """The tasks of a bag, oldest first; goals instead of the tasks of their steps.

    :param damage: where and why the bag ends early; "" if it is complete.
    """

    path: str
    runs: list[TaskRun]
    damage: str


class RunPresenter:
    """Used in the window's thread.

    :ivar run: the shown task; None for none.
    :ivar tick: the index of the shown tick; None for live.
    :ivar bag: the bag whose tasks are shown; None for live tasks.
    :ivar follows: whether the view keeps the running node in view.
    :ivar on_change: called with the parts to redraw. Called often: the view should combine calls.
    """

    def __init__(self, window: Window) -> None:
        self._window = window
        self._trees: weakref.WeakKeyDictionary[TaskRun, RunTree] = weakref.WeakKeyDictionary()
        self._no_tree = RunTree()
        self._awaited_task: tuple[str, int] | None = None
        self._is_pinned = False
        self._cached_frame: tuple[TaskRun, float, Frame] | None = None
        self.run: TaskRun | None = None
        self.tick: int | None = None
        self._tick_time = 0.0  # the time of the shown tick
        self.bag: RunBag | None = None
        self.follows = True
        self.on_change: Callable[[Redraw], None] = lambda part: None
        self.breakpoints = Breakpoints(window, lambda: self.on_change(Redraw.BREAKPOINTS | Redraw.STATES))
        self.node = SelectedNode(window, lambda: self.on_change(Redraw.NODE))
        self._live = window.tasks
        window.subscribe(RunRecorded, self._on_run)
        window.subscribe(TasksChanged, lambda _: self._on_tasks())
        window.subscribe(TaskStarted, self._on_started)

    # -- tasks -----------------------------------------------------------------------------------------------------

    @property
    def runs(self) -> Sequence[TaskRun]:
        """The tasks to choose from, oldest first; goals instead of the tasks of their steps."""
        return self._live.shown if self.bag is None else self.bag.runs

    @property
    def task(self) -> TaskRun | None:
        """The shown task; of a goal the task of the step that has started last, None before the first."""
        if self.run is None or self.bag is not None:
            return self.run
        return max(self._live.tasks_of(self.run), key=lambda run: (not run.is_finished, run.start), default=None)

    @property
    def robot(self) -> str:
        """The manager of the shown task; without a task the only manager, if there is one; else ""."""
        if self.task is not None and self.bag is None:
            return self.task.robot
        managers = list(self._window.system.managers)
        return managers[0] if len(managers) == 1 else ""

    @property
    def is_live(self) -> bool:
        """Whether the shown task is running and shown live."""
        run = self.run
        return self.bag is None and self.tick is None and run is not None and not run.is_finished

    @property
    def is_paused(self) -> bool:
        return self.is_live and self.run is not None and self.run.state is TaskState.PAUSED

    def pick(self, run: TaskRun) -> None:
        """Shows a task until it has ended; a task that has ended stays until another one is picked."""
        self._is_pinned = run.is_finished
        self._show(run)

    def command(self, action: str) -> None:
        """Sends a command for the shown task."""
        run = self.run
        if run is not None and self.is_live:
            self._live.command(action, run.robot, run.task_id)

    def toggle(self) -> None:
        """Pauses or resumes the shown task."""
        self.command(RESUME if self.is_paused else PAUSE)

    # -- bags ------------------------------------------------------------------------------------------------------

    def open_bag(self, path: str) -> None:
        """Shows the tasks of a bag."""
        self._window.jobs.run(lambda: _read_bag(path), self._take_bag, activity=f"reading {path}", queue="bag")

    def close_bag(self) -> None:
        """Shows the live tasks again."""
        if self.bag is not None:
            self.bag = None
            self._is_pinned = False
            self._show(self._live.newest())

    def _take_bag(self, bag: RunBag) -> None:
        self.bag = bag
        if bag.damage:
            self._window.problems.report(bag.path, f"the bag is not whole: {bag.damage}")
        self._show(next(iter(bag.runs), None))
        self.go_to(0)

    # -- the shown tree --------------------------------------------------------------------------------------------

    @property
    def tree(self) -> RunTree:
        """The folding, selection and search of the shown task."""
        if self.run is None:
            return self._no_tree
        tree = self._trees.get(self.run)
        if tree is None:
            tree = self._trees[self.run] = RunTree()
        return tree

    @property
    def frame(self) -> Frame | None:
        """The tree at the shown tick."""
        run = self.run
        if run is None:
            return None
        if self.tick is None:
            return run.latest
        at = run.times[self.tick]
        if self._cached_frame is None or self._cached_frame[:2] != (run, at):
            self._cached_frame = (run, at, run.frame(self.tick))
        return self._cached_frame[2]

    def select(self, index: int | None) -> None:
        """Selects a node of the shown tree, and unfolds its ancestors."""
        frame, part = self.frame, Redraw.NODE | Redraw.STATES
        if frame is None:
            return
        self.tree.show(frame.shape)
        self.tree.selected = None if index is None else frame.shape.id(index)
        if index is not None and self.tree.reveal(index):
            part |= Redraw.TREE
        self.ask_node()
        self.on_change(part)

    def selected_index(self) -> int | None:
        """Returns the index of the selected node; None if none is selected or it is not in the shown tree."""
        node = self.tree.selected
        return self.frame.shape.index_by_id.get(node) if self.frame is not None and node is not None else None

    def ask_node(self) -> None:
        """Reads the details of the selected node from its manager, if possible."""
        frame, index = self.frame, self.selected_index()
        if self.run is None or frame is None or index is None:
            self.node.clear()
            return
        task, node = self._origin(self.run, frame.shape.id(index))
        is_known = self.bag is None and self._live.find(task.robot, task.task_id) is task
        self.node.ask(task, node, self.run, frame, index, self.is_live and not task.is_finished, is_known)

    def _origin(self, run: TaskRun, node: int) -> tuple[TaskRun, int]:
        """Returns the task and the id of a node; of a goal's own nodes the goal."""
        return (self._live.origin(run, node) if self.bag is None else None) or (run, node)

    def robot_at(self, index: int) -> str:
        """Returns the manager of a node of the shown tree; "" in a bag, and for the root of a goal."""
        frame = self.frame
        if self.run is None or self.bag is not None or frame is None:
            return ""
        return self._live.robot_of(self.run, frame.shape.id(index))

    def node_text(self, index: int) -> NodeText | None:
        """Returns the description of a node of the shown tree."""
        frame = self.frame
        if self.run is None or frame is None:
            return None
        task, node = self._origin(self.run, frame.shape.id(index))
        return self.node.text(task, node, self.run, frame, index, self.bag is not None)

    def fold(self, index: int) -> None:
        """Folds or unfolds a node."""
        if self.frame is not None:
            self.tree.show(self.frame.shape)
            self.tree.toggle_fold(self.frame.shape.id(index))
            self.on_change(Redraw.TREE)

    def change_folds(self, change: Callable[[RunTree, Frame], None]) -> None:
        """Applies a function that changes the folding."""
        if self.frame is not None:
            self.tree.show(self.frame.shape)
            change(self.tree, self.frame)
            self.on_change(Redraw.TREE)

    def search(self, text: str) -> list[int]:
        """Searches for nodes whose label or type contains all words; returns their indices."""
        self.tree.text = text
        self.on_change(Redraw.STATES)
        return self.found()

    def found(self) -> list[int]:
        """Returns the indices of the nodes found, from top to bottom."""
        if self.frame is not None:
            self.tree.show(self.frame.shape)
        return self.tree.found()

    def select_next(self, indices: Iterable[int], step: int = 1) -> int | None:
        """Selects the next of some nodes (-1: the previous one). Returns its index, or None."""
        if self.frame is not None:
            self.tree.show(self.frame.shape)
        index = self.tree.next_of(indices, step)
        if index is not None:
            self.select(index)
        return index

    def running(self) -> list[int]:
        """Returns the indices of the running leaf nodes, ordered by start."""
        return self.frame.running() if self.frame is not None else []

    def by_time(self, most: int = 500) -> list[tuple[int, float]]:
        """Returns index and duration (s) of the skills that have run, the longest first."""
        frame = self.frame
        if frame is None:
            return []
        known = [(p, s) for p, s in enumerate(frame.durations()) if s == s and frame.shape.is_skill(p)]
        return heapq.nlargest(most, known, key=lambda pair: pair[1])

    # -- history -----------------------------------------------------------------------------------------------------

    def go_to(self, tick: int | None) -> None:
        """Shows a tick; None for live. The index is clamped to the range of ticks."""
        if self.run is None:
            return
        self.tick = None if tick is None else min(max(0, tick), len(self.run) - 1)
        self._tick_time = 0.0 if self.tick is None else self.run.times[self.tick]
        self.ask_node()
        self.on_change(Redraw.ALL)

    def go_to_time(self, moment: float) -> None:
        """Shows the tick at a time (s since the epoch)."""
        if self.run is not None:
            self.go_to(self.run.tick_at(moment))

    def step(self, ticks: int) -> None:
        """Moves by some ticks. After the last one follows live."""
        if self.run is None:
            return
        at = (len(self.run) - 1 if self.tick is None else self.tick) + ticks
        self.go_to(None if at >= len(self.run) - 1 and self.bag is None else at)

    # -- events ------------------------------------------------------------------------------------------------------

    def _on_tasks(self) -> None:
        if self.bag is None and self.run is not None:
            goal = self._live.goal_of(self.run)
            if goal is not None:
                self._show(goal)
            elif self.run not in list(self._live.runs):
                self._show(self._live.newest())
        self.on_change(Redraw.TASKS | Redraw.STATES)

    def _on_run(self, event: RunRecorded) -> None:
        if self.bag is not None:
            return
        run = event.run
        if self._live.goal_of(run) is not None:
            return  # its goal is shown, and has an event of its own
        if self._awaited_task == (run.robot, run.task_id):
            self._awaited_task = None
            self.pick(run)
        elif self.run is not run and self._may_switch_to(run):
            self._show(run)
        if run is self.run:
            if self.tick is not None:
                self.tick = run.tick_at(self._tick_time)  # older ones may have been dropped
            elif run.latest.has_ended:
                self._select_failed_node(run)
            self.on_change(Redraw.STATES | Redraw.TREE if event.is_new_shape else Redraw.STATES)

    def _select_failed_node(self, run: TaskRun) -> None:
        """Selects the node that failed last, if none is selected; else reads the selected one again."""
        failed = run.latest.failed()
        if failed and self.tree.selected is None:
            self.select(failed[-1])
        else:
            self.ask_node()
            self.on_change(Redraw.NODE)

    def _may_switch_to(self, run: TaskRun) -> bool:
        """Returns whether a running task replaces the shown one, which has ended and was not picked."""
        shown = self.run
        if shown is None:
            return True
        return shown.is_finished and not self._is_pinned and self.tick is None and not run.latest.has_ended

    def _on_started(self, event: TaskStarted) -> None:
        run = self._live.find(event.manager, event.task)
        if self.bag is not None:
            self.close_bag()
        if run is not None and not run.latest.has_ended:
            self.pick(run)
        else:
            self._awaited_task = (event.manager, event.task)

    def _show(self, run: TaskRun | None) -> None:
        self.run, self.tick = run, None
        self.ask_node()
        self.on_change(Redraw.ALL)


def _read_bag(path: str) -> RunBag:
    """Reads the tasks of a bag. Takes about a second for 10 000 ticks of a small tree.

    :raises BagError: it cannot be read, or has no progress of tasks.
    """
    from skiros2_bags.core.bag_file import BagError  # imported here, as it takes a second
    from skiros2_bags.core.recorded_cell import recorded_cell
    from skiros2_bags.core.run import Run

    run = Run.open(path)
    cell = recorded_cell(run)
    if not cell.runs:
        raise BagError(f"{path}: no task ran while the bag was recorded")
    return RunBag(path, cell.shown, run.damage)
