"""Nodes inside `expand`, as compounds of libraries for SkiROS2 use them. Compatibility, section 15."""

import logging

import pytest

from compatibility.rules import rule
from compatibility.test_blackboard import OPTIONAL, REQUIRED, compound, message, primitive, tells
from skiros2_common.core.params import ParamHandler
from skiros2_common.core.world_element import Element
from skiros2_skill.core.skill import ParallelFf

PARAMS = (("N", 1, REQUIRED), ("Text", str, OPTIONAL), ("Object", Element("skiros:Product"), OPTIONAL))


@pytest.fixture
def expanded(skill_bench):
    """Runs a compound whose `expand` is a function of itself and its node."""

    def run(expand, **blackboard):
        has = lambda d: d.getIsSpecifiedCond("HasObject", "Object", False)  # noqa: E731
        skill_bench.load(
            primitive("Tell", *PARAMS, pre=[has], execute=tells("N")),
            primitive("Read", ("Text", str, OPTIONAL), execute=tells("Text")),
            compound("Tree", expand),
        )
        return skill_bench.run(skill_bench.node("Tree"), **blackboard)

    return run


@rule("nodes", "`self.skill(...)` has the description's parameters, conditions and type, under the remapped keys")
def test_a_node_has_the_description_of_its_skill(expanded):
    seen = {}

    def expand(self, skill):
        node = self.skill("Tell", "", remap={"Object": "Thing"}, specify={"N": 7})
        seen["type"], seen["keys"] = node.type, list(node.params.keys())
        seen["values"] = node.params["N"].value, node.params["N"].default, node.params["Text"].value
        seen["conditions"] = [list(c.getKeys()) for c in node.pre_conditions]
        skill(node)

    task = expanded(expand)
    assert seen["type"] == "skiros:Tell"
    assert seen["keys"] == ["N", "Text", "Thing", "Robot"]
    assert seen["values"] == (7, 7, None)
    assert seen["conditions"] == [["Thing"]]
    assert message(task, "Tell") == "[7]"


@rule("nodes", "`node.specifyParamDefault(key, value)` fixes a parameter")
def test_specify_param_default_fixes(expanded):
    def expand(self, skill):
        node = self.skill("Tell", "")
        node.specifyParamDefault("N", 5)
        assert node.params["N"].value == 5
        skill(node)

    assert message(expanded(expand), "Tell") == "[5]"


@rule("nodes", "`node.specifyParam(key, value)` is lost when the node starts")
def test_specify_param_is_lost_at_the_start(expanded):
    def expand(self, skill):
        node = self.skill("Tell", "")
        node.specifyParam("N", 6)
        assert node.params["N"].value == 6
        skill(node)

    assert message(expanded(expand), "Tell") == "[1]"


@rule("nodes", "`specify` of an unknown key is logged and ignored", better="the error names the nearest key")
def test_specify_of_an_unknown_key(expanded, caplog):
    with caplog.at_level(logging.ERROR):
        task = expanded(lambda self, skill: skill(self.skill("Tell", "", specify={"Txt": "x"})))
    assert message(task, "Tell") == "[1]"
    assert "no parameter 'Txt'; near: Text" in caplog.text


@rule("nodes", "`node.addPreCondition(condition)` holds for this node, over its remapped keys")
def test_a_condition_of_a_node(expanded):
    def expand(self, skill):
        node = self.skill("Read", "", remap={"Text": "Words"})
        node.addPreCondition(self.getIsSpecifiedCond("NeedsWords", "Words", True))
        skill(node)

    task = expanded(expand)
    assert "[NeedsWords]" in task.why


@rule("nodes", "`node.getParamsNoRemaps()` is a `ParamHandler` with the original keys")
def test_parameters_without_remaps(expanded):
    seen = []

    def expand(self, skill):
        node = self.skill("Read", "", remap={"Text": "Words"}, specify={"Words": "hello"})
        seen.append(node.getParamsNoRemaps())
        skill(node)

    expanded(expand)
    assert isinstance(seen[0], ParamHandler)
    assert seen[0].getParamValue("Text") == "hello"


@rule("nodes", "A second `remap` of a remapped key is ignored with a warning")
def test_a_second_remap_is_ignored(expanded, caplog):
    def expand(self, skill):
        node = self.skill("Read", "", remap={"Text": "First"})
        node.remap("Text", "Second")
        skill(node)

    with caplog.at_level(logging.WARNING):
        task = expanded(expand, First="one", Second="two")
    assert message(task, "Read") == "['one']"
    assert "'Text' is remapped to 'First' already" in caplog.text


@rule("nodes", "`self.skill(Processor(), remap={...})` remaps for all children that are added to it")
def test_a_processor_remaps_for_its_children(expanded):
    def expand(self, skill):
        skill(self.skill(ParallelFf(), remap={"Text": "Words"})(self.skill("Read"), self.skill("Tell")))

    assert message(expanded(expand, Words="hello"), "Read") == "['hello']"


@rule("nodes", "`self.skill(Processor(), specify={...})` is logged and ignored")
def test_a_processor_has_nothing_to_specify(expanded, caplog):
    with caplog.at_level(logging.ERROR):
        task = expanded(lambda self, skill: skill(self.skill(ParallelFf(), specify={"Text": "x"})(self.skill("Read"))))
    assert message(task, "Read") == "[]"
    assert "a processor has no parameters" in caplog.text


@rule("nodes", "`setProcessor` returns None")
def test_set_processor_returns_none(expanded):
    seen = []

    def expand(self, skill):
        seen.extend([skill.setProcessor(ParallelFf()), self.setProcessor(ParallelFf())])
        skill(self.skill("Read"))

    expanded(expand)
    assert seen == [None, None]
