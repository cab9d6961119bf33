"""Nodes of trees as programs use them without a task: their places, names, parameters, effects, and ticks by hand."""

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import Refused, WrongValue
from skiros2_common.core.params import ParamHandler
from skiros2_skill.core.skill import ParallelFf, Root, Sequential, Skill, SkillBase, SkillInterface, SkillWrapper
from unit.skiros2_skill.skills import (
    CONTAINER,
    OBJECT,
    REQUIRED,
    Speak,
    Take,
    Work,
    contains,
    describe,
    primitive,
    running_for,
)


@pytest.fixture
def take(bench):
    """A node that has its implementation."""
    bench.load(primitive(Take, "take"))
    node = bench.node("take", Object=bench.product)
    bench.run(node)
    return node


# -- places ------------------------------------------------------------------------------------------------------------


def test_node_has_parent_and_children():
    leaf, other = Skill("leaf"), Skill("other")
    group = Skill("group")(leaf, other)
    root = Root("root")(group)
    assert (leaf.getParent(), leaf.parent, root.getParent()) == (group, group, None)
    assert root.hasChildren() and not leaf.hasChildren()
    assert group.last() is other
    assert [leaf.inSubtreeOf(node) for node in (leaf, group, root, other)] == [True, True, True, False]


def test_child_is_moved_to_another_node():
    child = Skill("child")
    one, two = Skill("one")(child), Skill("two")
    with pytest.raises(Refused, match="is a child of"):
        two.addChild(child)
    assert one.popChild() is child
    two.addChild(child)
    assert child.parent is two
    with pytest.raises(WrongValue, match="has no children"):
        one.popChild()


# -- copies ------------------------------------------------------------------------------------------------------------


def test_light_copy_of_a_node_has_its_skill_and_parameters(bench, take):
    take.remap("Object", "Thing")
    copy = take.getLightCopy()
    assert isinstance(copy, SkillWrapper)
    assert (copy.type, copy.label, copy.parent, copy.children) == (take.type, "take", None, [])
    assert copy.get_remap("Object") == "Thing"
    assert not copy.hasInstance()
    fresh = bench.node("take", Object=bench.product).getLightCopy()
    assert bench.run(fresh).state is State.Success


def test_light_copy_of_a_compound_is_loaded(bench):
    class both(SkillBase):
        def createDescription(self):
            self.setDescription(describe("Both", [OBJECT])(), "both")

    bench.load(both)
    copy = bench.library.by_label("both").declared.getLightCopy()
    assert (copy.type, copy.label, copy.state) == ("skiros:Both", "both", State.Idle)
    assert copy.wmi is bench.wmi


def test_light_copy_of_a_group_has_its_processor():
    copy = Skill("group", ParallelFf())(Skill("child")).getLightCopy()
    assert (copy.label, copy.processor.printType(), copy.children) == ("group", "|ff|", [])


# -- names of parameters -----------------------------------------------------------------------------------------------


def test_remap_of_a_remapped_key_is_chained():
    node = SkillInterface()
    node.remap("A", "B")
    node.remap("B", "C")
    assert node.get_remap("A") == "C"
    node.remap("X", "Y", record=False)
    assert node.get_remap("X") == "X"


def test_own_keys_are_independent_of_remaps(take):
    take.remap("Object", "Thing")
    assert list(take.getParamsNoRemaps()) == ["Container", "Object", "Robot"]


def test_specified_parameters_are_copied_and_may_be_kept(bench):
    bench.load(primitive(Speak, "speak", execute=lambda s: s.success(s.params["Text"].value)))
    given = ParamHandler()
    given.addParam("Text", "given", REQUIRED)
    node = bench.node("speak", Text="fixed")
    node.specifyParams(given)
    bench.run(node)
    assert node.progress_msg == "fixed"
    node = bench.node("speak", Text="fixed")
    node.specifyParamsDefault(given)
    bench.run(node)
    assert node.progress_msg == "given"


