"""Preemption with a held object: the manager puts it down, and goals wait for that and are planned again."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from skiros2_msgs import srv as srvs
from skiros2_msgs.msg import AchieveResult, SkillProgress, TreeProgress
from skiros2_runs.core.progress import task_state
from skiros2_runs.core.states import TaskState
from skiros2_skill.ros.skill_manager_interface import SkillManagerInterface
from skiros2_task.ros.task_manager_interface import TaskManagerInterface
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.hauling_skills import TAKEN
from support.planning_world import PlanningWorld
from support.ros import Ros, run_command, wait_until

pytestmark = pytest.mark.timeout(120)

TESTS = Path(__file__).resolve().parents[1]
ROBOT = "/hauler"
WAIT = 60.0  # s


class Cell:
    """A shelf with two products, a bench, a store, and one robot with a gripper."""

    def __init__(self, ros: Ros) -> None:
        self.ros = ros
        ros.run("skiros2_world_model", "world_model_server_node", name="wm")
        self.wm = WorldModelInterface("tests")
        world = PlanningWorld(self.wm)
        self.shelf, self.bench, self.store = (world.thing("skiros:Location", n) for n in ("shelf", "bench", "store"))
        self.products = [world.thing("skiros:Product", inside=self.shelf) for _ in range(2)]
        self.gripper = world.gripper(world.thing("cora:Robot", "skiros:hauler"))
        params = {
            "libraries_list": ["support.hauling_skills", "skiros2_std_skills"],
            "primitive_list": ["haul", "put_down"],
            "prefix": "skiros",
        }
        env = {**ros.master.env, "PYTHONPATH": f"{TESTS}:{ros.master.env['PYTHONPATH']}"}
        ros.run("skiros2_skill", "skill_manager_node", name=ROBOT[1:], params=params, env=env)
        ros.service(f"{ROBOT}/get_skills", srvs.ResourceGetDescriptions)()
        self.manager = SkillManagerInterface(ROBOT, "tests")
        self.monitor = ros.messages(f"{ROBOT}/monitor", TreeProgress).connected()

    def start_task_manager(self) -> None:
        self.ros.run("skiros2_task", "task_manager_node", name="tm")
        wait_until(lambda: "/tm/achieve/status" in self.ros.master.topics(), WAIT, "the task manager")

    def haul(self, **params: Any) -> Any:
        """Starts to haul the first product to the store, and waits until it is in the gripper."""
        skill = self.manager.get_skill("haul")
        skill.ph.specify("Object", self.wm.get_element(self.products[0]))
        skill.ph.specify("To", self.wm.get_element(self.store))
        for key, value in params.items():
            skill.ph.specify(key, value)
        run = self.manager.run([skill])
        self.wait_until_held(self.products[0])
        assert run.wait_for_task(WAIT) >= 0
        return run

    def take_bench(self, is_taken: bool) -> None:
        """Makes the handler wait, or continue."""
        bench = self.wm.get_element(self.bench)
        bench.setProperty(TAKEN, is_taken)
        self.wm.update_element_properties(bench)

    def place_of(self, product: str) -> str:
        (relation,) = self.wm.get_element(product).getRelations("", "skiros:contain", "-1")
        return str(relation["src"])

    def wait_until_held(self, product: str) -> None:
        wait_until(lambda: self.place_of(product) == self.gripper, WAIT, "the product in the gripper")

    def states(self, task: int) -> list[TaskState]:
        """The reported states of a task, without repetitions."""
        roots = [message.progress[0] for message in self.monitor.all]
        reported = [task_state(root) for root in roots if root.id == task]
        return list(dict.fromkeys(reported))

    def hold_step(self, product: str) -> None:
        """Waits until a step holds a product, and keeps it from ending by itself."""
        self.wait_until_held(product)
        assert self.manager.pause_all()

    def wait_for_state(self, task: int, state: TaskState) -> None:
        wait_until(lambda: state in self.states(task), WAIT, f"task {task} {state}")

    def achieve(self, product: str, **options: Any) -> Request:
        return Request(f"(skiros:contain {self.store} {product})", **options)

    def close(self) -> None:
        self.manager.shutdown()


class Request:
    """A goal that was sent."""

    def __init__(self, goal: str, **options: Any) -> None:
        self.tasks = TaskManagerInterface()
        self.tasks.achieve(goal, **options)

    @property
    def result(self) -> Any:
        return self.tasks.wait_for_result()

    @property
    def done(self) -> list[tuple[str, str]]:
        """State and start place of each started step."""
        return [(step["state"], step["arguments"]["From"]) for step in json.loads(self.result.done)]


@pytest.fixture
def cell(ros: Ros) -> Iterator[Cell]:
    made = Cell(ros)
    yield made
    made.close()


def test_preempted_task_puts_the_object_down_and_shows_that_it_is_ending(cell: Cell) -> None:
    cell.take_bench(True)
    run = cell.haul(Duration=60.0)
    run.cancel()
    cell.wait_for_state(run.task, TaskState.ENDING)
    (tree,) = cell.manager.read_tasks(run.task)
    assert tree[0].progress_message == "ending: on_preempt of skiros:Haul-haul (skiros:PutDown)"
    assert [node.label for node in tree if node.parent_id == tree[0].id] == ["haul", "put_down"]
    watched = run_command(["rosrun", "skiros2_skill", "watch", "--once"], cell.ros.master.env).stdout
    assert f"task {run.task} on {ROBOT}: ending: on_preempt of skiros:Haul-haul (skiros:PutDown)" in watched
    cell.take_bench(False)
    result = run.result(WAIT)
    assert (result.state, result.code, result.message) == (SkillProgress.FAILURE, -1, "Preempted")
    assert cell.place_of(cell.products[0]) == cell.bench
    cell.wait_for_state(run.task, TaskState.PREEMPTED)
    assert cell.states(run.task) == [TaskState.RUNNING, TaskState.ENDING, TaskState.PREEMPTED]


def test_second_stop_abandons_the_handler(cell: Cell) -> None:
    cell.take_bench(True)
    run = cell.haul(Duration=60.0)
    run.cancel()
    cell.wait_for_state(run.task, TaskState.ENDING)
    assert cell.manager.preempt_one(run.task)
    assert run.result(WAIT).message.endswith("(skiros:PutDown) was abandoned: the task was stopped again")
    assert cell.place_of(cell.products[0]) == cell.gripper


def test_stopped_goal_resumes_from_the_place_where_the_object_was_put_down(cell: Cell) -> None:
    cell.start_task_manager()
    request = cell.achieve(cell.products[0])
    cell.hold_step(cell.products[0])
    assert cell.manager.preempt_all()  # somebody stops the robot's task, not the goal
    assert request.result.state == AchieveResult.SUCCEEDED, request.result.message
    assert request.done == [("failed", cell.shelf), ("succeeded", cell.bench)]
    assert cell.place_of(cell.products[0]) == cell.store


@pytest.mark.long
def test_interrupting_goal_waits_until_the_object_is_put_down(cell: Cell) -> None:
    cell.start_task_manager()
    first, second = cell.products
    low = cell.achieve(first)
    cell.hold_step(first)
    ends: list[str] = []
    high = cell.achieve(second, priority=100, done_cb=lambda *_: ends.append(cell.place_of(first)))
    assert high.result.state == AchieveResult.SUCCEEDED, high.result.message
    assert low.result.state == AchieveResult.SUCCEEDED, low.result.message
    assert [state for state, _ in high.done] == ["succeeded"]
    assert low.done == [("stopped", cell.shelf), ("succeeded", cell.bench)]
    assert ends[0] in (cell.bench, cell.gripper), "the first product came to the store after the second one"
    assert [cell.place_of(product) for product in cell.products] == [cell.store] * 2
