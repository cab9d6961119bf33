# ruff: noqa
from skiros2_skill.core.skill import *
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_skill.core.skill import RetryOnFail
from foreign_cell_skills.descriptions import Bring, Go, Grab


class go_around(SkillBase):
    """Another way to go; only for robots that say so."""

    def createDescription(self):
        self.setDescription(Go(), self.__class__.__name__)
        self.addParam("Via", Element("skiros:Location"), ParamTypes.Optional)
        self.addPreCondition(self.getPropCond("Shy", "skiros:ContainerState", "Robot", "=", "Shy", True))

    def expand(self, skill):
        skill.setProcessor(SerialStar())
        skill(self.skill("Go", "go_fake"))


class grab_light(SkillBase):
    """Grabs starters alone: it narrows the type of its object."""

    def createDescription(self):
        self.setDescription(Grab(), self.__class__.__name__)
        self.addParam("Object", Element("skiros:Starter"), ParamTypes.Required)

    def expand(self, skill):
        skill(
            self.skill("Approach", ""),
            self.skill(
                ":WmMoveObject", "wm_move_object", remap={"StartLocation": "Container", "TargetLocation": "Gripper"}
            ),
        )


class bring(SkillBase):
    def createDescription(self):
        self.setDescription(Bring(), self.__class__.__name__)
        self._expand_on_start = True

    def onStart(self):
        self.params["Report"].value = {"tries": self.params["Tries"].value}
        return True

    def expand(self, skill):
        self.setProcessor(Sequential())
        skill(
            self.skill(Selector())(
                self.skill("Approach", "approach_fake", remap=""),
                self.skill("Wait", "wait", specify={"Duration": 100.0}),
            ),
            self.skill("Go", "", remap={"TargetLocation": "From"}),
            self.skill(RetryOnFail(self.params["Tries"].value))(
                self.skill("skiros:Grab", "", remap={"Container": "From"}, specify={"Force": 5.0}),
            ),
            self.skill(ParallelFs())(
                self.skill("Go", "go_fake", remap={"TargetLocation": "To"}),
                self.skill("Wait", "wait", specify={"Duration": 100.0}),
            ),
        )
        skill.addChild(self.skill("Drop", "drop_fake", remap={"PlacingLocation": "To"}))
        skill.addChild(self.getNode(NoFail(Sequential())))
        skill.last()(self.skill("Grab", "grab_fake", specify={"Force": 1000.0}))

    def onPreempt(self):
        return State.Failure

    def onEnd(self):
        return True

    def execute(self):
        return None


class bring_all(SkillBase):
    """Twice the same skill at once, on different levels of remaps."""

    def createDescription(self):
        self.setDescription(BringAll(), self.__class__.__name__)

    def expand(self, skill):
        skill.setProcessor(ParallelFf())
        skill(
            self.skill("Approach", ""),
            self.skill("Approach", ""),
            self.skill(Serial())(
                self.skill("Bring", "bring", remap={"Object": "First", "To": "Goal"}),
            ),
        )


class BringAll(SkillDescription):
    def createDescription(self):
        self.addParam("First", Element("skiros:Product"), ParamTypes.Required)
        self.addParam("Goal", Element("skiros:Location"), ParamTypes.Required)
