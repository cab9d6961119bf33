"""The leaves of the trees."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from typing import Any

from skiros2_common.core.abstract_skill import ParamOptions, SkillDescription, State
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.primitive_thread import PrimitiveThreadBase
from skiros2_common.core.world_element import Element

REQUIRED, OPTIONAL, INFERRED = ParamTypes.Required, ParamTypes.Optional, ParamTypes.Inferred


class Act(SkillDescription):
    """Does nothing, as it is told."""

    def createDescription(self) -> None:
        self.addParam("Script", "S", REQUIRED, "One letter for each tick, the last for all further ones")
        self.addParam("Start", "", OPTIONAL, "How onStart ends: F false, X raises")
        self.addParam("Stop", "F", OPTIONAL, "What onPreempt answers; each R before it takes one tick")
        self.addParam("End", "", OPTIONAL, "How onEnd ends: F false, X raises")


class Scripted(PrimitiveBase, ABC):
    """A primitive whose ticks end as a script says: R runs, S succeeds, F fails with -5, X raises; preempted: -9."""

    script = "S"
    stop = "F"

    @abstractmethod
    def createDescription(self) -> None:
        """What it implements."""

    def onStart(self) -> bool:
        self._ticks = 0
        self._stopped = False
        return True

    def execute(self) -> Any:
        if self._stopped:
            return self._stop()
        self._ticks += 1
        return self.outcome(self.script[min(self._ticks, len(self.script)) - 1])

    def onPreempt(self) -> Any:
        self._stopped = True
        return self._stop()

    def _stop(self) -> Any:
        letter, self.stop = self.stop[0], self.stop[1:]
        return self.fail("stopped", 9) if letter == "F" else self.outcome(letter)

    def outcome(self, letter: str) -> Any:
        """What a hook answers that ends so; T, N and 7 are what it answers instead of a state."""
        if letter == "X":
            raise RuntimeError("as the script says")
        if letter in "TN7":
            return {"T": True, "N": None, "7": 7}[letter]
        return {"R": self.step, "S": self.success}[letter]("") if letter in "RS" else self.fail("as told", 5)


class act(Scripted):
    """As its parameters say."""

    def createDescription(self) -> None:
        self.setDescription(Act(), "act")

    def onStart(self) -> bool:
        self.script, self.stop = self.params["Script"].value, self.params["Stop"].value
        super().onStart()
        start = self.params["Start"].value
        if start == "X":
            self.outcome("X")
        return self.startError("as told", 7) if start == "F" else True

    def onEnd(self) -> bool:
        end = self.params["End"].value
        if end == "X":
            self.outcome("X")
        return end != "F"


# -- parameters --------------------------------------------------------------------------------------------------------


class Hear(SkillDescription):
    """Takes a text."""

    def createDescription(self) -> None:
        self.addParam("Text", str, OPTIONAL)
        self.addParam("Expected", str, REQUIRED)


class hear(PrimitiveBase):
    """Succeeds when the text is what is expected, else fails with -6."""

    def createDescription(self) -> None:
        self.setDescription(Hear(), "hear")

    def execute(self) -> State:
        text, expected = self.params["Text"].value, self.params["Expected"].value
        return self.success(text) if text == expected else self.fail(f"{text!r}, expected {expected!r}", 6)


class await_text(PrimitiveBase):
    """Runs until the text is what is expected."""

    def createDescription(self) -> None:
        self.setDescription(Hear(), "await_text")

    def execute(self) -> State:
        return self.success() if self.params["Text"].value == self.params["Expected"].value else self.step()


class HearDefault(SkillDescription):
    """As `Hear`, with a default."""

    def createDescription(self) -> None:
        self.addParam("Text", "mine", OPTIONAL)
        self.addParam("Expected", str, REQUIRED)


class hear_default(hear):
    """As `hear`."""

    def createDescription(self) -> None:
        self.setDescription(HearDefault(), "hear_default")


class Tell(SkillDescription):
    """Sets a text."""

    def createDescription(self) -> None:
        self.addParam("Text", str, OPTIONAL)
        self.addParam("Words", str, REQUIRED, "One word for each tick")


class tell(PrimitiveBase):
    """Sets the text to one word after the other, and succeeds with the last."""

    def createDescription(self) -> None:
        self.setDescription(Tell(), "tell")

    def onStart(self) -> bool:
        self._words = self.params["Words"].value.split()
        return True

    def execute(self) -> State:
        self.params["Text"].value = self._words.pop(0)
        return self.step() if self._words else self.success()


class Count(SkillDescription):
    """Counts its starts."""

    def createDescription(self) -> None:
        self.addParam("Number", int, OPTIONAL)


class count(PrimitiveBase):
    """One more at each start."""

    def createDescription(self) -> None:
        self.setDescription(Count(), "count")

    def execute(self) -> State:
        self.params["Number"].value = (self.params["Number"].value or 0) + 1
        return self.success()


class HearNumber(SkillDescription):
    """Takes a number."""

    def createDescription(self) -> None:
        self.addParam("Number", int, OPTIONAL)
        self.addParam("Expected", int, REQUIRED)


class hear_number(hear):
    """Succeeds when the number is what is expected, else fails with -6."""

    def createDescription(self) -> None:
        self.setDescription(HearNumber(), "hear_number")

    def execute(self) -> State:
        number, expected = self.params["Number"].value, self.params["Expected"].value
        return self.success() if number == expected else self.fail(f"{number}, expected {expected}", 6)


# -- elements ----------------------------------------------------------------------------------------------------------


class Check(SkillDescription):
    """A thing weighs more than a kilogram."""

    def createDescription(self) -> None:
        self.addParam("Thing", Element("skiros:Product"), REQUIRED)
        self.addPreCondition(self.getPropCond("Heavy", "skiros:Weight", "Thing", ">", 1.0, True))


class check(Scripted):
    """Succeeds at once."""

    def createDescription(self) -> None:
        self.setDescription(Check(), "check")


class Weigh(SkillDescription):
    """Gives a thing a weight."""

    def createDescription(self) -> None:
        self.addParam("Thing", Element("skiros:Product"), REQUIRED)
        self.addParam("Weight", float, REQUIRED)


class weigh(PrimitiveBase):
    """Changes the element that it has as a parameter."""

    def createDescription(self) -> None:
        self.setDescription(Weigh(), "weigh")

    def execute(self) -> State:
        thing = self.params["Thing"].value
        thing.setProperty("skiros:Weight", self.params["Weight"].value)
        self.params["Thing"].value = thing
        return self.success()


class Take(SkillDescription):
    """Takes a product out of what contains it."""

    def createDescription(self) -> None:
        self.addParam("Container", Element("skiros:LargeBox"), INFERRED)
        self.addParam("Object", Element("skiros:Product"), REQUIRED)
        self.addParam("Expected", "", OPTIONAL, "The labels of container and object")
        self.addPreCondition(self.getRelationCond("Contains", "skiros:contain", "Container", "Object", True))


class take(PrimitiveBase):
    """Fails with -6 when it was given, or has inferred, other elements than it expects."""

    def createDescription(self) -> None:
        self.setDescription(Take(), "take")

    def execute(self) -> State:
        found = ", ".join(self.params[key].value.label for key in ("Container", "Object"))
        return self.success() if found == self.params["Expected"].value else self.fail(found, 6)


class Remove(SkillDescription):
    """Takes a product out of the world."""

    def createDescription(self) -> None:
        self.addParam("Thing", Element("skiros:Product"), REQUIRED, [ParamOptions.Consume])


class remove(PrimitiveBase):
    """Does so."""

    def createDescription(self) -> None:
        self.setDescription(Remove(), "remove")

    def execute(self) -> State:
        self.wmi.remove_element(self.params["Thing"].value)
        return self.success()


class remove_not(Scripted):
    """Forgets to."""

    def createDescription(self) -> None:
        self.setDescription(Remove(), "remove_not")


class Forget(SkillDescription):
    """Unsets its parameter."""

    def createDescription(self) -> None:
        self.addParam("Thing", Element("skiros:Product"), REQUIRED, [ParamOptions.Unspecify])


class forget(PrimitiveBase):
    """Does so."""

    def createDescription(self) -> None:
        self.setDescription(Forget(), "forget")

    def execute(self) -> State:
        self.params["Thing"].unset()
        return self.success()


class forget_not(Scripted):
    """Forgets to."""

    def createDescription(self) -> None:
        self.setDescription(Forget(), "forget_not")


class UseArm(SkillDescription):
    """Needs an arm to itself."""

    def createDescription(self) -> None:
        self.addParam("Arm", Element("rparts:ArmDevice"), REQUIRED, [ParamOptions.Lock])
        self.addParam("Script", "S", REQUIRED)


class use_arm(Scripted):
    """As the script says."""

    def createDescription(self) -> None:
        self.setDescription(UseArm(), "use_arm")

    def onStart(self) -> bool:
        self.script, self.stop = self.params["Script"].value, "F"
        return super().onStart()


class Box(SkillDescription):
    """Needs a box, of all things."""

    def createDescription(self) -> None:
        self.addParam("Thing", Element("skiros:LargeBox"), REQUIRED, [ParamOptions.RespectType])


class box(Scripted):
    """Succeeds at once."""

    def createDescription(self) -> None:
        self.setDescription(Box(), "box")


# -- several implementations -------------------------------------------------------------------------------------------


class Lift(SkillDescription):
    """Lifts anything."""

    def createDescription(self) -> None:
        self.addParam("Thing", Element("sumo:Object"), REQUIRED)


class lift_box(Scripted):
    """Lifts boxes only: it narrows the type of its parameter."""

    script = "RS"

    def createDescription(self) -> None:
        self.setDescription(Lift(), "lift_box")

    def modifyDescription(self, skill: Any) -> None:
        skill.addParam("Thing", Element("skiros:LargeBox"), REQUIRED, [ParamOptions.RespectType])


class lift_heavy(Scripted):
    """Lifts what weighs more than a kilogram: it has a condition more."""

    def createDescription(self) -> None:
        self.setDescription(Lift(), "lift_heavy")
        self.addPreCondition(self.getPropCond("Heavy", "skiros:Weight", "Thing", ">", 1.0, True))


class lift_light(Scripted):
    """Lifts what weighs up to a kilogram."""

    def createDescription(self) -> None:
        self.setDescription(Lift(), "lift_light")
        self.addPreCondition(self.getPropCond("Light", "skiros:Weight", "Thing", "<=", 1.0, True))


class Job(SkillDescription):
    """Something that two can do."""


class job_one(Scripted):
    """The first."""

    script = "RS"

    def createDescription(self) -> None:
        self.setDescription(Job(), "job_one")


class job_two(Scripted):
    """The second."""

    script = "RS"

    def createDescription(self) -> None:
        self.setDescription(Job(), "job_two")


# -- threads -----------------------------------------------------------------------------------------------------------


class Think(SkillDescription):
    """Works in a thread."""

    def createDescription(self) -> None:
        self.addParam("Answer", "S", REQUIRED, "How run ends: S, F with -8, X raises, N no state")
        self.addParam("Before", "", OPTIONAL, "F: preStart says no")


class think(PrimitiveThreadBase):
    """Its thread ends while its third tick goes on, not before, so that the trace is always the same."""

    def createDescription(self) -> None:
        self.setDescription(Think(), "think")

    def preStart(self) -> bool:
        self._ticks = 0
        self._go_on = threading.Event()
        return bool(self.params["Before"].value != "F")

    def run(self) -> Any:
        self._go_on.wait()
        answer = self.params["Answer"].value
        if answer == "X":
            raise RuntimeError("as the script says")
        return {"S": lambda: self.success("thought"), "F": lambda: self.fail("no idea", 8), "N": lambda: None}[answer]()

    def execute(self) -> State:
        self._ticks += 1
        if self._ticks == 3:
            self._go_on.set()
            assert self._thread is not None
            self._thread.join()
        return super().execute()

    def onPreempt(self) -> State:
        self._go_on.set()
        return self.fail("stopped", 9)
