"""Stops of a robot on a real master: sources, tasks, clients, recovery."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Iterator
from typing import Any

import actionlib
import pytest
import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from std_msgs.msg import Bool, Int32
from std_srvs.srv import Trigger, TriggerResponse

from skiros2_common.core.errors import SkirosError
from skiros2_common.core.explanation import STOP
from skiros2_gui.app.ros.system import RosSystem
from skiros2_gui.app.stops import StoppedRobot, Stops
from skiros2_gui.app.system import stop_of
from skiros2_live.core.cell import CellDocument
from skiros2_live.core.patch import Patch
from skiros2_live.ros.managers import ManagerConnections
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_skill.client.description import Step
from skiros2_skill.ros.skill_manager_interface import SkillManagerInterface
from support.ros import Messages, Ros, RosMaster, SharedSystem, run_command, wait_until
from support.window.synchronous import make_window

pytestmark = pytest.mark.timeout(90)

ROBOT = "/test_robot"
SOURCES = (
    "[{topic: /e_stop, clear_delay: 0.05}, "
    "{topic: /arm_mode, type: std_msgs/Int32, field: data, kind: protective_stop, stop_values: [4], clear_delay: 0.0}, "
    "{topic: /diagnostics, type: diagnostic_msgs/DiagnosticArray, names: ['arm*'], clear_delay: 0.0}]"
)
RUNNING = "running"

_numbers = itertools.count()


def launch(ros: Ros) -> None:
    ros.launch(
        "skiros2", "skiros.launch", gui=False, task_mgr_on=False, libraries_list="[skiros2_std_skills]",
        primitive_list="[wait, recover_from_stop]", safety_sources=SOURCES, recovery="{call: /recover}",
    )  # fmt: skip
    ros.service(f"{ROBOT}/command", srvs.SkillCommand)


@pytest.fixture(scope="module")
def shared(ros_master: RosMaster) -> Iterator[SharedSystem]:
    with SharedSystem(ros_master, launch) as system:
        yield system


class Driver:
    """The robot's driver: an emergency stop, a mode and diagnostics; a service clears all."""

    def __init__(self, ros: Ros, publishers: dict[str, Any]) -> None:
        self._publishers = publishers
        for topic, publisher in self._publishers.items():
            wait_until(publisher.get_num_connections, what=f"the manager on {topic}")
        self.status = ros.messages(f"{ROBOT}/safety", msgs.SafetyStatus).connected()
        self.answer = TriggerResponse(True, "")
        self.calls = 0
        self._service = rospy.Service("/recover", Trigger, self._recover)

    def press(self, pressed: bool = True) -> None:
        self._publishers["/e_stop"].publish(Bool(pressed))

    def set_mode(self, mode: int) -> None:
        self._publishers["/arm_mode"].publish(Int32(mode))

    def diagnose(self, level: int, text: str = "", name: str = "arm: motor") -> None:
        self._publishers["/diagnostics"].publish(DiagnosticArray(status=[DiagnosticStatus(level, name, text, "", [])]))

    def clear(self) -> None:
        self.press(False)
        self.set_mode(1)
        self.diagnose(0)

    def wait_for(self, state: str) -> Any:
        """Waits until the last published state is this one."""
        return wait_until(lambda: self.status.all and self.status.all[-1].state == state and self.status.all[-1])

    def close(self) -> None:
        self._service.shutdown()

    def _recover(self, _: Any) -> Any:
        self.calls += 1
        if self.answer.success:
            self.clear()
        return self.answer


@pytest.fixture
def system(shared: SharedSystem) -> Iterator[None]:
    """Starts before `ros`, which takes away the parameters that were set after its own start."""
    shared.use()
    yield
    shared.restore()


@pytest.fixture(scope="module")
def publishers(shared: SharedSystem) -> Iterator[dict[str, Any]]:
    """For all tests: rospy may not connect to a topic of the same node that comes back at once."""
    made = {
        topic: rospy.Publisher(topic, kind, queue_size=1000, tcp_nodelay=True)
        for topic, kind in (("/e_stop", Bool), ("/arm_mode", Int32), ("/diagnostics", DiagnosticArray))
    }
    yield made
    for publisher in made.values():
        publisher.unregister()


