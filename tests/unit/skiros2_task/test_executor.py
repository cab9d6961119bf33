"""The goal executor, with simulated robots in a world model."""

from __future__ import annotations

import json
import re
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from skiros2_task.core.commands import End
from skiros2_task.core.engines import EngineProcesses, Job, Limits, PlannerAnswer
from skiros2_task.core.executor import GoalExecutor
from skiros2_task.core.goal_execution import Began, Ended, Goal, GoalExecution
from skiros2_task.core.goal_report import progress_of, result_of
from skiros2_task.core.plan import Plan, Step
from skiros2_task.core.planners import engine_planner
from skiros2_task.core.planning import TaskPlanner, Verdict
from skiros2_task.core.step_record import Phase, StepState
from skiros2_task.core.task import PlanningTask
from skiros2_world_model.core.local_world_model import LocalWorldModel
from support.planning_world import REQUIRED, PlanningWorld, prop, skill, transport_world
from support.stand_in_step_runner import StandInStepRunner


class Cell:
    """A transport world with a executor."""

    def __init__(self, world: PlanningWorld, processes: EngineProcesses, seconds: float = 0.02) -> None:
        self.world = world
        self.step_runner = StandInStepRunner(world, seconds)
        self.executor = GoalExecutor(TaskPlanner(world.wm, engine_planner(processes), Limits(30.0)), self.step_runner)
        self.step_runner.on_change = self.executor.world_changed

    @property
    def goal(self) -> str:
        return f"(forall (?p - skiros:Product) (skiros:contain {self.world.places[-1]} ?p))"

    @property
    def reached(self) -> bool:
        place = self.world.wm.get_element(self.world.places[-1])
        return all(place.hasRelation("-1", "skiros:contain", product) for product in self.world.products)

    def achieve(self, goal: str = "", **options: Any) -> Request:
        return Request(self.executor, Goal(goal or self.goal, **options))

    def move(self, product: str, start: str, end: str) -> None:
        self.world.wm.set_relation(start, "skiros:contain", product, False)
        self.world.wm.set_relation(end, "skiros:contain", product, True)
        self.executor.world_changed()


class Request:
    def __init__(self, executor: GoalExecutor, goal: Goal) -> None:
        self._over = threading.Event()
        self._end: End | None = None
        self.execution = executor.achieve(goal, lambda execution: None, self._on_end)

    def _on_end(self, execution: GoalExecution, end: End) -> None:
        self._end = end
        self._over.set()

    def wait_for(self, condition: Callable[[], object], timeout: float = 10.0) -> bool:
        """Waits for a condition on the execution, which ends the wait as well."""
        deadline = time.monotonic() + timeout
        while not condition() and not self._over.wait(0.01) and time.monotonic() < deadline:
            pass
        return bool(condition())

    @property
    def end(self) -> End:
        assert self._over.wait(30.0)
        assert self._end is not None
        return self._end


Make = Callable[..., Cell]


@pytest.fixture
def cell(processes: EngineProcesses) -> Iterator[Make]:
    cells: list[Cell] = []

    def make(*size: int, seconds: float = 0.02) -> Cell:
        cells.append(Cell(transport_world(*size), processes, seconds))
        return cells[-1]

    yield make
    for one in cells:
        one.executor.close()


def test_steps_are_reported_with_the_numbers_of_their_tasks(cell: Make) -> None:
    busy = cell(1, 2, 1)
    reported: dict[int, int] = {}
    ended = threading.Event()

    def note(execution: GoalExecution) -> None:
        steps = json.loads(progress_of(execution).steps)
        reported.update((step["number"], step["task"]) for step in steps if "task" in step)

    execution = busy.executor.achieve(Goal(busy.goal), note, lambda *_: ended.set())
    assert ended.wait(30.0)
    started = [step.number for _, step in busy.step_runner.started]
    expected = dict(zip(started, range(1, len(started) + 1), strict=True))  # the stand-in numbers its runs
    assert reported == expected
    done = json.loads(result_of(execution, End(Verdict.PLANNED, "")).done)
    assert {step["number"]: step["task"] for step in done} == expected


def test_robots_reach_goal_in_parallel(cell: Make) -> None:
    busy = cell(2, 3, 4)
    request = busy.achieve()
    assert (request.end.verdict, request.end.message) == (Verdict.PLANNED, "the goal is reached")
    assert busy.reached
    assert busy.step_runner.max_parallel == 2
    assert {record.state for record in request.execution.started} == {StepState.SUCCEEDED}
    goals = busy.step_runner.goals
    assert goals[0] and goals == len(goals) * goals[:1], "all steps have that of one goal"
    assert busy.achieve().end.verdict is Verdict.NOTHING_TO_DO
    busy.move(busy.world.products[0], busy.world.places[-1], busy.world.places[0])
    assert busy.achieve().end.verdict is Verdict.PLANNED
    assert goals[-1] and goals[-1] != goals[0], "another goal has another one"


