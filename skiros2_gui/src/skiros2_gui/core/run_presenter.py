"""What the tab of running trees shows: a task out of those that run or ran, at its present or at an earlier tick."""

from __future__ import annotations

import enum
import heapq
import weakref
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

from skiros2_gui.core.events import ManagersChanged, Progressed, TaskStarted
from skiros2_gui.core.run_bag import RunBag, read_bag
from skiros2_gui.core.run_breakpoints import RunBreakpoints
from skiros2_gui.core.run_frame import Frame
from skiros2_gui.core.run_history import TaskRun
from skiros2_gui.core.run_tree import RunTree
from skiros2_gui.core.runs import Runs
from skiros2_gui.core.selected_node import SelectedNode
from skiros2_gui.core.states import look_of
from skiros2_gui.core.window import Window

#: The commands for a task, and what one is doing who sends them.
PAUSE, RESUME, STEP, STOP = "pause", "start", "tick_once", "preempt"
_DOING = {PAUSE: "pausing", RESUME: "going on with", STEP: "ticking", STOP: "stopping"}


#: A task that has not ended tells of itself once a second; of one that has not for so long (s) the end may be lost.
_SILENT = 3.0


class Part(enum.Flag):
    """What is to be shown anew."""

    TASKS = enum.auto()
    TREE = enum.auto()
    STATES = enum.auto()
    NODE = enum.auto()
    BREAKPOINTS = enum.auto()
    ALL = TASKS | TREE | STATES | NODE | BREAKPOINTS