@pytest.fixture
def driver(system: None, ros: Ros, publishers: dict[str, Any]) -> Iterator[Driver]:
    driver = Driver(ros, publishers)
    driver.wait_for(RUNNING)
    yield driver
    driver.clear()
    driver.wait_for(RUNNING)
    driver.close()


@pytest.fixture
def robot(driver: Driver) -> Iterator[SkillManagerInterface]:
    client = SkillManagerInterface(ROBOT, "tests")
    wait_until(client._monitor_sub.get_num_connections, what="the connection to the manager")
    yield client
    client.preempt_all()
    wait_until(lambda: not client.tasks, what="the end of all tasks")
    client.shutdown()


@pytest.fixture
def progress(ros: Ros, robot: SkillManagerInterface) -> Messages:
    return ros.messages(f"{ROBOT}/monitor", msgs.TreeProgress).connected()


def wait_step(seconds: float = 60.0) -> Any:
    return Step("Wait", "wait", [f'{{"key": "Duration", "values": [{seconds}]}}'])


def recovery_step(**values: str) -> Any:
    return Step("RecoverFromStop", "", [f'{{"key": "{key}", "values": ["{value}"]}}' for key, value in values.items()])


def refusal_of(call: Callable[[], Any]) -> str:
    with pytest.raises(SkirosError) as refused:
        call()
    return str(refused.value)


def test_emergency_stop_fails_the_task_blocks_starts_and_is_recovered_by_a_skill(
    robot: SkillManagerInterface, driver: Driver, progress: Messages
) -> None:
    reason = "emergency stop by /e_stop: data is True"
    run = robot.run([wait_step()])
    task = run.wait_for_task(30)
    progress.wait_for(lambda m: m.progress[0].task_id == task and len(m.progress) > 1 and m.progress[1].state == 3)
    driver.press()
    result = run.result(30)
    assert (result.state, result.code, result.message) == (msgs.SkillProgress.FAILURE, -5, reason)
    assert run.explanations()[-1].stage == STOP
    assert reason in robot.why(task).text
    end = progress.wait_for(lambda m: m.progress[0].task_id == task and m.progress[0].progress_code == -1)
    assert end.progress[0].progress_message == reason

    status = driver.wait_for("emergency_stop")
    assert (status.source, status.reason, status.stops) == ("/e_stop", "data is True", [reason])
    assert abs(status.since.to_sec() - rospy.get_time()) < 60
    assert robot.safety().state == "emergency_stop"

    assert reason in refusal_of(lambda: robot.command("start", -1, [wait_step()]))
    refused = robot.run([wait_step()]).result(30)
    assert (refused.task_id, refused.code, refused.message) == (-1, -5, reason)
    assert robot.why(-1).explanations[0].code == -5
    refusal = robot.preview([wait_step()]).refusal
    assert refusal is not None
    assert (refusal.stage, refusal.code, refusal.message) == (STOP, -5, reason)
    assert robot.preview([recovery_step()]).refusal is None

    recovered = robot.run([recovery_step()]).result(30)
    assert (recovered.state, driver.calls) == (msgs.SkillProgress.SUCCESS, 1), recovered.message
    assert robot.run([wait_step(0.0)]).succeeded(30)


def test_protective_stop_pauses_the_task_and_its_progress_has_the_reason(
    robot: SkillManagerInterface, driver: Driver, progress: Messages
) -> None:
    reason = "protective stop by /arm_mode: data is 4"
    task = robot.command("start", -1, [wait_step()])
    driver.set_mode(4)
    progress.wait_for(lambda m: m.progress[0].task_id == task and m.progress[0].progress_message == f"paused: {reason}")
    assert robot.why(task).text == f"task {task} by tests is paused: {reason}"
    assert reason in refusal_of(lambda: robot.command("start", task))
    assert reason in refusal_of(lambda: robot.command("tick_once", task))
    driver.set_mode(1)
    driver.wait_for(RUNNING)
    progress.wait_for(lambda m: m.progress[0].progress_message.endswith("; it is over, resume or stop the task"))
    progress.clear()
    assert robot.command("start", task) == task
    progress.wait_for(lambda m: m.progress[0].task_id == task and not m.progress[0].progress_message)


