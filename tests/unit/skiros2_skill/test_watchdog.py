"""Hooks that take long or do not return: the other tasks go on, and a preempted task ends."""

import threading
import time

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.explanation import PREEMPT
from skiros2_skill.core.engine.hook_guard import HookGuard
from skiros2_skill.core.runtime.scheduler import Scheduler
from skiros2_skill.core.skill import ParallelFf, Skill
from unit.skiros2_skill.skills import LOCKED_ARM, Work, describe, primitive, running_for

TIMEOUT = 0.3  # s for a preempted task to end


class Stuck:
    """A hook that is called and does not return until it is released."""

    def __init__(self):
        self.reached = threading.Event()
        self.released = threading.Event()
        self.returned = threading.Event()

    def __call__(self, skill):
        self.reached.set()
        assert self.released.wait(30)
        self.returned.set()
        return skill.success("at last")


@pytest.fixture
def stuck():
    hook = Stuck()
    yield hook
    hook.released.set()


@pytest.fixture
def scheduler():
    made = []

    def make(**options):
        made.append(Scheduler(rate=200, preempt_timeout=TIMEOUT, **options))
        return made[-1]

    yield make
    for one in made:
        one.stop(timeout=0.5)


def started(scheduler, bench, *nodes):
    task = scheduler.new_task(bench.wmi, "test")
    task.root(*nodes)
    scheduler.start(task.id)
    return task


def test_hung_hook_blocks_only_its_own_task(scheduler, bench, stuck):
    bench.load(primitive(Work, "stuck", execute=stuck), primitive(Work, "work", execute=running_for(20)))
    one = scheduler()
    blocked = started(one, bench, bench.node("stuck"))
    assert stuck.reached.wait(5)
    others = [started(one, bench, bench.node("work")) for _ in range(3)]
    assert all(task.ended.wait(10) for task in others)
    assert not blocked.ended.is_set()


def test_task_continues_when_slow_hook_returns(scheduler, bench, stuck):
    bench.load(primitive(Work, "stuck", execute=stuck), primitive(Work, "work", execute=running_for(20)))
    one = scheduler()
    blocked = started(one, bench, bench.node("stuck"), bench.node("work"))
    assert stuck.reached.wait(5)
    assert started(one, bench, bench.node("work")).ended.wait(10)
    stuck.released.set()
    assert blocked.ended.wait(10)
    assert blocked.state is State.Success


@pytest.mark.parametrize("hook", ["onStart", "execute"])
def test_preempted_task_ends_and_names_abandoned_hook(scheduler, bench, stuck, hook):
    ended = []
    bench.load(primitive(Work, "stuck", **{hook: stuck}, onEnd=lambda self: ended.append(1)))
    told = []
    one = scheduler(on_progress=lambda task: told.append((task.id, task.root.progress_code)))
    blocked = started(one, bench, bench.node("stuck"))
    assert stuck.reached.wait(5)
    one.preempt(blocked.id)
    assert blocked.ended.wait(10)
    assert blocked.state is State.Failure
    node = blocked.root.children[0]
    assert node.state is State.Failure
    assert f"skiros:Work-stuck: {hook} has not returned for" in node.progress_msg
    assert node.progress_msg in blocked.root.progress_msg
    assert node.progress_msg in {e.message for e in blocked.explanations()}
    one.stop()
    assert told[-1] == (blocked.id, -1)
    stuck.released.set()
    assert stuck.returned.wait(5)
    assert ended == []  # what comes later has no effect
    assert node.state is State.Failure


@pytest.mark.parametrize("hook", ["onPreempt", "onEnd"])
def test_hook_that_hangs_at_the_end_is_abandoned(scheduler, bench, stuck, hook):
    begun = threading.Event()
    running = {"execute": lambda self: begun.set() or self.step("")}
    bench.load(primitive(Work, "stuck", **{**running, hook: stuck}))
    one = scheduler()
    blocked = started(one, bench, bench.node("stuck"))
    assert begun.wait(5)
    one.preempt(blocked.id)
    assert blocked.ended.wait(10)
    assert f"skiros:Work-stuck: {hook} has not returned" in blocked.root.progress_msg


