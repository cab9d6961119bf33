"""Invalid commands and misbehaving skills: a skill manager reports the reason and runs the next task."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import rospy

from skiros2_common.core.world_element import Element
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_skill.ros.skill_manager_interface import SkillManagerInterface
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.ros import Ros, RosMaster, wait_until

pytestmark = pytest.mark.timeout(240)

ROBOT = "/test_robot"
LIBRARIES = Path(__file__).parents[1] / "libraries"
#: The nodes of all trees that must not leak: 400 bytes of each would be noticed.
NODES = 100_000
SUCCESS, FAILURE = msgs.SkillProgress.SUCCESS, msgs.SkillProgress.FAILURE


class Manager:
    """A manager with unruly skills, and a client of it."""

    def __init__(self, ros: Ros) -> None:
        self.ros = ros
        env = {**ros.master.env, "PYTHONPATH": f"{LIBRARIES}:{ros.master.env['PYTHONPATH']}"}
        ros.launch("skiros2", "world_model_server.launch", gui=False)
        self.program = ros.launch(
            "skiros2", "skill_mgr.launch", libraries_list="[skiros2_std_skills, unruly_skills]",
            primitive_list="[wait, counter, unruly]", skill_list="[wide, deep]", env=env,
        )  # fmt: skip
        self.command = ros.service(f"{ROBOT}/command", srvs.SkillCommand)
        self.client = SkillManagerInterface(ROBOT, "tests")
        self.progress = ros.messages(f"{ROBOT}/monitor", msgs.TreeProgress)
        self.wmi = WorldModelInterface("tests")

    def start(self, label: str, **values: Any) -> int:
        holder = self.client.get_skill(label)
        for key, value in values.items():
            holder.ph.specify(key, value)
        task = self.client.execute(skill_list=[holder])
        assert task >= 0, self.client.last_error
        return task

    def end(self, task: int) -> Any:
        """The last progress of a task."""
        ended = self.progress.wait_for(
            lambda m: m.progress[0].task_id == task and abs(m.progress[0].progress_code) == 1, timeout=60.0
        )
        self.progress.clear()
        return ended.progress

    def run(self, label: str, **values: Any) -> Any:
        return self.end(self.start(label, **values))

    def lives(self) -> bool:
        """Whether the next task runs."""
        return self.run("counter", CountTarget=2)[0].state == SUCCESS

    def refusal(self, **request: Any) -> str:
        """Why a command is refused."""
        with pytest.raises(rospy.ServiceException) as refused:
            self.command(author="tests", **request)
        return str(refused.value)

    def add_product(self) -> Element:
        product = Element("skiros:Product", "a product")
        product.addRelation("skiros:Scene-0", "skiros:contain", "-1")
        self.wmi.add_element(product)
        return product


@pytest.fixture(scope="module")
def manager(ros_master: RosMaster) -> Iterator[Manager]:
    """One for all tests: whatever a test does to it, it must run the next one."""
    ros = Ros(ros_master)
    try:
        manager = Manager(ros)
        yield manager
        manager.client.shutdown()
    finally:
        ros.stop()


@pytest.fixture(autouse=True)
def forget_earlier_progress(manager: Manager) -> None:
    manager.progress.clear()


def test_modules_with_import_errors_are_skipped_and_logged_with_the_line(manager: Manager) -> None:
    for named in (
        r"unruly_skills\.exits cannot be imported.*exits\.py, line 5: SystemExit: nothing to do",
        r"unruly_skills\.imports_nothing cannot .*line 3: ModuleNotFoundError: No module named 'no_such_module'",
        r"unruly_skills\.syntax_error cannot .*syntax_error\.py, line 1: ",
    ):
        manager.program.wait_for_line(named)
    assert {"wait", "counter", "unruly", "wide", "deep"} <= set(manager.client.get_skill_list(update=True))
    assert manager.lives()


def said_about(hook: str) -> dict[str, str]:
    """By what a hook does: the message, "" when it is a success."""
    preempted = "Preempted" if hook == "onPreempt" else ""
    return {
        "raise": "RuntimeError: out of coffee",
        "exit": "SystemExit: I am off",
        "recurse": "RecursionError",
        "theirs": "no parameter 'Words'",
        "number": {"execute": "execute returned 7", "onPreempt": "expected a State"}.get(hook, ""),
        "nothing": {"execute": "execute returned None"}.get(hook, preempted),
        "false": preempted or f"{hook} returned False",
        "true": preempted,
        "thread": preempted,
        "ask": preempted,
    }


def test_misbehaving_hook_fails_its_task_with_a_reason_and_the_next_task_runs(manager: Manager) -> None:
    for hook in ("onStart", "execute", "onEnd", "onPreempt"):
        for what, message in said_about(hook).items():
            task = manager.start("unruly", Where=hook, What=what)
            if hook == "onPreempt":
                manager.progress.wait_for(
                    lambda m, task=task: (
                        m.progress[0].task_id == task and m.progress[-1].state == msgs.SkillProgress.RUNNING
                    )
                )
                manager.client.preempt_one(task)
            root, node = manager.end(task)
            assert root.state == (FAILURE if message else SUCCESS), (hook, what, root.progress_message)
            assert message in (root if message == "Preempted" else node).progress_message, (hook, what)
        assert manager.lives()


def test_a_skill_may_remove_its_own_element(manager: Manager) -> None:
    for what in ("remove", "forget"):
        root, node = manager.run("unruly", Where="execute", What=what, Thing=manager.add_product())
        assert root.state == SUCCESS, (what, node.progress_message)
    assert manager.lives()


def test_robot_removed_during_a_task_is_created_again(manager: Manager) -> None:
    """The task fails and names it; a new one runs, or is refused until the robot is there again."""
    task = manager.start("wait", Duration=60.0)
    robots = manager.wmi.resolve_elements(Element("cora:Robot"))
    (robot,) = (r for r in robots if r.hasProperty("skiros:SkillMgr", ROBOT[1:]))
    assert manager.lives()
    eid = robot.id
    manager.wmi.remove_element(robot)
    root, _ = manager.end(task)
    assert root.state == FAILURE
    assert f"element {eid} was removed by tests" in root.progress_message
    counter = manager.client.get_skill("counter")
    counter.ph.specify("CountTarget", 2)
    new = wait_until(lambda: 1 + manager.client.execute(skill_list=[counter]), what="a robot") - 1
    assert manager.end(new)[0].state == SUCCESS
    assert manager.lives()


PARAM = {"key": "CountTarget", "description": "", "specType": 0, "type": "int", "values": [2]}

#: `Param` messages, or what to change in a good one, and what the refusal names.
BAD_PARAMS: list[tuple[Any, str]] = [
    ("", "parameter is not JSON"),
    ("null", "expected a JSON object"),
    ("[" * 100_000, "parameter is not JSON"),
    ('{"key": "CountTarget"}', 'has no "values"'),
    ({"specType": 9}, "specType 9, expected 0 (required), 1 (optional) or 2 (inferred)"),
    ({"type": "os.system"}, "unknown type name 'os.system'"),
    ({"type": "skiros_wm::Element"}, "element"),
    ({"values": 2}, "'values'"),
    ({"values": ["two"]}, "CountTarget"),
    ({"values": []}, "required parameter 'CountTarget' (int) is not set"),
    ({"type": "str", "values": ["2"]}, "CountTarget: expected a value of type int"),
    ({"values": [1e999]}, "CountTarget"),
    ({"key": "CountTraget"}, "has no parameter 'CountTraget'; it has: CountTarget, Robot"),
    ({"key": "Robot", "values": [4]}, "Robot"),
]


def test_unreadable_or_wrong_parameters_are_rejected_by_name(manager: Manager) -> None:
    for bad, named in BAD_PARAMS:
        text = bad if isinstance(bad, str) else json.dumps({**PARAM, **bad})
        skill = msgs.ResourceDescription("skiros:Counter", "counter", [msgs.Param(text)])
        assert named in manager.refusal(action="start", execution_id=-1, skills=[skill]), bad
    assert manager.lives()


def test_missing_elements_are_rejected_by_name(manager: Manager) -> None:
    holder = manager.client.get_skill("unruly")
    holder.ph.specify("Thing", Element("skiros:Product", "", "skiros:Product-4711"))
    assert manager.client.execute(skill_list=[holder]) == -1
    assert "there is no element 'skiros:Product-4711' in the scene" in manager.client.last_error
    assert manager.lives()


def test_invalid_task_commands_are_rejected_without_effect(manager: Manager) -> None:
    task = manager.start("wait", Duration=60.0)
    assert f"task {task} runs already" in manager.refusal(action="start", execution_id=task)
    assert f"task {task} runs already" in manager.refusal(action="tick_once", execution_id=task)
    for action in ("start", "tick_once"):
        assert "a task needs at least one skill" in manager.refusal(action=action, execution_id=-1)
    for action in ("start", "preempt", "pause", "tick_once"):
        for unknown in (4711, -7, 32767):
            assert f"no task {unknown}" in manager.refusal(action=action, execution_id=unknown), (action, unknown)
    assert task in manager.client.tasks
    assert manager.client.pause_one(task)
    assert manager.client.execute(task) == task
    assert manager.client.preempt_one(task)
    assert manager.end(task)[0].progress_message == "Preempted"
    for action in ("start", "preempt", "pause", "tick_once"):
        assert f"no task {task}" in manager.refusal(action=action, execution_id=task)
    assert manager.lives()


@pytest.mark.long
def test_deep_wide_and_endless_trees(manager: Manager) -> None:
    deep = manager.run("deep", Depth=1000)
    assert (deep[0].state, len(deep)) == (SUCCESS, 1003)
    endless = manager.run("deep", Depth=-1)
    assert endless[0].state == FAILURE
    assert "one of them contains itself" in endless[0].progress_message
    wide = manager.run("wide", Width=2000)
    assert (wide[0].state, len(wide)) == (SUCCESS, 2002)
    assert len({node.id for node in wide}) == 2002
    assert manager.lives()


@pytest.mark.long
def test_wide_trees_do_not_leak_memory(manager: Manager) -> None:
    pid = manager.ros.master.node_pid(ROBOT)
    manager.run("wide", Width=10_000)
    before = resident(pid)
    for _ in range(NODES // 1000):
        manager.run("wide", Width=1000)
    # The interpreter takes some 15 MB more in the first 100 tasks, and no more after.
    assert resident(pid) - before < 40
    assert manager.lives()


def resident(pid: int) -> float:
    """What a process has of the machine's memory (MB)."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6
