"""Descriptions and skills as libraries and programs use them. Compatibility, section 14."""

import pytest

from compatibility.rules import rule
from skiros2_common.core.abstract_skill import ParamOptions, SkillDescription, State
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element


class Pick(SkillDescription):
    def createDescription(self):
        self.addParam("Object", Element("skiros:Product"), ParamTypes.Required, [ParamOptions.RespectType])
        self.addParam("Gripper", Element("rparts:GripperEffector"), ParamTypes.Inferred, [ParamOptions.Lock])
        self.addParam("Box", Element("skiros:Container"), ParamTypes.Optional, [ParamOptions.Consume])
        self.addParam("Place", Element("skiros:Location"), ParamTypes.Optional, [ParamOptions.Unspecify])
        self.addParam("Speed", 0.5, ParamTypes.Optional)
        self.addParam("Tries", int, ParamTypes.Required)
        self.addPreCondition(self.getRelationCond("InBox", "skiros:contain", "Box", "Object", True))
        self.addPostCondition(self.getPropCond("Held", "skiros:Held", "Object", "=", True, True))


class pick(PrimitiveBase):
    def createDescription(self):
        self.setDescription(Pick(), "pick")

    def onStart(self):
        """Returns nothing."""

    def execute(self):
        return self.success("done")

    def onEnd(self):
        """Returns nothing."""


@pytest.fixture
def skill():
    made = pick()
    made.init(None)
    return made


def labels(conditions):
    return [c._label for c in conditions]


@rule("description", "`Pick()` has its parameters, `Robot` and its conditions at once")
def test_a_description_is_complete():
    description = Pick()
    assert list(description.params.keys()) == ["Object", "Gripper", "Box", "Place", "Speed", "Tries", "Robot"]
    assert description.type == "skiros:Pick"
    assert labels(description.getDescription()[2]) == ["InBox", "ObjectOfType", "GripperIdle"]


@rule("description", "`getDescription()` is (type, params, pre, hold, post), and `setDescription(*that)` works")
def test_get_and_set_description():
    kind, params, pre, hold, post = Pick().getDescription()
    other = SkillDescription()
    other.setDescription(kind, params, pre, hold, post)
    assert (other.type, list(other.params.keys())) == ("skiros:Pick", list(params.keys()))
    assert [labels(some) for some in other.getDescription()[2:]] == [labels(some) for some in (pre, hold, post)]


@rule("description", "Options make conditions `ConsumeX`, `UnsetX`, `XIdle`, `XBusy`, `XIdle`, `XOfType`")
def test_labels_of_options():
    _, _, pre, hold, post = Pick().getDescription()
    assert {"ObjectOfType", "GripperIdle"} < set(labels(pre))
    assert labels(hold) == ["GripperBusy"]
    assert {"GripperIdle", "ConsumeBox", "UnsetPlace"} < set(labels(post))


@rule("description", "Each Optional element parameter `X` has a post-condition `HasX`, exported and never checked")
def test_generated_conditions(skill):
    assert {"HasBox", "HasPlace"} < set(labels(skill.getDescription()[4]))
    exported = [r["dst"].label for r in skill.toElement()._local_relations if r["type"] == "skiros:hasPostCondition"]
    assert {"HasBox", "HasPlace", "Held"} < set(exported)
    skill.checkPostCond()
    assert "Held" in skill.progress_msg and "Has" not in skill.progress_msg


@rule("description", "`checkPreCond`, `checkHoldCond`, `checkPostCond` return the keys that break; progress -1 or -2")
def test_checks_return_keys(skill):
    assert skill.checkPostCond() == ["Object", "Gripper"]
    assert skill.progress_code == -2
    skill.specifyParam("Gripper", Element("rparts:GripperEffector", "g", "rparts:GripperEffector-1"))
    skill.params["Gripper"].value.setProperty("skiros:StateProperty", "Idle")
    assert skill.checkHoldCond() == ["Gripper"]
    assert skill.progress_code == -2
    skill.params["Gripper"].value.setProperty("skiros:StateProperty", "Busy")
    assert skill.checkHoldCond() == []
    skill.pre_conditions[:] = [c for c in skill.pre_conditions if c._label == "GripperIdle"]
    assert skill.checkPreCond() == ["Gripper"]
    assert skill.progress_code == -1


@rule("description", "`start()`, `preempt()` and `reset()` return the State")
def test_states(skill):
    assert skill.start() is State.Running
    assert skill.preempt() is skill.state
    assert skill.reset() is State.Idle


@rule("description", "`getOutputParams()` gives all Optional parameters; `getModifiedParams()` a set")
def test_parameters():
    description = Pick()
    assert sorted(description.getOutputParams()) == ["Box", "Place", "Speed"]
    assert description.getModifiedParams() >= {"Object", "Box", "Place"}
    assert isinstance(description.getModifiedParams(), set)


@rule("description", "`toElement()` has only element parameters as `skiros:hasParam`; conditions are children")
def test_to_element():
    children = [(r["type"], r["dst"].label) for r in Pick().toElement()._local_relations]
    assert [label for kind, label in children if kind == "skiros:hasParam"] == [
        "Object", "Gripper", "Box", "Place", "Robot",
    ]  # fmt: skip
    assert {("skiros:hasPreCondition", "InBox"), ("skiros:hasHoldCondition", "GripperBusy")} < set(children)


@rule("description", "`onStart` and `onEnd` that return None are a success")
def test_hooks_that_return_nothing(skill_bench):
    class Free(SkillDescription):
        def createDescription(self):
            """Robot alone."""

    class free(pick):
        def createDescription(self):
            self.setDescription(Free(), "free")

    skill_bench.load(free)
    assert skill_bench.run(skill_bench.node("free")).state is State.Success


@rule("description", "`printState()` is `Type-label(State.X)`")
def test_print_state(skill):
    assert skill.printState() == "skiros:Pick-pick(State.Idle)"


@rule("description", "`_setState(bool)` is logged and taken as success or failure")
@pytest.mark.parametrize(("given", "state"), [(True, State.Success), (False, State.Failure)])
def test_set_state_to_a_bool(skill, caplog, given, state):
    skill._setState(given)
    assert skill.state is state
    assert "expected a State" in caplog.text
