# ruff: noqa
from actionlib import SimpleActionClient
from actionlib.msg import TestAction, TestGoal
import skiros2_common.tools.logger as log
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element
from skiros2_skill.core.skill import State
from skiros2_std_skills.action_client_primitive import PrimitiveActionClient
from .descriptions import *


class move_base_fake(PrimitiveActionClient):
    """Drives through an action server, and writes where the robot is."""

    def createDescription(self):
        self.setDescription(MoveBase(), self.__class__.__name__)

    def modifyDescription(self, skill):
        self.addParam("Times", 1, ParamTypes.Optional)

    def buildClient(self):
        return SimpleActionClient("/drive", TestAction)

    def buildGoal(self):
        return TestGoal(goal=self.params["TargetLocation"].value.getIdNumber())

    def onFeedback(self, msg):
        return self.step("on the way: {}".format(msg.feedback))

    def onDone(self, status, msg):
        robot = self._wmi.get_element(self.params["Robot"].value.id)
        robot.setRelation("-1", "skiros:at", self.params["TargetLocation"].value.id)
        self._wmi.update_element(robot)
        return self.success("there: {}".format(msg.result))


class arm_move(PrimitiveBase):
    def createDescription(self):
        self.setDescription(ArmMovement(), self.__class__.__name__)

    def onInit(self):
        return True

    def onPreempt(self):
        return self.fail("stopped", -1)

    def onStart(self):
        if self.params["Speed"].value is None:
            self.params["Speed"].value = 0.5
        log.info("[{}]".format(self.__class__.__name__), "to {}".format(self.params["Target"].value))
        self.ticks = 0
        return True

    def execute(self):
        self.ticks += 1
        if self.ticks < 3:
            return self.step("moving")
        return self.success(
            "reached {} in mode {}".format(self.params["Target"].value.label, self.params["Mode"].value)
        )


class look_around(PrimitiveBase):
    """Adds a product to the scene, and hands it and some way points to its siblings."""

    def createDescription(self):
        self.setDescription(LookAround(), self.__class__.__name__)

    def execute(self):
        found = Element("skiros:Product", "found")
        found.setProperty("skiros:SizeX", 0.1)
        found.setData(":Position", [0.1, 0.0, 0.3])
        found.setRelation(self.params["Container"].value.id, "skiros:contain", "-1")
        self._wmi.add_element(found)
        self.params["Found"].value = found
        self.params["Waypoints"].value = {"x": 1.0}
        self.params["Waypoints"].values.append({"x": 2.0})
        return self.success("found {}".format(found.id))


class follow(PrimitiveBase):
    """Takes one way point after the other from the list of its sibling."""

    def createDescription(self):
        self.setDescription(Follow(), self.__class__.__name__)

    def onStart(self):
        self.done = []
        return True

    def execute(self):
        if not self.params["Waypoints"].values:
            return self.success("went through {}".format(self.done))
        self.done.append(self.params["Waypoints"].values.pop(0)["x"])
        return self.step("")
