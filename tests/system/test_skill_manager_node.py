"""Skill manager nodes: services, tasks, commands, several robots."""

import json

import pytest
import rospy

from skiros2_common.core.world_element import Element
from skiros2_common.ros.utils import deserializeParamMap
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_skill.ros.skill_layer_interface import SkillLayerInterface
from skiros2_skill.ros.skill_manager_interface import SkillManagerInterface
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.ros import Ros, RosMaster, SharedSystem, wait_until

pytestmark = pytest.mark.timeout(90)

ROBOT = "/test_robot"


@pytest.fixture(scope="module")
def shared(ros_master: RosMaster):
    with SharedSystem(ros_master, launch) as system:
        yield system


def launch(ros: Ros) -> None:
    """A world model with a blank scene, and one robot with the standard skills."""
    ros.launch(
        "skiros2", "skiros.launch", gui=False, task_mgr_on=False, libraries_list="[skiros2_std_skills]",
        primitive_list="[wait, counter, wm_set_properties]",
    )  # fmt: skip
    ros.service(f"{ROBOT}/command", srvs.SkillCommand)


@pytest.fixture
def robot(shared: SharedSystem):
    """The client of the robot of a system that the tests share."""
    master = shared.use().master
    topic = f"{ROBOT}/monitor"
    # all subscribers of a process share one connection: with another one there is no new connection
    is_shared = rospy.topics.get_topic_manager().has_subscription(topic)
    earlier = {} if is_shared else master.connections(ROBOT)
    client = SkillManagerInterface(ROBOT, "tests")
    wait_until(client._monitor_sub.get_num_connections, what="the connection to the manager")
    # rospy counts a connection before its publisher sends to it, and that of the test before may still be listed
    reader = (rospy.get_name(), topic)

    def is_connected() -> bool:
        return any(number not in earlier and other == reader for number, other in master.connections(ROBOT).items())

    wait_until(is_connected, what="the manager's connection")
    yield client
    client.preempt_all()
    wait_until(lambda: not client.tasks, what="the end of all tasks")
    client.set_debug(False)
    client.shutdown()
    shared.restore()


@pytest.fixture
def alone(shared: SharedSystem) -> None:
    """For tests that start nodes of their own."""
    shared.stop()


@pytest.fixture
def progress(ros: Ros, robot):
    return ros.messages(f"{ROBOT}/monitor", msgs.TreeProgress).connected()


def skill(robot, label, **values):
    holder = robot.get_skill(label)
    for key, value in values.items():
        holder.ph.specify(key, value)
    return holder


def end_of(progress, task_id):
    """The last message of a task."""
    return progress.wait_for(lambda m: m.progress[0].id == task_id and abs(m.progress[0].progress_code) == 1)


def command(ros, **request):
    return ros.service(f"{ROBOT}/command", srvs.SkillCommand)(author="tests", **request)


def test_manager_lists_its_skills_with_parameters(robot):
    holder = robot.get_skill("wait")
    assert holder.type == "skiros:Wait"
    assert list(holder.ph.keys()) == ["Duration", "Robot"]


def test_last_progress_message_has_the_final_state(robot, progress):
    task = robot.execute(skill_list=[skill(robot, "counter", CountTarget=3)])
    last = end_of(progress, task)
    root, counter = last.progress
    assert (root.type, root.robot, root.state, root.progress_code) == (":Root", ROBOT, msgs.SkillProgress.SUCCESS, 1)
    assert (counter.label, counter.state, counter.parent_id) == ("counter", msgs.SkillProgress.SUCCESS, root.id)


def test_progress_contains_parameters_in_debug_mode(ros, robot, progress):
    robot.set_debug(True)

    def has_parameters():
        task = robot.execute(skill_list=[skill(robot, "counter", CountTarget=2)])
        return [json.loads(p.param) for p in end_of(progress, task).progress[1].params]

    params = wait_until(has_parameters, what="parameters in the progress")
    assert {p["key"]: p["values"] for p in params}["CountTarget"] == [2]