def test_most_severe_stop_is_shown_and_each_source_clears_its_own(driver: Driver) -> None:
    driver.set_mode(4)
    driver.wait_for("protective_stop")
    driver.diagnose(2, "too hot")
    status = driver.wait_for("fault")
    assert status.stops == [
        "fault by /diagnostics: arm: motor: too hot (error)", "protective stop by /arm_mode: data is 4"
    ]  # fmt: skip
    driver.press()
    driver.wait_for("emergency_stop")
    driver.set_mode(1)
    driver.diagnose(0)
    wait_until(lambda: len(driver.status.all[-1].stops) == 1)
    assert driver.status.all[-1].state == "emergency_stop"


def test_window_shows_the_stop_and_starts_the_recovery(robot: SkillManagerInterface, driver: Driver) -> None:
    window = make_window(RosSystem)
    stops = Stops(window, lambda: None)

    def shown() -> list[StoppedRobot]:
        window.process_events()
        return stops.robots

    wait_until(lambda: shown() == [] and ROBOT in window.system.managers, what="the window's connection")
    driver.press()
    (stopped,) = wait_until(lambda: [s for s in shown() if not s.obstacle], what="the stop and the robot's skills")
    assert (stopped.manager, stopped.kind) == (ROBOT, "emergency stop")
    assert stopped.text.endswith("emergency stop by /e_stop: data is True.")
    stops.recover(ROBOT)
    wait_until(lambda: not shown(), what="the end of the stop")
    assert driver.calls == 1
    window.system.close()


def test_malformed_diagnostics_are_a_fault(robot: SkillManagerInterface, driver: Driver) -> None:
    driver.diagnose(2, "gone", name="camera")  # of nobody's concern
    driver.diagnose(77, "x" * 5000 + "\nsecond line", name="arm \u00fc")
    status = driver.wait_for("fault")
    assert "unknown level 77" in status.reason or status.reason.endswith("…")
    assert "fault by /diagnostics: arm" in refusal_of(lambda: robot.command("start", -1, [wait_step()]))
    driver.diagnose(0, name="arm \u00fc")
    driver.wait_for(RUNNING)


def test_flapping_emergency_stop_is_one_stop(robot: SkillManagerInterface, driver: Driver) -> None:
    run = robot.run([wait_step()])
    run.wait_for_task(30)
    driver.status.clear()
    for n in range(500):
        driver.press(n % 2 == 0)
    assert run.result(30).code == -5
    driver.wait_for(RUNNING)
    assert len(driver.status.all) < 50
    assert robot.run([wait_step(0.0)]).succeeded(30)


def test_failed_recovery_has_the_reason_of_the_driver(robot: SkillManagerInterface, driver: Driver) -> None:
    driver.press()
    driver.wait_for("emergency_stop")
    driver.answer = TriggerResponse(False, "the button is pressed")
    assert robot.run([recovery_step()]).result(30).message.endswith("/recover has failed: the button is pressed")
    driver.answer = TriggerResponse(True, "")
    missing = robot.run([recovery_step(Call="/nobody")]).result(30)
    assert "/nobody" in missing.message
    wrong = robot.run([recovery_step(Call="/recover", Type="nothing/Here")]).result(30)
    assert "there is no service or action type 'nothing/Here'" in wrong.message


def test_recovery_that_does_not_clear_the_stop_names_it(robot: SkillManagerInterface, driver: Driver) -> None:
    driver.press()
    driver.wait_for("emergency_stop")
    step = Step("RecoverFromStop", "", ['{"key": "Timeout", "values": [0.2]}', '{"key": "Call", "values": ["/idle"]}'])
    service = rospy.Service("/idle", Trigger, lambda _: TriggerResponse(True, ""))
    try:
        message = robot.run([step]).result(30).message
    finally:
        service.shutdown()
    assert "Not recovered within 0.2 s: emergency stop by /e_stop: data is True" in message


