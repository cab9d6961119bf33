"""The presenter of the tab "Running", on robots in this process."""

from __future__ import annotations

import json
import re
import threading
import time
from collections.abc import Callable, Iterator

import pytest

from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element
from skiros2_gui.app.events import ManagersChanged, TaskStarted
from skiros2_gui.app.tasks import PAUSE, RESUME, STEP, STOP
from skiros2_gui.app.window import Window
from skiros2_gui.run.presenter import RunPresenter
from skiros2_gui.run.tree import RunTree
from skiros2_live.core.patch import TaskProgress
from skiros2_runs.core.states import TaskState
from skiros2_skill.client.description import Step
from support.progress import IDLE, RUNNING, SUCCESS, ProgressNode, pick_and_place, random_tree, root
from support.recorded_run import ROOT
from support.ros import wait_until
from support.window.local_system import LocalManager, LocalSystem
from support.window.synchronous import make_window
from unit.skiros2_skill.skills import CONTAINER, OBJECT, contains, describe

Guard = describe("Guard", [CONTAINER, OBJECT], pre=[contains()], hold=[contains()])


class Held(PrimitiveBase):
    """Runs until the test lets it end."""

    ended = threading.Event()
    ending = "success"

    def createDescription(self) -> None:
        self.setDescription(Guard(), "guard")

    def execute(self) -> object:
        if not self.ended.is_set():
            return self.step("guarding")
        return self.success("done") if self.ending == "success" else self.fail("it has gone", -7)


@pytest.fixture
def window() -> Iterator[Window]:
    Held.ended.clear()
    Held.ending = "success"
    made = make_window(LocalSystem)
    yield made
    Held.ended.set()
    made.system.close()


@pytest.fixture
def presenter(window: Window) -> RunPresenter:
    return RunPresenter(window)


@pytest.fixture
def robot(window: Window, presenter: RunPresenter) -> LocalManager:
    """Guards a product in a box as soon as it is told to."""
    world = window.system.world
    holder = "skiros:Scene-0"
    for kind, label in (("Container", "box"), ("Product", "thing")):
        element = Element(f"skiros:{kind}", label)
        element.addRelation(holder, "skiros:contain", "-1")
        world.add_element(element)
        holder = element.id
    made = window.system.add_manager("/robot", [Held])
    window.process_events()
    return made


def until(window: Window, condition: Callable[[], object]) -> None:
    def is_so() -> object:
        window.process_events()
        return condition()

    wait_until(is_so)


def started(window: Window, presenter: RunPresenter, robot: LocalManager) -> int:
    """A task that guards, shown with its first skill selected."""
    task = robot.command("start", -1, [Step("skiros:Guard", "guard")])
    until(window, lambda: presenter.run is not None and presenter.frame.running())
    presenter.select(1)
    return task


def test_started_task_is_shown_and_accepts_commands(window: Window, presenter: RunPresenter, robot: LocalManager):
    started(window, presenter, robot)
    assert presenter.is_live and not presenter.is_paused
    presenter.toggle()
    until(window, lambda: presenter.is_paused)
    assert presenter.run.state is TaskState.PAUSED
    ticks = presenter.run.latest.code(1)
    presenter.command(STEP)
    # a tick may have been running when it was paused
    until(window, lambda: presenter.run.latest.code(1) > ticks and presenter.is_paused)
    presenter.toggle()
    until(window, lambda: not presenter.is_paused)
    presenter.command(STOP)
    until(window, lambda: presenter.run.latest.has_ended)
    assert not presenter.is_live
    assert presenter.run.state is TaskState.PREEMPTED
    presenter.command(STOP)  # of a task that has ended: nothing
    assert window.problems.newest is None


def test_refused_command_is_reported(window: Window, presenter: RunPresenter, robot: LocalManager):
    window.publish(TaskProgress("/robot", pick_and_place(task_id=77), 1.0))
    presenter.command(PAUSE)
    assert window.problems.newest.line.startswith("pausing task 77 of /robot: ")
    window.publish(TaskProgress("/nobody", pick_and_place(task_id=3), 1.0))
    presenter.pick(list(presenter.runs)[-1])
    presenter.command(STOP)
    assert window.problems.newest.line == "stopping task 3 of /nobody: /nobody is not running"


def test_selected_node_shows_conditions_as_evaluated_and_values(window, presenter, robot):
    started(window, presenter, robot)
    text = presenter.node_text(1)
    stages = [(re.sub(r"[\d:.]{8,}", "TIME", c.stage), c.symbol) for c in text.conditions]
    assert stages == [("before the start, evaluated at TIME", "✓"), ("while it runs, evaluated at TIME", "✓")]
    assert "box" in text.conditions[0].text and "thing" in text.conditions[0].text
    assert {key: origin for key, _, origin in text.params}["Object"].startswith("inferred")
    thing = window.system.world.resolve_elements(Element("skiros:Product", "thing"))[0].id
    window.system.world.remove_element(thing)
    until(window, lambda: presenter.run.latest.has_ended)
    presenter.ask_node()
    text = presenter.node_text(1)
    assert text.why[0].startswith("guard was interrupted: element thing was removed by window at ")
    assert text.conditions[0].symbol == "✓"  # it was true before the start


