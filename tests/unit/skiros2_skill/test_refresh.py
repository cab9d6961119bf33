"""What running skills read again, and what they need not."""

import random
from collections import Counter

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.conditions import ConditionProperty
from skiros2_common.core.world_element import Element
from skiros2_skill.core.runtime.task import Task
from skiros2_skill.core.skill import NoFail, ParallelFf, Sequential, Skill
from skiros2_world_model.core.local_world_model import LocalWorldModel
from unit.skiros2_skill.conftest import Workbench
from unit.skiros2_skill.skills import INFERRED, OPTIONAL, REQUIRED, contains, describe, primitive

ON = {"execute": lambda s: s.step("on")}
PARAMS = [
    ("Container", Element("skiros:Container"), REQUIRED),
    ("Object", Element("skiros:Product"), REQUIRED),
    ("Any", Element("skiros:Product"), OPTIONAL),
]


class Counting(LocalWorldModel):
    """Counts the reads of elements."""

    def __init__(self):
        super().__init__("test")
        self.calls = Counter()

    def find_element(self, eid, context_id="scene"):
        self.calls["element"] += 1
        return super().find_element(eid, context_id)

    def check_relation(self, *args):
        self.calls["relation"] += 1
        return super().check_relation(*args)


class Blind(LocalWorldModel):
    """Cannot tell what has changed."""

    def revisions(self):
        return None


class Heaviest(ConditionProperty):
    """A library's own condition, which looks beyond its element."""

    def holds(self, ph, wmi):
        weights = [e.value_of("skiros:Weight") or 0.0 for e in wmi.resolve_elements(Element("skiros:Product"))]
        return (wmi.get_element(ph.getParamValue("Object").id).value_of("skiros:Weight") or 0.0) >= max(weights)


def change(bench, element, **properties):
    fresh = bench.wmi.get_element(element.id)
    for key, value in properties.items():
        fresh.setProperty(f"skiros:{key}", value)
    bench.wmi.update_element(fresh)


@pytest.fixture
def counted():
    return Workbench(Counting())


def held(bench, *hold, **specify):
    """A task of one skill that runs while its conditions hold; it has been ticked twice."""
    Held = describe("Held", PARAMS, hold=hold)
    bench.load(primitive(Held, "held", **ON))
    task = bench.task(bench.node("held", **{"Container": bench.tray, "Object": bench.product, **specify}))
    assert task.tick() is task.tick() is State.Running
    return task


# -- what is not read again --------------------------------------------------------------------------------------------


def test_unchanged_world_causes_no_reads(counted):
    task = held(counted, contains())
    counted.wmi.calls.clear()
    task.tick()
    assert not counted.wmi.calls


def test_change_of_unrelated_element_causes_no_reads(counted):
    task = held(counted, contains())
    change(counted, counted.other_product, Weight=1.0)
    counted.wmi.calls.clear()
    assert task.tick() is State.Running
    assert not counted.wmi.calls


def test_changed_element_is_read_once(counted):
    task = held(counted, contains())
    change(counted, counted.product, Weight=1.0)
    counted.wmi.calls.clear()
    task.tick()
    assert counted.wmi.calls["relation"] == 1
    counted.wmi.calls.clear()
    task.tick()
    assert not counted.wmi.calls


def test_element_that_changes_before_first_execute_is_read_once(counted):
    Plain = describe("Plain", PARAMS[:2])
    counted.load(primitive(Plain, "plain"))
    tray, product = (counted.wmi.get_element(e.id) for e in (counted.tray, counted.product))
    task = counted.task(counted.node("plain", Container=tray, Object=product))
    change(counted, counted.product, Weight=1.0)
    counted.wmi.calls.clear()
    assert task.tick() is State.Success
    assert counted.wmi.calls["element"] == 1  # what was given is the same, but for the product


def test_change_of_unused_parameter_causes_no_reads(counted):
    Other = describe("Other", [("Other", 0, REQUIRED)])
    Held = describe("Held", PARAMS, hold=[contains()])

    def count(skill):
        skill.params["Other"].value += 1
        return skill.step("")

    counted.load(primitive(Other, "other", execute=count), primitive(Held, "held", **ON))
    held_node = counted.node("held", Container=counted.tray, Object=counted.product)
    task = counted.task(Skill("", ParallelFf())(counted.node("other"), held_node))
    assert task.tick() is task.tick() is State.Running
    counted.wmi.calls.clear()
    assert task.tick() is State.Running
    assert task.root.params.getParamValue("Other") == 3
    assert not counted.wmi.calls["relation"]


# -- what is -----------------------------------------------------------------------------------------------------------


