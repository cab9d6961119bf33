"""The action `~execute` and the services `~why` and `~inspect` of a skill manager."""

import dataclasses
import json
import os
import signal
from pathlib import Path

import actionlib
import pytest
import rospy
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray

from skiros2_common.core.errors import TimedOut, UnknownName
from skiros2_common.core.explanation import EXECUTE, INFERENCE, PARAMETER, START
from skiros2_common.core.world_element import Element
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_skill.client.manager import ManagerClient
from skiros2_skill.ros.skill_manager_interface import SkillManagerInterface
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.ros import Ros, RosMaster, SharedSystem, wait_until

pytestmark = pytest.mark.timeout(90)

ROBOT = "/test_robot"
TESTS = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def shared(ros_master: RosMaster):
    with SharedSystem(ros_master, launch) as system:
        yield system


def launch(ros: Ros) -> None:
    """A world model with a blank scene, and one robot with the skills of `support.hand_skills`."""
    path = f"{TESTS}:{ros.master.env['PYTHONPATH']}"
    ros.launch(
        "skiros2", "skiros.launch", gui=False, task_mgr_on=False, libraries_list="[support.hand_skills]",
        primitive_list="[add, stay, give_up, weigh]", env={**ros.master.env, "PYTHONPATH": path},
    )  # fmt: skip
    ros.service(f"{ROBOT}/command", srvs.SkillCommand)


@pytest.fixture
def robot(shared: SharedSystem):
    """The client of the robot of a system that the tests share."""
    shared.use()
    client = SkillManagerInterface(ROBOT, "tests")
    wait_until(client._monitor_sub.get_num_connections, what="the connection to the manager")
    yield client
    client.preempt_all()
    wait_until(lambda: not client.tasks, what="the end of all tasks")
    client.shutdown()
    shared.restore()


def connected_client(shared: SharedSystem) -> actionlib.SimpleActionClient:
    """An action client to which the robot sends results: `wait_for_server` returns before its publisher does so.

    Its `wait_for_result` and callbacks miss what arrives before `send_goal` has returned; `get_result` does not.
    """
    client = actionlib.SimpleActionClient(f"{ROBOT}/execute", msgs.ExecuteSkillsAction)
    assert client.wait_for_server(rospy.Duration(30))
    reader = (rospy.get_name(), f"{ROBOT}/execute/result")
    master = shared.use().master
    wait_until(lambda: reader in master.readers(ROBOT), what="the connection for results")
    return client


@pytest.fixture
def own_robot(ros: Ros, shared: SharedSystem):
    """The client of the robot of a system that the test may break."""
    shared.stop()
    launch(ros)
    client = SkillManagerInterface(ROBOT, "tests")
    wait_until(client._monitor_sub.get_num_connections, what="the connection to the manager")
    yield client
    client.shutdown()


def skill(robot, label, **values):
    holder = robot.get_skill(label)
    for key, value in values.items():
        holder.ph.specify(key, value)
    return holder


# -- commands of a new client ------------------------------------------------------------------------------------------


def test_new_client_hears_of_the_end_of_a_task_that_it_starts_at_once(robot):
    for _ in range(5):
        client = SkillManagerInterface(ROBOT, "hasty")
        started = client.execute(skill_list=[skill(robot, "add", A=1, B=2)])
        wait_until(lambda: not client.tasks, what=f"the end of task {started}")  # noqa: B023
        client.shutdown()


def test_new_client_hears_of_the_end_of_a_task_that_it_stops_at_once(robot):
    for _ in range(5):
        client = SkillManagerInterface(ROBOT, "hasty")
        started = client.execute(skill_list=[skill(robot, "stay")])
        client.preempt_one(started)
        wait_until(lambda: not client.tasks, what=f"the end of task {started}")  # noqa: B023
        client.shutdown()


# -- what goals become -------------------------------------------------------------------------------------------------