def test_values_of_an_unselected_finished_node_are_read_from_its_manager(window, presenter, robot):
    robot.command("start", -1, [Step("skiros:Guard", "guard")])
    until(window, lambda: presenter.run is not None and presenter.frame.running())
    Held.ended.set()
    until(window, lambda: presenter.run.latest.has_ended)
    presenter.select(1)
    text = presenter.node_text(1)
    assert "thing" in {key: value for key, value, _ in text.params}["Object"]
    assert [condition.symbol for condition in text.conditions] == ["✓", "✓"]


def test_values_of_a_past_tick_are_shown(window, presenter, robot):
    started(window, presenter, robot)
    Held.ended.set()
    until(window, lambda: presenter.run.latest.has_ended)
    running = next(tick for tick in range(len(presenter.run)) if presenter.run.frame(tick).state(1) == RUNNING)
    presenter.go_to(running)
    text = presenter.node_text(1)
    assert text.state == RUNNING
    assert "box" in {key: value for key, value, _ in text.params}["Container"]
    assert text.note == ""


def test_failed_node_shows_the_managers_reason(window, presenter, robot):
    started(window, presenter, robot)
    Held.ending = "failure"
    Held.ended.set()
    until(window, lambda: presenter.run.latest.has_ended)
    presenter.ask_node()
    assert presenter.node_text(1).why[0] == "guard failed: it has gone."


def test_breakpoint_at_a_node_pauses_the_task(window, presenter, robot):
    window.publish(TaskProgress("/robot", [root(), ProgressNode(9, 5, "guard", "skiros:Guard")], 1.0))
    shape = presenter.frame.shape
    presenter.breakpoints.toggle("/robot", shape, 1)
    assert presenter.breakpoints.by_node("/robot", shape) == {1: "start"}
    (known,) = presenter.breakpoints.of("/robot")
    assert str(known) == "before the start of node skiros:Guard-guard"
    task = robot.command("start", -1, [Step("skiros:Guard", "guard")])
    window.publish(TaskStarted("/robot", task))
    until(window, lambda: presenter.run.task_id == task and presenter.is_paused)
    assert presenter.run.latest.message(0).startswith("paused at breakpoint 1")
    presenter.breakpoints.toggle("/robot", shape, 1)
    assert presenter.breakpoints.by_node("/robot", shape) == {}
    presenter.command(RESUME)
    until(window, lambda: presenter.run.latest.state(1) == RUNNING)


def test_invalid_breakpoint_is_reported(window, presenter, robot):
    presenter.breakpoints.add("/robot", "node", "x", "sometimes")
    assert "sometimes" in window.problems.newest.line
    presenter.breakpoints.add("/gone", "node", "x", "start")
    assert "/gone is not running" in window.problems.newest.line


def test_invalid_response_of_a_manager_is_reported(window, presenter, robot, monkeypatch):
    monkeypatch.setattr(robot, "breakpoints", lambda: json.loads("{"))
    presenter.breakpoints.add("/robot", "node", "x", "start")
    assert "JSONDecodeError" in window.problems.newest.line
    started(window, presenter, robot)
    monkeypatch.setattr(robot, "inspect", lambda *_: json.loads("{"))
    presenter.ask_node()
    assert "JSONDecodeError" in presenter.node_text(1).note
    assert presenter.is_live


def test_tasks_of_a_disconnected_robot_are_lost(window, presenter, robot):
    started(window, presenter, robot)
    run = presenter.run
    robot._report = lambda event: None  # it is killed
    window.system.remove_manager("/robot")
    window.process_events()
    assert run.state is TaskState.LOST
    assert not presenter.is_live
    assert presenter.frame.state(1) == RUNNING
    window.tasks.clear_ended()
    assert presenter.run is None and presenter.frame is None


def test_task_that_the_manager_does_not_list_is_lost(window, presenter, robot):
    task = started(window, presenter, robot)
    presenter.toggle()
    until(window, lambda: presenter.is_paused)
    window.publish(TaskProgress("/robot", pick_and_place(task_id=task + 1), time.time() - 100))
    window.tasks.check(time.time())
    window.tasks.check(time.time() + 100)
    assert {run.task_id: run.is_lost for run in presenter.runs} == {task: False, task + 1: True}
    window.publish(TaskProgress("/robot", pick_and_place(task_id=task + 1), time.time()))
    assert not any(run.is_lost for run in presenter.runs)  # it has told of itself again


