# ruff: noqa
from skiros2_common.core.primitive import PrimitiveBase
from plant_skills.descriptions import Drive, Locate, Pick, Place


class drive_fake(PrimitiveBase):
    def createDescription(self):
        self.setDescription(Drive(), self.__class__.__name__)

    def execute(self):
        robot = self._wmi.get_element(self.params["Robot"].value.id)
        robot.setRelation("-1", "skiros:at", self.params["TargetLocation"].value.id)
        self._wmi.update_element(robot)
        return self.success("At {}".format(self.params["TargetLocation"].value.label))


class locate_fake(PrimitiveBase):
    """Finds what is looked for: makes an element of its template."""

    def createDescription(self):
        self.setDescription(Locate(), self.__class__.__name__)

    def execute(self):
        wanted, container = self.params["Object"].value, self.params["Container"].value
        if wanted.isAbstract():
            relation = {"src": container.id, "type": "skiros:contain", "dst": "-1", "state": True}
            self.params["Object"].value = self._wmi.instanciate(wanted.label, False, [relation])
        return self.success("Located {}".format(self.params["Object"].value.label))


class pick_fake(PrimitiveBase):
    def createDescription(self):
        self.setDescription(Pick(), self.__class__.__name__)

    def execute(self):
        part, gripper = self.params["Object"].value, self.params["Gripper"].value
        self._wmi.set_relation(self.params["Container"].value.id, "skiros:contain", part.id, False)
        self._wmi.set_relation(gripper.id, "skiros:contain", part.id)
        gripper = self._wmi.get_element(gripper.id)
        gripper.setProperty("skiros:ContainerState", "Full")
        self._wmi.update_element_properties(gripper)
        return self.success("Picked {}".format(part.label))


class place_fake(PrimitiveBase):
    def createDescription(self):
        self.setDescription(Place(), self.__class__.__name__)

    def execute(self):
        part, gripper = self.params["Object"].value, self.params["Gripper"].value
        self._wmi.set_relation(gripper.id, "skiros:contain", part.id, False)
        self._wmi.set_relation(self.params["PlacingLocation"].value.id, "skiros:contain", part.id)
        gripper = self._wmi.get_element(gripper.id)
        gripper.setProperty("skiros:ContainerState", "Empty")
        self._wmi.update_element_properties(gripper)
        return self.success("Placed {}".format(part.label))


class place_gear(PrimitiveBase):
    """Places gears alone, beside place_fake: it narrows the class of its object, and has a condition more."""

    def createDescription(self):
        self.setDescription(Place(), self.__class__.__name__)
        self.addPreCondition(self.getHasPropCond("Weighed", "skiros:Weight", "Object", True))

    def execute(self):
        return self.fail("not meant to run", -1)