@pytest.mark.parametrize("is_released", [True, False])
def test_goal_waits_for_a_device_whose_release_is_late(
    processes: EngineProcesses, monkeypatch: pytest.MonkeyPatch, is_released: bool
) -> None:
    monkeypatch.setattr("skiros2_task.core.goal_planning._RELEASE_TIME", 10.0 if is_released else 0.3)
    world = PlanningWorld()
    camera = world.thing("skiros:DepthCamera", StateProperty="Busy", LockedBy="/alpha", Power="Off")
    idle = prop("Device", "skiros:StateProperty", "=", "Idle")
    switch_on = prop("Device", "skiros:Power", "=", "On")
    world.robot("alpha", skill("SwitchOn", [("Device", "sumo:Device", REQUIRED)], [idle], [switch_on]))
    busy = Cell(world, processes)
    request = busy.achieve(f"(skiros:Power_On {camera})")
    assert not request.wait_for(lambda: False, 0.1)
    if is_released:
        device = world.wm.get_element(camera)
        device.setProperty("skiros:StateProperty", "Idle")
        device.removeProperty("skiros:LockedBy")
        world.wm.update_element(device)
    assert request.end.verdict is (Verdict.PLANNED if is_released else Verdict.IMPOSSIBLE)
    busy.executor.close()


