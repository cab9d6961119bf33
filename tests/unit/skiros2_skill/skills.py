"""Small skills that tests run."""

from skiros2_common.core.abstract_skill import ParamOptions, SkillDescription, State
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element

REQUIRED, OPTIONAL, INFERRED = ParamTypes.Required, ParamTypes.Optional, ParamTypes.Inferred


def describe(name, params=(), pre=(), hold=(), post=()):
    """A description class with these parameters and conditions; each condition is a function of the description."""

    def create(self):
        for param in params:
            self.addParam(*param)
        for condition in pre:
            self.addPreCondition(condition(self))
        for condition in hold:
            self.addHoldCondition(condition(self))
        for condition in post:
            self.addPostCondition(condition(self))

    return type(name, (SkillDescription,), {"createDescription": create})


def primitive(description, label=None, **hooks):
    """A primitive class for a description, with these hooks. Each may be a function of the skill, or an answer."""

    def method(answer):
        return lambda self: answer(self) if callable(answer) else answer

    body = {name: method(answer) for name, answer in hooks.items()}
    body.setdefault("execute", lambda self: self.success("done"))
    body["createDescription"] = lambda self: self.setDescription(description(), label or "")
    return type(label or description.__name__.lower(), (PrimitiveBase,), body)


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
    """An `execute` that runs so many ticks and then succeeds."""

    def execute(self):
        self.count = getattr(self, "count", 0) + 1
        return self.step(f"{self.count}") if self.count < ticks else self.success("done")

    return execute


STATES = {"S": State.Success, "F": State.Failure, "R": State.Running}
