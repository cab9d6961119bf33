"""The action `~achieve`: robots with different skills reach goals together."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from skiros2_msgs import srv as srvs
from skiros2_msgs.msg import AchieveResult
from skiros2_skill.ros.skill_manager_interface import SkillManagerInterface
from skiros2_task.ros.task_manager_interface import TaskManagerInterface
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.planning_world import PlanningWorld
from support.ros import Ros, RosMaster, SharedSystem, wait_until

pytestmark = pytest.mark.timeout(120)

TESTS = Path(__file__).resolve().parents[1]
#: Each has what no other has; any two can do all.
SPECIALISTS = {"porter": ["carry"], "washer": ["wash"], "labeller": ["label"]}
CREW = {"porter": ["carry", "wash"], "helper": ["carry", "label"], "finisher": ["wash", "label"]}
WAIT = 60.0  # s


class Cell:
    """A shelf with three products, a bench and a store; robots whose managers run; the task manager."""

    def __init__(self, ros: Ros, crew: dict[str, list[str]]) -> None:
        self.ros = ros
        ros.run("skiros2_world_model", "world_model_server_node", name="wm")
        self.wm = WorldModelInterface("tests")
        world = PlanningWorld(self.wm)
        self.shelf, self.store = world.thing("skiros:Location"), world.thing("skiros:Location")
        self.bench = world.thing("skiros:LargeBox")
        self.products = [world.thing("skiros:Product", inside=self.shelf) for _ in range(3)]
        for name, skills in crew.items():
            world.thing("cora:Robot", f"skiros:{name}")
            self.start_manager(name, skills)
        ros.run("skiros2_task", "task_manager_node", name="tm")
        for name in crew:
            ros.service(f"/{name}/get_skills", srvs.ResourceGetDescriptions)()
        wait_until(lambda: "/tm/achieve/status" in ros.master.topics(), WAIT, "the task manager")

    def start_manager(self, name: str, skills: list[str]) -> None:
        params = {
            "libraries_list": ["support.team_skills", "skiros2_std_skills"],
            "primitive_list": skills,
            "prefix": "skiros",
        }
        env = {**self.ros.master.env, "PYTHONPATH": f"{TESTS}:{self.ros.master.env['PYTHONPATH']}"}
        self.ros.run("skiros2_skill", "skill_manager_node", name=name, params=params, env=env)

    @property
    def goal(self) -> str:
        """All products washed, labelled and in the store."""
        done = f"(and (skiros:contain {self.store} ?p) (skiros:Washed ?p) (skiros:Labelled ?p))"
        return f"(forall (?p - skiros:Product) {done})"

    def place_of(self, product: str) -> str:
        (relation,) = self.wm.get_element(product).getRelations("", "skiros:contain", "-1")
        return str(relation["src"])

    @property
    def is_done(self) -> bool:
        elements = [self.wm.get_element(product) for product in self.products]
        return all(
            self.place_of(e.id) == self.store and e.value_of("skiros:Washed") and e.value_of("skiros:Labelled")
            for e in elements
        )

    def achieve(self, goal: str = "", **options: Any) -> Request:
        return Request(TaskManagerInterface(), goal or self.goal, **options)


class Request:
    """A sent goal with its messages."""

    def __init__(self, tasks: TaskManagerInterface, goal: str, **options: Any) -> None:
        self.tasks = tasks
        self.told: list[Any] = []
        tasks.achieve(goal, feedback_cb=self.told.append, **options)

    def wait_for(self, condition: Callable[[Any], Any]) -> Any:
        """Waits until the condition holds for the last message, and returns its value."""
        return wait_until(lambda: self.told and condition(self.told[-1]), WAIT, "feedback as wanted")

    @property
    def result(self) -> Any:
        return self.tasks.wait_for_result()

    @property
    def done(self) -> list[dict[str, Any]]:
        return list(json.loads(self.result.done))


@pytest.fixture(scope="module")
def shared(ros_master: RosMaster) -> Iterator[SharedCell]:
    with SharedCell(ros_master) as system:
        yield system


class SharedCell(SharedSystem):
    """A cell with the specialists, for tests that leave its nodes alone."""

    def __init__(self, master: RosMaster) -> None:
        super().__init__(master, self._build)
        self.cell: Cell

    def _build(self, ros: Ros) -> None:
        self.cell = Cell(ros, SPECIALISTS)


@pytest.fixture
def cell(shared: SharedCell) -> Iterator[Cell]:
    shared.use()
    yield shared.cell
    shared.restore()


@pytest.fixture
def own(ros: Ros, shared: SharedCell) -> Ros:
    """For a cell whose nodes the test kills."""
    shared.stop()
    return ros


def running(feedback: Any) -> list[dict[str, Any]]:
    """The running steps, by the last message."""
    return [step for step in json.loads(feedback.steps) if step["state"] == "running"]


def test_robots_with_different_skills_reach_a_goal_together(cell: Cell) -> None:
    request = cell.achieve()
    result = request.result
    assert (result.state, result.message) == (AchieveResult.SUCCEEDED, "the goal is reached")
    assert cell.is_done
    assert [step["state"] for step in request.done] == ["succeeded"] * 12
    assert {step["robot"] for step in request.done} == {"/porter", "/washer", "/labeller"}
    assert max(len(running(feedback)) for feedback in request.told) >= 2, "no two robots worked at the same time"
    again = cell.achieve()
    assert again.result.state == AchieveResult.NOTHING_TO_DO


@pytest.mark.long
@pytest.mark.parametrize("finished", [1, 5])
def test_goal_is_reached_after_a_manager_is_killed(own: Ros, finished: int) -> None:
    cell = Cell(own, CREW)
    managers = {f"/{name}": SkillManagerInterface(f"/{name}", "tests") for name in CREW}  # connected beforehand
    request = cell.achieve()
    # The one that has just begun a step, held so that it is still at it when it is killed.
    victim = request.wait_for(
        lambda f: (
            sum(s["state"] == "succeeded" for s in json.loads(f.steps)) >= finished
            and [
                s
                for s in running(f)
                if f.message.startswith(f"step {s['number']},") and f.message.endswith("is started")
            ]
        )
    )[0]["robot"]
    managers[victim].pause_all()
    for manager in managers.values():
        manager.shutdown()
    own.kill_node(victim)
    assert request.result.state == AchieveResult.SUCCEEDED, request.result.message
    assert cell.is_done
    # Its message depends on whether the manager had begun the step when it was killed.
    lost = [step for step in request.done if step["state"] == "failed"]
    assert {step["robot"] for step in lost} == {victim}
    after = request.done[request.done.index(lost[-1]) + 1 :]
    assert victim not in {step["robot"] for step in after}


@pytest.mark.long
def test_goal_waits_for_an_irreplaceable_manager(own: Ros) -> None:
    cell = Cell(own, SPECIALISTS)
    request = cell.achieve()
    request.wait_for(lambda f: any(step["robot"] == "/washer" for step in running(f)))
    own.kill_node("/washer")
    request.wait_for(lambda f: f.phase == f.PLANNING and "robot is lost" in f.message)
    cell.start_manager("washer", SPECIALISTS["washer"])
    assert request.result.state == AchieveResult.SUCCEEDED, request.result.message
    assert cell.is_done


def test_external_changes_trigger_replanning(cell: Cell) -> None:
    request = cell.achieve()
    product = request.wait_for(lambda f: [s for s in json.loads(f.plan) if s["label"] == "wash"])[-1]["arguments"][
        "Object"
    ]
    element = cell.wm.get_element(product)
    element.setProperty("skiros:Washed", True)  # nobody needs to do that any more
    element.setProperty("skiros:Labelled", True)
    element.setRelation(cell.store, "skiros:contain", "-1")
    cell.wm.update_element(element)
    assert request.result.state == AchieveResult.SUCCEEDED, request.result.message
    assert cell.is_done
    assert product not in {step["arguments"]["Object"] for step in request.done}


def test_cancelled_goal_stops_its_steps_and_the_next_goal_succeeds(cell: Cell) -> None:
    request = cell.achieve()
    request.wait_for(running)
    request.tasks.preempt()
    assert (request.result.state, request.result.message) == (AchieveResult.CANCELLED, "cancelled")
    assert request.done[-1]["state"] == "stopped"
    assert cell.achieve(f"(skiros:contain {cell.bench} {cell.products[0]})").result.state == AchieveResult.SUCCEEDED


@pytest.mark.long
def test_shutdown_of_the_task_manager_stops_running_steps(own: Ros) -> None:
    cell = Cell(own, SPECIALISTS)
    porter = SkillManagerInterface("/porter", "tests")
    request = cell.achieve()
    request.wait_for(running)
    (task,) = wait_until(lambda: list(porter.tasks), WAIT, "the porter's task")
    porter.pause_one(task)  # by itself it would not end
    os.kill(own.master.node_pid("/tm"), signal.SIGINT)
    own.wait_until_gone("/tm")
    wait_until(lambda: not porter.tasks, WAIT, "the end of the porter's task")
    assert request.result.state == AchieveResult.CANCELLED
    porter.shutdown()


@pytest.mark.long
def test_shutdown_of_the_task_manager_ends_goals_whose_steps_do_not_stop(own: Ros) -> None:
    cell = Cell(own, SPECIALISTS)
    request = cell.achieve()
    request.wait_for(running)
    porter = own.master.node_pid("/porter")
    os.kill(porter, signal.SIGSTOP)
    try:
        os.kill(own.master.node_pid("/tm"), signal.SIGINT)
        result = request.result
    finally:
        os.kill(porter, signal.SIGCONT)
    assert (result.state, result.message) == (AchieveResult.FAILED, "/tm ended before the goal did")


def test_of_two_goals_the_more_urgent_one_gets_the_robot_first(cell: Cell) -> None:
    porter = SkillManagerInterface("/porter", "tests")
    first, second, third = (f"(skiros:contain {cell.store} {product})" for product in cell.products)
    begun = cell.achieve(first)
    begun.wait_for(running)
    (task,) = wait_until(lambda: list(porter.tasks), WAIT, "the porter's task")
    porter.pause_one(task)
    ends: list[str] = []
    low = cell.achieve(second, done_cb=lambda *_: ends.append("low"))
    low.wait_for(lambda f: f.phase == f.RUNNING)  # it has a plan, and waits for the robot
    high = cell.achieve(third, done_cb=lambda *_: ends.append("high"), priority=5)
    high.wait_for(lambda f: f.phase == f.RUNNING)
    assert porter.execute(task) == task
    assert [r.result.state for r in (begun, low, high)] == [AchieveResult.SUCCEEDED] * 3
    assert ends == ["high", "low"]
    porter.shutdown()


def test_impossible_goals_are_rejected_with_the_reason(cell: Cell) -> None:
    washed = f"(skiros:Washed {cell.products[0]})"
    for goal, options, state, message in [
        ("(skiros:contain", {}, AchieveResult.FAILED, "goal, line 1, column"),
        (f"(skiros:contain {cell.products[0]} {cell.bench})", {}, AchieveResult.IMPOSSIBLE, "cannot be reached"),
        (washed, {"quality": "miracle"}, AchieveResult.FAILED, "'miracle'"),
        (washed, {"seconds": float("nan")}, AchieveResult.FAILED, "seconds is nan"),
        (washed, {"seconds": -1.0}, AchieveResult.FAILED, "seconds is -1.0"),
    ]:
        result = cell.achieve(goal, **options).result
        assert (result.state, message in result.message) == (state, True), f"{goal}: {result.message}"
        assert json.loads(result.done) == []
    for quality in ("first", "best", "optimal"):
        cell.wm.set_relation(cell.shelf, "skiros:contain", cell.products[0], True)
        cell.wm.set_relation(cell.store, "skiros:contain", cell.products[0], False)
        request = cell.achieve(f"(skiros:contain {cell.store} {cell.products[0]})", quality=quality, seconds=2.0)
        assert request.result.state == AchieveResult.SUCCEEDED, request.result.message
        assert [step["label"] for step in request.done] == ["carry"]


@pytest.mark.long
def test_a_goal_is_reached_by_a_skill_of_one_robot_with_the_skills_of_others(own: Ros) -> None:
    cell = Cell(own, {**SPECIALISTS, "foreman": ["achieve"]})
    foreman = SkillManagerInterface("/foreman", "tests")
    reach = foreman.get_skill("achieve")
    reach.ph.specify("Goal", cell.goal)
    run = foreman.run([reach])
    assert run.succeeded(WAIT), run.result().message
    assert cell.is_done
    reach.ph.specify("Goal", f"(skiros:contain {cell.products[0]} {cell.bench})")
    hopeless = foreman.run([reach]).result(WAIT)
    assert "No plan: carry needs a location for To, but Product-4 is a product" in hopeless.message
    reach.ph.specify("Goal", f"(skiros:contain {cell.bench} {cell.products[0]})")
    run = foreman.run([reach])
    porter = SkillManagerInterface("/porter", "tests")
    wait_until(lambda: porter.tasks, WAIT, "a step of the porter")
    run.cancel()
    assert run.result(WAIT).message == "Preempted"
    wait_until(lambda: not porter.tasks, WAIT, "the end of the porter's step")
    assert cell.place_of(cell.products[0]) == cell.store
    porter.shutdown()
    foreman.shutdown()
