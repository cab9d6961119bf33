"""Goals that are carried out in a world model, by robots that follow the skills' conditions."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator

import pytest

from skiros2_task.core.commands import End, JobState
from skiros2_task.core.conductor import Achievement, Conductor, Goal
from skiros2_task.core.engine_processes import EngineProcesses
from skiros2_task.core.planner import Limits, PlannerAnswer
from skiros2_task.core.task import PlanningTask
from skiros2_task.core.task_planner import TaskPlanner, Verdict
from skiros2_task.core.up_planner import UpPlanner
from support.planning_world import PlanningWorld, transport_world
from support.stand_in_crew import StandInCrew


class Cell:
    """A transport world with a conductor."""

    def __init__(self, world: PlanningWorld, processes: EngineProcesses, seconds: float = 0.02) -> None:
        self.world = world
        self.crew = StandInCrew(world, seconds)
        self.conductor = Conductor(TaskPlanner(world.wm, UpPlanner(processes), Limits(30.0)), self.crew)
        self.crew.on_change = self.conductor.world_changed

    @property
    def goal(self) -> str:
        return f"(forall (?p - skiros:Product) (skiros:contain {self.world.places[-1]} ?p))"

    @property
    def reached(self) -> bool:
        place = self.world.wm.get_element(self.world.places[-1])
        return all(place.hasRelation("-1", "skiros:contain", product) for product in self.world.products)

    def achieve(self, goal: str = "", **options: int) -> Request:
        return Request(self.conductor, Goal(goal or self.goal, **options))

    def move(self, product: str, start: str, end: str) -> None:
        self.world.wm.set_relation(start, "skiros:contain", product, False)
        self.world.wm.set_relation(end, "skiros:contain", product, True)
        self.conductor.world_changed()


class Request:
    def __init__(self, conductor: Conductor, goal: Goal) -> None:
        self._over = threading.Event()
        self._end: End | None = None
        self.achievement = conductor.achieve(goal, lambda achievement: None, self._on_end)

    def _on_end(self, achievement: Achievement, end: End) -> None:
        self._end = end
        self._over.set()

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
        one.conductor.close()


def test_several_robots_reach_a_goal_side_by_side(cell: Make) -> None:
    busy = cell(2, 3, 4)
    request = busy.achieve()
    assert (request.end.verdict, request.end.message) == (Verdict.PLANNED, "the goal is reached")
    assert busy.reached
    assert busy.crew.at_once == 2
    assert {record.state for record in request.achievement.done} == {JobState.SUCCEEDED}
    assert busy.achieve().end.verdict is Verdict.NOTHING_TO_DO


def test_what_others_change_is_planned_with(cell: Make) -> None:
    busy = cell(1, 3, 4, seconds=0.2)
    request = busy.achieve()
    busy.crew.wait_for_starts(1)
    taken = {element.id for _, job in busy.crew.begun for _, element in job.call.arguments}
    product = next(p for p in busy.world.products[1:] if p not in taken)
    start = busy.world.places[busy.world.products.index(product) % 3]
    busy.move(product, start, next(p for p in busy.world.places[:-1] if p != start))
    assert request.end.verdict is Verdict.PLANNED
    assert busy.reached
    assert request.achievement.executive.replans == 1


def test_the_work_of_a_robot_that_disappears_is_done_by_another(cell: Make) -> None:
    busy = cell(2, 3, 4, seconds=0.2)
    request = busy.achieve()
    busy.crew.wait_for_starts(2)
    manager = busy.crew.begun[0][1].call.manager
    busy.crew.lose(manager)
    busy.conductor.robot_gone(manager)
    assert request.end.verdict is Verdict.PLANNED
    assert busy.reached
    after = [record for record in request.achievement.done if record.job.number >= 3]
    assert manager not in {record.job.call.manager for record in after if record.state is JobState.SUCCEEDED}


def test_goals_that_want_the_same_robot_are_carried_out_one_after_the_other(cell: Make) -> None:
    busy = cell(1, 3, 2)
    place = busy.world.places[-1]
    requests = [busy.achieve(f"(skiros:contain {place} {product})") for product in busy.world.products]
    assert [request.end.verdict for request in requests] == [Verdict.PLANNED] * 2
    assert busy.reached
    assert busy.crew.at_once == 1


def test_a_goal_is_cancelled_while_steps_run_and_while_it_is_planned(cell: Make) -> None:
    busy = cell(1, 3, 2, seconds=30.0)
    request = busy.achieve()
    busy.crew.wait_for_starts(1)
    busy.conductor.cancel(request.achievement)
    assert request.end.verdict is Verdict.CANCELLED
    assert request.achievement.done[-1].state is JobState.STOPPED
    planning = busy.achieve()
    busy.conductor.cancel(planning.achievement)
    assert planning.end.verdict is Verdict.CANCELLED
    assert planning.achievement.done == []


def test_a_goal_that_cannot_be_read_or_reached_is_answered(cell: Make) -> None:
    busy = cell(1, 2, 1)
    assert busy.achieve("(skiros:contain").end.verdict is Verdict.FAILED
    assert busy.achieve(f"(skiros:contain {busy.world.products[0]} {busy.world.places[0]})").end.verdict is (
        Verdict.IMPOSSIBLE
    )
    assert busy.achieve().end.verdict is Verdict.PLANNED


def test_goals_without_a_plan_do_not_wait_for_each_other(cell: Make) -> None:
    busy = cell(1, 2, 1)
    goals = [f"(skiros:contain {busy.world.products[0]} {place})" for place in busy.world.places]
    requests = [busy.achieve(goal) for goal in goals]
    assert [request.end.verdict for request in requests] == [Verdict.IMPOSSIBLE] * 2


def test_closing_ends_all_goals(cell: Make) -> None:
    busy = cell(2, 3, 4, seconds=30.0)
    requests = [busy.achieve(), busy.achieve()]
    busy.crew.wait_for_starts(1)
    busy.conductor.close()
    assert [request.end.verdict for request in requests] == [Verdict.CANCELLED] * 2


class BadPlanner:
    """One that has a mistake."""

    name = "bad"

    def solve(self, task: PlanningTask, limits: Limits, cancelled: threading.Event | None = None) -> PlannerAnswer:
        raise RuntimeError("a bug")


class BadCrew(StandInCrew):
    def start(self, *_: object) -> Callable[[], None]:
        raise RuntimeError("a bug")


def test_a_mistake_of_our_own_ends_the_goal_with_a_message(processes: EngineProcesses) -> None:
    world = transport_world()
    goal = Goal(f"(skiros:contain {world.places[1]} {world.products[0]})")
    for planner, crew in ((BadPlanner(), StandInCrew(world)), (UpPlanner(processes), BadCrew(world))):
        conductor = Conductor(TaskPlanner(world.wm, planner, Limits(30.0)), crew)
        end = Request(conductor, goal).end
        assert (end.verdict, end.message) == (Verdict.FAILED, "internal error: RuntimeError: a bug")
        conductor.close()
