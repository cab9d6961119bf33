"""The ticking thread: several tasks, commands from other threads, and what must not end it."""

import queue
import threading
import time

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import Refused, UnknownName
from skiros2_skill.core.runtime.scheduler import Scheduler
from skiros2_skill.core.skill import Skill
from unit.skiros2_skill.skills import Work, primitive, running_for


@pytest.fixture
def scheduler():
    made = []

    def make(**options):
        made.append(Scheduler(rate=200, **options))
        return made[-1]

    yield make
    for one in made:
        one.stop()


def started(scheduler, bench, *nodes, ticks=0):
    task = scheduler.new_task(bench.wmi, "test")
    task.root(*nodes)
    scheduler.start(task.id, ticks)
    return task


@pytest.fixture
def skills(bench):
    return bench.load(
        primitive(Work, "work", execute=running_for(3)),
        primitive(Work, "endless", execute=lambda self: self.step()),
    )


def test_tasks_run_in_parallel(scheduler, skills):
    one = scheduler()
    tasks = [started(one, skills, skills.node("work")) for _ in range(20)]
    assert all(task.ended.wait(5) for task in tasks)
    assert {task.state for task in tasks} == {State.Success}
    assert one.tasks() == []


def test_one_command_pauses_or_preempts_all_tasks(scheduler, skills):
    one = scheduler()
    tasks = [started(one, skills, skills.node("endless")) for _ in range(5)]
    one.pause_all()
    assert all(task.paused for task in tasks)
    one.preempt_all()
    assert all(task.ended.wait(5) for task in tasks)
    one.preempt_all()
    assert one.tasks() == []


def test_last_progress_has_end_of_task(scheduler, skills):
    told, ended = [], threading.Event()

    def on_progress(task):
        told.append((task.state, task.root.progress_code))
        if task.ended.is_set():
            ended.set()

    started(scheduler(on_progress=on_progress), skills, skills.node("work"))
    assert ended.wait(5)
    assert told[-1] == (State.Success, 1)
    assert [code for _, code in told[:-1]] == [0] * (len(told) - 1)


def test_unchanged_progress_is_repeated(scheduler, skills):
    told = threading.Semaphore(0)
    one = scheduler(on_progress=lambda task: told.release(), keep_alive=0.02)
    skills.load(primitive(Work, "still", execute=State.Running))
    started(one, skills, skills.node("still"))
    assert all(told.acquire(timeout=5) for _ in range(5))


def test_preempt_affects_only_one_task(scheduler, skills):
    one = scheduler()
    tasks = [started(one, skills, skills.node("endless")) for _ in range(5)]
    one.preempt(tasks[2].id)
    assert tasks[2].ended.wait(5)
    assert sorted(t.id for t in one.tasks()) == sorted(t.id for t in tasks if t is not tasks[2])


def test_paused_task_resumes_in_same_state(scheduler, skills):
    count = []
    skills.load(primitive(Work, "count", execute=lambda self: count.append(1) or self.step()))
    ticks = threading.Semaphore(0)
    one = scheduler(on_tick=ticks.release)
    task = started(one, skills, skills.node("count"))
    other = started(one, skills, skills.node("endless"))
    while len(count) < 3:
        assert ticks.acquire(timeout=5)
    one.pause(task.id)
    for _ in range(3):  # the round under way may still tick it
        assert ticks.acquire(timeout=5)
    held = len(count)
    for _ in range(10):
        assert ticks.acquire(timeout=5)
    assert len(count) <= held + 1
    with pytest.raises(Refused):
        one.start(other.id)
    held = len(count)
    one.start(task.id)
    while len(count) == held:
        assert ticks.acquire(timeout=5)


def test_tick_once_ticks_once_and_pauses(scheduler, skills):
    count = []
    skills.load(primitive(Work, "count", execute=lambda self: count.append(1) or self.step()))
    one = scheduler()
    task = started(one, skills, skills.node("count"), ticks=1)
    deadline = time.monotonic() + 5
    while not task.paused and time.monotonic() < deadline:
        time.sleep(0.001)
    assert len(count) == 1
    one.preempt(task.id)
    assert task.ended.wait(5)


def test_progress_of_paused_task_is_paused_until_resume(scheduler, skills):
    messages = queue.SimpleQueue()
    one = scheduler(on_progress=lambda task: messages.put(task.progress()[0].progress_message))
    task = started(one, skills, skills.node("endless"))
    assert messages.get(timeout=5) == ""
    one.pause(task.id)
    while messages.get(timeout=5) != "paused":
        pass
    one.start(task.id)
    while messages.get(timeout=5) != "":
        pass


