"""A library whose skills use one element, which reaches them in every way in which a value reaches a parameter."""

from __future__ import annotations

import json
import time

from skiros2_common.core.abstract_skill import SkillDescription
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element
from skiros2_skill.core.skill import RetryOnFail, SkillBase
from skiros2_skill.ros.utils import deserialize_skill
from support.value_table import CHANGES, Stage

WEIGHT, MODEL, WORTH = "skiros:Weight", "skiros:CadModel", "skiros:Value"


def _gate(wmi):
    (gate,) = wmi.resolve_elements(Element("skiros:Location", "gate"))
    return gate


def use(skill):
    """Reports the element as the skill sees it, and changes one property of it."""
    element = skill.params["Object"].value
    if element is None:
        return skill.success(json.dumps(None))
    holders = [r["src"] for r in element.getRelations("", "skiros:contain", "-1")]
    seen = {"id": element.id, "weight": element.value_of(WEIGHT), "holders": holders}
    element.setProperty(MODEL, "used")
    skill.params["Object"].value = element
    return skill.success(json.dumps(seen))


def _describe(name, ptype, *, wanted=False):
    def create(self):
        self.addParam("Object", Element("skiros:Product"), ptype)
        if wanted:
            self.addPreCondition(self.getHasPropCond("Weighed", WEIGHT, "Object", True))

    return type(name, (SkillDescription,), {"createDescription": create})


class _Use(PrimitiveBase):
    described = None

    def createDescription(self):
        self.setDescription(self.described(), type(self).__name__)

    def execute(self):
        return use(self)


class use_required(_Use):
    described = _describe("UseRequired", ParamTypes.Required)


class use_optional(_Use):
    described = _describe("UseOptional", ParamTypes.Optional)


class use_inferred(_Use):
    described = _describe("UseInferred", ParamTypes.Inferred, wanted=True)


class use_late(_Use):
    """Writes the element after another author has changed it, within one `execute`."""

    described = _describe("UseLate", ParamTypes.Required)

    def execute(self):
        element, gate = self.params["Object"].value, _gate(self._wmi)
        gate.setProperty(MODEL, "read")
        self._wmi.update_element(gate)
        deadline = time.monotonic() + 20.0
        while not _gate(self._wmi).hasProperty(WEIGHT):
            if time.monotonic() > deadline:
                return self.fail("nobody has opened the gate", -1)
            time.sleep(0.01)
        element.setProperty(MODEL, "used")
        self.params["Object"].value = element
        return self.success()


class Gate(SkillDescription):
    def createDescription(self):
        pass


class gate(PrimitiveBase):
    """Waits until the element `gate` has a weight."""

    def createDescription(self):
        self.setDescription(Gate(), "gate")

    def execute(self):
        return self.success() if _gate(self._wmi).hasProperty(WEIGHT) else self.step("waiting")


class Edit(SkillDescription):
    def createDescription(self):
        self.addParam("Change", str, ParamTypes.Required)
        self.addParam("Stage", dict, ParamTypes.Required)


class edit(PrimitiveBase):
    """Makes a change of the table as the robot: by its own client of the world model."""

    def createDescription(self):
        self.setDescription(Edit(), "edit")

    def execute(self):
        CHANGES[self.params["Change"].value](self._wmi, Stage(**self.params["Stage"].value))
        return self.success()


class hold_given(_Use):
    """Has the element, and leaves it alone."""

    described = _describe("HoldGiven", ParamTypes.Required)

    def execute(self):
        return self.success()


class hold_inferred(hold_given):
    described = _describe("HoldInferred", ParamTypes.Inferred, wanted=True)


class _Find(_Use):
    def execute(self):
        (part,) = self._wmi.resolve_elements(Element("skiros:Product", "part"))
        self.output(part)
        return self.success()


class find(_Find):
    """Assigns all values."""

    described = _describe("Find", ParamTypes.Optional)

    def output(self, part):
        self.params["Object"].values = [part]


class rework(_Find):
    """Assigns the inferred element in place, with a change of its own."""

    described = _describe("Rework", ParamTypes.Inferred, wanted=True)

    def output(self, part):
        part.setProperty(WORTH, "reworked")
        self.params["Object"].value = part


class _Around(SkillBase):
    """Waits between its own start and that of the skill that uses the element."""

    described, user, remap = None, "UseRequired", {}

    def createDescription(self):
        self.setDescription(self.described(), type(self).__name__)

    def expand(self, skill):
        skill(self.skill("Gate"), self.skill(self.user, remap=self.remap))


class above(_Around):
    described = _describe("Above", ParamTypes.Required)


class above_inferred(_Around):
    described = _describe("AboveInferred", ParamTypes.Inferred, wanted=True)
    user = "UseInferred"


class Remapped(SkillDescription):
    def createDescription(self):
        self.addParam("Thing", Element("skiros:Product"), ParamTypes.Required)


class remapped(_Around):
    described = Remapped
    remap = {"Object": "Thing"}


class Specified(Remapped):
    pass


class specified(SkillBase):
    def createDescription(self):
        self.setDescription(Specified(), "specified")

    def expand(self, skill):
        part = self.params["Thing"].value
        skill(self.skill("Gate"), self.skill("UseRequired", specify={"Object": part}))


class FindBelow(SkillDescription):
    def createDescription(self):
        self.addParam("Thing", Element("skiros:Product"), ParamTypes.Optional)


class find_below(SkillBase):
    """A child finds the element, a later one uses it."""

    def createDescription(self):
        self.setDescription(FindBelow(), "find_below")

    def expand(self, skill):
        names = {"Object": "Thing"}
        skill(self.skill("Find", remap=names), self.skill("Gate"), self.skill("UseRequired", remap=names))


class UseAtSecondTry(SkillDescription):
    def createDescription(self):
        self.addParam("Object", Element("skiros:Product"), ParamTypes.Inferred)
        self.addPreCondition(self.getHasPropCond("Weighed", WEIGHT, "Object", True))


class use_at_second_try(PrimitiveBase):
    """Waits for the gate, fails, and uses the element when it is started again."""

    def createDescription(self):
        self.setDescription(UseAtSecondTry(), "use_at_second_try")

    def execute(self):
        element = _gate(self._wmi)
        if not element.hasProperty(WEIGHT):
            return self.step("waiting")
        if not element.hasProperty(MODEL):
            element.setProperty(MODEL, "tried")
            self._wmi.update_element(element)
            return self.fail("the first try fails", -7)
        return use(self)


class Again(SkillDescription):
    def createDescription(self):
        pass


class again(SkillBase):
    def createDescription(self):
        self.setDescription(Again(), "again")

    def expand(self, skill):
        skill.setProcessor(RetryOnFail(2))
        skill(self.skill("UseAtSecondTry"))


class RunPlan(SkillDescription):
    def createDescription(self):
        self.addParam("Plan", str, ParamTypes.Required)


class run_plan(SkillBase):
    """Runs the steps of a plan as its children, as the standard skill for planning does."""

    def createDescription(self):
        self.setDescription(RunPlan(), "run_plan")

    def expand(self, skill):
        for step in deserialize_skill(self.params["Plan"].value).children:
            node = self.skill(step.type, step.name)
            node.specifyParamsDefault(step.ph)
            skill(node)