def test_next_task_is_shown_unless_the_ended_one_was_picked(window, presenter):
    over = {"state": SUCCESS, "code": 1}
    window.publish(TaskProgress("/robot", pick_and_place(SUCCESS, SUCCESS, task_id=1, **over), 1.0))
    window.publish(TaskProgress("/robot", pick_and_place(task_id=2), 2.0))
    assert presenter.run.task_id == 2
    window.publish(TaskProgress("/robot", pick_and_place(SUCCESS, SUCCESS, task_id=2, **over), 3.0))
    presenter.pick(presenter.run)
    window.publish(TaskProgress("/robot", pick_and_place(task_id=3), 4.0))
    assert presenter.run.task_id == 2
    window.publish(TaskStarted("/robot", 3))
    window.publish(TaskProgress("/robot", pick_and_place(SUCCESS, SUCCESS, task_id=3, **over), 5.0))
    window.publish(TaskProgress("/robot", pick_and_place(task_id=4), 6.0))
    assert presenter.run.task_id == 4


def test_stepping_past_the_last_tick_is_live(window, presenter):
    for second, (pick, place) in enumerate([(IDLE, IDLE), (RUNNING, IDLE), (SUCCESS, RUNNING)]):
        window.publish(TaskProgress("/robot", pick_and_place(pick, place), 1000.0 + second))
    presenter.step(-1)
    assert (presenter.tick, presenter.frame.state(1)) == (1, RUNNING)
    presenter.step(-5)
    assert presenter.tick == 0
    presenter.go_to_time(1001.5)
    assert presenter.tick == 1
    presenter.step(1)
    assert presenter.tick is None and presenter.is_live


def test_fold_quiet_keeps_running_branches(window, presenter):
    nodes = random_tree(300)
    for node in nodes[1:]:
        node.state = SUCCESS
    busy = nodes[200]
    busy.state = RUNNING
    window.publish(TaskProgress("/robot", nodes, 1.0))
    presenter.change_folds(RunTree.fold_quiet)
    shape, drawing = presenter.frame.shape, presenter.tree.drawing
    place = shape.index_by_id[busy.id]
    assert all(drawing.is_drawn(above) for above in shape.path(place))
    assert len(drawing.drawn) < 100
    assert presenter.running() == [place]
    presenter.select(None)
    assert presenter.select_next(presenter.running()) == place
    assert presenter.tree.selected == busy.id


def test_selection_and_folds_are_kept_when_the_tree_grows(window, presenter):
    nodes = pick_and_place()
    window.publish(TaskProgress("/robot", nodes, 1.0))
    presenter.select(4)
    presenter.fold(1)
    grown = [*nodes[:3], ProgressNode(300, 100, "new"), *nodes[3:]]
    window.publish(TaskProgress("/robot", grown, 2.0))
    presenter.tree.show(presenter.frame.shape)
    assert presenter.frame.shape.name(presenter.tree.selected_index()) == "place"
    assert presenter.tree.drawing.hidden == {1: 3}


def test_truncated_bag_is_read_and_reported(window, presenter, tmp_path):
    whole = (ROOT / "tests/bags/timed_pick_place.bag").read_bytes()
    (tmp_path / "cut.bag").write_bytes(whole[: len(whole) * 3 // 4])
    presenter.open_bag(str(tmp_path / "cut.bag"))
    assert presenter.bag is not None and presenter.frame is not None
    assert "the bag is not whole" in window.problems.newest.line
    presenter.go_to(len(presenter.run) - 1)
    presenter.select(1)
    assert "not recorded" in presenter.node_text(1).note
    window.publish(ManagersChanged())
    assert presenter.bag is not None


def test_bag_has_one_tree_for_each_goal(window, presenter):
    presenter.open_bag(str(ROOT / "tests/bags/timed_goal.bag"))
    [goal] = presenter.runs
    presenter.go_to(len(goal) - 1)
    shape = presenter.frame.shape
    assert shape.name(0) == "Tray B contains Product A"
    assert [shape.name(index) for index in shape.children[0]] == ["drive", "pick", "drive", "place"]
    assert all(shape.children[index] for index in shape.children[0] if shape.name(index) in ("pick", "place"))
    assert {presenter.frame.state(place) for place in range(len(shape))} == {SUCCESS}


def test_by_time_lists_longest_skills_first(window, presenter):
    for second, (pick, place) in enumerate([(RUNNING, IDLE), (RUNNING, IDLE), (SUCCESS, RUNNING), (SUCCESS, SUCCESS)]):
        window.publish(TaskProgress("/robot", pick_and_place(pick, place), 1000.0 + second))
    shape = presenter.frame.shape
    assert [(shape.name(p), s) for p, s in presenter.by_time()] == [("pick", 2.0), ("move_arm", 2.0), ("place", 1.0)]
    assert len(presenter.by_time(1)) == 1
