"""The adapter of the default interface with a stand-in driver that publishes what a failing one does."""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable, Iterator
from io import BytesIO
from typing import Any

import pytest
import rospy
from geometry_msgs.msg import PoseStamped, Vector3, WrenchStamped

from controller_manager_msgs.srv import SwitchController, SwitchControllerResponse
from skiros2_common.core.failure_kind import FailureKind
from skiros2_contact_skills.ros.impedance_arm import ImpedanceArm
from skiros2_motion.core.compliant_arm import ArmState
from skiros2_motion.core.force_control import ForceGoal
from skiros2_motion.core.geometry import IDENTITY
from skiros2_motion.core.regions import MARGIN, Region
from skiros2_sim_msgs.msg import ImpedanceState
from skiros2_sim_msgs.srv import SetWrenchLimits, SetWrenchLimitsResponse
from support.ros import Ros, RosMaster, wait_until

pytestmark = pytest.mark.timeout(120)

WAIT = 30.0
SPACE = "/stand_in/compliant"


class Driver:
    """Publishes its state 50 times per second of wall time."""

    def __init__(self) -> None:
        self.state = ImpedanceState(active=True)
        self.state.pose.position.x, self.state.pose.orientation.w = 0.5, 1.0
        self.state.reference = self.state.pose
        self.change: Callable[[ImpedanceState], None] = lambda state: None
        self.references: list[PoseStamped] = []
        self.is_silent = False
        #: Number of states that wait in the queue of the publisher.
        self.late = 0
        self._ended = threading.Event()
        self._topic = rospy.Publisher(f"{SPACE}/state", ImpedanceState, queue_size=1)
        self._connections: list[Any] = [
            rospy.Service("/stand_in/switch_controller", SwitchController, lambda _: SwitchControllerResponse(True)),
            rospy.Service(f"{SPACE}/set_wrench_limits", SetWrenchLimits, self._on_limits),
            rospy.Subscriber(f"{SPACE}/reference_pose", PoseStamped, self.references.append),
        ]
        for name in ("set_cartesian_stiffness", "set_damping_factors", "set_cartesian_wrench"):
            self._connections.append(rospy.Subscriber(f"{SPACE}/{name}", WrenchStamped, lambda _: None))
        self._thread = threading.Thread(target=self._run, name="stand-in of a driver")
        self._thread.start()

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        for connection in self._connections:
            (connection.shutdown if hasattr(connection, "shutdown") else connection.unregister)()

    def _on_limits(self, request: Any) -> SetWrenchLimitsResponse:
        self.state.force_limit, self.state.torque_limit = request.force, request.torque
        self.state.stopped_by = ""
        return SetWrenchLimitsResponse(ok=True, stamp=self.state.header.stamp)

    def _run(self) -> None:
        queue: deque[ImpedanceState] = deque()
        while not self._ended.wait(0.02):
            self.state.header.stamp = rospy.Time.now()
            message = ImpedanceState()
            message.deserialize(_serialized(self.state))
            self.change(message)
            queue.append(message)
            while len(queue) > self.late:
                message = queue.popleft()
                if not self.is_silent:
                    self._topic.publish(message)


def _serialized(message: Any) -> bytes:
    buffer = BytesIO()
    message.serialize(buffer)
    return buffer.getvalue()


@pytest.fixture(scope="module")
def ros(ros_master: RosMaster) -> Iterator[Ros]:
    system = Ros(ros_master)
    yield system
    system.stop()


@pytest.fixture
def driver(ros: Ros) -> Iterator[Driver]:
    made = Driver()
    yield made
    made.close()


@pytest.fixture
def arm(driver: Driver) -> Iterator[ImpedanceArm]:
    made = ImpedanceArm("arm", SPACE, "/stand_in", "/stand_in/switch_controller", ("compliant", "position"), IDENTITY)
    made.begin()
    made.set_wrench_limits(40.0, 15.0)
    wait_for(made, lambda s: not s.stopped)
    yield made
    made.close()


def wait_for(arm: ImpedanceArm, condition: Callable[[ArmState], object]) -> ArmState:
    def state() -> ArmState | None:
        found = arm.state()
        return found if found is not None and condition(found) else None

    return wait_until(state, WAIT, "a state as wanted")


@pytest.mark.parametrize(
    "place",
    [
        *(f"pose.position.{axis}" for axis in "xyz"),
        *(f"pose.orientation.{axis}" for axis in "xyzw"),
        *(f"reference.position.{axis}" for axis in "xyz"),
        *(f"measured_wrench.{part}.{axis}" for part in ("force", "torque") for axis in "xyz"),
        "force_limit",
        "torque_limit",
    ],
)
def test_state_with_a_number_that_is_not_finite_stops_the_arm(driver: Driver, arm: ImpedanceArm, place: str) -> None:
    *path, field = place.split(".")

    def change(message: ImpedanceState) -> None:
        part = message
        for name in path:
            part = getattr(part, name)
        setattr(part, field, math.nan)

    driver.change = change
    stopped = wait_for(arm, lambda s: s.stopped)
    assert "not finite" in stopped.stopped
    assert stopped.kind is FailureKind.SENSOR
    driver.references.clear()
    arm.end()
    held = wait_until(lambda: driver.references, WAIT, "a reference")[0].pose.position
    assert (held.x, held.y, held.z) == (0.5, 0.0, 0.0), "the last pose that was known"


