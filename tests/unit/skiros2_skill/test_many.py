"""Many tasks, many nodes, deep and wide trees: all of them end, and nothing of them stays."""

import gc
import sys
import threading
import time
from collections import Counter

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_skill.core.runtime.scheduler import Scheduler
from skiros2_skill.core.runtime.task import Task
from skiros2_skill.core.skill import ParallelFf, Skill, SkillBase
from unit.skiros2_skill.skills import INFERRED, OBJECT, OPTIONAL, Take, Work, describe, primitive, running_for

Say = describe("Say", [("Text", "words", OPTIONAL), OBJECT])


@pytest.fixture
def scheduler():
    scheduler = Scheduler(rate=100.0)
    yield scheduler
    scheduler.stop()


def start(scheduler, bench, *nodes):
    task = scheduler.new_task(bench.wmi, "tests")
    task.root(*nodes)
    scheduler.start(task.id)
    return task


def run(scheduler, bench, *nodes):
    task = start(scheduler, bench, *nodes)
    assert task.ended.wait(60)
    return task


def test_five_hundred_tasks_run_in_parallel(scheduler, bench):
    go_on = threading.Event()
    execute = lambda self: self.success("done") if go_on.is_set() else self.step("runs")  # noqa: E731
    bench.load(primitive(Work, "work", execute=execute))
    tasks = [start(scheduler, bench, bench.node("work")) for _ in range(500)]
    assert len({task.id for task in tasks}) == 500
    assert len(scheduler.tasks()) == 500
    go_on.set()
    for task in tasks:
        assert task.ended.wait(30)
        assert task.state is State.Success
    assert not bench.library.by_label("work").busy


def test_thousand_levels_of_compounds_run_and_are_preempted(scheduler, bench):
    """Each level is a skill of its own with parameters and a remap."""

    class nest(SkillBase):
        def createDescription(self):
            self.setDescription(describe("Nest", [("Depth", int, OPTIONAL)])(), "nest")
            self._expand_on_start = True

        def expand(self, skill):
            depth = self.params["Depth"].value
            if depth:
                skill(self.skill("Nest", "nest", specify={"Depth": depth - 1}))
            else:
                skill(self.skill("Work", "work"), self.skill("Long", "long"))

    bench.load(nest, primitive(Work, "work"), primitive(describe("Long"), "long", execute=lambda s: s.step("at work")))
    task = start(scheduler, bench, bench.node("nest", Depth=1000))
    long = lambda: [n for n in task.nodes() if n.label == "long" and n.progress_code > 2]  # noqa: E731
    while not long():
        assert not task.ended.wait(0.01), task.root.progress_msg
    scheduler.preempt(task.id)
    assert task.ended.wait(30)
    assert Counter(node.state for node in task.nodes()) == {State.Failure: 1003, State.Success: 1}
    assert len(task.progress()) == 1004


@pytest.mark.long
def test_ten_thousand_parallel_nodes_are_preempted(scheduler, bench):
    bench.load(primitive(Work, "work", execute=lambda self: self.step()))
    group = Skill("", ParallelFf())(*(bench.node("work") for _ in range(10_000)))
    task = start(scheduler, bench, group)
    while group.children[-1].state is not State.Running:
        assert not task.ended.wait(0.01), task.root.progress_msg
    scheduler.preempt(task.id)
    assert task.ended.wait(60)
    assert {child.state for child in group.children} == {State.Failure}
    assert not bench.library.by_label("work").busy


def test_skill_that_ends_in_the_tick_of_its_start_takes_few_calls(bench):
    """With three elements and a pre-condition. Counted, not timed: the load of the machine does not matter."""
    bench.load(primitive(Take, "take"))

    def calls(number):
        task = Task(0, bench.wmi)
        task.root.params.addParam("Robot", bench.robot, INFERRED)
        task.root(*(bench.node("take", Container=bench.tray, Object=bench.product) for _ in range(number)))
        events = []
        sys.setprofile(lambda frame, event, argument: events.append(event))
        try:
            state = task.tick()
        finally:
            sys.setprofile(None)
        assert state is State.Success
        return events.count("call")

    calls(1)
    assert (calls(20) - calls(10)) / 10 <= 230


def test_nodes_of_ended_tasks_are_freed(scheduler, bench):
    """Of those that ended well, failed, and were preempted. tests/system/test_bad_commands.py does it with 100 000."""
    bench.load(
        primitive(Say, "say", execute=running_for(1)),
        primitive(Say, "fails", execute=lambda self: self.fail("no", 1)),
        primitive(describe("Long"), "long", execute=lambda self: self.step()),
    )
    group = lambda *labels: Skill("", ParallelFf())(*(bench.node(label) for label in labels))  # noqa: E731

    def a_hundred_nodes():
        run(scheduler, bench, group(*["say"] * 80))
        run(scheduler, bench, group(*["say"] * 8, "fails"))
        task = start(scheduler, bench, group(*["say"] * 8, "long"))
        scheduler.preempt(task.id)
        assert task.ended.wait(30)

    for _ in range(10):
        a_hundred_nodes()
    before, threads = alive(), threading.active_count()
    for _ in range(40):
        a_hundred_nodes()
    assert threading.active_count() <= threads  # those of other tests may end meanwhile
    deadline = time.monotonic() + 10.0  # the ticking thread may still be telling of the last task
    while sum((more := alive() - before).values()) >= 100 and time.monotonic() < deadline:
        time.sleep(0.05)
    assert sum(more.values()) < 100, more.most_common(5)


def alive():
    """How many objects there are, by class; without what pytest keeps of the log."""
    gc.collect()
    return Counter(type(o).__name__ for o in gc.get_objects() if type(o).__name__ != "LogRecord")
