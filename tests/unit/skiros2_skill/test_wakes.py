"""When tasks are ticked: on a grid of time, and at once when something happens that concerns them."""

import threading
import time

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.primitive_thread import PrimitiveThreadBase
from skiros2_skill.core.runtime.scheduler import Scheduler
from skiros2_skill.core.runtime.worker import MAX_WAKES
from unit.skiros2_skill.skills import CONTAINER, OBJECT, Work, contains, describe, primitive

Hold = describe("Hold", [CONTAINER, OBJECT], pre=[contains()], hold=[contains()])
NEVER = 0.001  # ticks per second: the first slot of the grid is the only one


@pytest.fixture
def scheduler(bench):
    made = []

    def make(rate=NEVER):
        made.append(Scheduler(rate=rate, keep_alive=1e6))
        bench.wmi.add_listener(made[-1].on_change)
        return made[-1]

    yield make
    for one in made:
        bench.wmi.remove_listener(one.on_change)
        one.stop()


def started(scheduler, bench, *nodes):
    task = scheduler.new_task(bench.wmi, "test")
    task.root(*nodes)
    scheduler.start(task.id)
    return task


class Ticks:
    """An `execute` that keeps running and counts its calls."""

    def __init__(self):
        self.count = 0
        self._changed = threading.Condition()

    def __call__(self, skill):
        with self._changed:
            self.count += 1
            self._changed.notify_all()
        return skill.step("")

    def reach(self, number):
        with self._changed:
            return self._changed.wait_for(lambda: self.count >= number, 10)


def take_out(bench, product):
    """Takes the product out of its tray."""
    bench.wmi.set_relation(bench.tray.id, "skiros:contain", product.id, False)


# -- the grid ----------------------------------------------------------------------------------------------------------


def test_started_task_is_ticked_at_once(scheduler, bench):
    ticks = Ticks()
    bench.load(primitive(Work, "work", execute=ticks))
    one = scheduler()
    first = started(one, bench, bench.node("work"))
    assert ticks.reach(1)
    started(one, bench, bench.node("work"))
    assert ticks.reach(2)
    assert not first.ended.is_set()


def test_start_ticks_no_other_task(scheduler, bench):
    ticks, others = Ticks(), Ticks()
    bench.load(primitive(Work, "work", execute=ticks), primitive(Work, "other", execute=others))
    one = scheduler()
    started(one, bench, bench.node("work"))
    assert ticks.reach(1)
    for number in range(25):
        started(one, bench, bench.node("other"))
        assert others.reach(number + 1)
    assert ticks.count <= 2  # its start, and perhaps the slot in which it was new


def test_ticks_do_not_drift_when_some_are_late(scheduler, bench):
    """What a late tick delays is made up for: the n-th tick comes n periods after the first, but for a period."""
    stamps, pause = [], threading.Event()

    def execute(skill):
        stamps.append(time.monotonic())
        pause.wait(0.03 if len(stamps) % 5 == 0 else 0.0)
        return skill.step("") if len(stamps) < 60 else skill.success("")

    bench.load(primitive(Work, "work", execute=execute))
    period = 0.02
    task = started(scheduler(1 / period), bench, bench.node("work"))
    assert task.ended.wait(30)
    slots = [(stamp - stamps[0]) / period for stamp in stamps]
    # A tick lies in the slot of its number or later: on a machine that is held up slots are left out, never doubled.
    assert all(slot > number - 1.5 for number, slot in enumerate(slots))
    # The machine itself may hold a tick up, so that the next ones are close behind it.
    on_time = [i for i in range(1, len(slots) - 2) if slots[i] - slots[i - 1] < 1.8]
    bursts = [i for i in on_time if slots[i + 2] - slots[i] < 0.5]
    assert bursts == []


# -- wakes by the world ------------------------------------------------------------------------------------------------


def test_change_that_affects_hold_condition_wakes_task(scheduler, bench):
    ticks = Ticks()
    bench.load(primitive(Hold, "hold", execute=ticks))
    task = started(scheduler(), bench, bench.node("hold", Object=bench.product))
    assert ticks.reach(1)
    take_out(bench, bench.product)
    assert task.ended.wait(5)
    assert "Hold-condition failed" in task.root.progress_msg


def test_unrelated_change_does_not_wake_task(scheduler, bench):
    ticks, other = Ticks(), Ticks()
    bench.load(primitive(Hold, "hold", execute=ticks), primitive(Work, "work", execute=other))
    one = scheduler()
    task = started(one, bench, bench.node("hold", Object=bench.product))
    assert ticks.reach(1)
    one.pause(task.id)
    one.start(task.id)  # the grid's first slot is over with this one
    assert ticks.reach(2)
    bench.add("skiros:Product", "a third one", bench.other_tray)
    started(one, bench, bench.node("work"))  # ticked after anything that the change has woken
    assert other.reach(1)
    assert ticks.count == 2
    assert not task.ended.is_set()


