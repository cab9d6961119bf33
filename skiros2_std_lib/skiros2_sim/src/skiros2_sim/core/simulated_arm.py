"""A compliant arm in the simulated world of this process. The thread that steps the world calls it."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

from skiros2_common.core.errors import Refused
from skiros2_common.core.failure_kind import FailureKind
from skiros2_motion.core.compliant_arm import ArmState, checked_reference, turned_wrench
from skiros2_motion.core.force_control import ForceGoal
from skiros2_motion.core.geometry import Pose, Vector, composed, inverted, rotated
from skiros2_motion.core.impedance import MAX_WRENCH, checked
from skiros2_motion.core.regions import Region
from skiros2_motion.core.spiral import SpiralGoal
from skiros2_motion.core.wrench_guard import is_finite
from skiros2_sim.core.arm_controller import ArmController


class SimulatedArm:
    """Adapter of `CompliantArm` to a controller of the simulator. An inactive or stopped controller refuses commands;
    the state reports that.

    :param controller: of the arm; there is one instance per arm.
    """

    def __init__(self, controller: ArmController) -> None:
        self._controller = controller
        self._mount = controller.arm.spec.pose

    def now(self) -> float:
        return self._controller.world.time

    def state(self) -> ArmState:
        controller = self._controller
        pose = composed(inverted(self._mount), controller.tool_pose())
        stopped, kind = "", FailureKind.RETRYABLE
        if not controller.compliant:
            kind = FailureKind.CONTROLLER
            stopped = f"controller {controller.names[1]} of arm {controller.arm.name} is not active"
        elif controller.stop is not None:
            stopped, kind = str(controller.stop), controller.stop.kind
        measured = controller.arm.measured_wrench()
        if not stopped and not is_finite(*pose, measured):
            stopped, kind = f"the state of arm {controller.arm.name} is not finite", FailureKind.SENSOR
        wrench = turned_wrench(pose.orientation, measured)
        return ArmState(pose, wrench, self.now(), stopped, kind)

    def begin(self) -> None:
        controller = self._controller
        controller.switch(controller.names[1])
        controller.force.set_goal(None)
        controller.set_limits(*controller.limits)

    def resume(self) -> None:
        if self._controller.compliant:
            self.begin()

    def end(self) -> None:
        controller = self._controller
        controller.force.set_goal(None)
        if controller.compliant and controller.stop is None:
            controller.set_reference(controller.tool_pose())
            controller.set_wrench((0.0,) * 6)
            controller.stop_overlay()

    def set_reference(self, pose: Pose) -> None:
        reference = composed(self._mount, checked_reference(pose))
        with suppress(Refused):
            self._controller.set_reference(reference)

    def set_stiffness(self, translational: Vector, rotational: Vector) -> None:
        self._controller.impedance.set_stiffness((*translational, *rotational))

    def set_damping(self, factors: Sequence[float]) -> None:
        self._controller.impedance.set_damping_factors(factors)

    def set_wrench(self, force: Vector, torque: Vector = (0.0, 0.0, 0.0)) -> None:
        wrench = checked("wrench", (*force, *torque), MAX_WRENCH)
        with suppress(Refused):
            self._controller.set_wrench(wrench)

    def set_force_control(self, goal: ForceGoal | None) -> None:
        with suppress(Refused):
            if goal is not None:
                self._controller.check_active()
            self._controller.force.set_goal(goal)

    def start_spiral(self, spiral: SpiralGoal) -> None:
        with suppress(Refused):
            self._controller.start_overlay(spiral)

    def stop_overlay(self) -> None:
        self._controller.stop_overlay()

    def set_wrench_limits(self, force: float, torque: float, axes: Sequence[float] = ()) -> None:
        self._controller.set_limits(force, torque, axes)

    def set_regions(self, regions: Sequence[Region]) -> None:
        law = self._controller.impedance
        law.regions = [region._replace(pose=composed(self._mount, region.pose)) for region in regions]

    def apparent_mass(self, direction: Vector) -> float:
        return self._controller.apparent_mass(rotated(self._mount.orientation, direction))

    def take_peak(self) -> float:
        return self._controller.hand.take_peak(self.now())

    def zero_sensor(self) -> None:
        with suppress(Refused):  # without a sensor, contacts are measured: their zero is right
            self._controller.zero_sensor()
