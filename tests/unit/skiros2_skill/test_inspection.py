"""A node of a running task looked at: the values of its parameters, and whether its conditions hold."""

import pytest

from skiros2_common.core.errors import UnknownName
from skiros2_common.core.explanation import HOLD, PRE
from skiros2_runs.core.values import FAILS, HOLDS, UNKNOWN, NodeStatus
from skiros2_skill.core.runtime.diagnosis import inspect
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


def test_inspection_evaluates_conditions_with_current_values(bench, task):
    now = inspect(task, task.root.children[0]._id, bench.wmi)
    assert {(p.key, p.value.partition("-")[2].partition("-")[2]) for p in now.params} >= {
        ("Container", "box"),
        ("Object", "thing"),
    }
    assert [(c.stage, c.verdict) for c in now.conditions] == [(PRE, HOLDS), (HOLD, HOLDS)]
    box, thing = bench.element("box"), bench.element("thing")
    assert [c.text for c in now.conditions] == [f"{box!r} skiros:contain {thing!r}"] * 2
    assert now.conditions[0].elements == sorted([repr(box), repr(thing)])


def test_condition_that_became_false_after_the_start_held_before_it(bench, task):
    thing = bench.element("thing")
    thing.removeRelation({"src": bench.element("box").id, "type": "skiros:contain", "dst": "-1"})
    bench.wmi.update_element(thing)
    node = task.root.children[0]._id
    evaluated_before = {c.stage: c.verdict for c in inspect(task, node, bench.wmi).conditions}
    assert evaluated_before == {PRE: HOLDS, HOLD: HOLDS}  # as evaluated at the last tick
    task.tick()
    pre, hold = inspect(task, node, bench.wmi).conditions
    assert (pre.verdict, hold.verdict) == (HOLDS, FAILS)
    assert 0.0 < pre.time < hold.time
    assert "thing" in hold.text + hold.found


def test_condition_before_its_evaluation_is_a_preview(bench):
    bench.load(primitive(Hold, "holder"))
    made = Task(3, bench.wmi, "test")
    made.root(bench.node("holder"))
    made.progress()
    assert made.root.children[0].pre_conditions  # an author has read the description
    assert {c.time for c in inspect(made, made.root.children[0]._id, bench.wmi).conditions} == {0.0}


def test_values_of_a_finished_node_stay_known(bench, task):
    task.preempt()
    while not task.ended.is_set():
        task.tick()
    status = inspect(task, task.root.children[0]._id, bench.wmi)
    assert repr(bench.element("thing")) in {p.value for p in status.params}
    assert [c.verdict for c in status.conditions] == [HOLDS, HOLDS]


def test_inspection_reports_a_condition_that_raises(bench, monkeypatch):
    bench.load(primitive(Hold, "holder"))
    made = Task(3, bench.wmi, "test")
    made.root(bench.node("holder"))
    made.progress()
    hold = made.root.children[0].hold_conditions[0]

    def raises(*_):
        raise RuntimeError("no camera")

    monkeypatch.setattr(type(hold), "holds", raises)
    found = inspect(made, made.root.children[0]._id, bench.wmi).conditions[1]
    assert found.verdict == UNKNOWN
    assert "no camera" in found.found


def test_inspection_does_not_change_the_task(bench, task):
    node = task.root.children[0]
    before = node._hold_conditions[0].getDescription()
    bench.wmi.remove_element(bench.element("thing"))
    inspect(task, node._id, bench.wmi)
    assert node._hold_conditions[0].getDescription() == before


def test_inspection_is_encoded_as_json(bench, task):
    now = inspect(task, task.root.children[0]._id, bench.wmi)
    assert NodeStatus.from_json(now.to_json()) == now


def test_inspection_of_an_unknown_node_is_refused(bench, task):
    with pytest.raises(UnknownName, match="task 3 has no node 99"):
        inspect(task, 99, bench.wmi)
    assert inspect(task, 3, bench.wmi).conditions == []
