"""Skills that are trees of other skills."""

from my_skills.descriptions import Inspect
from skiros2_skill.core.skill import SkillBase


class inspect(SkillBase):
    """Takes a picture, then notes in the world model that the object is inspected."""

    def createDescription(self):
        self.setDescription(Inspect(), "inspect")

    def expand(self, skill):
        skill(
            self.skill("TakePicture", ""),
            self.skill(
                "WmSetProperties",
                "wm_set_properties",
                remap={"Src": "Object"},
                specify={"Properties": {"my_skills:Inspected": True}},
            ),
        )