def test_change_between_start_and_first_execute_is_read(bench):
    """Made by the skill itself, in `onStart`."""

    def weigh(skill):
        fresh = bench.wmi.get_element(bench.product.id)
        fresh.setProperty("skiros:Weight", 3.0)
        bench.wmi.update_element(fresh)
        return True

    seen = []
    Plain = describe("Plain", PARAMS[:2])
    bench.load(
        primitive(
            Plain,
            "plain",
            onStart=weigh,
            execute=lambda s: seen.append(s.params["Object"].value.value_of("skiros:Weight")) or s.success(""),
        )
    )
    bench.run(bench.node("plain", Container=bench.tray, Object=bench.product))
    assert seen == [3.0]


def test_change_in_leaf_reaches_next_leaf_in_same_tick(bench):
    def weigh(skill):
        bench.wmi.set_relation(bench.tray, "skiros:contain", bench.product, False)
        return skill.step("")

    Held = describe("Held", PARAMS, hold=[contains()])
    Work = describe("Work")
    bench.load(primitive(Work, "work", execute=weigh), primitive(Held, "held", **ON))
    held_node = bench.node("held", Container=bench.tray, Object=bench.product)
    task = bench.task(Skill("", ParallelFf())(bench.node("work"), held_node))
    assert task.tick() is State.Failure
    assert "Hold-condition failed" in held_node.progress_msg


def test_hold_condition_on_own_parameter_is_checked_after_assignment(bench):
    Own = describe("Own", [("Note", str, OPTIONAL)], hold=[lambda d: d.getIsSpecifiedCond("Unset", "Note", False)])

    def note(skill):
        if skill.progress_code:
            skill.params["Note"].value = "there"
        return skill.step("")

    bench.load(primitive(Own, "own", execute=note))
    task = bench.task(bench.node("own"))
    assert [task.tick() for _ in range(3)] == [State.Running, State.Running, State.Failure]


def test_later_subproperty_satisfies_a_running_hold_condition(bench):
    task = held(bench, lambda d: d.getRelationCond("Apart", "skiros:closeTogether", "Container", "Object", False))
    bench.wmi.model.modify([("skiros:contain", "rdfs:subPropertyOf", "skiros:closeTogether", True)], "test")
    assert task.tick() is State.Failure


def test_condition_on_other_elements_is_evaluated_again(bench):
    change(bench, bench.product, Weight=2.0)
    task = held(bench, lambda d: Heaviest("Heaviest", "skiros:Weight", "Object", "=", 0.0, True))
    change(bench, bench.other_product, Weight=3.0)
    assert task.tick() is State.Failure


def test_removed_element_fails_its_hold_condition(bench):
    task = held(bench, contains())
    bench.wmi.remove_element(bench.product)
    assert task.tick() is State.Failure


# -- a skill that goes on, with nothing to read ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("answer", "state", "code", "message"),
    [
        (lambda s: s.step("still"), State.Running, 4, "still"),
        (lambda s: s.success("done"), State.Success, 4, "done"),
        (lambda s: s.fail("no", 7), State.Failure, -7, "no"),
        (lambda s: True, State.Success, 3, "on"),
        (lambda s: None, State.Failure, -405, "returned None"),
        (lambda s: 1 / 0, State.Failure, -405, "ZeroDivisionError"),
    ],
)
def test_result_of_execute_after_some_ticks_is_used(bench, answer, state, code, message):
    turn = lambda s: s.step("on") if s.progress_code < 3 else answer(s)  # noqa: E731
    bench.load(primitive(describe("Turn"), "turn", execute=turn))
    node = bench.node("turn")
    task = bench.task(node)
    for _ in range(3):
        assert task.tick() is State.Running
    assert task.tick() is state
    assert (node.state, node.progress_code) == (state, code)
    assert message in node.progress_msg


def test_progress_of_primitive_is_published_after_each_tick(bench):
    seen = []
    bench.load(primitive(describe("Turn"), "turn", execute=lambda s: s.step(f"step {s.progress_code}")))
    node = bench.node("turn")
    task = bench.task(node)
    for _ in range(4):
        task.tick()
        assert task.update_revision()
        seen.append((node.progress_msg, task.progress()[1].progress_message))
    assert seen == [(f"step {n}", f"step {n}") for n in range(4)]


def test_primitive_without_progress_does_not_change_revision(bench):
    bench.load(primitive(describe("Turn"), "turn", execute=State.Running))
    task = bench.task(bench.node("turn"))
    task.tick()
    task.update_revision()
    task.tick()
    assert not task.update_revision()