def test_successful_goal_returns_the_final_parameters(robot):
    run = robot.run([skill(robot, "add", A=2.0, B=3.0)])
    result = run.result(30)
    assert (result.state, result.code, result.message) == (msgs.SkillProgress.SUCCESS, 1, "End")
    params = run.params()
    assert {key: params[key].value for key in ("A", "B", "Sum")} == {"A": 2.0, "B": 3.0, "Sum": 5.0}
    assert params["Robot"].value.getProperty("skiros:SkillMgr").value == ROBOT[1:]
    assert run.explanations() == []
    assert run.task == result.task_id >= 0


def test_result_contains_inferred_parameters(robot):
    wmi = WorldModelInterface("tests")
    box, product = boxed_product(wmi)
    run = robot.run([skill(robot, "weigh", Container=box)])
    assert run.succeeded(30)
    assert run.params()["Object"].value.id == product.id


def test_failed_goal_returns_code_message_and_explanation(robot):
    run = robot.run([skill(robot, "add", B=1.0), skill(robot, "give_up")])
    result = run.result(30)
    assert (result.state, result.code) == (msgs.SkillProgress.FAILURE, -7)
    assert result.message == "skiros:Give-give_up(Failure): too heavy"
    (why,) = run.explanations()
    assert (why.stage, why.code, why.message, why.path) == (EXECUTE, -7, "too heavy", ["give_up"])
    assert run.params()["Sum"].value == 2.0, "what was done before the failure is told too"


def test_cancellation_does_not_wait_for_a_goal_that_cannot_begin(ros, robot):
    run = robot.run([skill(robot, "stay")])
    run.wait_for_task(30)
    add = skill(robot, "add", B=1.0)
    pid = ros.master.node_pid("/wm")
    os.kill(pid, signal.SIGSTOP)
    try:
        waiting = robot.run([add])  # a start reads the world model
        run.cancel()
        assert run.result(20).message == "Preempted"
        assert not waiting.done
    finally:
        os.kill(pid, signal.SIGCONT)
    assert waiting.succeeded(30)


def test_goal_cancelled_before_its_start_does_not_start(ros, robot):
    stay = skill(robot, "stay")
    pid = ros.master.node_pid("/wm")
    os.kill(pid, signal.SIGSTOP)
    try:
        run = robot.run([stay])
        wait_until(lambda: run._handle.get_comm_state() != actionlib.CommState.WAITING_FOR_GOAL_ACK, what="the goal")
        run.cancel()
        wait_until(lambda: run._handle.get_goal_status() == GoalStatus.RECALLING, what="the cancellation")
    finally:
        os.kill(pid, signal.SIGCONT)
    assert run.result(30).task_id < 1
    assert robot.read_tasks() == []


def test_cancelling_one_of_several_goals_keeps_the_others(robot):
    runs = [robot.run([skill(robot, "stay")]) for _ in range(3)]
    tasks = [run.wait_for_task(30) for run in runs]
    assert len(set(tasks)) == 3
    assert -1 not in tasks
    runs[1].cancel()
    result = runs[1].result(30)
    assert (result.state, result.code, result.message) == (msgs.SkillProgress.FAILURE, -1, "Preempted")
    assert robot.run([skill(robot, "add", B=1.0)]).succeeded(30)
    assert not runs[0].done
    assert not runs[2].done
    assert robot.preempt_all()
    assert [run.result(30).message for run in (runs[0], runs[2])] == ["Preempted", "Preempted"]


def test_an_actionlib_client_sees_the_states_of_the_protocol(robot, shared):
    client = connected_client(shared)

    def end_of(*skills):
        client.send_goal(msgs.ExecuteSkillsGoal("tests", [s.toMsg() for s in skills], ""))
        wait_until(client.get_result, what="the result")
        return client.get_state(), client.get_goal_status_text()

    assert end_of(skill(robot, "add", B=1.0)) == (GoalStatus.SUCCEEDED, "End")
    assert end_of(skill(robot, "give_up")) == (GoalStatus.ABORTED, "skiros:Give-give_up(Failure): too heavy")
    assert end_of() == (GoalStatus.REJECTED, "a task needs at least one skill, the list is empty")

    client.send_goal(msgs.ExecuteSkillsGoal("tests", [skill(robot, "stay").toMsg()], ""))
    wait_until(lambda: client.get_state() == GoalStatus.ACTIVE, what="the start")
    client.cancel_goal()
    assert client.wait_for_result(rospy.Duration(30))
    assert (client.get_state(), client.get_goal_status_text()) == (GoalStatus.PREEMPTED, "Preempted")
    client.action_client.stop()