def test_stopping_one_of_two_tasks_keeps_the_other(robot, progress):
    first = robot.execute(skill_list=[skill(robot, "wait", Duration=60.0)])
    second = robot.execute(skill_list=[skill(robot, "counter", CountTarget=10)])
    assert first != second
    assert end_of(progress, second).progress[0].state == msgs.SkillProgress.SUCCESS
    assert first in robot.tasks
    assert robot.preempt_one(first)
    ended = end_of(progress, first)
    assert ended.progress[0].state == msgs.SkillProgress.FAILURE
    assert ended.progress[0].progress_message == "Preempted"


def test_stopped_task_can_run_again(robot, progress):
    task = robot.execute(skill_list=[skill(robot, "wait", Duration=60.0)])
    robot.preempt_one(task)
    end_of(progress, task)
    again = robot.execute(skill_list=[skill(robot, "wait", Duration=0.1)])
    assert end_of(progress, again).progress[0].state == msgs.SkillProgress.SUCCESS


def test_a_task_is_ticked_once_paused_and_resumed(robot, progress):
    task = robot.tick_once(skill_list=[skill(robot, "counter", CountTarget=3)])
    first = progress.wait_for(lambda m: m.progress[0].id == task and len(m.progress) > 1)
    assert first.progress[1].state == msgs.SkillProgress.RUNNING
    assert robot.tick_once(task) == task
    assert robot.execute(task) == task
    assert end_of(progress, task).progress[0].state == msgs.SkillProgress.SUCCESS


def test_a_skill_s_changes_reach_the_world_model(robot, progress):
    wmi = WorldModelInterface("tests")
    product = Element("skiros:Product", "a product")
    product.addRelation("skiros:Scene-0", "skiros:contain", "-1")
    wmi.add_element(product)
    weigh = skill(robot, "wm_set_properties", Src=product, Properties={"skiros:Weight": 2.5})
    task = robot.execute(skill_list=[weigh])
    assert end_of(progress, task).progress[0].state == msgs.SkillProgress.SUCCESS
    assert wmi.get_element(product.id).getProperty("skiros:Weight").value == 2.5


@pytest.mark.parametrize(
    ("request_", "named"),
    [
        ({"action": "start", "execution_id": -1}, "a task needs at least one skill"),
        ({"action": "start", "execution_id": 4711}, "no task 4711"),
        ({"action": "preempt", "execution_id": 4711}, "no task 4711"),
        ({"action": "pause", "execution_id": 4711}, "no task 4711"),
        ({"action": "preempt", "execution_id": -2}, "no task -2 is here; ids begin at 0, and -1 means new or all"),
        ({"action": "dance", "execution_id": -1}, "unknown action 'dance', expected one of: start, preempt, pause"),
        (
            {"action": "start", "execution_id": -1, "skills": [msgs.ResourceDescription("skiros:Wiat", "", [])]},
            "no skill of type skiros:Wiat; near: skiros:Wait",
        ),
        (
            {"action": "start", "execution_id": -1, "skills": [msgs.ResourceDescription("Counter", "counter", [])]},
            r"required parameter 'CountTarget' (int) is not set",
        ),
        (
            {
                "action": "start",
                "execution_id": -1,
                "skills": [msgs.ResourceDescription("Counter", "counter", [msgs.Param("{")])],
            },
            "parameter is not JSON",
        ),
    ],
)
def test_invalid_command_is_rejected_with_the_reason(ros, robot, request_, named):
    with pytest.raises(rospy.ServiceException) as refused:
        command(ros, **request_)
    assert named in str(refused.value)


def test_after_a_refused_command_the_next_task_runs(ros, robot, progress):
    with pytest.raises(rospy.ServiceException):
        command(ros, action="start", execution_id=-1)
    task = robot.execute(skill_list=[skill(robot, "counter", CountTarget=2)])
    assert end_of(progress, task).progress[0].state == msgs.SkillProgress.SUCCESS


def test_client_receives_the_reason_of_a_refused_command(robot):
    assert not robot.preempt_one(4711)
    assert "no task 4711" in robot.last_error


