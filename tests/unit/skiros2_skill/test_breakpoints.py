"""Breakpoints: a task pauses without preempting a node, reports the node, and resumes there."""

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import UnknownName, WrongValue
from skiros2_skill.core.breakpoint import Breakpoint
from skiros2_skill.core.engine.breakpoints import Breakpoints
from skiros2_skill.core.runtime.scheduler import Scheduler
from skiros2_skill.core.runtime.task import Task
from skiros2_skill.core.skill import ParallelFf, SelectorStar, Serial, Skill
from unit.skiros2_skill.skills import CONTAINER, OBJECT, Work, contains, describe, primitive, running_for

Hold = describe("Hold", [CONTAINER, OBJECT], pre=[contains()], hold=[contains()])


@pytest.fixture
def breakpoints():
    return Breakpoints()


@pytest.fixture
def task(bench, breakpoints):
    def make(*nodes):
        made = Task(0, bench.wmi, "test", breakpoints)
        made.root(*nodes)
        return made

    return make


def recorder(calls, name, ticks=1):
    run = running_for(ticks)
    return primitive(Work, name, execute=lambda self: calls.append(name) or run(self))


def resumed(task):
    task.resume()
    return task.tick()


def test_start_breakpoint_pauses_before_node_starts(bench, breakpoints, task):
    calls = []
    bench.load(recorder(calls, "first"), recorder(calls, "second"))
    number = breakpoints.add(Breakpoint("node", "second"))
    one = task(bench.node("first"), bench.node("second"))
    assert one.tick() is State.Running
    assert one.paused
    assert one.root.progress_msg == f"paused at breakpoint {number}: before the start of skiros:Work-second"
    assert one.root.progress_code == 0
    assert calls == ["first"]
    assert one.root.children[1].state is State.Idle
    assert resumed(one) is State.Success
    assert calls == ["first", "second"]


@pytest.mark.parametrize("pattern", ["second", "SECOND", "sec*", "skiros:Work-second", "work-second", "*-second"])
def test_node_breakpoint_matches_label_type_and_pattern(bench, breakpoints, task, pattern):
    bench.load(primitive(Work, "first"), primitive(Work, "second"))
    breakpoints.add(Breakpoint("node", pattern))
    one = task(bench.node("first"), bench.node("second"))
    one.tick()
    assert "before the start of skiros:Work-second" in one.root.progress_msg


def test_type_breakpoint_pauses_at_every_node_of_type(bench, breakpoints, task):
    bench.load(primitive(Work, "first"), primitive(Work, "second"))
    breakpoints.add(Breakpoint("node", "skiros:Work"))
    one = task(bench.node("first"), bench.node("second"))
    one.tick()
    assert "skiros:Work-first" in one.root.progress_msg
    resumed(one)
    assert "skiros:Work-second" in one.root.progress_msg
    assert resumed(one) is State.Success


def test_end_breakpoint_pauses_before_next_node_starts(bench, breakpoints, task):
    calls = []
    bench.load(recorder(calls, "first", 2), recorder(calls, "second"))
    breakpoints.add(Breakpoint("node", "first", "end"))
    one = task(bench.node("first"), bench.node("second"))
    one.tick()
    assert not one.paused
    one.tick()
    assert one.paused
    assert "at the end of skiros:Work-first" in one.root.progress_msg
    assert one.root.children[0].state is State.Success
    assert resumed(one) is State.Success
    assert calls == ["first", "first", "second"]


def test_breakpoint_preempts_nothing(bench, breakpoints, task):
    calls = []
    bench.load(
        recorder(calls, "check"),
        primitive(Work, "moves", execute=running_for(4), onPreempt=lambda self: calls.append("preempted")),
    )
    one = task(Skill("reactive", Serial())(bench.node("check"), bench.node("moves")))
    one.tick()
    number = breakpoints.add(Breakpoint("node", "check"))
    one.tick()
    assert one.paused
    assert one.root.children[0].children[1].state is State.Running
    breakpoints.remove(number)
    while one.root.state is State.Running:
        resumed(one)
    assert one.root.state is State.Success
    assert "preempted" not in calls