def test_feedback_is_published_only_on_change(ros, robot):
    monitor = ros.messages(f"{ROBOT}/monitor", msgs.TreeProgress).connected()
    fed = []
    run = robot.run([skill(robot, "add", B=1.0), skill(robot, "stay")], monitor_cb=fed.append)
    task = run.wait_for_task(30)
    running = [(":Root", msgs.SkillProgress.RUNNING), ("skiros:Add", msgs.SkillProgress.SUCCESS)]
    running.append(("skiros:Stay", msgs.SkillProgress.RUNNING))
    assert [(node.type, node.state) for node in fed[-1].progress] == running
    monitor.clear()
    for _ in range(2):  # the monitor repeats itself each second
        monitor.wait_for(lambda m: m.progress[0].id == task)
        monitor.clear()
    assert len(fed) == 1
    run.cancel()
    run.result(30)
    assert {feedback.task_id for feedback in fed} == {task}


def test_task_continues_without_its_client(ros, robot):
    other = SkillManagerInterface(ROBOT, "somebody else")
    task = other.run([skill(robot, "stay")]).wait_for_task(30)
    other.shutdown()
    monitor = ros.messages(f"{ROBOT}/monitor", msgs.TreeProgress).connected()
    monitor.wait_for(lambda m: m.progress[0].id == task)
    assert robot.preempt_one(task)
    monitor.wait_for(lambda m: m.progress[0].id == task and m.progress[0].progress_code == -1)


@pytest.mark.long
def test_goals_end_when_the_manager_shuts_down(ros, own_robot):
    run = own_robot.run([skill(own_robot, "stay")])
    run.wait_for_task(30)
    ros.stop()
    assert run.result(30).message == "Preempted"


# -- goals that cannot be followed ------------------------------------------------------------------------------------

REFUSED = [
    ([], "a task needs at least one skill"),
    ([msgs.ResourceDescription("skiros:Ad", "", [])], "no skill of type skiros:Ad; near: skiros:Add"),
    ([msgs.ResourceDescription("skiros:Add", "nobody", [])], "no implementation 'nobody'"),
    ([msgs.ResourceDescription("skiros:Add", "add", [])], "required parameter 'B' (float) is not set"),
    ([msgs.ResourceDescription("skiros:Add", "add", [msgs.Param("{")])], "parameter is not JSON"),
    ([msgs.ResourceDescription("skiros:Add", "add", [msgs.Param("[" * 100_000)])], "parameter is not JSON"),
    ([msgs.ResourceDescription("skiros:Add", "add", [msgs.Param("7")])], "expected a JSON object"),
    ([msgs.ResourceDescription("", "", [])], "no skill of type"),
]


def test_invalid_goals_are_rejected_with_the_reason(robot, shared):
    client = connected_client(shared)
    for skills, named in REFUSED:
        client.send_goal(msgs.ExecuteSkillsGoal("tests", skills, ""))
        result = wait_until(client.get_result, what="the result")
        assert client.get_state() == GoalStatus.REJECTED
        assert named in result.message
        assert "\n" not in result.message
        assert (result.task_id, result.state, result.code) == (-1, msgs.SkillProgress.FAILURE, -1)
        (why,) = json.loads(result.explanation)
        stage = PARAMETER if "parameter 'B'" in named or "JSON" in named else START
        assert (why["stage"], why["message"]) == (stage, result.message)
        assert robot.why().explanations[0].message == result.message
    client.action_client.stop()
    assert robot.run([skill(robot, "add", B=1.0)]).succeeded(30)


# -- why --------------------------------------------------------------------------------------------------------------