def test_skills_are_in_the_world_model_only_while_the_manager_runs(ros, alone):
    ros.launch("skiros2", "world_model_server.launch", gui=False)
    manager = ros.launch(
        "skiros2", "skill_mgr.launch", libraries_list="[skiros2_std_skills]", primitive_list="[wait]"
    )  # fmt: skip
    ros.service(f"{ROBOT}/command", srvs.SkillCommand)
    wmi = WorldModelInterface("tests")
    (agent,) = [r for r in wmi.resolve_elements(Element("cora:Robot")) if r.hasProperty("skiros:SkillMgr", ROBOT[1:])]
    wait = wmi.resolve_element(Element("skiros:Wait"))
    assert wmi.get_relations(agent.id, "skiros:hasSkill", wait.id)
    assert "skiros:Wait" in wmi.get_sub_classes("skiros:Skill")
    manager.stop()
    assert wmi.resolve_elements(Element("skiros:Skill")) == []
    assert wmi.resolve_elements(Element("skiros:Parameter")) == []


@pytest.mark.long
def test_two_robots_bind_robot_each_to_itself(ros, alone):
    ros.launch("skiros2_demo_skills", "demo.launch", gui=False)
    ros.service("/mobile_manipulator/command", srvs.SkillCommand)
    ros.launch(
        "skiros2", "skill_mgr.launch", robot_name="test_robot", libraries_list="[skiros2_std_skills]",
        primitive_list="[wait]",
    )  # fmt: skip
    ros.service("/test_robot/command", srvs.SkillCommand)
    layer = SkillLayerInterface("tests")
    try:
        wait_until(lambda: len(layer.agents) == 2, what="both managers")
        layer.set_debug(True)
        for name in ("/mobile_manipulator", "/test_robot"):
            agent = layer.get_agent(name)
            heard = ros.messages(f"{name}/monitor", msgs.TreeProgress)
            robot = wait_until(lambda agent=agent, heard=heard: _robot_of_a_run(agent, heard), what="parameters")
            assert robot.getProperty("skiros:SkillMgr").value == name[1:]
    finally:
        layer.shutdown()


def _robot_of_a_run(agent, heard):
    """Runs `wait` and returns the robot that it had as parameter, None while parameters do not travel yet."""
    task = agent.execute(skill_list=[skill(agent, "wait", Duration=0.1)])
    params = deserializeParamMap(end_of(heard, task).progress[1].params)
    return params["Robot"].value if "Robot" in params else None


def test_ended_manager_is_gone_for_clients(ros, alone):
    launch(ros)
    layer = SkillLayerInterface("tests")
    try:
        wait_until(lambda: ROBOT in layer.agents, what="the manager")
        assert layer.has_changes
        ros.stop()
        wait_until(lambda: not layer.has_active_agents, what="no manager")
    finally:
        layer.shutdown()


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"libraries_list": "[no_such_library]"}, "library 'no_such_library': there is no Python package of that name"),
        (
            {"libraries_list": "[skiros2_std_skills]", "primitive_list": "[wiat]"},
            "skill 'wiat': no class of that name in skiros2_std_skills; near: wait",
        ),
        ({"robot_name": "nobody"}, "robot skiros:nobody: the scene has no cora:Robot with that label"),
    ],
)
def test_configuration_error_is_the_last_line_of_the_launch(ros, alone, arguments, named):
    launch = ros.launch("skiros2", "skiros.launch", forked=False, gui=False, task_mgr_on=False, **arguments)
    launch.wait_for_line(named.replace("[", r"\["))
    launch.wait()
    assert 1 <= launch.output.count(named) <= 2
    assert named in launch.output.rstrip().splitlines()[-1]
    assert "Traceback" not in launch.output


def test_node_without_a_master_fails_with_a_message(ros, tmp_path):
    env = {**ros.master.env, "ROS_MASTER_URI": "http://localhost:1"}
    program = ros.run("skiros2_skill", "skill_manager_node", env=env)
    assert program.wait() != 0
    assert "no ROS master" in program.output