def test_parameters_are_reset_to_their_values_at_the_start(bench):
    def execute(self):
        self.params["Text"].value = "changed"
        return self.success()

    bench.load(primitive(Speak, "speak", execute=execute))
    node = bench.node("speak")
    bench.run(node)
    assert node.params["Text"].value == "changed"
    node.revertInput()
    assert node.params["Text"].value == "hello"


# -- descriptions ------------------------------------------------------------------------------------------------------


def test_node_copies_and_extends_a_description(bench, take):
    node = SkillInterface()
    node.resetDescription(take)
    assert list(node.params.keys()) == ["Container", "Object", "Robot"]
    assert node.hasPreCond()
    bench.load(primitive(describe("Hold", [CONTAINER, OBJECT, ("Force", 1.0, REQUIRED)], hold=[contains()]), "hold"))
    node.mergeDescription(bench.library.by_label("hold").declared)
    assert list(node.params.keys()) == ["Container", "Object", "Robot", "Force"]
    assert len(node.hold_conditions) == 1
    node.params.specify("Force", 2.0)
    assert bench.library.by_label("hold").declared.params["Force"].value == 1.0


def test_added_condition_modifies_the_description(bench):
    class work(primitive(Work, "base")):
        pass

    class top(SkillBase):
        def createDescription(self):
            self.setDescription(describe("Top", [CONTAINER, OBJECT])(), "top")
            for add in (self.addPreCondition, self.addHoldCondition, self.addPostCondition):
                add(contains()(self), modify_description=True)

    bench.load(top)
    described = bench.library.by_label("top").declared._description
    kinds = (described.pre_conditions, described.hold_conditions, described.post_conditions)
    assert [len(some) for some in kinds] == [1, 1, 1]


# -- effects -----------------------------------------------------------------------------------------------------------


def test_effects_are_simulated_and_undone(bench):
    gone = describe("Gone", [CONTAINER, OBJECT], hold=[contains()], post=[contains(state=False)])
    bench.load(primitive(gone, "gone", execute=lambda self: self.step()))
    node = bench.node("gone", Object=bench.product, Container=bench.tray)
    node.resetDescription(bench.library.by_label("gone").declared)
    node.params.specify("Object", bench.product)
    node.params.specify("Container", bench.tray)
    inside = lambda: bool(bench.wmi.get_relations(bench.tray.id, "skiros:contain", bench.product.id))  # noqa: E731
    assert node.simulate()
    assert not inside()
    assert node.hold()
    assert inside()
    node.revertHold()
    assert not inside()
    node.revertSimulation()
    assert inside()


# -- ticks by hand -----------------------------------------------------------------------------------------------------


def test_tree_is_ticked_without_a_task(bench):
    twice = lambda self: self.step() if self.progress_code == 0 else self.success()  # noqa: E731
    bench.load(primitive(Work, "work", execute=twice))
    tree = Skill("", Sequential(), bench.wmi)(bench.node("work"), bench.node("work"))
    assert tree.start()
    states = [tree.tick() for _ in range(3)]
    assert states == [State.Running, State.Running, State.Success]
    assert [child.getInstance() for child in tree.children] == [None, None]  # given back
    assert bench.library.by_label("work")._free


def test_node_that_is_reset_while_it_runs_starts_again(bench):
    starts = []
    bench.load(primitive(Work, "work", execute=running_for(3), onStart=lambda self: starts.append(self)))
    node = bench.node("work")
    task = bench.task(node)
    task.tick()
    node.reset()
    assert (node.state, node.progress_code) == (State.Idle, 0)
    task.run()
    assert (node.state, len(starts)) == (State.Success, 2)
    assert not bench.library.by_label("work").busy


def test_selected_implementation_is_available_while_the_node_runs(bench):
    resets = []
    bench.load(primitive(Work, "work", execute=lambda self: self.step(), onReset=lambda self: resets.append(1)))
    node = bench.node("work")
    task = bench.task(node)
    assert not node.hasInstance()
    task.tick()
    assert node.hasInstance()
    assert node.getInstance().label == node.label == "work"
    node.onReset()
    assert resets == [1]