def test_recovery_by_an_action(robot: SkillManagerInterface, driver: Driver) -> None:
    cancelled = threading.Event()
    outcome = ["success"]

    def work(_: Any) -> None:
        if outcome[0] == "success":
            driver.clear()
            server.set_succeeded()
        elif outcome[0] == "abort":
            server.set_aborted(text="still in contact")
        else:
            outcome[0] = "began"
            wait_until(server.is_preempt_requested)
            server.set_preempted()
            cancelled.set()

    # In one process, connections to an earlier server of the same name may outlive it for a moment.
    name = f"/error_recovery_{next(_numbers)}"
    server = actionlib.SimpleActionServer(name, msgs.AssignTaskAction, work, auto_start=False)
    server.start()
    step = recovery_step(Call=name, Type="skiros2_msgs/AssignTaskAction")
    driver.set_mode(4)
    driver.wait_for("protective_stop")
    outcome[0] = "abort"
    assert robot.run([step]).result(30).message.endswith(f"{name} has failed: still in contact")
    outcome[0] = "long"
    run = robot.run([step])
    wait_until(lambda: outcome[0] == "began")
    run.cancel()
    assert cancelled.wait(30)
    run.wait(30)
    outcome[0] = "success"
    assert robot.run([step]).succeeded(30)
    driver.wait_for(RUNNING)


def test_commands_show_the_stop(ros_master: RosMaster, robot: SkillManagerInterface, driver: Driver) -> None:
    def run(name: str, *arguments: str) -> Any:
        return run_command(["rosrun", "skiros2_skill", name, *arguments], ros_master.env)

    assert run("safety").stdout == f"{ROBOT} is not stopped\n"
    task = str(robot.command("start", -1, [wait_step()]))
    driver.set_mode(4)
    driver.wait_for("protective_stop")
    reason = "protective stop by /arm_mode: data is 4"
    for name in ("safety", "list"):
        first = run(name).stdout.splitlines()[0]
        assert first.startswith(f"{ROBOT} is stopped since ")
        assert first.endswith(reason)
    shown = run("watch", "--once").stdout
    assert f"task {task} on {ROBOT}: paused: {reason}" in shown
    refused = run("run", "wait", "Duration=0")
    assert refused.returncode == 1
    assert reason in refused.stderr
    assert reason in run("preview", "wait", "Duration=0").stdout
    assert reason in run("resume", task).stderr
    assert run("run", "recover_from_stop").returncode == 0
    assert run("safety", "--json").stdout.count(RUNNING) == 1


def test_window_shows_the_stop(driver: Driver) -> None:
    patches: list[Patch] = []
    connections = ManagerConnections("tests", patches.append)
    cell = CellDocument()

    def shown() -> tuple[str, str]:
        while patches:
            cell.apply(patches.pop(0))
        return stop_of(cell.robots[ROBOT].safety) if ROBOT in cell.robots else ("", "")

    try:
        wait_until(lambda: ROBOT in connections.managers)
        driver.press()
        text, stop = wait_until(lambda: (found := shown())[1] and found)
        assert stop == "emergency stop"
        assert text.endswith(": emergency stop by /e_stop: data is True.")
        driver.press(False)
        wait_until(lambda: shown() == ("", ""))
    finally:
        connections.close()


def test_silent_required_source_stops_the_robot(ros: Ros, shared: SharedSystem) -> None:
    shared.stop()
    ros.launch(
        "skiros2", "skiros.launch", gui=False, task_mgr_on=False, libraries_list="[skiros2_std_skills]",
        primitive_list="[wait]", safety_sources="[{topic: /e_stop, required: true, timeout: 0.3, clear_delay: 0.0}]",
    )  # fmt: skip
    ros.service(f"{ROBOT}/command", srvs.SkillCommand)
    status = ros.messages(f"{ROBOT}/safety", msgs.SafetyStatus)
    status.wait_for(lambda m: m.reason == "no message yet, and the source is required")
    publisher = rospy.Publisher("/e_stop", Bool, queue_size=1)
    wait_until(publisher.get_num_connections, what="the manager on /e_stop")
    publisher.publish(Bool(False))
    status.wait_for(lambda m: m.state == RUNNING)
    status.wait_for(lambda m: m.reason == "no message for 0.3 s, and the source is required")
    publisher.unregister()


def test_wrong_configuration_ends_the_node_with_one_line(ros: Ros, shared: SharedSystem) -> None:
    shared.stop()
    manager = ros.launch(
        "skiros2", "skill_mgr.launch", libraries_list="[skiros2_std_skills]", on_fault="ignore",
        safety_sources="[{topic: /e_stop, kind: stop}, {topic: /state, type: lab_msgs/Arm}]",
    )  # fmt: skip
    manager.wait_for_line(r"safety_sources\[0\]: 'kind' is 'stop'.*lab_msgs/Arm.*on_fault is 'ignore'")
    manager.wait()
    assert "Traceback" not in manager.output
