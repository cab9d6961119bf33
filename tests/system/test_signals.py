"""Hold-conditions on topics: a message beyond the limit fails the skill at once; recorders keep the topic."""

import time
from pathlib import Path

import pytest
import rospy
from geometry_msgs.msg import WrenchStamped

from skiros2_bags.core.run import Run
from skiros2_bags.testing.recording import Recording
from skiros2_bags.testing.rerun import Settings, rerun
from skiros2_common.core.world_element import Element
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_skill.client.manager import ManagerClient
from skiros2_skill.ros.skill_manager_interface import SkillManagerInterface
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.ros import Ros, RosMaster, SharedSystem, wait_until

pytestmark = pytest.mark.timeout(90)

ROBOT = "/test_robot"
TOPIC = "/arm/wrench"
LIBRARIES = Path(__file__).resolve().parents[1] / "libraries"


@pytest.fixture(scope="module")
def shared(ros_master: RosMaster):
    with SharedSystem(ros_master, launch) as system:
        yield system


def launch(ros: Ros) -> None:
    """A world model with a blank scene, and one robot that can press."""
    path = f"{LIBRARIES}:{ros.master.env['PYTHONPATH']}"
    ros.launch(
        "skiros2", "skiros.launch", gui=False, task_mgr_on=False, libraries_list="[force_skills]",
        primitive_list="[press]", env={**ros.master.env, "PYTHONPATH": path},
    )  # fmt: skip
    ros.service(f"{ROBOT}/command", srvs.SkillCommand)


class Sensor:
    """A force sensor that publishes every 5 ms, until it is stopped."""

    def __init__(self):
        self._publisher = rospy.Publisher(TOPIC, WrenchStamped, queue_size=10, tcp_nodelay=True)
        self._force = 0.0
        self._timer = rospy.Timer(rospy.Duration(0.005), lambda _: self.send(self._force))

    @property
    def readers(self):
        """The number of nodes that have subscribed."""
        return self._publisher.get_num_connections()

    def send(self, force):
        """Publishes a force along z (N). Returns the time (s since the epoch)."""
        message = WrenchStamped()
        message.wrench.force.z = force
        self._force = force
        now = time.time()
        self._publisher.publish(message)
        return now

    def stop(self):
        self._timer.shutdown()
        self._timer.join()

    def close(self):
        self.stop()
        self._publisher.unregister()


@pytest.fixture
def sensor(shared):
    shared.use()
    made = Sensor()
    yield made
    made.close()


@pytest.fixture
def robot(shared, sensor):
    client = SkillManagerInterface(ROBOT, "tests")
    wait_until(client._monitor_sub.get_num_connections, what="the connection to the manager")
    yield client
    client.preempt_all()
    wait_until(lambda: not client.tasks and not sensor.readers, what="the end of all tasks and subscriptions")
    client.shutdown()
    shared.restore()


@pytest.fixture
def arm(robot):
    """The arm of the robot, with a signal."""
    wmi = WorldModelInterface("tests")
    (found,) = wmi.resolve_elements(Element("rparts:ArmDevice"))
    force = Element("skiros:WristForce", "wrist_force")
    for key, value in (("SignalTopic", TOPIC), ("MessageField", "wrench.force"), ("Unit", "N")):
        force.setProperty(f"skiros:{key}", value)
    force.addRelation(found.id, "skiros:hasA", "-1")
    wmi.add_element(force)
    return found


def pressing(robot, arm, sensor, **values):
    """A goal whose skill runs and reads the sensor."""
    holder = robot.get_skill("press")
    for key, value in {"Arm": arm, **values}.items():
        holder.ph.specify(key, value)
    before = sensor.readers
    run = robot.run([holder])
    wait_until(lambda: sensor.readers > before, what="the subscription")
    return run


def reason(run):
    result = run.result(30)
    assert result.state == msgs.SkillProgress.FAILURE
    return result.message


def test_force_limit_fails_the_skill_at_once(robot, arm, sensor):
    run = pressing(robot, arm, sensor)
    sent = sensor.send(41.25)
    text = reason(run)
    assert "[ForceBelowLimit] skiros:WristForce of rparts:ArmDevice" in text
    assert "wrist_force was 41.25 N at " in text and text.endswith(", above 30 N")
    (explanation,) = run.explanations()
    latency = explanation.stamp - sent
    print(f"from the message to the tick: {latency * 1e3:.2f} ms")
    assert latency < 0.5


def test_force_within_the_limit_of_the_goal_keeps_the_skill_running(robot, arm, sensor):
    run = pressing(robot, arm, sensor, MaxForce=50.0)
    sensor.send(41.25)
    sensor.send(51.0)
    assert "was 51 N at " in reason(run)


def test_manager_reports_the_limits_of_a_task_and_their_violation(robot, arm, sensor):
    run = pressing(robot, arm, sensor, MaxForce=50.0)
    manager = ManagerClient(ROBOT, "tests")
    (bound,) = manager.signal_bounds(run.wait_for_task(30)).bounds
    (signal,) = WorldModelInterface("tests").resolve_elements(Element("skiros:WristForce"))
    assert (bound.condition, bound.signal, bound.side, bound.value) == ("ForceBelowLimit", signal.id, "maximum", 50.0)
    assert not bound.violated
    sent = sensor.send(51.0)
    reason(run)
    (bound,) = manager.signal_bounds(run.task).bounds
    assert sent <= bound.violated <= time.time()
    manager.close()


def test_sensor_that_stops_fails_the_skill(robot, arm, sensor):
    run = pressing(robot, arm, sensor)
    sensor.stop()
    assert f"wrist_force has sent no message on {TOPIC} for 0.5" in reason(run)


def test_not_a_number_fails_the_skill(robot, arm, sensor):
    run = pressing(robot, arm, sensor)
    sensor.send(float("nan"))
    assert "wrist_force was not a number (NaN) at " in reason(run)


def test_topic_is_subscribed_while_the_skill_runs(robot, arm, sensor):
    assert not sensor.readers
    run = pressing(robot, arm, sensor)
    robot.preempt_all()
    run.result(30)
    wait_until(lambda: not sensor.readers, what="the end of the subscription")


@pytest.mark.long
def test_recorded_run_has_the_signal_and_re_runs(ros, robot, arm, sensor, tmp_path, monkeypatch):
    bag = tmp_path / "run.bag"
    first = pressing(robot, arm, sensor)  # connects the client, before the recorder looks for it
    robot.preempt_all()
    first.result(30)
    wait_until(lambda: not sensor.readers, what="the end of the subscription")
    recorder = ros.run("skiros2_bags", "record", "-o", str(bag), "--robots", ROBOT, name="recorder")
    topics = {("/recorder", f"{ROBOT}/{name}") for name in ("monitor", "execute/feedback", "execute/result")}
    wait_until(lambda: sensor.readers and topics <= ros.master.readers(ROBOT), what="the recorder")
    goals = ("/recorder", f"{ROBOT}/execute/goal")
    wait_until(lambda: goals in ros.master.readers(rospy.get_name()), what="the recorder of goals")
    run = pressing(robot, arm, sensor)
    sensor.send(12.5)
    sensor.send(41.25)
    assert "was 41.25 N" in reason(run)
    ros.program("rosnode", "kill", "/recorder")
    recorder.wait(30)
    forces = [message.content.wrench.force.z for message in Run.open(bag).messages(TOPIC)]
    assert {0.0, 12.5, 41.25} == {*forces}
    monkeypatch.syspath_prepend(str(LIBRARIES))
    assert rerun(Recording(bag), Settings()).divergence is None