def test_siblings_of_hung_hook_are_preempted(scheduler, bench, stuck):
    calls = []
    bench.load(
        primitive(
            Work,
            "moves",
            execute=lambda self: self.step(""),
            onPreempt=lambda self: calls.append("onPreempt"),
            onEnd=lambda self: calls.append("onEnd"),
        ),
        primitive(Work, "stuck", execute=stuck),
    )
    one = scheduler()
    task = started(one, bench, Skill("both", ParallelFf())(bench.node("moves"), bench.node("stuck")))
    assert stuck.reached.wait(5)
    one.preempt(task.id)
    assert task.ended.wait(10)
    assert calls == ["onPreempt", "onEnd"]


def test_abandoned_instance_is_not_used_again(scheduler, bench, stuck):
    instances = []
    bench.load(primitive(Work, "stuck", execute=lambda self: instances.append(self) or stuck(self)))
    one = scheduler()
    task = started(one, bench, bench.node("stuck"))
    assert stuck.reached.wait(5)
    one.preempt(task.id)
    assert task.ended.wait(10)
    stuck.released.set()
    assert stuck.returned.wait(5)
    again = started(one, bench, bench.node("stuck"))
    assert again.ended.wait(10)
    assert again.state is State.Success
    assert len({id(instance) for instance in instances}) == 2
    assert not bench.library.by_label("stuck").busy


def test_abandoned_skill_does_not_change_blackboard(scheduler, bench, stuck):
    from unit.skiros2_skill.skills import Speak

    def execute(self):
        stuck(self)
        self.params["Text"].value = "too late"
        return self.success("")

    bench.load(primitive(Speak, "stuck", execute=execute))
    one = scheduler()
    task = one.new_task(bench.wmi, "test")
    task.root.params.addParam("Text", "before", 1)
    task.root(bench.node("stuck"))
    one.start(task.id)
    assert stuck.reached.wait(5)
    one.preempt(task.id)
    assert task.ended.wait(10)
    stuck.released.set()
    assert stuck.returned.wait(5)
    one.stop()
    assert task.root.params["Text"].value == "hello"  # the default, from the start


def test_devices_of_abandoned_skill_are_released(scheduler, bench, stuck):
    arm = bench.add("rparts:ArmDevice", "arm", StateProperty="Idle")
    bench.load(primitive(describe("Weld", [LOCKED_ARM]), "weld", execute=stuck))
    one = scheduler()
    task = started(one, bench, bench.node("weld"))
    assert stuck.reached.wait(5)
    assert bench.wmi.get_element(arm.id).getProperty("skiros:StateProperty").value == "Busy"
    one.preempt(task.id)
    assert task.ended.wait(10)
    assert bench.wmi.get_element(arm.id).getProperty("skiros:StateProperty").value == "Idle"


def test_node_that_keeps_running_after_preemption_is_ended_after_timeout(scheduler, bench):
    begun, ended = threading.Event(), threading.Event()
    bench.load(
        primitive(
            Work,
            "endless",
            execute=lambda self: begun.set() or self.step(""),
            onPreempt=State.Running,
            onEnd=lambda self: ended.set(),
        )
    )
    one = scheduler()
    task = started(one, bench, bench.node("endless"))
    assert begun.wait(5)
    one.preempt(task.id)
    assert task.ended.wait(10)
    assert ended.is_set()
    assert "did not end in time" in task.root.children[0].progress_msg


def test_task_is_preempted_while_hook_of_another_hangs(scheduler, bench, stuck):
    bench.load(primitive(Work, "stuck", execute=stuck), primitive(Work, "endless", execute=lambda self: self.step("")))
    one = scheduler()
    started(one, bench, bench.node("stuck"))
    tasks = [started(one, bench, bench.node("endless")) for _ in range(5)]
    assert stuck.reached.wait(5)
    one.preempt(tasks[2].id)
    assert tasks[2].ended.wait(10)
    assert not any(task.ended.is_set() for task in tasks if task is not tasks[2])


def test_many_hung_hooks_at_once_are_abandoned(scheduler, bench, stuck):
    bench.load(primitive(Work, "stuck", execute=stuck), primitive(Work, "work", execute=running_for(3)))
    one = scheduler()
    tasks = []
    for _ in range(8):
        stuck.reached.clear()
        tasks.append(started(one, bench, bench.node("stuck")))
        assert stuck.reached.wait(5)
    assert started(one, bench, bench.node("work")).ended.wait(10)
    for task in tasks:
        one.preempt(task.id)
    assert all(task.ended.wait(10) for task in tasks)
    assert started(one, bench, bench.node("work")).ended.wait(10)


