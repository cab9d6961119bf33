# ruff: noqa
from skiros2_common.core.primitive import *
from skiros2_common.core.abstract_skill import State
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_common.core.primitive_thread import PrimitiveThreadBase
from skiros2_world_model.core.world_model_abstract_interface import WmException
import skiros2_common.tools.logger as log
from foreign_cell_skills.descriptions import Approach, Go, Grab, Drop, Look, Scrap, Check


class approach_fake(PrimitiveBase):
    def createDescription(self):
        self.setDescription(Approach(), self.__class__.__name__)

    def onInit(self):
        self.count = 0

    def execute(self):
        self.count += 1
        if self._progress_code < 2:
            return self.step("Approaching.")
        return self.success()


class go_fake(PrimitiveBase):
    """Needs some ticks; moves the robot at the end."""

    def createDescription(self):
        self.setDescription(Go(), self.__class__.__name__)

    def onPreempt(self):
        return True

    def onStart(self):
        self._left = 3
        target = self.params["TargetLocation"].value
        if target == None or target.isAbstract():
            return self.startError("No target.", -1)
        return True

    def execute(self):
        if self._left > 0:
            self._left -= 1
            return self.step("Moving to %s, %d to go." % (self.params["TargetLocation"].value.label, self._left))
        robot = self._wmi.get_element(self.params["Robot"].value.id)
        robot.setRelation("-1", "skiros:at", self.params["TargetLocation"].value.id)
        self._wmi.update_element(robot)
        return self.success("Arrived.")

    def onEnd(self):
        return True


class grab_fake(PrimitiveBase):
    def createDescription(self):
        self.setDescription(Grab(), self.__class__.__name__)

    def execute(self):
        obj = self.params["Object"].value
        gripper = self.params["Gripper"].value
        if self.params["Force"].value > 100.0:
            return self.fail("Too firm: {}".format(self.params["Force"].value), -3)
        obj.setRelation(gripper.id, "skiros:contain", "-1")
        obj.removeRelation2(self.params["Container"].value.id, "skiros:contain", "-1")
        self._wmi.update_element(obj)
        gripper.setProperty("skiros:ContainerState", "Full")
        self.params["Gripper"].value = gripper
        self.params["Grasped"].value = obj.label
        log.info("grab_fake", "Grasped %s" % obj.label)
        return self.success("Grasped {} with {}".format(obj, gripper))


class drop_fake(PrimitiveThreadBase):
    """Works in a thread."""

    def createDescription(self):
        self.setDescription(Drop(), self.__class__.__name__)

    def preStart(self):
        self.status = "Lowering"
        return self.params["Object"].value is not None

    def run(self):
        obj = self._wmi.get_element(self.params["Object"].value.id)
        for r in obj.getRelations(pred="skiros:contain", obj="-1"):
            obj.removeRelation(r)
        obj.addRelation(self.params["PlacingLocation"].value.id, "skiros:contain", "-1")
        self._wmi.update_element(obj)
        gripper = self._wmi.get_element(self.params["Gripper"].value.id)
        gripper.setProperty("skiros:ContainerState", "Empty")
        self._wmi.update_element_properties(gripper)
        return self.success("Dropped")


class look_fake(PrimitiveBase):
    def createDescription(self):
        self.setDescription(Look(), self.__class__.__name__)

    def execute(self):
        e = Element("skiros:Product", "seen thing")
        e.setProperty("skiros:Weight", 0.5)
        e.addRelation(self.params["Place"].value.id, "skiros:contain", "-1")
        try:
            self._wmi.add_element(e)
        except WmException as exc:
            return self.fail(str(exc), -1)
        self.params["Seen"].value = e
        return self.success()


class scrap_fake(PrimitiveBase):
    def createDescription(self):
        self.setDescription(Scrap(), "scrap fake/1")

    def execute(self):
        self.params["Old Label/Name"].value = self.params["Object"].value.label
        self._wmi.remove_element(self.params["Object"].value)
        self.params["Old Label/Name"].unset()
        return self.success()


class check_value(PrimitiveBase):
    def createDescription(self):
        self.setDescription(Check(), "check_value")

    def modifyDescription(self, skill):
        skill.addParam("Unit", "m", ParamTypes.Optional)

    def execute(self):
        return self.success("{} {}".format(self.params["Value"].value, self.params["Unit"].value))


class Check_Value(check_value):
    """The label differs in case only."""

    def createDescription(self):
        self.setDescription(Check(), "Check_Value")
        self.addParam("Limit", 100.0, ParamTypes.Required)
        self.addParam("Value", float, ParamTypes.Required)