class RunPresenter:
    """Used in the window's thread.

    :ivar run: the task that is shown; None: there is none.
    :ivar tick: the number of the tick that is shown; None: the present.
    :ivar bag: the bag whose tasks are shown; None: those that run.
    :ivar follows: whether the view stays with the node that runs.
    :ivar on_change: called with what is to be shown anew. Often: what comes of it should wait for the last.
    """

    def __init__(self, window: Window) -> None:
        self._window = window
        self._live = Runs()
        self._trees: weakref.WeakKeyDictionary[TaskRun, RunTree] = weakref.WeakKeyDictionary()
        self._told: weakref.WeakKeyDictionary[TaskRun, tuple[str, str]] = weakref.WeakKeyDictionary()
        self._no_tree = RunTree()
        self._known: set[str] = set()
        self._wanted: tuple[str, int] | None = None
        self._is_picked = False
        self._past: tuple[TaskRun, float, Frame] | None = None
        self.run: TaskRun | None = None
        self.tick: int | None = None
        self.bag: RunBag | None = None
        self.follows = True
        self.on_change: Callable[[Part], None] = lambda part: None
        self.breakpoints = RunBreakpoints(window, lambda: self.on_change(Part.BREAKPOINTS | Part.STATES))
        self.node = SelectedNode(window, lambda: self.on_change(Part.NODE))
        window.subscribe(Progressed, self._on_progress)
        window.subscribe(ManagersChanged, lambda _: self._on_managers())
        window.subscribe(TaskStarted, self._on_started)
        self._on_managers()

    # -- tasks -----------------------------------------------------------------------------------------------------

    @property
    def runs(self) -> Runs:
        """The tasks to choose from, oldest first."""
        return self._live if self.bag is None else self.bag.runs

    @property
    def robot(self) -> str:
        """The manager of the task that is shown; without one the only manager that is there; else ""."""
        if self.run is not None and self.bag is None:
            return self.run.robot
        managers = list(self._window.system.managers)
        return managers[0] if len(managers) == 1 else ""

    @property
    def is_live(self) -> bool:
        """Whether what is shown goes on by itself: the present of a task that has not ended."""
        run = self.run
        return self.bag is None and self.tick is None and run is not None and not (run.now.has_ended or run.is_lost)

    @property
    def is_paused(self) -> bool:
        return self.is_live and self.run is not None and is_paused(self.run)

    def pick(self, run: TaskRun) -> None:
        """The user wants to see that task: one that has ended, until he picks another one; else until it has ended."""
        self._is_picked = run.now.has_ended or run.is_lost
        self._show(run)

    def command(self, action: str) -> None:
        """Sends a command for the task that is shown."""
        run = self.run
        if run is None or not self.is_live:
            return
        what = f"{_DOING[action]} task {run.task_id} of {run.robot}"
        manager = self._window.system.managers.get(run.robot)
        if manager is None:
            self._window.problems.tell(what, f"{run.robot} is not there")
            return
        self._window.jobs.run(lambda: manager.command(action, run.task_id), what=what, lane=run.robot)

    def toggle(self) -> None:
        """Pauses the task that is shown, or goes on with it."""
        self.command(RESUME if self.is_paused else PAUSE)

    def forget_ended(self) -> None:
        """Gives up the tasks that have ended."""
        self._live.forget_ended()
        if self.bag is None and self.run is not None and self.run not in list(self._live):
            self._show(next(iter(self._live), None))
        self.on_change(Part.TASKS)

    def check(self, now: float) -> None:
        """Asks for the tasks of which nothing was heard for long: news of their end may have got lost.

        :param now: s since the epoch.
        """
        silent = [r for r in self._live if not (r.now.has_ended or r.is_lost) and now - r.now.time > _SILENT]
        for robot in {run.robot for run in silent} & self._window.system.managers.keys():
            manager = self._window.system.managers[robot]
            of_robot = [run for run in silent if run.robot == robot]
            self._window.jobs.run(
                manager.tasks, partial(self._take_alive, of_robot, now), lambda error: None, lane=robot
            )

    def _take_alive(self, silent: list[TaskRun], asked: float, tasks: list[Any]) -> None:
        alive = {nodes[0].id for nodes in tasks if nodes}
        for run in silent:
            if run.task_id not in alive and run.now.time < asked and not run.now.has_ended:
                run.is_lost = True
                self.on_change(Part.TASKS | Part.STATES)

    # -- bags ------------------------------------------------------------------------------------------------------

    def open_bag(self, path: str) -> None:
        """Shows the tasks of a bag instead of those that run."""
        self._window.jobs.run(lambda: read_bag(path), self._take_bag, what=f"reading {path}", lane="bag")

    def close_bag(self) -> None:
        """Shows what runs again."""
        if self.bag is not None:
            self.bag = None
            self._is_picked = False
            self._show(_newest(self._live))

    def _take_bag(self, bag: RunBag) -> None:
        self.bag = bag
        if bag.damage:
            self._window.problems.tell(bag.path, f"the bag is not whole: {bag.damage}")
        self._show(next(iter(bag.runs), None))
        self.go_to(0)

    # -- the tree that is shown --------------------------------------------------------------------------------------

    @property
    def tree(self) -> RunTree:
        """What is folded, selected and searched in the task that is shown."""
        if self.run is None:
            return self._no_tree
        tree = self._trees.get(self.run)
        if tree is None:
            tree = self._trees[self.run] = RunTree()
        return tree

    @property
    def frame(self) -> Frame | None:
        """The tree as it is, or was at the tick that is shown."""
        run = self.run
        if run is None:
            return None
        if self.tick is None:
            return run.now
        at = run.times[self.tick]
        if self._past is None or self._past[:2] != (run, at):
            self._past = (run, at, run.frame(self.tick))
        return self._past[2]

    def select(self, place: int | None) -> None:
        """Selects a node of the tree that is shown, and unfolds what it lies in."""
        frame, part = self.frame, Part.NODE | Part.STATES
        if frame is None:
            return
        self.tree.show(frame.shape)
        self.tree.selected = None if place is None else frame.shape.id(place)
        if place is not None and self.tree.reveal(place):
            part |= Part.TREE
        self.ask_node()
        self.on_change(part)

    def ask_node(self) -> None:
        """Has the manager tell what the selected node is now, where it can."""
        place = self.tree.place()
        if self.run is None or place is None:
            self.node.clear()
        else:
            self.node.ask(self.run, self.run.now if self.frame is None else self.frame, place, self.is_live, self.bag)

    def fold(self, place: int) -> None:
        """Folds a node, or unfolds it."""
        if self.tree.drawing is not None:
            self.tree.toggle_fold(self.tree.drawing.shape.id(place))
            self.on_change(Part.TREE)

    def change_folds(self, change: Callable[[RunTree, Frame], None]) -> None:
        """Folds and unfolds as `change` does."""
        if self.frame is not None:
            self.tree.show(self.frame.shape)
            change(self.tree, self.frame)
            self.on_change(Part.TREE)

    def search(self, text: str) -> list[int]:
        """Marks the nodes whose label or type holds all words of a text; returns their places."""
        self.tree.text = text
        self.on_change(Part.STATES)
        return self.tree.found()

    def select_next(self, places: Iterable[int], step: int = 1) -> int | None:
        """Selects of some nodes the one after the selected one (-1: before it). Returns its place, if there is one."""
        place = self.tree.next_of(places, step)
        if place is not None:
            self.select(place)
        return place

    def running(self) -> list[int]:
        """The places of the nodes that the task is at, the one that began last at the end."""
        return self.frame.running() if self.frame is not None else []

    def by_time(self, most: int = 500) -> list[tuple[int, float]]:
        """The places of the skills that have run and for how long (s), those that took longest first."""
        frame = self.frame
        if frame is None:
            return []
        known = [(p, s) for p, s in enumerate(frame.durations()) if s == s and frame.shape.is_skill(p)]
        return heapq.nlargest(most, known, key=lambda pair: pair[1])

    # -- history -----------------------------------------------------------------------------------------------------

    def go_to(self, tick: int | None) -> None:
        """Shows the tree at that tick; None: at its present. A number that is out of range is the nearest that is."""
        if self.run is None:
            return
        self.tick = None if tick is None else min(max(0, tick), len(self.run) - 1)
        self.ask_node()
        self.on_change(Part.ALL)

    def go_to_time(self, moment: float) -> None:
        """Shows the tree as it was at a time (s since the epoch)."""
        if self.run is not None:
            self.go_to(self.run.tick_at(moment))

    def step(self, ticks: int) -> None:
        """Goes so many ticks on, or back. Past the last one is the present."""
        if self.run is None:
            return
        at = (len(self.run) - 1 if self.tick is None else self.tick) + ticks
        self.go_to(None if at >= len(self.run) - 1 and self.bag is None else at)

    # -- news --------------------------------------------------------------------------------------------------------

    def _on_progress(self, event: Progressed) -> None:
        at = self.run.times[self.tick] if self.run is not None and self.tick is not None else None
        entered = self._live.enter(event.manager, event.nodes, event.stamp)
        if entered is None:
            return
        run, is_new = entered
        if self.bag is not None:
            return
        if self._told.get(run) != (said := state_text(run)):
            self._told[run] = said
            self.on_change(Part.TASKS)
        if self._wanted == (run.robot, run.task_id):
            self._wanted = None
            self.pick(run)
        elif self.run is not run and self._may_go_on_to(run):
            self._show(run)
        if run is self.run:
            if at is not None:
                self.tick = run.tick_at(at)  # older ones may have been dropped
            if run.now.has_ended and self.tick is None:
                self._look_at_end(run)
            self.on_change(Part.STATES | Part.TREE if is_new else Part.STATES)

    def _look_at_end(self, run: TaskRun) -> None:
        """The selected node is asked for once more; where none is, the one that failed last is selected."""
        failed = run.now.failed()
        if failed and self.tree.selected is None:
            self.select(failed[-1])
        else:
            self.ask_node()

    def _may_go_on_to(self, run: TaskRun) -> bool:
        """Whether a task that runs takes the place of the one that is shown: nobody wanted to see that one."""
        shown = self.run
        if shown is None:
            return True
        is_over = shown.now.has_ended or shown.is_lost
        return is_over and not self._is_picked and self.tick is None and not run.now.has_ended

    def _on_started(self, event: TaskStarted) -> None:
        run = next((r for r in reversed(list(self._live)) if (r.robot, r.task_id) == (event.manager, event.task)), None)
        if self.bag is not None:
            self.close_bag()
        if run is not None and not run.now.has_ended:
            self.pick(run)
        else:
            self._wanted = (event.manager, event.task)

    def _on_managers(self) -> None:
        managers = self._window.system.managers
        for name in self._known - managers.keys():
            self._live.lose(name)
            self.breakpoints.ask(name)
        for name in managers.keys() - self._known:
            self.breakpoints.ask(name)
        self._known = set(managers)
        self.on_change(Part.TASKS | Part.STATES)

    def _show(self, run: TaskRun | None) -> None:
        self.run, self.tick = run, None
        self.ask_node()
        self.on_change(Part.ALL)


def is_paused(run: TaskRun) -> bool:
    """Whether the task waits for somebody to go on with it: its root says so."""
    return not run.now.has_ended and run.now.message(0).startswith("paused")


def state_text(run: TaskRun) -> tuple[str, str]:
    """A symbol and a word for what a task is doing."""
    if run.now.has_ended:
        look = look_of(run.now.state(0))
        return look.symbol, look.word
    if run.is_lost:
        return "?", "lost: its end was not heard of"
    if is_paused(run):
        return "‖", "paused"
    look = look_of(run.now.state(0))
    return look.symbol, look.word


def _newest(runs: Runs) -> TaskRun | None:
    """The task that was seen to begin last, of those that run if there are any."""
    known = list(runs)
    alive = [run for run in known if not (run.now.has_ended or run.is_lost)]
    chosen = alive or known
    return chosen[-1] if chosen else None
