"""Trees that are wide, deep, or without end."""

from skiros2_common.core.abstract_skill import SkillDescription
from skiros2_common.core.params import ParamTypes
from skiros2_skill.core.skill import ParallelFf, SkillBase


class Wide(SkillDescription):
    def createDescription(self):
        self.addParam("Width", int, ParamTypes.Required)


class wide(SkillBase):
    def createDescription(self):
        self.setDescription(Wide(), "wide")

    def expand(self, skill):
        skill.setProcessor(ParallelFf())
        for _ in range(self.params["Width"].value):
            skill(self.skill("Counter", "counter", specify={"CountTarget": 1}))


class Deep(SkillDescription):
    def createDescription(self):
        self.addParam("Depth", int, ParamTypes.Required)


class deep(SkillBase):
    def createDescription(self):
        self.setDescription(Deep(), "deep")

    def expand(self, skill):
        depth = self.params["Depth"].value
        if depth > 0:
            skill(self.skill("Deep", "deep", specify={"Depth": depth - 1}))
        elif depth < 0:
            skill(self.skill("Deep", "deep", specify={"Depth": depth}))  # without end
        else:
            skill(self.skill("Counter", "counter", specify={"CountTarget": 2}))
