"""What the tab of running trees shows: a task out of those that run or ran, at its present or at an earlier tick."""

from __future__ import annotations

import enum
import heapq
import weakref
from collections.abc import Callable, Iterable

from skiros2_gui.core.events import TaskStarted
from skiros2_gui.core.live_runs import LiveRuns, is_paused
from skiros2_gui.core.run_bag import RunBag, read_bag
from skiros2_gui.core.run_breakpoints import RunBreakpoints
from skiros2_gui.core.run_frame import Frame
from skiros2_gui.core.run_history import TaskRun
from skiros2_gui.core.run_tree import RunTree
from skiros2_gui.core.runs import Runs
from skiros2_gui.core.selected_node import SelectedNode
from skiros2_gui.core.window import Window

#: The commands for a task, and what one is doing who sends them.
PAUSE, RESUME, STEP, STOP = "pause", "start", "tick_once", "preempt"
_DOING = {PAUSE: "pausing", RESUME: "going on with", STEP: "ticking", STOP: "stopping"}


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
        self._trees: weakref.WeakKeyDictionary[TaskRun, RunTree] = weakref.WeakKeyDictionary()
        self._no_tree = RunTree()
        self._wanted: tuple[str, int] | None = None
        self._is_picked = False
        self._past: tuple[TaskRun, float, Frame] | None = None
        self.run: TaskRun | None = None
        self.tick: int | None = None
        self._moment = 0.0  # the time of that tick
        self.bag: RunBag | None = None
        self.follows = True
        self.on_change: Callable[[Part], None] = lambda part: None
        self.breakpoints = RunBreakpoints(window, lambda: self.on_change(Part.BREAKPOINTS | Part.STATES))
        self.node = SelectedNode(window, lambda: self.on_change(Part.NODE))
        self._live = LiveRuns(
            window, self._on_run, lambda: self.on_change(Part.TASKS | Part.STATES), self.breakpoints.ask
        )
        window.subscribe(TaskStarted, self._on_started)
        self._live.look_at_managers()

    # -- tasks -----------------------------------------------------------------------------------------------------

    @property
    def runs(self) -> Runs:
        """The tasks to choose from, oldest first."""
        return self._live.runs if self.bag is None else self.bag.runs

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
        return self.bag is None and self.tick is None and run is not None and not run.is_over

    @property
    def is_paused(self) -> bool:
        return self.is_live and self.run is not None and is_paused(self.run)

    def pick(self, run: TaskRun) -> None:
        """The user wants to see that task: one that has ended, until he picks another one; else until it has ended."""
        self._is_picked = run.is_over
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
        # In no lane with the inspections: stopping waits for nothing, the other commands only for each other.
        self._window.jobs.run(
            lambda: manager.command(action, run.task_id),
            what=what,
            lane=f"{run.robot}: commands",
            urgent=action == STOP,
        )

    def toggle(self) -> None:
        """Pauses the task that is shown, or goes on with it."""
        self.command(RESUME if self.is_paused else PAUSE)

    def forget_ended(self) -> None:
        """Gives up the tasks that have ended."""
        self._live.runs.forget_ended()
        if self.bag is None and self.run is not None and self.run not in list(self._live.runs):
            self._show(self._live.newest())
        self.on_change(Part.TASKS)

    def check(self, now: float) -> None:
        """Looks whether tasks have gone silent; to be called now and then.

        :param now: s since the epoch.
        """
        self._live.check(now)

    # -- bags ------------------------------------------------------------------------------------------------------

    def open_bag(self, path: str) -> None:
        """Shows the tasks of a bag instead of those that run."""
        self._window.jobs.run(lambda: read_bag(path), self._take_bag, what=f"reading {path}", lane="bag")

    def close_bag(self) -> None:
        """Shows what runs again."""
        if self.bag is not None:
            self.bag = None
            self._is_picked = False
            self._show(self._live.newest())

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

    def selected(self) -> int | None:
        """The place of the selected node in the tree that is shown; None: none is, or it is not in this tree."""
        node = self.tree.selected
        return self.frame.shape.places.get(node) if self.frame is not None and node is not None else None

    def ask_node(self) -> None:
        """Has the manager tell what the selected node is now, where it can."""
        frame, place = self.frame, self.selected()
        if self.run is None or frame is None or place is None:
            self.node.clear()
        else:
            self.node.ask(self.run, frame, place, self.is_live, self.bag)

    def fold(self, place: int) -> None:
        """Folds a node, or unfolds it."""
        if self.frame is not None:
            self.tree.show(self.frame.shape)
            self.tree.toggle_fold(self.frame.shape.id(place))
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
        return self.found()

    def found(self) -> list[int]:
        """The places of the nodes that are searched for, from the top down."""
        if self.frame is not None:
            self.tree.show(self.frame.shape)
        return self.tree.found()

    def select_next(self, places: Iterable[int], step: int = 1) -> int | None:
        """Selects of some nodes the one after the selected one (-1: before it). Returns its place, if there is one."""
        if self.frame is not None:
            self.tree.show(self.frame.shape)
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
        self._moment = 0.0 if self.tick is None else self.run.times[self.tick]
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

    def _on_run(self, run: TaskRun, is_new: bool) -> None:
        if self.bag is not None:
            return
        if self._wanted == (run.robot, run.task_id):
            self._wanted = None
            self.pick(run)
        elif self.run is not run and self._may_go_on_to(run):
            self._show(run)
        if run is self.run:
            if self.tick is not None:
                self.tick = run.tick_at(self._moment)  # older ones may have been dropped
            elif run.now.has_ended:
                self._look_at_end(run)
            self.on_change(Part.STATES | Part.TREE if is_new else Part.STATES)

    def _look_at_end(self, run: TaskRun) -> None:
        """The selected node is asked for once more; where none is, the one that failed last is selected."""
        failed = run.now.failed()
        if failed and self.tree.selected is None:
            self.select(failed[-1])
        else:
            self.ask_node()
            self.on_change(Part.NODE)

    def _may_go_on_to(self, run: TaskRun) -> bool:
        """Whether a task that runs takes the place of the one that is shown: nobody wanted to see that one."""
        shown = self.run
        if shown is None:
            return True
        return shown.is_over and not self._is_picked and self.tick is None and not run.now.has_ended

    def _on_started(self, event: TaskStarted) -> None:
        run = self._live.find(event.manager, event.task)
        if self.bag is not None:
            self.close_bag()
        if run is not None and not run.now.has_ended:
            self.pick(run)
        else:
            self._wanted = (event.manager, event.task)

    def _show(self, run: TaskRun | None) -> None:
        self.run, self.tick = run, None
        self.ask_node()
        self.on_change(Part.ALL)
