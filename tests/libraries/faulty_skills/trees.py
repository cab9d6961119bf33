"""Faults in the trees of compounds."""

from faulty_skills.descriptions import Fetch
from skiros2_common.core.abstract_skill import SkillDescription
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element
from skiros2_skill.core.skill import ParallelFf, SkillBase


class Say(SkillDescription):
    def createDescription(self):
        self.addParam("Text", str, ParamTypes.Required)
        self.addParam("Times", 1, ParamTypes.Optional)


class say(PrimitiveBase):
    def createDescription(self):
        self.setDescription(Say(), "say")

    def execute(self):
        return self.success(self.params["Text"].value)


class fetch(PrimitiveBase):
    def createDescription(self):
        self.setDescription(Fetch(), "fetch")

    def execute(self):
        return self.success("")


class Tell(SkillDescription):
    def createDescription(self):
        self.addParam("Words", str, ParamTypes.Required)
        self.addParam("Volume", 0.5, ParamTypes.Optional)
        self.addParam("Listener", Element("sumo:Agent"), ParamTypes.Inferred)


class wrong_remaps(SkillBase):
    def createDescription(self):
        self.setDescription(Tell(), "wrong_remaps")

    def expand(self, skill):
        skill(
            self.skill("Say", "", remap={"Text": "Words"}),
            self.skill("Say", "say", remap={"Txet": "Words"}, specify={"Text": "hello"}),  # warning: unknown-remap
            self.skill(ParallelFf())(
                self.skill("Fetch", "", remap={"Objekt": "Listener"}),  # warning: unknown-remap
            ),
        )


class wrong_remap_of_a_descendant(SkillBase):
    def createDescription(self):
        self.setDescription(Tell(), "wrong_remap_of_a_descendant")

    def expand(self, skill):
        skill(
            self.skill("Tell", "right", remap={"Words": "Words", "Times": "Volume"}),
            self.skill("Tell", "right", remap={"Loudness": "Volume"}),  # warning: unknown-remap
        )


class wrong_values(SkillBase):
    def createDescription(self):
        self.setDescription(Tell(), "wrong_values")

    def expand(self, skill):
        skill(
            self.skill("Say", "", remap={"Text": "Words"}, specify={"Tmies": 2}),  # warning: unknown-specify
            self.skill("Say", "", remap={"Text": "Words"}, specify={"Times": "often"}),  # warning: wrong-type
        )


class wrong_types(SkillBase):
    def createDescription(self):
        self.setDescription(Tell(), "wrong_types")

    def expand(self, skill):
        skill(
            self.skill("Say", "", remap={"Text": "Volume"}),  # warning: wrong-type
            self.skill("Fetch", "fetch", remap={"Object": "Listener"}),  # warning: wrong-type
        )


class wrong_pre_condition(SkillBase):
    def createDescription(self):
        self.setDescription(Tell(), "wrong_pre_condition")

    def expand(self, skill):
        near = self.getRelationCond("Near", "skiros:at", "Robot", "Plcae", True)
        skill(self.skill("Say", "", remap={"Text": "Words"}, preconditions=[near]))  # warning: unknown-key


class nothing_sets_it(SkillBase):
    def createDescription(self):
        self.setDescription(Tell(), "nothing_sets_it")

    def expand(self, skill):
        skill(self.skill("Say", "", remap={"Text": "Sentence"}))  # warning: never-set  # warning: unknown-target


class no_such_skill(SkillBase):
    def createDescription(self):
        self.setDescription(Tell(), "no_such_skill")

    def expand(self, skill):
        skill(
            self.skill("Sya", ""),  # error: unknown-skill
            self.skill("Say", "shout", specify={"Text": "!"}),  # error: unknown-skill
        )


class wrong_targets(SkillBase):
    def createDescription(self):
        self.setDescription(Tell(), "wrong_targets")

    def expand(self, skill):
        skill(
            self.skill("Say", "", remap={"Text": "Words", "Times": "Once"}),
            self.skill("Fetch", "", remap={"Object": "Listner"}),  # warning: unknown-target
            self.skill("Fetch", "", remap={"Object": "Parcel", "Container": "Tray"}),
            self.skill("Fetch", "fetch", remap={"Object": "Parcel", "Container": "Tray"}),
        )


class in_itself(SkillBase):
    def createDescription(self):
        self.setDescription(Endless(), "in_itself")

    def expand(self, skill):
        skill(self.skill("Endless", ""))  # warning: recursion


class Endless(SkillDescription):
    pass


class right(SkillBase):
    """Nothing is wrong with this one."""

    def createDescription(self):
        self.setDescription(Tell(), "right")

    def expand(self, skill):
        skill(
            self.skill("Say", "", remap={"Text": "Words"}),
            self.skill("Say", "", remap={"Text": "Words"}, specify={"Times": 2}),
        )
