"""The task manager node: goals in, plans or reasons out."""

from __future__ import annotations

import json
import os
import signal
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import actionlib
import pytest
from actionlib_msgs.msg import GoalStatus

from skiros2_common.core.errors import Refused, TimedOut
from skiros2_msgs.msg import AssignTaskAction, AssignTaskGoal
from skiros2_skill.ros.utils import SkillHolder, deserialize_skill
from skiros2_task.core.explain_no_plan import NoPlan
from skiros2_task.core.explain_plan import WhyPlan
from skiros2_task.core.preview import Preview
from skiros2_task.ros.task_manager_interface import TaskManagerInterface
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.planning_world import PlanningWorld, transport_world
from support.programs import ProcessId, descendants
from support.ros import Ros, RosMaster, SharedSystem, wait_until

FAILED, NOTHING_TO_DO, PLAN = 1, 2, 3
WAIT = 30.0  # s


@pytest.fixture(scope="module")
def shared(ros_master: RosMaster) -> Iterator[SharedSystem]:
    with SharedSystem(ros_master, start) as system:
        yield system


def start(ros: Ros) -> None:
    ros.run("skiros2_world_model", "world_model_server_node", name="wm")
    ros.run("skiros2_task", "task_manager_node", name="tm")


@pytest.fixture
def world(shared: SharedSystem) -> Iterator[PlanningWorld]:
    """One robot, two places, one product at the first; a world model and a task manager that the tests share."""
    shared.use()
    yield transport_world(wm=WorldModelInterface("tests"))
    shared.restore()


@pytest.fixture
def wm(ros: Ros, shared: SharedSystem) -> WorldModelInterface:
    """A world model without a task manager."""
    shared.stop()
    ros.run("skiros2_world_model", "world_model_server_node", name="wm")
    return WorldModelInterface("tests")


@pytest.fixture
def client(world: PlanningWorld) -> Any:
    client = actionlib.ActionClient("tm/task_plan", AssignTaskAction)
    assert client.wait_for_server(rospy_duration(WAIT))
    return client


def rospy_duration(seconds: float) -> Any:
    import rospy

    return rospy.Duration.from_sec(seconds)


def ask(client: Any, goals: str, author: str = "tests", on_feedback: Callable[..., None] | None = None) -> Any:
    """Sends goals; gives the goal's handle."""
    return client.send_goal(AssignTaskGoal(author=author, goals=goals), None, on_feedback)


def answer(handle: Any) -> tuple[int, str]:
    """The code and the message of the result."""
    wait_until(lambda: handle.get_result() is not None, WAIT, "the task manager's answer")
    return handle.get_result().progress_code, handle.get_result().progress_message


def bring(world: PlanningWorld) -> str:
    return f"(skiros:contain {world.places[1]} {world.products[0]})"


def value(step: SkillHolder, key: str) -> str:
    return str(step.ph.getParamValue(key).id)


def test_a_goal_becomes_a_task_for_a_skill_manager(client: Any, world: PlanningWorld) -> None:
    handle = ask(client, bring(world))
    code, message = answer(handle)
    assert code == PLAN, message
    assert handle.get_goal_status() == GoalStatus.SUCCEEDED
    task = deserialize_skill(message)
    assert (task.type, task.name) == ("Processor", "Sequential")
    assert [(step.manager, step.type, step.name) for step in task.children] == [
        ("/alpha", "skiros:Pick", "pick"),
        ("/alpha", "skiros:Drive", "drive"),
        ("/alpha", "skiros:Place", "place"),
    ]
    pick, drive, place = task.children
    assert (value(pick, "Object"), value(pick, "Place")) == (world.products[0], world.places[0])
    assert (value(drive, "StartLocation"), value(drive, "TargetLocation")) == (world.places[0], world.places[1])
    assert (value(place, "Robot"), value(place, "Gripper")) == (world.robots[0], world.grippers[0])