def test_changed_world_causes_replan_which_is_searched_while_the_world_settles(
    cell: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs: list[Job] = []
    run = EngineProcesses._run

    def count(self: EngineProcesses, job: Job, cancelled: threading.Event) -> PlannerAnswer:
        runs.append(job)
        return run(self, job, cancelled)

    monkeypatch.setattr(EngineProcesses, "_run", count)
    busy = cell(1, 3, 4, seconds=0.2)
    request = busy.achieve()
    busy.step_runner.wait_for_starts(1)
    taken = {element.id for _, step in busy.step_runner.started for _, element in step.call.arguments}
    product = next(p for p in busy.world.products[1:] if p not in taken)
    start = busy.world.places[busy.world.products.index(product) % 3]
    busy.move(product, start, next(p for p in busy.world.places[:-1] if p != start))
    assert request.end.verdict is Verdict.PLANNED
    assert busy.reached
    assert request.execution.machine.replans == 1
    assert len(runs) == 2, "the search that began before the plan was replaced is not repeated"


def test_steps_of_lost_robot_move_to_other(cell: Make) -> None:
    busy = cell(2, 3, 4, seconds=0.2)
    request = busy.achieve()
    busy.step_runner.wait_for_starts(2)
    manager = busy.step_runner.started[0][1].call.manager
    busy.step_runner.lose(manager)
    busy.executor.robot_lost(manager)
    assert request.end.verdict is Verdict.PLANNED
    assert busy.reached
    after = [record for record in request.execution.started if record.step.number >= 3]
    assert manager not in {record.step.call.manager for record in after if record.state is StepState.SUCCEEDED}


def test_goal_waits_for_a_robot_whose_manager_is_restarted(cell: Make) -> None:
    """The world model has removed the skills of the killed manager; its loss is not noticed yet."""
    busy = cell(1, 3, 2)
    wm, robot = busy.world.wm, busy.world.robots[0]
    manager = wm.get_element(robot).value_of("skiros:SkillMgr")
    busy.executor.robot_found(manager)
    skills = wm.get_element(robot).getRelations("-1", "skiros:hasSkill", "")
    assert skills
    for relation in skills:
        wm.set_relation(robot, "skiros:hasSkill", relation["dst"], False)
    request = busy.achieve()
    assert request.wait_for(lambda: request.execution.machine.phase is Phase.BLOCKED)
    for relation in skills:
        wm.set_relation(robot, "skiros:hasSkill", relation["dst"], True)
    busy.executor.robot_found(manager)
    assert request.end.verdict is Verdict.PLANNED
    assert busy.reached


def test_goals_for_one_robot_run_in_sequence(cell: Make) -> None:
    busy = cell(1, 3, 2)
    place = busy.world.places[-1]
    requests = [busy.achieve(f"(skiros:contain {place} {product})") for product in busy.world.products]
    assert [request.end.verdict for request in requests] == [Verdict.PLANNED] * 2
    assert busy.reached
    assert busy.step_runner.max_parallel == 1


def test_goal_is_cancelled_while_running_and_planning(cell: Make) -> None:
    busy = cell(1, 3, 2, seconds=30.0)
    request = busy.achieve()
    busy.step_runner.wait_for_starts(1)
    busy.executor.cancel(request.execution)
    assert request.end.verdict is Verdict.CANCELLED
    assert request.execution.started[-1].state is StepState.STOPPED
    planning = busy.achieve()
    busy.executor.cancel(planning.execution)
    assert planning.end.verdict is Verdict.CANCELLED
    assert planning.execution.started == []


def test_cancelled_goal_stops_its_steps_while_the_executor_is_busy(cell: Make) -> None:
    busy = cell(1, 3, 2, seconds=30.0)
    is_held, released = threading.Event(), threading.Event()
    stopped = threading.Event()
    start = busy.step_runner.start

    def start_step(step: Step, ended: Ended, run: str, began: Began, goal: str) -> Callable[[], None]:
        stop = start(step, ended, run, began, goal)
        return lambda: (stopped.set(), stop())[1]

    def hold(_: GoalExecution) -> None:
        if busy.step_runner.started:
            is_held.set()
            assert released.wait(30.0)

    busy.step_runner.start = start_step  # type: ignore[method-assign]
    execution = busy.executor.achieve(Goal(busy.goal), hold, lambda *_: None)
    assert is_held.wait(30.0)
    busy.executor.cancel(execution)
    was_stopped = stopped.is_set()
    released.set()
    assert was_stopped


def test_invalid_and_impossible_goals_end(cell: Make) -> None:
    busy = cell(1, 2, 1)
    assert busy.achieve("(skiros:contain").end.verdict is Verdict.FAILED
    assert busy.achieve(f"(skiros:contain {busy.world.products[0]} {busy.world.places[0]})").end.verdict is (
        Verdict.IMPOSSIBLE
    )
    assert busy.achieve().end.verdict is Verdict.PLANNED


def test_impossible_goals_do_not_wait_for_each_other(cell: Make) -> None:
    busy = cell(1, 2, 1)
    goals = [f"(skiros:contain {busy.world.products[0]} {place})" for place in busy.world.places]
    requests = [busy.achieve(goal) for goal in goals]
    assert [request.end.verdict for request in requests] == [Verdict.IMPOSSIBLE] * 2


def test_close_cancels_all_goals(cell: Make) -> None:
    busy = cell(2, 3, 4, seconds=30.0)
    requests = [busy.achieve(), busy.achieve()]
    busy.step_runner.wait_for_starts(1)
    busy.executor.close()
    assert [request.end.verdict for request in requests] == [Verdict.CANCELLED] * 2


class BadPlanner:
    """One that has a mistake."""

    name = "bad"

    def solve(self, task: PlanningTask, limits: Limits, cancelled: threading.Event | None = None) -> PlannerAnswer:
        raise RuntimeError("a bug")


class BadStepRunner(StandInStepRunner):
    def start(self, *_: object) -> Callable[[], None]:
        raise RuntimeError("a bug")


def testinternal_error_ends_goal_with_message(processes: EngineProcesses) -> None:
    world = transport_world()
    goal = Goal(f"(skiros:contain {world.places[1]} {world.products[0]})")
    cases = ((BadPlanner(), StandInStepRunner(world)), (engine_planner(processes), BadStepRunner(world)))
    for planner, step_runner in cases:
        executor = GoalExecutor(TaskPlanner(world.wm, planner, Limits(30.0)), step_runner)
        end = Request(executor, goal).end
        assert (end.verdict, end.message) == (Verdict.FAILED, "internal error: RuntimeError: a bug")
        executor.close()


def test_error_after_planning_ends_goal_with_message(cell: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    busy = cell(1, 2, 1)

    def raises(self: Plan, first: int) -> None:
        raise RuntimeError("a bug")

    monkeypatch.setattr(Plan, "numbered_from", raises)
    end = busy.achieve().end
    assert (end.verdict, end.message) == (Verdict.FAILED, "internal error: RuntimeError: a bug")


def test_timers_need_no_threads(cell: Make) -> None:
    busy = cell(1, 2, 1)
    before, over, done = threading.active_count(), threading.Event(), []

    def begin() -> None:
        for number in reversed(range(200)):
            busy.executor.after(0.2 + 0.001 * number, lambda number=number: done.append(number))
        busy.executor.after(0.5, over.set)

    busy.executor._events.put(begin)
    assert not over.wait(0.1)
    assert threading.active_count() == before
    assert over.wait(10.0)
    assert done == list(range(200))


@pytest.mark.parametrize("interrupts", [True, False])
def test_goal_with_higher_priority_waits_for_the_end_of_the_steps_that_it_interrupts(
    cell: Make, interrupts: bool
) -> None:
    busy = cell(1, 3, 2, seconds=30.0 if interrupts else 1.0)
    busy.step_runner.stop_seconds = 0.2
    place, (first, second) = busy.world.places[-1], busy.world.products
    low = busy.achieve(f"(skiros:contain {place} {first})")
    busy.step_runner.wait_for_starts(1)
    busy.step_runner.seconds = 0.02
    high = busy.achieve(f"(skiros:contain {place} {second})", priority=1, interrupts=interrupts)
    assert high.end.verdict is Verdict.PLANNED
    assert low.end.verdict is Verdict.PLANNED
    assert busy.reached
    assert busy.step_runner.max_parallel == 1, "the robot was never used twice"
    stopped = [record for record in low.execution.started if record.state is StepState.STOPPED]
    assert len(stopped) == interrupts
    assert low.execution.machine.replans == 0 or not interrupts
    (high_start, high_end), low_starts = _span(high), [record.started for record in low.execution.started]
    if interrupts:
        assert high_start >= (stopped[0].ended or 0.0)
        assert max(low_starts) >= high_end
    else:
        assert max(low_starts) <= high_start


def _span(request: Request) -> tuple[float, float]:
    records = request.execution.started
    return min(r.started or 0.0 for r in records), max(r.ended or 0.0 for r in records)


PAINT = skill(
    "Paint",
    [("Wall", "skiros:Location", REQUIRED)],
    pre=[prop("Wall", "skiros:Clean", "=", True)],
    post=[prop("Wall", "skiros:Painted", "=", True)],
)


@pytest.fixture
def walls(processes: EngineProcesses) -> Iterator[tuple[PlanningWorld, StandInStepRunner, GoalExecutor]]:
    """Two clean walls, and a robot that paints."""
    world = PlanningWorld()
    world.robot("alpha", PAINT)
    world.places = [world.thing("skiros:Location", Clean=True, Painted=False) for _ in range(2)]
    runner = StandInStepRunner(world)
    executor = GoalExecutor(TaskPlanner(world.wm, engine_planner(processes), Limits(30.0)), runner)
    world.wm.add_listener(executor.world_changed)
    yield world, runner, executor
    executor.close()


def soil(world: PlanningWorld, wall: str, author: str) -> None:
    wm = LocalWorldModel(author, world.wm.model)
    element = wm.get_element(wall)
    element.setProperty("skiros:Clean", False)
    wm.update_element_properties(element)


Walls = tuple[PlanningWorld, StandInStepRunner, GoalExecutor]


@pytest.mark.parametrize(("author", "blamed"), [("/alpha", True), ("a person", False)])
def test_failure_names_the_step_that_changed_an_undeclared_property(walls: Walls, author: str, blamed: bool) -> None:
    world, runner, executor = walls

    def soil_the_other_wall() -> None:
        _, first = runner.started[0]
        (wall,) = (element.id for key, element in first.call.arguments if key == "Wall")
        soil(world, next(place for place in world.places if place != wall), author)

    runner.after_effects = soil_the_other_wall
    goal = ", ".join(f"(skiros:Painted {wall})" for wall in world.places)
    end = Request(executor, Goal(goal)).end
    assert end.verdict is Verdict.IMPOSSIBLE
    assert ("step 1, paint by alpha" in end.message) == blamed
    assert ("the description of skiros:Paint does not declare it" in end.message) == blamed
    (step,) = [line for line in end.message.splitlines() if line.startswith("step 1")] or [""]
    assert bool(re.search(r"made \(skiros:Clean skiros:Location-\d+\) false at \d\d:\d\d:\d\d;", step)) == blamed


def test_failure_names_no_change_that_a_step_has_restored(walls: Walls) -> None:
    world, runner, executor = walls
    runner.seconds = 1.0
    request = Request(executor, Goal(f"(skiros:Painted {world.places[0]}), (skiros:Clean {world.places[1]})"))
    runner.wait_for_starts(1)
    soil(world, world.places[1], "/alpha")
    assert request.wait_for(lambda: str(request.execution.undeclared))
    wm = LocalWorldModel("/alpha", world.wm.model)
    element = wm.get_element(world.places[1])
    element.setProperty("skiros:Clean", True)
    wm.update_element_properties(element)
    assert request.end.verdict is Verdict.PLANNED
    assert not str(request.execution.undeclared)
