"""A killed goal executor: the next one continues its goals."""

from __future__ import annotations

import json
import threading
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

import pytest

from skiros2_task.core.commands import End
from skiros2_task.core.engines import EngineProcesses, Limits
from skiros2_task.core.executor import GoalExecutor
from skiros2_task.core.goal_execution import Goal, GoalExecution
from skiros2_task.core.goal_store import GoalStore, OnRestart
from skiros2_task.core.planners import engine_planner
from skiros2_task.core.planning import TaskPlanner, Verdict
from skiros2_task.core.recovery import Restart
from skiros2_task.core.step_codec import decode_step, encode_step
from skiros2_task.core.step_record import Phase, StepState
from support.planning_world import PlanningWorld, transport_world
from support.stand_in_step_runner import StandInStepRunner

GOAL_ID = "order-1"
MANAGER = "/alpha"


class System:
    """A transport world with an executor whose process can be killed."""

    def __init__(self, processes: EngineProcesses, path: Path, seconds: float) -> None:
        self.world: PlanningWorld = transport_world(1, 2, 1)
        self.runner = StandInStepRunner(self.world, seconds)
        self._processes = processes
        self._path = path
        self.question = ""
        self.asked: list[set[str]] = []
        self._over = threading.Event()
        self._asks = threading.Event()
        self.end: End | None = None
        self.start()

    def start(self) -> None:
        self.store = GoalStore(self._path)
        planner = TaskPlanner(self.world.wm, engine_planner(self._processes), Limits(30.0))
        self.executor = GoalExecutor(planner, self.runner, self.store)
        self.runner.on_change = self.executor.world_changed

    def achieve(self, **options: Any) -> GoalExecution:
        goal = f"(forall (?p - skiros:Product) (skiros:contain {self.world.places[-1]} ?p))"
        self.goal = Goal(goal, id=GOAL_ID, **options)
        assert self.store.accept(GOAL_ID, {"goals": goal})
        self.execution = self.executor.achieve(self.goal, self._on_change, self._on_end)
        return self.execution

    def kill(self) -> None:
        """Kills the executor's process. Its robots continue."""
        self.runner.kill_client()
        self.store.close()

    def recover(self) -> None:
        self.start()
        (stored,) = self.store.open_goals()
        self.execution = self.executor.prepare(self.goal, self._on_change, self._on_end)
        restart = Restart(frozenset(), lambda gid: self.store.on_restart(gid) or OnRestart.DEFAULT, self._question)
        self.executor.recover([(self.execution, stored)], restart)
        self.executor.robot_found(MANAGER)

    def wait_for_question(self) -> None:
        assert self._asks.wait(30.0)

    @property
    def labels(self) -> list[str]:
        """The labels of all started steps."""
        return [step.call.label for _, step in self.runner.started]

    def wait(self) -> End:
        assert self._over.wait(30.0)
        assert self.end is not None
        return self.end

    def _question(self, managers: Collection[str]) -> str:
        self.asked.append(set(managers))
        return self.question

    def _on_change(self, execution: GoalExecution) -> None:
        if execution.machine.phase is Phase.ASKING:
            self._asks.set()

    def _on_end(self, execution: GoalExecution, end: End) -> None:
        self.end = end
        self._over.set()


@pytest.fixture
def system(processes: EngineProcesses, tmp_path: Path) -> Iterator[Any]:
    systems: list[System] = []

    def make(seconds: float = 0.3) -> System:
        systems.append(System(processes, tmp_path / "goals", seconds))
        return systems[-1]

    yield make
    for each in systems:
        each.executor.close()
        each.store.close()


def test_running_step_continues_and_no_step_is_done_twice(system: Any) -> None:
    one = system()
    one.achieve()
    one.runner.wait_for_starts(1)
    one.kill()
    one.recover()
    assert (one.wait().verdict, one.end.message) == (Verdict.PLANNED, "the goal is reached")
    assert one.labels == ["pick", "drive", "place"]
    assert [record.state for record in one.execution.started] == [StepState.SUCCEEDED] * 3
    assert one.execution.machine.replans == 0
    assert one.asked == [set()], "the robot's step was running"