def test_satisfied_goal_needs_no_plan(client: Any, world: PlanningWorld) -> None:
    handle = ask(client, f"(skiros:at {world.robots[0]} {world.places[0]})")
    assert answer(handle) == (NOTHING_TO_DO, "the goal holds already")
    assert handle.get_goal_status() == GoalStatus.SUCCEEDED


def test_goal_without_a_plan_is_aborted_with_the_reason(client: Any, world: PlanningWorld) -> None:
    (robot,), (start, place), (product,) = world.robots, world.places, world.products
    for goal, expected in [
        (f"(skiros:contain {place} ", "goal, line 1, column"),
        ("", "the goal is empty"),
        (f"(skiros:holds {place} {product})", "unknown relation 'skiros:holds'"),
        (f"(skiros:contain {place} skiros:Product-9999)", "unknown element 'skiros:Product-9999'"),
        (f"(skiros:contain {product} {place})", "No plan: "),
        (f"(skiros:at {robot} {place}), (not (skiros:at {robot} {place}))", "and for the opposite"),
        (f"(skiros:at {robot} {place}), (skiros:at {robot} {start})", "but not all parts together"),
    ]:
        handle = ask(client, goal)
        code, message = answer(handle)
        assert code == FAILED, goal
        assert handle.get_goal_status() == GoalStatus.ABORTED
        assert expected in message
    # and the next request works
    assert answer(ask(client, bring(world)))[0] == PLAN


def test_clients_that_plan_again_and_again_log_no_errors(
    world: PlanningWorld, caplog: pytest.LogCaptureFixture
) -> None:
    """A simple client loses a state that arrives before its `send_goal` has returned."""
    goal = AssignTaskGoal(author="tests", goals=f"(skiros:at {world.robots[0]} {world.places[0]})")
    for _ in range(10):
        simple = actionlib.SimpleActionClient("tm/task_plan", AssignTaskAction)
        assert simple.wait_for_server(rospy_duration(WAIT))
        for _ in range(3):
            simple.send_goal(goal)
        assert simple.wait_for_result(rospy_duration(WAIT))
        assert simple.get_result().progress_code == NOTHING_TO_DO
    assert not [record for record in caplog.records if "tracking" in record.getMessage()]


def test_planning_phases_are_published_as_feedback(client: Any, world: PlanningWorld) -> None:
    told: list[str] = []
    answer(ask(client, bring(world), on_feedback=lambda handle, feedback: told.append(feedback.progress_message)))
    assert any("reading the world model" in text for text in told)
    assert any("planning with" in text for text in told)


def test_plan_uses_the_current_scene(client: Any, world: PlanningWorld) -> None:
    """Each request reads the world model again."""
    world.wm.set_relation(world.robots[0], "skiros:at", world.places[0], False)
    world.wm.set_relation(world.robots[0], "skiros:at", world.places[1], True)
    code, message = answer(ask(client, bring(world)))
    assert code == PLAN
    assert [step.name for step in deserialize_skill(message).children] == ["drive", "pick", "drive", "place"]


def test_a_skill_manager_gets_a_plan_for_its_own_robot(client: Any, world: PlanningWorld) -> None:
    second = transport_world(robots=2, wm=world.wm)  # with an /alpha, too, and a /beta
    for name in ("/alpha", "/beta"):
        code, message = answer(ask(client, bring(second), author=name))
        assert code == PLAN
        assert {step.manager for step in deserialize_skill(message).children} == {name}


def test_concurrent_clients_get_their_own_results(client: Any, world: PlanningWorld) -> None:
    handles = [ask(client, bring(world)) for _ in range(3)]
    other = ask(client, f"(skiros:at {world.robots[0]} {world.places[1]})")
    wrong = ask(client, "(nonsense")
    assert [len(deserialize_skill(answer(handle)[1]).children) for handle in handles] == [3, 3, 3]
    assert [step.name for step in deserialize_skill(answer(other)[1]).children] == ["drive"]
    assert answer(wrong)[0] == FAILED


