from pick_place_skills.descriptions import Fetch, Pick, Place, TakeStock
from skiros2_skill.core.skill import ParallelFf, SkillBase


class pick_fake(SkillBase):
    def createDescription(self):
        self.setDescription(Pick(), self.__class__.__name__)

    def expand(self, skill):
        skill(
            self.skill(
                "WmMoveObject", "wm_move_object", remap={"StartLocation": "Container", "TargetLocation": "Gripper"}
            ),
        )


class place_fake(SkillBase):
    """The moving child unsets its start, which is the gripper that the post-conditions speak of."""

    def createDescription(self):
        self.setDescription(Place(), self.__class__.__name__)

    def expand(self, skill):
        skill(
            self.skill(
                "WmMoveObject",
                "wm_move_object",
                remap={"StartLocation": "Gripper", "TargetLocation": "PlacingLocation"},
            ),
        )


class fetch_fake(SkillBase):
    def createDescription(self):
        self.setDescription(Fetch(), self.__class__.__name__)

    def expand(self, skill):
        skill(
            self.skill("Drive", "", remap={"TargetLocation": "Container"}),
            self.skill("Pick", "pick_fake"),
            self.skill("Drive", "", remap={"TargetLocation": "To"}),
            self.skill("Place", "place_fake", remap={"PlacingLocation": "To"}),
        )


class take_stock_fake(SkillBase):
    """Finds and sorts side by side, and hands what is detected to the next."""

    def createDescription(self):
        self.setDescription(TakeStock(), self.__class__.__name__)

    def expand(self, skill):
        skill(
            self.skill(ParallelFf())(
                self.skill("Scan", ""),
                self.skill("Sort", ""),
            ),
            self.skill("Detect", "detect_fake"),
            self.skill("Weigh", "weigh_fake", remap={"Object": "Detected"}),
        )
