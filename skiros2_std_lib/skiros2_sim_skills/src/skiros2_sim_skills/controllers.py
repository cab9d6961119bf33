"""The controllers of an arm, switched by a service like controller_manager's."""

from __future__ import annotations

import rospy

from controller_manager_msgs.srv import SwitchController as Switch
from controller_manager_msgs.srv import SwitchControllerRequest, SwitchControllerResponse
from skiros2_common.core.abstract_skill import State
from skiros2_sim_skills.motions import SwitchController
from skiros2_std_skills.core.controller_use import forget
from skiros2_std_skills.core.devices import name_of
from skiros2_std_skills.core.driver_names import (
    COMPLIANT_CONTROLLER,
    POSITION_CONTROLLER,
    SWITCH_CONTROLLER,
    robot_name,
)
from skiros2_std_skills.drivers import DriverService


class switch_controller(DriverService):
    """Starts one controller of the arm and stops the other."""

    def createDescription(self) -> None:
        self.setDescription(SwitchController(), self.__class__.__name__)

    def buildClient(self) -> rospy.ServiceProxy:
        return rospy.ServiceProxy(SWITCH_CONTROLLER.format(robot=robot_name(self.element("Robot"))), Switch)

    def buildRequest(self) -> SwitchControllerRequest:
        forget(self.element("Arm").id)
        on, off = self._controllers()
        return SwitchControllerRequest(
            start_controllers=[on], stop_controllers=[off], strictness=SwitchControllerRequest.BEST_EFFORT
        )

    def onDone(self, response: SwitchControllerResponse) -> State:
        on, _ = self._controllers()
        if not response.ok:
            return self.fail(f"{self.label_of('Arm')} did not switch to controller {on!r}", -1)
        return self.success(f"Controller {on!r} is active")

    def _controllers(self) -> tuple[str, str]:
        """Returns the controllers to start and to stop."""
        robot, arm = self.element("Robot"), self.element("Arm")
        position, compliant = (name_of(address, robot, arm) for address in (POSITION_CONTROLLER, COMPLIANT_CONTROLLER))
        return (compliant, position) if self.value("Compliant") else (position, compliant)