def test_the_pddl_and_the_log_are_kept(ros_master: RosMaster, client: Any, world: PlanningWorld) -> None:
    answer(ask(client, bring(world)))
    folder = Path(ros_master.env["HOME"]) / ".skiros/planner"
    assert "(:action pick" in (folder / "domain.pddl").read_text()
    assert f"(skiros_contain {world.places[1].lower().replace(':', '_')}" in (folder / "p01.pddl").read_text()
    latest = max((p for p in folder.iterdir() if p.is_dir()), key=lambda p: p.stat().st_mtime_ns)
    assert {"domain.pddl", "p01.pddl", "goal.txt", "result.txt", "planner.log"} <= {p.name for p in latest.iterdir()}


# -- an engine that takes long ------------------------------------------------------------------------------------


@pytest.fixture
def hard(ros: Ros, wm: WorldModelInterface) -> tuple[Any, str]:
    """A client, and a goal that the optimal planner works on for long."""
    world = transport_world(4, 12, 14, wm=wm)
    ros.run("skiros2_task", "task_manager_node", name="tm", params={"planner": "fast-downward-opt"})
    client = actionlib.ActionClient("tm/task_plan", AssignTaskAction)
    assert client.wait_for_server(rospy_duration(WAIT))
    goals = [f"(skiros:contain {world.places[(i + 1) % 12]} {p})" for i, p in enumerate(world.products)]
    return client, ", ".join(goals)


def running_engines(ros: Ros) -> list[ProcessId]:
    """Waits until the task manager's engine searches; gives all processes of the run."""

    def searching() -> list[ProcessId]:
        processes = descendants(ros.master.node_pid("/tm"))
        return processes[1:] if any("bin/downward" in repr(process) for process in processes) else []

    found: list[ProcessId] = wait_until(searching, WAIT, "the planner")
    return found


def wait_for_end(processes: list[ProcessId]) -> None:
    wait_until(lambda: not any(p.running for p in processes), 5.0, f"the end of {processes}")


def test_a_request_can_be_cancelled(ros: Ros, hard: tuple[Any, str]) -> None:
    client, goals = hard
    handle = ask(client, goals)
    engines = running_engines(ros)
    handle.cancel()
    code, message = answer(handle)
    assert code == FAILED and "cancelled" in message
    assert handle.get_goal_status() == GoalStatus.PREEMPTED
    wait_for_end(engines)


def test_shutdown_ends_planning_with_a_result(ros: Ros, hard: tuple[Any, str]) -> None:
    client, goals = hard
    handle = ask(client, goals)
    engines = running_engines(ros)
    os.kill(ros.master.node_pid("/tm"), signal.SIGINT)
    assert answer(handle)[0] == FAILED
    ros.wait_until_gone("/tm")
    wait_for_end(engines)


def test_planner_timeout_is_reported(ros: Ros, wm: WorldModelInterface) -> None:
    world = transport_world(4, 12, 14, wm=wm)
    ros.launch("skiros2", "task_mgr.launch", planner="fast-downward-opt", planning_time=1, max_replans=0)
    client = actionlib.ActionClient("tm/task_plan", AssignTaskAction)
    assert client.wait_for_server(rospy_duration(WAIT))
    goals = [f"(skiros:contain {world.places[(i + 1) % 12]} {p})" for i, p in enumerate(world.products)]
    code, message = answer(ask(client, ", ".join(goals)))
    assert code == FAILED
    assert message.startswith("No plan found in time: ")
    assert "\nverdict: timed out (the planner found no plan within the time limit)" in message


def test_invalid_time_is_rejected(ros: Ros, shared: SharedSystem) -> None:
    shared.stop()
    program = ros.run("skiros2_task", "task_manager_node", name="tm", params={"planning_time": "soon"})
    assert program.wait(WAIT) == 78
    assert "/tm: parameter /tm/planning_time is 'soon', expected seconds" in program.output


# -- the client ---------------------------------------------------------------------------------------------------


