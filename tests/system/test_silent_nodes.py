"""A robot or the task manager is silent for seconds, as in a gap of a radio network, and continues."""

from __future__ import annotations

import os
import signal
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from skiros2_msgs.msg import TreeProgress
from skiros2_skill.ros.skill_manager_interface import SkillManagerInterface
from support.job_cell import ROBOT, JobCell, job_cell
from support.ros import RosMaster, wait_until

pytestmark = pytest.mark.timeout(600)

SKILL = "carry_when_released"


@pytest.fixture(scope="module")
def cell(ros_master: RosMaster, tmp_path_factory: pytest.TempPathFactory) -> Iterator[JobCell]:
    with job_cell(ros_master, tmp_path_factory.mktemp("silent"), products=5, skill=SKILL) as made:
        yield made


@pytest.fixture(autouse=True)
def nothing_is_released(cell: JobCell) -> None:
    (cell.folder / "released").unlink(missing_ok=True)


def test_task_of_a_silent_robot_continues_and_counts_as_what_it_ends_as(cell: JobCell) -> None:
    before = _counters(cell)
    with _task(cell, 0):
        with _silent_robot(cell):
            assert _counters(cell) == before + Counter(failed=1)
        wait_until(lambda: _robot(cell)["state"] == "busy", what="the task")
        assert _counters(cell) == before
        _release(cell)
        wait_until(lambda: _robot(cell)["state"] == "idle", what="the end")
    assert _counters(cell) == before + Counter(succeeded=1)


def test_task_that_ends_while_its_robot_is_silent_counts_as_what_it_ended_as(cell: JobCell) -> None:
    before = _counters(cell)
    with _task(cell, 1):
        with _silent_robot(cell):
            assert _counters(cell) == before + Counter(failed=1)
            _release(cell)
        wait_until(lambda: _counters(cell) == before + Counter(succeeded=1), what="the end")


def test_step_of_a_silent_robot_is_stopped_before_the_next_plan_starts_one(cell: JobCell) -> None:
    progress = cell.ros.messages(f"{ROBOT}/monitor", TreeProgress).connected()
    _start_job(cell, "replanned", 2)
    with _silent_robot(cell):
        wait_until(lambda: _steps(cell, "replanned") == ["failed"], what="a task manager that has noticed it")
    wait_until(lambda: _steps(cell, "replanned")[-1] == "running", what="the next step")
    _release(cell)

    assert cell.wait_for(["replanned"])["replanned"]["response"]["outcome"] == "succeeded"
    assert _steps(cell, "replanned") == ["failed", "succeeded"]
    assert _most_at_once(progress.all) == 1


def test_step_of_a_silent_robot_is_stopped_if_its_job_was_aborted_meanwhile(cell: JobCell) -> None:
    progress = cell.ros.messages(f"{ROBOT}/monitor", TreeProgress).connected()
    _start_job(cell, "aborted", 3)
    with _silent_robot(cell):
        wait_until(lambda: _steps(cell, "aborted") == ["failed"], what="a task manager that has noticed it")
        assert cell.rest.post("/api/jobs/aborted/abort", {})[0] == 200
        assert cell.wait_for(["aborted"])["aborted"]["state"] == "Aborted"
    end = progress.wait_for(lambda message: abs(message.progress[0].progress_code) == 1)
    assert "preempted" in end.progress[0].params[0].param


def test_job_with_a_restart_policy_waits_for_a_silent_task_manager(cell: JobCell) -> None:
    _release(cell)
    with _silent(cell, "/tm"):
        order = cell.order("patient", 4) | {"on_restart": "continue"}
        assert cell.rest.post("/api/jobs", order)[0] == 201
        time.sleep(5.0)  # a service call is given up after 3 s
    assert cell.wait_for(["patient"])["patient"]["response"]["outcome"] == "succeeded"


# -- the cell --------------------------------------------------------------------------------------------------------


@contextmanager
def _silent(cell: JobCell, node: str) -> Iterator[None]:
    process = cell.ros.master.node_pid(node)
    os.kill(process, signal.SIGSTOP)
    try:
        yield
    finally:
        os.kill(process, signal.SIGCONT)


@contextmanager
def _silent_robot(cell: JobCell) -> Iterator[None]:
    """A robot that counts as disconnected."""
    with _silent(cell, ROBOT):
        wait_until(lambda: _robot(cell)["state"] == "disconnected", what="the silence")
        yield


@contextmanager
def _task(cell: JobCell, product: int) -> Iterator[None]:
    """A task that no job has started runs."""
    manager = SkillManagerInterface(ROBOT, "operator")
    try:
        skill = manager.get_skill(SKILL)
        skill.ph["Object"].setValue(cell.world.wm.get_element(cell.products[product]))
        skill.ph["To"].setValue(cell.world.wm.get_element(cell.stores[0]))
        assert manager.execute(skill_list=[skill]) >= 0, manager.last_error
        wait_until(lambda: _robot(cell)["state"] == "busy", what="the task")
        yield
    finally:
        manager.shutdown()


def _start_job(cell: JobCell, job: str, product: int) -> None:
    assert cell.rest.post("/api/jobs", cell.order(job, product))[0] == 201
    wait_until(lambda: _robot(cell)["state"] == "busy", what="the task")


def _release(cell: JobCell) -> None:
    (cell.folder / "released").write_text("")


def _robot(cell: JobCell) -> Any:
    return cell.rest.get("/api/state")["robots"][0]


def _steps(cell: JobCell, job: str) -> list[str]:
    return [step["state"] for step in cell.rest.get(f"/api/jobs/{job}")["response"]["steps"]]


def _counters(cell: JobCell) -> Counter[str]:
    found = _robot(cell)["counters"]
    return Counter({name: found[name] for name in ("succeeded", "failed")})


def _most_at_once(messages: list[Any]) -> int:
    running: set[int] = set()
    most = 0
    for message in messages:
        root = message.progress[0]
        (running.discard if abs(root.progress_code) == 1 else running.add)(root.id)
        most = max(most, len(running))
    return most
