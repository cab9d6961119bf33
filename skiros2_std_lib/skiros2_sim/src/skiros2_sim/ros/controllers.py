"""The controller manager of a robot's arms, with ros_control's services."""

from __future__ import annotations

import logging

import rospy
from geometry_msgs.msg import Wrench

from controller_manager_msgs.msg import ControllerState, HardwareInterfaceResources
from controller_manager_msgs.srv import (
    ListControllers,
    ListControllersRequest,
    ListControllersResponse,
    SwitchController,
    SwitchControllerRequest,
    SwitchControllerResponse,
)
from skiros2_common.core.errors import Refused, SkirosError, UnknownName
from skiros2_sim.core.arm_controller import ArmController
from skiros2_sim.core.scene_spec import ArmSpec, RobotSpec
from skiros2_sim.core.stepper import Stepper
from skiros2_sim.core.world import World
from skiros2_sim.ros.device_server import Device
from skiros2_sim.ros.messages import vector_from
from skiros2_std_skills.core import driver_names as names

log = logging.getLogger(__name__)


class Controllers:
    """The services that switch and list the controllers of a robot's arms, and the topics for their stiffness.

    :param controllers: controllers of all arms, by id of the arm; replaced by a reset.
    :param devices: devices of the arms, by id of the arm.
    """

    def __init__(
        self, robot: RobotSpec, stepper: Stepper, controllers: dict[str, ArmController], devices: dict[str, Device]
    ) -> None:
        self._robot = robot
        self._stepper = stepper
        self._controllers = controllers
        self._devices = devices
        self._arms = [arm for arm in robot.arms if arm.id in controllers]
        self._services = [
            rospy.Service(names.SWITCH_CONTROLLER.format(robot=robot.name), SwitchController, self._on_switch),
            rospy.Service(names.LIST_CONTROLLERS.format(robot=robot.name), ListControllers, self._on_list),
        ]
        self._subscribers = [
            rospy.Subscriber(arm.stiffness_topic, Wrench, self._on_stiffness, arm, queue_size=1) for arm in self._arms
        ]

    def close(self) -> None:
        """Shuts services and topics down."""
        for service in self._services:
            service.shutdown()
        for subscriber in self._subscribers:
            subscriber.unregister()

    def _on_list(self, _: ListControllersRequest) -> ListControllersResponse:
        """Returns the controllers of all arms, with the names that a switch accepts."""
        kinds = (("Position", "PositionJointInterface"), ("CartesianImpedance", "EffortJointInterface"))
        found = []
        for arm in self._arms:
            controller = self._controllers[arm.id]
            joints = [joint.name for joint in controller.arm.joints]
            for name, (kind, interface) in zip(controller.names, kinds, strict=True):
                is_unique = sum(name in other.names for other in self._arm_controllers()) == 1
                resources = HardwareInterfaceResources(f"hardware_interface::{interface}", joints)
                state = "running" if name == controller.active else "stopped"
                full_name = name if is_unique else f"{arm.name}/{name}"
                found.append(ControllerState(full_name, state, f"skiros2_sim/{kind}", [resources]))
        return ListControllersResponse(found)

    def _arm_controllers(self) -> list[ArmController]:
        return [self._controllers[arm.id] for arm in self._arms]

    def _on_switch(self, request: SwitchControllerRequest) -> SwitchControllerResponse:
        strict = request.strictness == SwitchControllerRequest.STRICT
        try:
            self._stepper.call(lambda _: self._switch(request.start_controllers, request.stop_controllers, strict))
        except SkirosError as error:
            log.warning("controllers of %s were not switched: %s", self._robot.name, error)
            return SwitchControllerResponse(False)
        return SwitchControllerResponse(True)

    def _switch(self, start: list[str], stop: list[str], strict: bool) -> None:
        """Switches all controllers, or none. Called in the stepping thread.

        :param strict: whether to reject unknown names and switches without effect; otherwise they are ignored.
        :raises UnknownName: there is no such controller.
        :raises Refused: a switch is not possible.
        """
        starts: dict[str, str] = {}
        stops: dict[str, str] = {}
        for wanted, chosen, be_on in ((start, starts, False), (stop, stops, True)):
            for name in wanted:
                try:
                    arm, controller = self._find(name)
                    if strict and (self._controllers[arm.id].active == controller) is not be_on:
                        raise Refused(f"{name} is already {'inactive' if be_on else 'active'}")
                    if chosen.setdefault(arm.id, controller) != controller:
                        state = "stopped" if be_on else "active"
                        raise Refused(f"both controllers of arm {arm.name} cannot be {state}")
                except UnknownName:
                    if strict:
                        raise
        for arm in self._arms:
            now = self._controllers[arm.id]
            on = starts.get(arm.id, now.active)
            if arm.id in stops and stops[arm.id] == on:
                raise Refused(f"arm {arm.name} needs a controller: {on} can only be replaced by another one")
            if on != now.active and self._devices[arm.id].running is not None:
                raise Refused(f"arm {arm.name} is executing a goal; cancel it first")
        for arm_id, controller in starts.items():
            self._controllers[arm_id].switch(controller)

    def _find(self, name: str) -> tuple[ArmSpec, str]:
        """Returns the arm and the name of a controller: `NAME`, or `ARM/NAME` if it is ambiguous.

        :raises UnknownName: no arm, or several arms, have such a controller.
        """
        found = [
            (arm, controller)
            for arm in self._arms
            for controller in (arm.position_controller, arm.compliant_controller)
            if name in (controller, f"{arm.name}/{controller}")
        ]
        if len(found) == 1:
            return found[0]
        known = [f"{a.name}/{c}" for a in self._arms for c in (a.position_controller, a.compliant_controller)]
        what = "several arms have" if found else "no arm has"
        raise UnknownName(f"{what} a controller {name!r}; expected one of: {', '.join(known) or 'none'}")

    def _on_stiffness(self, message: Wrench, arm: ArmSpec) -> None:
        try:
            values = (
                *vector_from(message.force, f"stiffness of {arm.name}, N/m"),
                *vector_from(message.torque, f"stiffness of {arm.name}, Nm/rad"),
            )

            def put(_: World) -> None:
                self._controllers[arm.id].stiffness = values

            self._stepper.call(put)
        except SkirosError as error:
            log.warning("%s: %s", arm.stiffness_topic, error)