def test_paused_task_can_be_preempted(scheduler, skills):
    one = scheduler()
    task = started(one, skills, skills.node("endless"), ticks=1)
    one.pause(task.id)
    one.preempt(task.id)
    assert task.ended.wait(5)


def test_command_to_unknown_task_names_it(scheduler, skills):
    one = scheduler()
    for command in (one.start, one.preempt, one.pause):
        with pytest.raises(UnknownName, match="no task 77 is here; there are: none"):
            command(77)


def test_exception_in_tick_ends_only_that_task(scheduler, skills):
    class Broken(Skill):
        def visit(self, visitor):
            raise RuntimeError("broken node")

    one = scheduler()
    bad = started(one, skills, Broken("broken"))
    good = started(one, skills, skills.node("work"))
    assert bad.ended.wait(5)
    assert good.ended.wait(5)
    assert bad.state is State.Failure
    assert "broken node" in bad.root.progress_msg
    assert good.state is State.Success


def test_exception_in_callback_does_not_end_thread(scheduler, skills):
    def raises(*_):
        raise RuntimeError("callback")

    one = scheduler(on_tick=raises, on_progress=raises)
    assert started(one, skills, skills.node("work")).ended.wait(5)
    assert started(one, skills, skills.node("work")).ended.wait(5)


def test_task_ids_are_unique_and_fit_int16(scheduler, skills):
    one = scheduler()
    one._next_id = 32767
    tasks = [started(one, skills, skills.node("endless")) for _ in range(3)]
    assert [t.id for t in tasks] == [32767, 0, 1]


def test_stop_ends_all_tasks_and_threads(skills):
    one = Scheduler(rate=200)
    tasks = [started(one, skills, skills.node("endless")) for _ in range(3)]
    before = set(threading.enumerate())
    one.stop()
    assert all(t.ended.is_set() for t in tasks)
    assert not any(thread.is_alive() and thread.name.startswith("scheduler") for thread in before)


def test_hook_may_send_commands(scheduler, skills):
    one = scheduler()
    skills.load(primitive(Work, "ender", execute=lambda self: one.preempt(other.id) or self.success()))
    other = started(one, skills, skills.node("endless"))
    started(one, skills, skills.node("ender"))
    assert other.ended.wait(5)


# -- an answer comes when what it promises is so -----------------------------------------------------------------------


@pytest.fixture
def gate(skills):
    """A skill that is in `execute` when `entered` is released, and leaves it when `open` is."""

    class Gate:
        entered, open = threading.Semaphore(0), threading.Semaphore(0)
        ticks = 0

        def __call__(self, skill):
            self.ticks += 1
            self.entered.release()
            assert self.open.acquire(timeout=30)
            return skill.step("")

    gate = Gate()
    skills.load(primitive(Work, "gate", execute=gate))
    return gate


def test_wait_until_idle_waits_for_tick_of_paused_task(scheduler, skills, gate):
    one = scheduler()
    task = started(one, skills, skills.node("gate"), ticks=1)
    assert gate.entered.acquire(timeout=5)
    assert not one.wait_until_idle([task.id], 0.05)
    gate.open.release()
    assert one.wait_until_idle([task.id], 10)
    assert task.paused
    one.start(task.id)  # is not refused
    assert gate.entered.acquire(timeout=5)
    one.pause(task.id)
    assert not one.wait_until_idle([task.id], 0.05)
    gate.open.release()
    assert one.wait_until_idle([task.id], 10)


def test_tick_requested_during_tick_is_executed_after_it(scheduler, skills, gate):
    one = scheduler()
    task = started(one, skills, skills.node("gate"))
    assert gate.entered.acquire(timeout=5)
    one.pause(task.id)
    one.start(task.id, ticks=1)
    gate.open.release(2)
    assert one.wait_until_idle([task.id], 10)
    assert gate.ticks == 2


def test_preempted_task_cannot_be_resumed(scheduler, skills, gate):
    one = scheduler()
    task = started(one, skills, skills.node("gate"))
    assert gate.entered.acquire(timeout=5)
    one.pause(task.id)
    one.preempt(task.id)
    with pytest.raises(Refused, match="was preempted"):
        one.start(task.id)
    gate.open.release()
    assert task.ended.wait(5)