def test_states_from_before_the_limits_were_set_do_not_stop_the_arm(driver: Driver, arm: ImpedanceArm) -> None:
    driver.state.stopped_by, driver.state.stop_value, driver.state.stop_limit = "force", 68.4, 40.0
    wait_for(arm, lambda s: s.stopped)
    driver.late = 10
    arm.begin()
    arm.set_wrench_limits(120.0, 15.0)
    first = wait_for(arm, lambda s: True)
    assert not first.stopped


def test_states_between_two_ticks_are_kept(driver: Driver, arm: ImpedanceArm) -> None:
    arm.take_states()
    forces = iter(range(1, 1000))
    driver.change = lambda message: setattr(message.measured_wrench.force, "z", next(forces))
    last = wait_for(arm, lambda s: s.wrench[2] >= 5.0)
    measured = [state.wrench[2] for state in arm.take_states()]
    assert [force for force in measured if force][:4] == [1.0, 2.0, 3.0, 4.0]
    assert measured[-1] >= last.wrench[2]


def test_driver_without_the_limits_that_were_set_was_restarted(driver: Driver, arm: ImpedanceArm) -> None:
    driver.state.force_limit = 0.0
    stopped = wait_for(arm, lambda s: s.stopped)
    assert "it was restarted, or they were changed" in stopped.stopped
    arm.begin()
    wait_for(arm, lambda s: not s.stopped)


def test_driver_that_dies_is_noticed(driver: Driver, arm: ImpedanceArm) -> None:
    driver.is_silent = True
    assert f"no state on {SPACE}/state" in wait_for(arm, lambda s: s.stopped).stopped
    driver.is_silent = False
    wait_for(arm, lambda s: not s.stopped)


def test_adapter_regulates_the_force_of_a_driver_without_a_loop_at_the_rate_that_it_says(
    driver: Driver, arm: ImpedanceArm
) -> None:
    driver.state.stiffness.force = Vector3(600.0, 600.0, 2000.0)
    start = wait_for(arm, lambda s: not s.stopped).pose
    assert 10.0 < arm.abilities().force_rate < 60.0, "50 Hz, on a busy machine"
    driver.references.clear()
    arm.set_force_control(ForceGoal((0.0, 0.0, 6.0), speed=0.05))
    arm.set_reference(start)
    wait_until(lambda: len(driver.references) > 15, WAIT, "references")
    leads = [message.pose.position.z for message in driver.references]
    assert leads == sorted(leads), "nothing answers the force"
    assert 0.003 < leads[-1] * 2000.0 <= 16.0, "bounded"
    driver.state.measured_wrench.force.z = -12.0
    wait_until(lambda: driver.references[-1].pose.position.z < 0.0, WAIT, "the retreat from a larger force")
    assert arm.take_peak() == pytest.approx(12.0)


def test_reference_behind_a_region_is_not_beyond_its_plane(driver: Driver, arm: ImpedanceArm) -> None:
    driver.state.stiffness.force = Vector3(600.0, 600.0, 600.0)
    start = wait_for(arm, lambda s: not s.stopped).pose
    arm.set_regions([Region("floor", IDENTITY._replace(position=(0.0, 0.0, -0.1)))])
    driver.references.clear()
    arm.set_reference(start._replace(position=(0.5, 0.0, -0.2)))
    wait_until(lambda: driver.references, WAIT, "a reference")
    assert driver.references[-1].pose.position.z == pytest.approx(MARGIN - 0.1)
    driver.state.pose.position.z = -0.09
    wait_until(lambda: driver.references[-1].pose.position.z > 0.0, WAIT, "a reference that pushes the tool back")
    arm.end()
    wait_until(lambda: driver.references[-1].pose.position.z == pytest.approx(-0.09), WAIT, "the pose at the end")


def test_state_brings_the_peak_of_its_force(driver: Driver, arm: ImpedanceArm) -> None:
    wait_for(arm, lambda s: not s.stopped)
    arm.take_peak()

    def hit(message: ImpedanceState) -> None:
        message.pose.position.x, message.peak_force = 0.6, 55.0

    driver.change = hit
    wait_for(arm, lambda s: s.pose.position[0] == pytest.approx(0.6))
    assert arm.take_peak() == 55.0, "with the first state after it"
    stamp = wait_for(arm, lambda s: True).stamp
    wait_for(arm, lambda s: s.stamp > stamp)
    assert arm.take_peak() < 1.0, "once"
    driver.change = lambda message: None
    wait_for(arm, lambda s: s.pose.position[0] < 0.55)
    driver.change = lambda message: setattr(message, "peak_force", 20.0)
    wait_until(lambda: arm.take_peak() == 20.0, WAIT, "a peak after the limits were set again")


def test_force_that_nobody_commands_any_more_is_not_regulated(driver: Driver, arm: ImpedanceArm) -> None:
    driver.state.stiffness.force = Vector3(600.0, 600.0, 2000.0)
    wait_for(arm, lambda s: not s.stopped)
    arm.set_force_control(ForceGoal((0.0, 0.0, 6.0), speed=0.05))
    wait_until(lambda: driver.references and driver.references[-1].pose.position.z > 0.001, WAIT, "references")
    wait_until(lambda: driver.references[-1].pose.position.z == 0.0, WAIT, "the measured pose")