def test_primitive_starts_again_after_preemption(bench):
    starts = []
    bench.load(primitive(describe("Turn"), "turn", onStart=lambda s: starts.append(s) or True, execute=State.Running))
    node = bench.node("turn")
    task = bench.task(node)
    for _ in range(3):
        task.tick()
    task._executor.preempt(node)
    assert node.state is State.Failure
    node.visit(task._executor)
    assert (len(starts), node.state) == (2, State.Running)


def test_ending_primitive_is_executed_once_per_tick(bench):
    counted = []
    Held = describe("Held", PARAMS, hold=[contains()])
    slow = {"execute": lambda s: counted.append(1) or s.step(""), "onPreempt": State.Running}
    bench.load(primitive(Held, "held", **slow))
    task = bench.task(Skill("", NoFail(Sequential()))(bench.node("held", Container=bench.tray, Object=bench.product)))
    task.tick(), task.tick()
    bench.wmi.set_relation(bench.tray, "skiros:contain", bench.product, False)
    task.tick()
    counted.clear()
    assert task.tick() is State.Running
    assert len(counted) == 1


CONDITIONS = {
    "relation": lambda d: d.getRelationCond("C", "skiros:contain", "Container", "Object", True),
    "no relation": lambda d: d.getRelationCond("C", "skiros:contain", "Container", "Object", False),
    "relation above": lambda d: d.getRelationCond("C", "skiros:spatiallyRelated", "Container", "Object", True),
    "unset side": lambda d: d.getRelationCond("C", "skiros:contain", "Container", "Any", True),
    "abstract relation": lambda d: d.getAbstractRelationCond("C", "skiros:contain", "Container", "Object", True),
    "property": lambda d: d.getPropCond("C", "skiros:Weight", "Object", "<", 2.0, True),
    "has property": lambda d: d.getHasPropCond("C", "skiros:Weight", "Object", True),
    "has no property": lambda d: d.getHasPropCond("C", "skiros:Weight", "Object", False),
    "specified": lambda d: d.getIsSpecifiedCond("C", "Object", True),
    "generate": lambda d: d.getGenerateCond("C", "Object", True),
    "type": lambda d: d.getOnTypeCond("C", "Object", "skiros:Product"),
    "or": lambda d: either(d, ("Container", "Object"), ("Container", "Any")),
    "library": lambda d: Heaviest("C", "skiros:Weight", "Object", "=", 0.0, True),
}


def either(description, *pairs):
    condition = description.getOrCond(True)
    for subject, object_ in pairs:
        condition.addCondition(description.getRelationCond("C", "skiros:contain", subject, object_, True))
    return condition


def random_change(choice, bench):
    product = choice.choice([bench.product, bench.other_product])
    what = choice.randrange(6)
    if bench.wmi.find_element(product.id) is None:
        return
    if what == 0:
        bench.wmi.set_relation(choice.choice([bench.tray, bench.other_tray]), "skiros:contain", product, True)
    elif what == 1:
        for relation in bench.wmi.get_relations("", "skiros:contain", product):
            bench.wmi.set_relation(relation["src"], "skiros:contain", product, False)
    elif what == 2:
        change(bench, product, Weight=choice.choice([1.0, 2.0, 3.0]))
    elif what == 3:
        fresh = bench.wmi.get_element(product.id)
        fresh.removeProperty("skiros:Weight")
        bench.wmi.update_element(fresh)
    elif what == 4 and choice.random() < 0.2:
        bench.wmi.remove_element(product)
    else:
        bench.add("skiros:Product", "another", choice.choice([bench.tray, bench.other_tray]))


@pytest.mark.parametrize("seed", range(40))
def test_selective_refresh_equals_full_refresh(bench, seed):
    """One task reads what has changed, another all of it after each change: their skills fail at the same ticks."""
    choice = random.Random(seed)
    labels = []
    for name, condition in CONDITIONS.items():
        label = f"while {name}"
        bench.load(primitive(describe(f"While{name.title().replace(' ', '')}", PARAMS, hold=[condition]), label, **ON))
        labels.append(label)

    def task(wmi):
        nodes = [bench.node(label, Container=bench.tray, Object=bench.product) for label in labels]
        made = Task(0, wmi)
        made.root.params.addParam("Robot", bench.robot, INFERRED)
        made.root(Skill("", ParallelFf())(*(Skill("", NoFail(Sequential()))(node) for node in nodes)))
        return made, nodes

    (seeing, some), (blind, others) = task(bench.wmi), task(Blind("test", bench.wmi.model))
    ended = 0
    for _ in range(12):
        assert seeing.tick() is blind.tick()
        states = [node.state for node in some]
        assert states == [node.state for node in others]
        ended = states.count(State.Failure)
        random_change(choice, bench)
    assert ended