def test_why_explains_a_failed_task(ros, robot):
    monitor = ros.messages(f"{ROBOT}/monitor", msgs.TreeProgress).connected()
    wmi = WorldModelInterface("tests")
    box = Element("skiros:LargeBox", "an empty box")
    box.addRelation("skiros:Scene-0", "skiros:contain", "-1")
    wmi.add_element(box)
    run = robot.run([skill(robot, "weigh", Container=box)])
    result = run.result(30)
    refused = monitor.wait_for(lambda m: m.progress[0].id == run.task and m.progress[0].progress_code == -1)
    assert [len(node.progress_message.splitlines()) for node in refused.progress] == [1, 1]
    assert result.message == refused.progress[0].progress_message
    text = robot.why(run.task).text
    assert text.startswith("weigh did not start: ")
    assert text.splitlines()[1] == f"task {run.task} by tests has failed"
    (why,) = robot.why(run.task).explanations
    assert why.stage == INFERENCE
    assert why == run.explanations()[0]


def test_why_names_the_author_of_the_last_change_of_a_condition(robot):
    cleaner = WorldModelInterface("/cleaner")
    box = Element("skiros:LargeBox", "a box")
    product = Element("skiros:Product", "a product")
    cleaner.add_elements([box, product])
    cleaner.set_relation(box.id, "skiros:contain", product.id)
    cleaner.set_relation(box.id, "skiros:contain", product.id, False)
    run = robot.run([skill(robot, "weigh", Container=box, Object=product)])
    assert not run.succeeded(30)
    text = robot.why(run.task).text
    assert text.startswith("weigh did not start: a product is nowhere: cleaner removed it from a box at ")
    assert "[InIt] a box contains nothing; nothing contains a product" in text
    (why,) = robot.why(run.task).explanations
    assert [(c.element, c.author) for c in why.all_changes()] == [(box.id, "/cleaner"), (product.id, "/cleaner")]


@pytest.mark.long
def test_why_without_a_task_explains_the_last_failure(ros, own_robot):
    answer = ros.service(f"{ROBOT}/why", srvs.SkillWhy)(-1)
    assert (answer.ok, answer.text) == (False, "no task has failed or was refused")
    own_robot.run([skill(own_robot, "give_up")]).result(30)
    assert own_robot.run([skill(own_robot, "add", B=1.0)]).succeeded(30)
    assert "give_up failed: too heavy." in own_robot.why().text
    assert own_robot.execute(skill_list=[skill(own_robot, "add")]) == -1
    assert own_robot.why().text.startswith("add did not start: required parameter 'B' (float) is not set.")


def test_why_reports_running_and_unknown_tasks(ros, robot):
    task = robot.run([skill(robot, "stay")]).wait_for_task(30)
    assert robot.why(task).text == f"task {task} by tests runs: nothing has failed"
    answer = ros.service(f"{ROBOT}/why", srvs.SkillWhy)(4711)
    assert not answer.ok
    assert "task 4711 neither runs nor is it among the last 100" in answer.text


# -- inspect ----------------------------------------------------------------------------------------------------------


def test_inspect_reports_a_node_of_a_running_task(robot):
    task = robot.run([skill(robot, "stay")]).wait_for_task(30)
    manager = ManagerClient(ROBOT, "tests")
    ((_, node, *_),) = manager.read_tasks(task)
    now = manager.inspect(task, node.id)
    assert dataclasses.replace(robot.inspect(task, node.id), time=now.time) == now
    assert (now.node, now.type, now.label) == (node.id, node.type, "stay")
    assert "Robot" in {p.key for p in now.params if p.value}
    for ids, text in (((task, 4711), f"task {task} has no node 4711"), ((4711, 1), "4711")):
        with pytest.raises(UnknownName, match=text):
            manager.inspect(*ids)
        with pytest.raises(UnknownName, match=text):
            robot.inspect(*ids)


# -- preview ----------------------------------------------------------------------------------------------------------