def test_step_that_ended_meanwhile_is_not_done_again(system: Any) -> None:
    one = system(0.05)
    one.achieve()
    one.runner.wait_for_starts(1)
    one.kill()
    done = threading.Event()
    one.runner.on_change = done.set
    assert done.wait(5.0) or one.world.wm.get_element(one.world.grippers[0]).getRelations("-1", "skiros:contain")
    one.recover()
    assert one.wait().verdict is Verdict.PLANNED
    assert one.labels == ["pick", "drive", "place"]


def test_interrupted_step_is_planned_again(system: Any) -> None:
    one = system()
    one.achieve()
    one.runner.wait_for_starts(1)
    one.kill()
    one.runner.restart()
    one.recover()
    assert one.wait().verdict is Verdict.PLANNED
    assert one.labels == ["pick", "pick", "drive", "place"]
    assert [record.state for record in one.execution.started] == [StepState.FAILED, *[StepState.SUCCEEDED] * 3]
    assert one.asked == [{MANAGER}]


def test_goal_of_a_robot_that_holds_something_asks(system: Any) -> None:
    one = system()
    one.achieve()
    one.runner.wait_for_starts(2)  # it has picked
    one.kill()
    one.runner.restart()
    one.question = "/alpha holds skiros:Product-3"
    one.recover()
    one.wait_for_question()
    assert one.execution.machine.message == one.question
    assert len(one.runner.started) == 2
    one.store.set_on_restart(GOAL_ID, OnRestart.CONTINUE)
    one.executor.decide(one.execution)
    assert one.wait().verdict is Verdict.PLANNED
    assert one.labels == ["pick", "drive", "drive", "place"]


def test_cancelled_goal_that_asks_ends(system: Any) -> None:
    one = system()
    one.achieve()
    one.runner.wait_for_starts(1)
    one.store.set_on_restart(GOAL_ID, OnRestart.ASK)
    one.kill()
    one.recover()
    one.wait_for_question()
    one.executor.cancel(one.execution)
    assert one.wait().verdict is Verdict.CANCELLED
    assert one.labels == ["pick"]


def test_goal_with_abort_stops_its_step_and_fails(system: Any) -> None:
    one = system()
    one.achieve()
    one.runner.wait_for_starts(1)
    one.store.set_on_restart(GOAL_ID, OnRestart.ABORT)
    one.kill()
    one.recover()
    assert one.wait().verdict is Verdict.FAILED
    assert "on_restart is abort" in one.end.message
    assert [record.state for record in one.execution.started] == [StepState.STOPPED]


def test_goal_that_somebody_reached_meanwhile_ends(system: Any) -> None:
    one = system()
    one.achieve()
    one.runner.wait_for_starts(1)
    one.kill()
    one.runner.restart()
    wm, (start, end), (product,) = one.world.wm, one.world.places, one.world.products
    wm.set_relation(start, "skiros:contain", product, False)
    wm.set_relation(end, "skiros:contain", product, True)
    one.recover()
    assert one.wait().verdict is Verdict.PLANNED
    assert one.labels == ["pick"]


def test_no_step_starts_that_is_not_stored(system: Any) -> None:
    one = system()
    one.store._db.execute("CREATE TRIGGER full BEFORE INSERT ON steps BEGIN SELECT RAISE(ABORT, 'disk full'); END")
    one.achieve(max_replans=0)
    assert one.wait().verdict is Verdict.FAILED
    assert "disk full" in one.end.message
    assert one.labels == []


def test_steps_survive_json(system: Any) -> None:
    one = system(0.0)
    one.achieve()
    one.wait()
    for _, step in one.runner.started:
        again = decode_step(json.loads(json.dumps(encode_step(step))))
        assert again.ground == step.ground
        assert (again.number, again.after, again.uses) == (step.number, step.after, step.uses)
        arguments = [(key, element.id, element.type) for key, element in step.call.arguments]
        assert [(key, element.id, element.type) for key, element in again.call.arguments] == arguments
        assert again.call.parameters == step.call.parameters