def test_stop_does_not_wait_for_hung_hook(bench, stuck):
    bench.load(primitive(Work, "stuck", execute=stuck))
    told = []
    one = Scheduler(rate=200, preempt_timeout=60, on_progress=lambda task: told.append(task.root.progress_code))
    task = started(one, bench, bench.node("stuck"))
    assert stuck.reached.wait(5)
    one.stop(timeout=0.3)
    assert task.ended.is_set()
    assert told[-1] == -1


def test_slow_tick_is_logged_once_with_slowest_hook(scheduler, bench, caplog):
    pause = threading.Event()
    bench.load(
        primitive(Work, "quick", execute=running_for(4)),
        primitive(Work, "slow", execute=lambda self: pause.wait(0.06) or running_for(4)(self)),
    )
    one = scheduler()
    task = started(one, bench, Skill("both", ParallelFf())(bench.node("quick"), bench.node("slow")))
    assert task.ended.wait(10)
    one.stop()
    reports = [r.getMessage() for r in caplog.records if "longer than the period of 0.005 s" in r.getMessage()]
    assert [r for r in reports if "most of it was spent in skiros:Work-slow: execute" in r] == reports
    assert len(reports) == 1


def test_exception_in_tick_preempts_nodes_and_releases_devices(scheduler, bench):
    class Broken(Skill):
        def visit(self, visitor):
            raise RuntimeError("broken node")

    arm = bench.add("rparts:ArmDevice", "arm", StateProperty="Idle")
    calls = []
    bench.load(
        primitive(
            describe("Weld", [LOCKED_ARM]),
            "weld",
            execute=lambda self: self.step(""),
            onPreempt=lambda self: calls.append("onPreempt"),
        )
    )
    task = started(scheduler(), bench, Skill("both", ParallelFf())(bench.node("weld"), Broken("broken")))
    assert task.ended.wait(5)
    assert "broken node" in task.root.progress_msg
    assert calls == ["onPreempt"]
    assert bench.wmi.get_element(arm.id).getProperty("skiros:StateProperty").value == "Idle"
    assert not bench.library.by_label("weld").busy


# -- preempted while a hook is being called --------------------------------------------------------------------------


def preempted_in(scheduler, bench, stuck, **hooks):
    """A task that was preempted while `execute` is being called, which returns then."""
    bench.load(primitive(Work, "stuck", execute=stuck, **hooks), primitive(Work, "next"))
    one = scheduler()
    task = started(one, bench, bench.node("stuck"), bench.node("next"))
    assert stuck.reached.wait(5)
    one.preempt(task.id)
    stuck.released.set()
    assert task.ended.wait(10)
    return task


def test_preempted_task_fails_regardless_of_running_execute(scheduler, bench, stuck):
    task = preempted_in(scheduler, bench, stuck)
    assert (task.state, task.root.progress_code, task.root.progress_msg) == (State.Failure, -1, "Preempted")
    assert task.cause().stage == PREEMPT


def test_no_skill_starts_after_preemption(scheduler, bench, stuck):
    task = preempted_in(scheduler, bench, stuck)
    assert [node.state for node in task.root.children] == [State.Success, State.Idle]


def test_preempted_task_fails_even_if_last_skill_succeeds(scheduler, bench, stuck):
    bench.load(primitive(Work, "stuck", execute=stuck))
    one = scheduler()
    task = started(one, bench, bench.node("stuck"))
    assert stuck.reached.wait(5)
    one.preempt(task.id)
    stuck.released.set()
    assert task.ended.wait(10)
    assert (task.state, task.root.progress_msg) == (State.Failure, "Preempted")


def test_hook_timeout_is_shorter_than_preempt_timeout(bench, stuck):
    bench.load(primitive(Work, "stuck", execute=stuck))
    one = Scheduler(rate=200, preempt_timeout=60, hook_timeout=0.2)
    try:
        task = started(one, bench, bench.node("stuck"))
        assert stuck.reached.wait(5)
        one.preempt(task.id)
        assert task.ended.wait(10)
        assert "execute has not returned" in task.root.progress_msg
    finally:
        stuck.released.set()
        one.stop(timeout=0.5)