def test_condition_breakpoint_pauses_at_failed_pre_condition(bench, breakpoints, task):
    calls = []
    bench.load(primitive(Hold, "hold"), recorder(calls, "instead"))
    breakpoints.add(Breakpoint("condition", "Contains"))
    held = bench.node("hold", Object=bench.product, Container=bench.other_tray)
    one = task(Skill("either", SelectorStar())(held, bench.node("instead")))
    one.tick()
    assert one.paused
    assert "condition [Contains] fails" in one.root.progress_msg
    assert calls == []
    assert resumed(one) is State.Success
    assert calls == ["instead"]


def test_condition_breakpoint_pauses_at_failed_hold_condition(bench, breakpoints, task):
    bench.load(primitive(Hold, "hold", execute=lambda self: self.step("")), primitive(Work, "instead"))
    breakpoints.add(Breakpoint("condition", "cont*"))
    held = bench.node("hold", Object=bench.product)
    one = task(Skill("either", SelectorStar())(held, bench.node("instead")))
    one.tick()
    assert not one.paused
    bench.wmi.set_relation(bench.tray.id, "skiros:contain", bench.product.id, False)
    one.tick()
    assert one.paused
    assert held.state is State.Failure
    assert resumed(one) is State.Success


def test_task_at_breakpoint_can_be_preempted(bench, breakpoints, task):
    bench.load(primitive(Work, "first"))
    breakpoints.add(Breakpoint("node", "first"))
    one = task(bench.node("first"))
    one.tick()
    one.preempt()
    assert one.tick() is State.Failure
    assert one.root.progress_msg == "Preempted"


def test_sibling_subtree_resumes_in_same_state(bench, breakpoints, task):
    calls = []
    bench.load(recorder(calls, "left", 3), recorder(calls, "right"))
    breakpoints.add(Breakpoint("node", "right"))
    one = task(Skill("both", ParallelFf())(bench.node("left"), bench.node("right")))
    one.tick()
    assert one.paused
    while one.root.state is State.Running:
        resumed(one)
    assert calls == ["left", "left", "right", "left"]
    assert one.root.state is State.Success


# -- the world ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("pattern", ["prod*", "{id}", "skiros:contain", "*:Product-*"])
def test_world_breakpoint_pauses_all_running_tasks(bench, pattern):
    scheduler = Scheduler(rate=200)
    bench.wmi.add_listener(scheduler.on_change)
    try:
        bench.load(primitive(Work, "endless", execute=lambda self: self.step("")))
        task = scheduler.new_task(bench.wmi, "test")
        task.root(bench.node("endless"))
        scheduler.start(task.id)
        number = scheduler.breakpoints.add(Breakpoint("world", pattern.format(id=bench.product.id)))
        product = bench.wmi.get_element(bench.product.id)
        product.setProperty("skiros:Value", 1)
        if pattern != "skiros:contain":
            bench.wmi.update_element(product)
        else:
            bench.wmi.set_relation(bench.tray.id, "skiros:contain", product.id, False)
        assert task.paused
        assert task.root.progress_msg.startswith(f"paused at breakpoint {number}: ")
        scheduler.breakpoints.remove(number)
        scheduler.start(task.id)
        assert not task.paused
    finally:
        scheduler.stop()


# -- the list ----------------------------------------------------------------------------------------------------------


def test_breakpoint_numbers_are_not_reused(breakpoints):
    first = breakpoints.add(Breakpoint("node", "a"))
    breakpoints.remove(first)
    second = breakpoints.add(Breakpoint("node", "b"))
    assert second != first
    assert breakpoints.all() == {second: Breakpoint("node", "b", "start")}


@pytest.mark.parametrize(
    ("breakpoint", "text"),
    [
        (Breakpoint("nodes", "a"), "kind 'nodes', expected one of: node, condition, world"),
        (Breakpoint("node", "a", "fails"), "at 'fails', expected one of: start, end"),
        (Breakpoint("condition", ""), "without a name"),
    ],
)
def test_invalid_breakpoint_is_refused(breakpoints, breakpoint, text):
    with pytest.raises(WrongValue, match=text):
        breakpoints.add(breakpoint)
    assert not breakpoints


def test_removing_unknown_breakpoint_lists_existing_ones(breakpoints):
    breakpoints.add(Breakpoint("node", "a"))
    with pytest.raises(UnknownName, match="no breakpoint 7; there are: 1"):
        breakpoints.remove(7)
