# ruff: noqa
from skiros2_skill.core.skill import *
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element
from site_skills.descriptions import GoTo, PaintWall, OpenDoor, PullHandle


class go_to(PrimitiveBase):
    def createDescription(self):
        self.setDescription(GoTo(), self.__class__.__name__)

    def onPreempt(self):
        return True

    def execute(self):
        robot = self.params["Robot"].value
        robot.setRelation("-1", "skiros:at", self.params["TargetLocation"].value.id)
        self.params["Robot"].value = robot
        return self.success("At %s" % self.params["TargetLocation"].value.label)


class paint_wall(PrimitiveBase):
    def createDescription(self):
        self.setDescription(PaintWall(), self.__class__.__name__)

    def onStart(self):
        self._strokes = 2
        return True

    def onPreempt(self):
        return True

    def execute(self):
        if self._strokes > 0:
            self._strokes -= 1
            return self.step("Stroke")
        wall = self.params["Wall"].value
        wall.setProperty("skiros:Painted", True)
        wall.setProperty("skiros:Coats", wall.getProperty("skiros:Coats").value + 1)
        self.params["Wall"].value = wall
        return self.success()


class open_door(SkillBase):
    """Its children share the key Door, and one of them assigns it."""

    def createDescription(self):
        self.setDescription(OpenDoor(), self.__class__.__name__)

    def expand(self, skill):
        skill(
            self.skill("PullHandle", "pull_handle"),
            self.skill(
                "WmSetProperties",
                "wm_set_properties",
                remap={"Src": "Door"},
                specify={"Properties": {"skiros:Open": True}},
            ),
        )


class open_door_in_a_draught(SkillBase):
    """The wind shuts the other doors, which the description does not say."""

    def createDescription(self):
        self.setDescription(OpenDoor(), "open_door_in_a_draught")

    def expand(self, skill):
        skill(
            self.skill("PullHandle", "pull_handle"),
            self.skill(
                "WmSetProperties",
                "wm_set_properties",
                remap={"Src": "Door"},
                specify={"Properties": {"skiros:Open": True}},
            ),
        )

    def execute(self):
        for door in self._wmi.resolve_elements(Element("skiros:Product")):
            if door.id != self.params["Door"].value.id and door.hasProperty("skiros:Open", True):
                door.setProperty("skiros:Open", False)
                self._wmi.update_element_properties(door)


class pull_handle(PrimitiveBase):
    def createDescription(self):
        self.setDescription(PullHandle(), self.__class__.__name__)

    def onPreempt(self):
        return True

    def execute(self):
        door = self.params["Door"].value
        pulls = door.getProperty("skiros:Pulls").value + 1 if door.hasProperty("skiros:Pulls") else 1
        door.setProperty("skiros:Pulls", pulls)
        self.params["Door"].value = door
        return self.success()