def test_running_skill_may_exceed_hook_timeout_after_preemption(bench):
    begun, ended = threading.Event(), threading.Event()
    ticks = []

    def ends(self):
        ticks.append(1)
        begun.set()
        return self.success("") if len(ticks) > 100 and ended.is_set() else self.step("")

    def on_preempt(self):
        ended.set()
        ticks.clear()
        return State.Running

    bench.load(primitive(Work, "brakes", execute=ends, onPreempt=on_preempt))
    one = Scheduler(rate=200, preempt_timeout=60, hook_timeout=0.1)
    try:
        task = started(one, bench, bench.node("brakes"))
        assert begun.wait(5)
        one.preempt(task.id)
        assert task.ended.wait(20)
        assert (task.state, task.root.progress_msg) == (State.Failure, "Preempted")
        assert len(ticks) == 101
    finally:
        one.stop(timeout=0.5)


def test_hook_that_is_called_while_another_is_not_found_can_be_abandoned():
    """The ticking thread begins a hook just when another thread has found that there is none to abandon."""

    class Calls(list):
        def pop(self, *index):
            if not self and not begun:
                begun.append(True)
                guard.calls.append(("run", "execute"))  # as `HookGuard.call` does
                raise IndexError
            return super().pop(*index)

    begun = []
    guard = HookGuard()
    guard.calls = Calls()
    assert guard.abandon() is None
    hung = guard.abandon()
    assert hung is not None
    assert (hung.run, hung.hook) == ("run", "execute")


def test_late_worker_skips_periods_and_does_not_tick_twice_at_once(bench):
    """A tick that takes 2.2 periods is followed by one late tick; the next one is on time again."""
    period, starts, clock = 0.2, [], time.monotonic

    def work(skill):
        starts.append(clock())
        if len(starts) == 2:
            time.sleep(2.2 * period)
        return skill.step() if len(starts) < 4 else skill.success()

    bench.load(primitive(Work, "work", execute=work))
    scheduler = Scheduler(rate=1 / period)
    try:
        task = started(scheduler, bench, bench.node("work"))
        assert task.ended.wait(20.0)
    finally:
        scheduler.stop()
    assert starts[3] - starts[2] > 0.4 * period


def test_preempted_task_stops_before_the_other_tasks_are_ticked(scheduler, bench):
    hooks = []  # in their order, from the preemption on
    blocks, is_blocked, released = threading.Event(), threading.Event(), threading.Event()

    def work(skill):
        if blocks.is_set() and not is_blocked.is_set():
            is_blocked.set()
            assert released.wait(30)
        elif is_blocked.is_set():
            hooks.append("another")
        return skill.step("working")

    class Stopped(primitive(Work, "stopped", execute=lambda skill: skill.step("moving"))):
        def onPreempt(self):
            hooks.append("preempted")
            return self.fail("stopped", -1)

    bench.load(primitive(Work, "work", execute=work), Stopped)
    one = scheduler(hook_timeout=30.0)
    one._watchdog._move_other_tasks = lambda *_: None  # all stay in one thread
    others = [started(one, bench, bench.node("work")) for _ in range(6)]
    stopped = started(one, bench, bench.node("stopped"))
    wait_until_running(stopped, *others)
    blocks.set()
    assert is_blocked.wait(10)
    one.preempt(stopped.id)
    released.set()
    assert stopped.ended.wait(10)
    assert hooks[0] == "preempted"


def test_preempted_task_does_not_wait_for_a_slow_hook_of_another_task(bench, stuck):
    bench.load(primitive(Work, "stuck", execute=stuck), primitive(Work, "work", execute=running_for(10**6)))
    one = Scheduler(rate=0.02)  # a tick is slow after 100 s
    try:
        other = started(one, bench, bench.node("work"))
        wait_until_running(other)
        started(one, bench, bench.node("stuck"))
        assert stuck.reached.wait(10)
        one.preempt(other.id)
        assert other.ended.wait(10)
    finally:
        stuck.released.set()
        one.stop(timeout=0.5)


def wait_until_running(*tasks):
    while any(task.state is not State.Running for task in tasks):
        time.sleep(0.001)