def test_preview_answers_as_the_start_would(robot):
    box, product = Element("skiros:LargeBox", "full box"), Element("skiros:Product", "a product")
    wmi = WorldModelInterface("/previewer")
    wmi.add_elements([box, product])
    wmi.set_relation(box.id, "skiros:contain", product.id)
    fits = robot.preview([skill(robot, "weigh", Container=box)])
    assert (fits.label, fits.refusal, fits.elements["Object"].id) == ("weigh", None, product.id)
    wmi.set_relation(box.id, "skiros:contain", product.id, False)
    run = robot.run([skill(robot, "weigh", Container=box)])
    assert not run.succeeded(30)
    refusal = robot.preview([skill(robot, "weigh", Container=box)]).refusal
    assert (refusal.stage, refusal.message) == (INFERENCE, run.explanations()[0].message)


def test_preview_of_a_wrong_request_leaves_no_record(robot):
    robot.run([skill(robot, "give_up")]).result(30)
    assert "required parameter 'B'" in robot.preview([skill(robot, "add")]).refusal.message
    assert "give_up" in robot.why().text


# -- breakpoints ------------------------------------------------------------------------------------------------------


def test_breakpoint_pauses_the_task(ros, robot):
    monitor = ros.messages(f"{ROBOT}/monitor", msgs.TreeProgress).connected()
    number = robot.set_breakpoint("node", "give_up")
    assert [(n, b.kind, b.pattern, b.when) for n, b in robot.breakpoints().items()] == [
        (number, "node", "give_up", "start")
    ]
    run = robot.run([skill(robot, "add", B=1.0), skill(robot, "give_up")])
    reached = monitor.wait_for(lambda m: "breakpoint" in m.progress[0].progress_message)
    assert [node.state for node in reached.progress[1:]] == [msgs.SkillProgress.SUCCESS, msgs.SkillProgress.IDLE]
    robot.remove_breakpoint(number)
    assert robot.breakpoints() == {}
    task = run.wait_for_task(30)
    assert robot.execute(task) == task
    assert run.result(30).code == -7


def test_invalid_breakpoints_are_rejected_with_the_reason(ros, robot):
    service = ros.service(f"{ROBOT}/breakpoint", srvs.SkillBreakpoint)
    for request, named in (
        ({"action": "dance"}, "unknown action 'dance', expected one of: add, remove, list"),
        ({"action": "add", "kind": "nod", "pattern": "x"}, "a breakpoint of kind 'nod', expected one of: node"),
        ({"action": "add", "kind": "node"}, "without a name or pattern"),
        ({"action": "remove", "number": 7}, "no breakpoint 7"),
    ):
        with pytest.raises(rospy.ServiceException) as refused:
            service(**request)
        assert named in str(refused.value)
    assert robot.breakpoints() == {}


# -- parameters of the node -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"tick_rate": 0}, "parameter /test_robot/tick_rate is 0, expected a number above 0 and up to 1000"),
        ({"tick_rate": "fast"}, "parameter /test_robot/tick_rate is 'fast', expected a number above 0 and up to 1000"),
        ({"preempt_timeout": -1.5}, "parameter /test_robot/preempt_timeout is -1.5, expected a number above 0"),
    ],
)
def test_invalid_rate_or_time_ends_the_node_with_one_line(ros, shared, arguments, named):
    shared.stop()
    launch = ros.launch("skiros2", "skill_mgr.launch", libraries_list="[skiros2_std_skills]", **arguments)
    launch.wait_for_line(named.replace("[", r"\["))
    launch.wait()
    assert "Traceback" not in launch.output


def test_the_tick_rate_is_that_of_the_parameter(ros, shared):
    shared.stop()
    path = f"{TESTS}:{ros.master.env['PYTHONPATH']}"
    ros.launch(
        "skiros2", "skiros.launch", gui=False, task_mgr_on=False, libraries_list="[support.hand_skills]",
        primitive_list="[stay]", tick_rate=5.0, env={**ros.master.env, "PYTHONPATH": path},
    )  # fmt: skip
    ros.service(f"{ROBOT}/command", srvs.SkillCommand)
    assert rospy.get_param(f"{ROBOT}/tick_rate") == 5.0
    client = SkillManagerInterface(ROBOT, "tests")
    wait_until(client._monitor_sub.get_num_connections, what="the connection to the manager")
    client.execute(skill_list=[skill(client, "stay")])
    rate = wait_until(lambda: len(client._tick_times) >= 6 and client.get_tick_rate(), what="ticks")
    assert 4.0 < rate < 6.0
    client.shutdown()