def test_the_interface_plans_and_waits(world: PlanningWorld) -> None:
    tasks = TaskManagerInterface()
    done = threading.Event()
    told: list[str] = []
    with pytest.raises(Refused, match="there is no request"):
        tasks.wait_for_result()
    tasks.preempt()  # nothing to end
    wait_until(lambda: connected(tasks), WAIT, "the task manager")
    tasks.plan(
        [bring(world), f"(skiros:at {world.robots[0]} {world.places[0]})"],
        done_cb=lambda state, result: done.set(),
        feedback_cb=lambda feedback: told.append(feedback.progress_message),
    )
    result = tasks.wait_for_result()
    assert result.progress_code == PLAN, result.progress_message
    assert [s.name for s in deserialize_skill(result.progress_message).children] == ["pick", "drive", "place", "drive"]
    assert done.wait(5.0)
    assert told


def test_plan_request_has_order_purpose_and_simulation(world: PlanningWorld) -> None:
    tasks = TaskManagerInterface()
    wait_until(lambda: connected(tasks), WAIT, "the task manager")
    tasks.make_plan(bring(world), quality="best", seconds=2.0)
    result = tasks.wait_for_result()
    assert result.state == result.PLANNED, result.message
    assert [(step["label"], step["after"]) for step in json.loads(result.plan)] == [
        ("pick", []),
        ("drive", [1]),
        ("place", [2]),
    ]
    assert result.makespan == json.loads(result.plan)[-1]["end"] > 0.0
    assert WhyPlan.from_json(result.why).steps[0].serves[0].step == 3
    assert Preview.from_json(result.preview).works
    tasks.make_plan(bring(world), quality="splendid")
    refused = tasks.wait_for_result()
    assert (refused.state, refused.plan) == (refused.FAILED, "[]")
    assert "'splendid' is unknown" in refused.message


def test_plan_request_without_plan_has_reason(world: PlanningWorld) -> None:
    tasks = TaskManagerInterface()
    wait_until(lambda: connected(tasks), WAIT, "the task manager")
    tasks.make_plan(f"(skiros:contain {world.products[0]} {world.places[0]})")
    result = tasks.wait_for_result()
    assert (result.state, result.plan, result.preview) == (result.IMPOSSIBLE, "[]", "")
    assert NoPlan.from_json(result.why).unreachable


def connected(tasks: TaskManagerInterface) -> bool:
    try:
        return tasks.plan("(skiros:at nobody nowhere)") and tasks.wait_for_result() is not None
    except TimedOut:
        return False  # the connection was still that to the task manager of the test before


def test_the_interface_ends_a_request(ros: Ros, hard: tuple[Any, str]) -> None:
    _, goals = hard
    tasks = TaskManagerInterface()
    tasks.plan(goals)
    engines = running_engines(ros)
    tasks.preempt()
    assert tasks.wait_for_result().progress_code == FAILED
    wait_for_end(engines)


def test_interface_without_a_task_manager_does_not_block(shared: SharedSystem) -> None:
    shared.stop()
    with pytest.raises(TimedOut, match="no task manager answers on /tm/achieve"):
        TaskManagerInterface().achieve("(skiros:at a b)")


@pytest.mark.long
def test_invalid_package_xml_is_reported_once_and_the_task_manager_plans(
    ros: Ros, wm: WorldModelInterface, tmp_path: Path
) -> None:
    manifest = tmp_path / "a_draft" / "package.xml"
    manifest.parent.mkdir()
    manifest.write_text("<package><name>a_draft</name></package>")
    world = transport_world(wm=wm)
    path = f"{tmp_path}:{ros.master.env['ROS_PACKAGE_PATH']}"
    program = ros.run("skiros2_task", "task_manager_node", name="tm", env={**ros.master.env, "ROS_PACKAGE_PATH": path})
    client = actionlib.ActionClient("tm/task_plan", AssignTaskAction)
    assert client.wait_for_server(rospy_duration(WAIT))
    assert answer(ask(client, bring(world)))[0] == PLAN
    assert program.output.count(f"{manifest} is skipped") == 1
