"""The figures of robots survive restarts of the gateway."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from skiros2_gateway.core.figures import Figures, report, totals_of
from skiros2_gateway.core.job import Job, Order, Response, State
from skiros2_gateway.core.missed_tasks import MissedTasks
from skiros2_gateway.core.store import FigureKey, JobStore
from skiros2_gateway.http.figures import figures_router
from skiros2_live.core.cell import CellDocument
from skiros2_live.core.patch import GoalProgress, ManagerConnection, TaskProgress
from support.http_gateway import curl, served
from support.progress import FAILURE, SUCCESS, ProgressNode, pick_and_place, root
from unit.skiros2_gateway.conftest import TOKENS

ROBOT = "/robot"


class Cell:
    """The figures of a document; `restart` is what a kill and a new start of the gateway do."""

    def __init__(self, path: Path) -> None:
        self.path, self.now = path, 7000.0
        self.restart()

    def restart(self) -> None:
        self.store = JobStore(self.path)
        self.document = CellDocument(clock=lambda: self.now)
        self.document.continue_counters(totals_of(self.store.figures()))
        self.figures = Figures(self.store, self.document)
        self.document.apply(ManagerConnection(ROBOT, True))

    def run(self, *nodes: ProgressNode, seconds: float = 0.0) -> None:
        self.now += seconds
        self.document.apply(TaskProgress(ROBOT, list(nodes), self.now))

    @property
    def counters(self) -> dict[str, float]:
        counters: dict[str, float] = self.document.robots_data()[0]["counters"]
        return counters


@pytest.fixture
def cell(tmp_path: Path) -> Cell:
    return Cell(tmp_path / "jobs.sqlite")


def test_counters_continue_after_a_restart(cell: Cell) -> None:
    for number, state in enumerate((SUCCESS, SUCCESS, SUCCESS, FAILURE)):
        cell.run(root(number), seconds=50.0)
        cell.run(root(number, state, 1), seconds=50.0)
        cell.figures.write()
    before = cell.counters
    assert (before["total_s"], before["busy_s"], before["quality"], before["oee"]) == (400.0, 200.0, 0.75, 0.75)
    cell.restart()
    assert cell.counters == before
    cell.figures.write()
    cell.restart()
    assert cell.counters == before


def test_killed_robot_lowers_the_oee_also_after_a_restart(cell: Cell) -> None:
    cell.run(root(1))
    cell.run(root(1, SUCCESS, 1), seconds=100.0)
    cell.run(*pick_and_place(task_id=2))
    cell.document.apply(ManagerConnection(ROBOT, False))
    cell.now += 100.0
    cell.figures.write()
    cell.restart()
    assert (cell.counters["failed"], cell.counters["down_s"], cell.counters["oee"]) == (1, 100.0, 0.25)
    assert cell.store.figures()[FigureKey(ROBOT, "failures", "pick")] == 1


@pytest.mark.parametrize("messages", [1, 2])
def test_task_of_a_robot_that_was_silent_is_no_failure(cell: Cell, messages: int) -> None:
    cell.run(*pick_and_place(task_id=2))
    cell.document.apply(ManagerConnection(ROBOT, False))
    cell.now += 100.0
    cell.figures.write()
    assert cell.store.figures()[FigureKey(ROBOT, "failures", "pick")] == 1
    cell.document.apply(ManagerConnection(ROBOT, True))
    ends = [pick_and_place(task_id=2), pick_and_place(SUCCESS, SUCCESS, task_id=2, state=SUCCESS, code=1)]
    for nodes in ends[-messages:]:
        nodes[0].progress_time = cell.now + 100.0 / messages - 7000.0
        cell.run(*nodes, seconds=100.0 / messages)
        cell.figures.write()
    found = cell.store.figures()
    of_pick = [found.get(FigureKey(ROBOT, kind, "pick"), 0.0) for kind in ("runs", "failures", "run_seconds")]
    assert (of_pick, cell.counters["failed"], cell.counters["succeeded"]) == ([1, 0, 200.0], 0, 1)
    assert report(cell.store, 0.0, 1e5)["robots"][0]["quality"] == 1.0


def test_figures_after_a_return_in_a_later_hour_have_no_negative_numbers(cell: Cell) -> None:
    cell.run(*pick_and_place(task_id=2))
    cell.document.apply(ManagerConnection(ROBOT, False))
    cell.figures.write()
    cell.document.apply(ManagerConnection(ROBOT, True))
    nodes = pick_and_place(task_id=2)
    nodes[0].progress_time = 3650.0
    cell.run(*nodes, seconds=3600.0)
    cell.figures.write()
    for begin in (0.0, 7200.0):
        found = report(cell.store, begin, 1e5)
        assert found["robots"][0]["failed"] == 0 and not found["skills"]


def test_figures_of_a_period_are_summed(cell: Cell) -> None:
    for number in range(3):
        cell.run(*pick_and_place(task_id=number), seconds=3500.0)
        nodes = pick_and_place(SUCCESS, SUCCESS, task_id=number, state=SUCCESS, code=1)
        cell.run(*nodes, seconds=100.0)
        cell.figures.write()
    found = cell.store.figures(3, 5)
    assert (found[FigureKey(ROBOT, "runs", "pick")], found[FigureKey(ROBOT, "run_seconds", "pick")]) == (2.0, 200.0)
    assert totals_of(found)[ROBOT].succeeded == 2


def test_figures_over_time_have_as_many_points_as_fit(cell: Cell) -> None:
    for number in range(4):
        cell.run(root(number), seconds=1800.0)
        cell.run(root(number, SUCCESS, 1), seconds=600.0 * (number + 1))
        cell.figures.write()
    found = report(cell.store, 0.0, cell.now)
    assert found["step"] == 3600.0
    points = [(each["begin"] / 3600.0, each["runs"], each["mean_s"]) for each in found["durations"]]
    assert points == [(2, 1, 600.0), (3, 1, 1200.0), (4, 1, 1800.0), (5, 1, 2400.0)]
    assert {each["begin"] / 3600.0 for each in found["throughput"]} == {2, 3, 4, 5}
    assert report(cell.store, 0.0, 1000 * 3600.0)["step"] == 17 * 3600.0


def test_figures_are_read_by_rest_also_as_csv(in_gateway: Callable[..., None]) -> None:
    async def test(gateway: Any) -> None:
        gateway.now = 7300.0
        for job_id, outcome in (("a", "succeeded"), ("b", "failed"), ("c", "failed")):
            await gateway.put(job_id)
            gateway.cell.run(job_id)
            gateway.cell.end(job_id, outcome, "=the gripper, is empty")
        gateway.store.add_figures(
            2, {FigureKey(ROBOT, "seconds", "idle"): 60.0, FigureKey(ROBOT, "tasks", "failed"): 2.0}
        )
        runs = {"runs": 4.0, "run_seconds": 10.0, "failures": 1.0}
        gateway.store.add_figures(2, {FigureKey(ROBOT, kind, "pick"): value for kind, value in runs.items()})
        async with served(gateway.service, routers=[figures_router(lambda: None)]) as address:

            async def read(path: str) -> Any:
                return (await curl(address, f"/api/figures{path}", token=TOKENS["view"]))[1]

            found = await read("?begin=7200&end=7400")
            assert found["jobs"] == [{"outcome": "failed", "jobs": 2}, {"outcome": "succeeded", "jobs": 1}]
            assert found["skills"] == [{"robot": ROBOT, "skill": "pick", "runs": 4, "failures": 1, "mean_s": 2.5}]
            assert (found["robots"][0]["failed"], found["robots"][0]["oee"]) == (2, 0.0)
            assert found == report(gateway.store, 7200.0, 7400.0)
            assert (await read("?end=7000"))["jobs"] == []
            assert await read("/failures.csv") == 'message,jobs\n"\'=the gripper, is empty",2\n'
            assert await read("/skills.csv?begin=20000") == "robot,skill,runs,failures,mean_s\n"
            rows = list(csv.DictReader(io.StringIO(await read("/throughput.csv?begin=7200&end=7400"))))
            assert rows == [{"begin": "1970-01-01T02:00:00Z", "succeeded": "1", "failed": "2"}]

    in_gateway(test)


def test_tasks_of_jobs_that_have_ended_unseen_are_counted_once(cell: Cell) -> None:
    def step(number: int, state: str) -> dict[str, Any]:
        return {"number": number, "robot": ROBOT, "state": state, "message": "", "task": number}

    def progress(goal_id: str) -> GoalProgress:
        texts = SimpleNamespace(phase="running", message="", plan=json.dumps(plan), steps=json.dumps(steps))
        return GoalProgress(goal_id, SimpleNamespace(feedback=texts), cell.now)

    cell.run(root(3), seconds=1.0)  # runs when the gateway starts again
    response = Response(steps=[step(0, "succeeded"), step(1, "running")])
    job = Job(Order(id="a", goal="(at)"), "(at)", 1, 0.0, 0.0, State.RUNNING, response=response)
    jobs = [job, replace(job, order=Order(id="b", goal="(at)"), response=Response())]
    MissedTasks(cell.document, [*jobs, replace(job, order=Order(id="other", goal="(at)"), state=State.ENDED)])
    steps = [step(0, "succeeded"), step(1, "succeeded"), step(2, "failed"), step(3, "running")]
    plan = [{"number": each["number"], "skill": "s", "label": "l", "robot": ROBOT, "arguments": {}} for each in steps]
    for _ in range(2):
        for goal_id in ("a", "other", "of another client"):
            cell.document.apply(progress(goal_id))
    assert (cell.counters["succeeded"], cell.counters["failed"]) == (1, 1)
    cell.run(root(3, SUCCESS, 1), seconds=1.0)
    steps[3]["state"] = "succeeded"
    cell.document.apply(progress("a"))
    assert (cell.counters["succeeded"], cell.counters["failed"]) == (2, 1)
    done = json.dumps([{**plan[0], **step(4, "failed")}])  # it has ended before its steps were asked for
    result = SimpleNamespace(result=SimpleNamespace(state="failed", message="", done=done))
    cell.document.apply(GoalProgress("b", result, cell.now))
    assert (cell.counters["succeeded"], cell.counters["failed"]) == (2, 2)
    cell.figures.write()
    cell.restart()
    assert (cell.counters["succeeded"], cell.counters["failed"]) == (2, 2)


def test_time_without_a_gateway_is_reported_as_unknown(cell: Cell) -> None:
    cell.now = 2 * 3600.0
    cell.restart()
    for seconds in (1.0, 3599.0):
        cell.now += seconds
        cell.figures.write()
    cell.now += 3600.0  # it does not run
    cell.restart()
    cell.now += 1800.0
    cell.figures.write()
    [robot] = report(cell.store, 0.0, cell.now)["robots"]
    assert (robot["total_s"], robot["unknown_s"]) == (5400.0, 5400.0)  # also the rest of the hour
    assert robot["availability"] == 1.0