# -- managers that die, goals that are odd ----------------------------------------------------------------------------


@pytest.mark.long
def test_goal_of_a_killed_manager_is_lost(ros, own_robot):
    run = own_robot.run([skill(own_robot, "stay")])
    task = run.wait_for_task(30)
    ros.kill_node(ROBOT)  # it is started anew
    result = run.result(60)
    assert (result.task_id, result.state) == (task, msgs.SkillProgress.FAILURE)
    assert "it was restarted" in result.message
    assert own_robot.run([skill(own_robot, "add", B=1.0)]).succeeded(30)
    assert own_robot.execute(skill_list=[skill(own_robot, "add", B=1.0)]) >= 0, "commands reach the new one too"


def test_client_does_not_wait_for_a_missing_manager(ros, own_robot):
    run = own_robot.run([skill(own_robot, "stay")])
    run.wait_for_task(30)
    with pytest.raises(TimedOut, match=r"no result within 0\.1 s"):
        run.result(0.1)
    pid = ros.master.node_pid(ROBOT)
    os.kill(pid, signal.SIGSTOP)
    try:
        with pytest.raises(TimedOut, match="sent no status for 5 s"):
            run.result()
    finally:
        os.kill(pid, signal.SIGCONT)


def test_early_or_unknown_cancellation_has_no_effect(ros, robot):
    run = robot.run([skill(robot, "stay")])
    run.wait_for_task(30)
    results = ros.messages(f"{ROBOT}/execute/result", msgs.ExecuteSkillsActionResult).connected()
    status = ros.messages(f"{ROBOT}/execute/status", GoalStatusArray)
    cancel = rospy.Publisher(f"{ROBOT}/execute/cancel", GoalID, queue_size=10)
    goals = rospy.Publisher(f"{ROBOT}/execute/goal", msgs.ExecuteSkillsActionGoal, queue_size=10)
    wait_until(lambda: cancel.get_num_connections() and goals.get_num_connections(), what="the manager")
    cancel.publish(GoalID(id="nobody's"))
    cancel.publish(GoalID(id="early"))
    goal = msgs.ExecuteSkillsGoal("tests", [skill(robot, "stay").toMsg()], "")
    status.wait_for(lambda m: any(s.goal_id.id == "early" for s in m.status_list))
    goals.publish(msgs.ExecuteSkillsActionGoal(goal_id=GoalID(id="early"), goal=goal))
    early = results.wait_for(lambda m: m.status.goal_id.id == "early")
    assert early.status.status == GoalStatus.RECALLED
    for _ in range(2):  # the second one is the first one
        goals.publish(msgs.ExecuteSkillsActionGoal(goal_id=GoalID(id="twice"), goal=goal))
    cancel.publish(GoalID(id="twice"))
    results.wait_for(lambda m: m.status.goal_id.id == "twice")
    assert not run.done
    cancel.unregister()
    goals.unregister()


@pytest.mark.long
def test_hundreds_of_simultaneous_goals_all_end(robot):
    stays = [robot.run([skill(robot, "stay")]) for _ in range(200)]
    for run in stays:
        run.wait_for_task(60)
    robot.preempt_all()
    assert {run.result(60).message for run in stays} == {"Preempted"}
    wait_until(lambda: not robot.tasks, what="the ends of all tasks on the monitor")
    runs = [robot.run([skill(robot, "add", A=float(number), B=1.0)]) for number in range(100)]
    assert [run.params(60)["Sum"].value for run in runs] == [number + 1.0 for number in range(100)]
    assert len({run.task for run in runs}) == 100


def boxed_product(wmi):
    box, product = Element("skiros:LargeBox", "a box"), Element("skiros:Product", "a product")
    box.addRelation("skiros:Scene-0", "skiros:contain", "-1")
    wmi.add_element(box)
    product.addRelation(box.id, "skiros:contain", "-1")
    wmi.add_element(product)
    return box, product
