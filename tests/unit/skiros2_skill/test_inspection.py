"""A node of a running task looked at: the values of its parameters, and whether its conditions hold."""

import pytest

from skiros2_common.core.errors import UnknownName
from skiros2_common.core.explanation import HOLD, PRE
from skiros2_skill.core.diagnosis.inspection import FAILS, HOLDS, UNKNOWN, NodeStatus, inspect
from skiros2_skill.core.runtime.task import Task
from unit.skiros2_skill.skills import CONTAINER, OBJECT, contains, describe, primitive, running_for

Hold = describe("Hold", [CONTAINER, OBJECT], pre=[contains()], hold=[contains()])


@pytest.fixture
def task(bench):
    """A skill that holds an object in a box, after its first tick."""
    box = bench.add("skiros:Container", "box")
    thing = bench.add("skiros:Product", "thing", box)
    bench.load(primitive(Hold, "holder", execute=running_for(9)))
    made = Task(3, bench.wmi, "test")
    made.root(bench.node("holder", Container=box, Object=thing))
    made.tick()
    made.progress()
    return made


def test_conditions_are_checked_with_the_values_the_node_has(bench, task):
    now = inspect(task, task.root.children[0]._id, bench.wmi)
    assert {(p.key, p.value.partition("-")[2].partition("-")[2]) for p in now.params} >= {
        ("Container", "box"),
        ("Object", "thing"),
    }
    assert [(c.stage, c.verdict) for c in now.conditions] == [(PRE, HOLDS), (HOLD, HOLDS)]
    box, thing = bench.element("box"), bench.element("thing")
    assert [c.text for c in now.conditions] == [f"{box!r} skiros:contain {thing!r}"] * 2
    assert now.conditions[0].elements == sorted([repr(box), repr(thing)])


def test_one_that_does_not_hold_any_more_says_what_is_so_instead(bench, task):
    bench.wmi.remove_element(bench.element("thing"))
    now = inspect(task, task.root.children[0]._id, bench.wmi)
    assert {c.verdict for c in now.conditions} == {FAILS}
    assert "thing" in now.conditions[0].text + now.conditions[0].found


def test_a_condition_that_raises_is_unknown_and_says_why(bench, task, monkeypatch):
    (hold,) = task.root.children[0]._hold_conditions

    def raises(*_):
        raise RuntimeError("no camera")

    monkeypatch.setattr(type(hold), "holds", raises)
    found = inspect(task, task.root.children[0]._id, bench.wmi).conditions[1]
    assert found.verdict == UNKNOWN
    assert "no camera" in found.found


def test_looking_changes_nothing_in_the_task(bench, task):
    node = task.root.children[0]
    before = node._hold_conditions[0].getDescription()
    bench.wmi.remove_element(bench.element("thing"))
    inspect(task, node._id, bench.wmi)
    assert node._hold_conditions[0].getDescription() == before


def test_it_travels_as_json(bench, task):
    now = inspect(task, task.root.children[0]._id, bench.wmi)
    assert NodeStatus.from_json(now.to_json()) == now


def test_a_node_that_there_is_not_is_named(bench, task):
    with pytest.raises(UnknownName, match="task 3 has no node 99"):
        inspect(task, 99, bench.wmi)
    assert inspect(task, 3, bench.wmi).conditions == []
