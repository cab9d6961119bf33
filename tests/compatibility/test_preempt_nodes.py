"""Preemption of tasks on a skill manager node."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from compatibility.rules import rule
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_skill.ros.skill_manager_interface import SkillManagerInterface
from support.ros import Messages, Ros, RosMaster

pytestmark = pytest.mark.timeout(240)

ROBOT = "/test_robot"
LIBRARIES = Path(__file__).parents[1] / "libraries"


class Cell:
    """A manager with stubborn skills, and a client of it."""

    def __init__(self, ros: Ros) -> None:
        env = {**ros.master.env, "PYTHONPATH": f"{LIBRARIES}:{ros.master.env['PYTHONPATH']}"}
        ros.launch("skiros2", "world_model_server.launch", gui=False)
        ros.launch(
            "skiros2", "skill_mgr.launch", libraries_list="[stubborn_skills]",
            primitive_list="[block, hang, brake, creep]", skill_list="[]", env=env,
        )  # fmt: skip
        ros.service(f"{ROBOT}/command", srvs.SkillCommand)
        self.client = SkillManagerInterface(ROBOT, "tests")
        self.progress: Messages = ros.messages(f"{ROBOT}/monitor", msgs.TreeProgress)

    def start(self, *labels: str, seconds: float = 0.0) -> int:
        """Starts skills one after the other, and waits until the first runs."""
        self.progress.clear()
        holders = [self.client.get_skill(label) for label in labels]
        for holder in holders:
            holder.ph.specify("Seconds", seconds)
        task = self.client.execute(skill_list=holders)
        assert task >= 0, self.client.last_error
        if labels[0] in ("brake", "creep"):
            self.progress.wait_for(lambda m: m.progress[0].id == task and len(m.progress) > 1)
        return task

    def end(self, task: int) -> Any:
        """The last progress of a task."""
        ended = self.progress.wait_for(lambda m: m.progress[0].id == task and abs(m.progress[0].progress_code) == 1)
        return ended.progress


@pytest.fixture(scope="module")
def cell(ros_master: RosMaster) -> Iterator[Cell]:
    ros = Ros(ros_master)
    cell = Cell(ros)
    yield cell
    cell.client.shutdown()
    ros.stop()


@rule(
    "robustness",
    "`preempt` answers at once; the task's result is failure (root state 2, code -1) whatever a running "
    "`execute` still returns",
    better="no further skill of the task starts",
)
def test_preempted_task_fails_regardless_of_execute(cell: Cell) -> None:
    task = cell.start("block", "creep", seconds=1.0)
    began_at = time.monotonic()
    assert cell.client.preempt_one(task)
    assert time.monotonic() - began_at < 0.5
    root, first, second = cell.end(task)
    assert (root.state, root.progress_code) == (msgs.SkillProgress.FAILURE, -1)
    assert first.progress_message == "done"
    assert second.state == msgs.SkillProgress.IDLE


@rule("robustness", "A hook that does not return is abandoned 2 s after the preemption; the manager continues")
def test_hanging_hook_is_abandoned_after_two_seconds(cell: Cell) -> None:
    task = cell.start("hang")
    began_at = time.monotonic()
    assert cell.client.preempt_one(task)
    root, node = cell.end(task)
    assert 1.5 < time.monotonic() - began_at < 6.0
    assert (root.state, root.progress_code) == (msgs.SkillProgress.FAILURE, -1)
    assert "execute has not returned" in node.progress_message
    assert cell.end(cell.start("block"))[0].state == msgs.SkillProgress.SUCCESS


@rule(
    "robustness",
    "A skill that returns Running from `onPreempt` is ticked on, for up to 10 s; the task has failed though "
    "the skill succeeds",
)
def test_a_skill_may_end_softly_after_its_preemption(cell: Cell) -> None:
    task = cell.start("brake", seconds=3.0)
    assert cell.client.preempt_one(task)
    root, node = cell.end(task)
    assert (root.state, root.progress_code) == (msgs.SkillProgress.FAILURE, -1)
    assert node.progress_message == "stopped softly"