def test_only_affected_tasks_are_woken(scheduler, bench):
    ticks, others = Ticks(), Ticks()
    bench.load(primitive(Hold, "hold", execute=ticks), primitive(Hold, "other", execute=others))
    one = scheduler()
    concerned = started(one, bench, bench.node("hold", Object=bench.product))
    unconcerned = started(one, bench, bench.node("other", Object=bench.other_product))
    assert ticks.reach(1) and others.reach(1)
    before = others.count
    bench.wmi.remove_element(bench.wmi.get_element(bench.product.id))
    assert concerned.ended.wait(5)
    assert others.count <= before + 1
    assert not unconcerned.ended.is_set()


def test_own_changes_do_not_wake_task(scheduler, bench):
    writes = Ticks()

    def execute(skill):
        product = skill.params["Object"].value
        product.setProperty("skiros:Value", writes.count)
        return writes(skill)

    bench.load(primitive(Hold, "hold", execute=execute), primitive(Work, "work"))
    one = scheduler()
    started(one, bench, bench.node("hold", Object=bench.product))
    assert writes.reach(1)
    assert started(one, bench, bench.node("work")).ended.wait(5)
    assert writes.count <= 2


# -- wakes by skills ---------------------------------------------------------------------------------------------------


def test_wake_from_another_thread_ticks_task(scheduler, bench):
    ready, skills = threading.Event(), []

    def execute(skill):
        skills.append(skill)
        return skill.success("") if ready.is_set() else skill.step("")

    bench.load(primitive(Work, "wait", execute=execute))
    task = started(scheduler(), bench, bench.node("wait"))
    while not skills:
        assert not task.ended.wait(0.01)
    ready.set()
    skills[0].wake()
    assert task.ended.wait(5)


def test_result_of_threaded_primitive_wakes_task(scheduler, bench):
    go = threading.Event()

    class think(PrimitiveThreadBase):
        def createDescription(self):
            self.setDescription(Work(), "think")

        def run(self):
            assert go.wait(10)
            return self.success("thought")

    bench.load(think)
    task = started(scheduler(), bench, bench.node("think"))
    go.set()
    assert task.ended.wait(5)
    assert task.state is State.Success


def test_skill_that_wakes_itself_at_each_tick_does_not_spin(scheduler, bench):
    ticks, other = Ticks(), Ticks()
    bench.load(
        primitive(Work, "restless", execute=lambda self: self.wake() or ticks(self)),
        primitive(Work, "work", execute=other),
    )
    one = scheduler()
    started(one, bench, bench.node("restless"))
    assert ticks.reach(MAX_WAKES)
    started(one, bench, bench.node("work"))
    assert other.reach(1)
    assert ticks.count <= MAX_WAKES + 2


def test_wake_after_end_does_nothing(scheduler, bench):
    kept = []
    bench.load(primitive(Work, "work", execute=lambda self: kept.append(self) or self.success("")))
    one = scheduler()
    assert started(one, bench, bench.node("work")).ended.wait(5)
    kept[0].wake()
    assert started(one, bench, bench.node("work")).ended.wait(5)


def test_woken_paused_task_stays_paused(scheduler, bench):
    ticks = Ticks()
    bench.load(primitive(Hold, "hold", execute=ticks))
    one = scheduler()
    task = started(one, bench, bench.node("hold", Object=bench.product))
    assert ticks.reach(1)
    one.pause(task.id)
    take_out(bench, bench.product)
    task.wake()
    assert started(one, bench, bench.node("hold", Object=bench.other_product)).id != task.id
    assert not task.ended.is_set()
    one.start(task.id)
    assert task.ended.wait(5)


# -- commands ----------------------------------------------------------------------------------------------------------


def test_start_with_tick_count_ticks_exactly_that_often(scheduler, bench):
    ticks = Ticks()
    bench.load(primitive(Work, "work", execute=ticks))
    one = scheduler(200)
    task = one.new_task(bench.wmi, "test")
    task.root(bench.node("work"))
    for count in (1, 3, 2):
        before = ticks.count
        one.start(task.id, count)
        assert ticks.reach(before + count)
        task.wake()
        assert task._paused.wait(5)
        assert ticks.count == before + count


def test_one_of_two_simultaneous_starts_is_refused(scheduler, bench):
    ticks = Ticks()
    bench.load(primitive(Work, "work", execute=ticks))
    one = scheduler(200)
    task = one.new_task(bench.wmi, "test")
    task.root(bench.node("work"))
    answers, gate = [], threading.Barrier(4)

    def start():
        gate.wait(5)
        try:
            one.start(task.id)
            answers.append("started")
        except Exception as error:
            answers.append(str(error))

    threads = [threading.Thread(target=start) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(5)
    assert sorted(answers) == ["started"] + [f"task {task.id} runs already"] * 3
