"""Small skills that tests run."""

from skiros2_common.core.abstract_skill import ParamOptions, State
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_skill.testing import describe, stand_in

REQUIRED, OPTIONAL, INFERRED = ParamTypes.Required, ParamTypes.Optional, ParamTypes.Inferred


def primitive(description, label="", **hooks):
    """A primitive class for a description, with these hooks. Each may be a function of the skill, or a return value."""
    return stand_in(description, label=label, **hooks)


def contains(container="Container", obj="Object", state=True):
    return lambda d: d.getRelationCond("Contains", "skiros:contain", container, obj, state)


CONTAINER = ("Container", Element("skiros:Container"), INFERRED)
OBJECT = ("Object", Element("skiros:Product"), REQUIRED)
LOCKED_ARM = ("Arm", Element("rparts:ArmDevice"), INFERRED, [ParamOptions.Lock])

Take = describe("Take", [CONTAINER, OBJECT], pre=[contains()])
Note = describe("Note", [("Text", str, REQUIRED)])
Speak = describe("Speak", [("Text", "hello", REQUIRED)])
Work = describe("Work")


def running_for(ticks):
    """An `execute` that runs for a number of ticks and then succeeds."""

    def execute(self):
        self.count = getattr(self, "count", 0) + 1
        return self.step(f"{self.count}") if self.count < ticks else self.success("done")

    return execute


STATES = {"S": State.Success, "F": State.Failure, "R": State.Running}
