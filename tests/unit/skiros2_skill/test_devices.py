"""Locks on devices: one of several managers has a device, and it is free again whatever happens."""

from __future__ import annotations

import threading

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import Refused
from skiros2_skill.core.engine import devices
from skiros2_skill.core.engine.devices import locks_in, release_stale_devices
from skiros2_skill.core.engine.executor import Executor
from skiros2_skill.core.runtime.scheduler import Scheduler
from skiros2_world_model.core.local_world_model import LocalWorldModel
from skiros2_world_model.core.wm_errors import WmException
from support.ros import wait_until
from unit.skiros2_skill.conftest import Workbench
from unit.skiros2_skill.skills import INFERRED, LOCKED_ARM, ParamOptions, describe, primitive, running_for
from unit.skiros2_skill.test_tick import message

STATE, HOLDER = "skiros:StateProperty", "skiros:LockedBy"
SECOND_ARM = ("Second", LOCKED_ARM[1], INFERRED, [ParamOptions.Lock])


class Meddled(LocalWorldModel):
    """A client whose next compare-and-sets meet with something: each function is called before one of them."""

    def __init__(self, author, model):
        super().__init__(author, model)
        self.before = []
        self.after = []

    def update_element_if_unchanged(self, e, context_id="scene"):
        if self.before:
            self.before.pop(0)(e)
        written = super().update_element_if_unchanged(e, context_id)
        if self.after:
            self.after.pop(0)(e)
        return written


@pytest.fixture
def bench():
    return Workbench(Meddled("/one", LocalWorldModel().model))


@pytest.fixture
def other(bench):
    """Another manager on the same world model."""
    return LocalWorldModel("/two", bench.wmi.model)


@pytest.fixture
def arm(bench):
    return bench.add("rparts:ArmDevice", "arm", StateProperty="Idle")


@pytest.fixture
def soon(monkeypatch):
    monkeypatch.setattr(devices, "RETRY_PERIOD", 0.01)


def lock_of(bench, arm):
    """State and holder of a device."""
    device = bench.wmi.get_element(arm.id)
    return device.value_of(STATE), device.value_of(HOLDER)


def refuses(_):
    raise WmException("not now")


def raises_anything(*_):
    raise RuntimeError("!")


def moving(bench, *params, **hooks):
    """A task that runs a skill with a locked arm."""
    hooks.setdefault("execute", lambda self: self.step())
    bench.load(primitive(describe("Move", [LOCKED_ARM, *params]), "move", **hooks))
    task = bench.task(bench.node("move"))
    task.tick()
    return task


# -- who has it --------------------------------------------------------------------------------------------------------


def test_locked_device_names_its_holder(bench, arm):
    task = moving(bench)
    assert lock_of(bench, arm) == ("Busy", "/one")
    task.preempt()
    task.tick()
    device = bench.wmi.get_element(arm.id)
    assert device.value_of(STATE) == "Idle"
    assert not device.hasProperty(HOLDER)


def test_skill_sees_locked_state_of_its_device(bench, arm):
    seen = []
    moving(bench, onStart=lambda self: seen.append(self.params["Arm"].value.value_of(STATE)))
    assert seen == ["Busy"]


def test_second_lock_is_refused_with_name_of_holder(bench, other, arm):
    bench.wmi.before.append(lambda device: locks_in(other).acquire(device.id, "a node", other))
    task = moving(bench)
    assert task.state is State.Failure
    assert f"{arm.id}-arm is locked by /two" in message(task)
    (explanation,) = task.explanations()
    assert (explanation.stage, explanation.code) == ("pre", -1)
    assert lock_of(bench, arm) == ("Busy", "/two")


def test_one_of_two_concurrent_managers_gets_lock(bench, other, arm):
    outcomes = {bench.wmi: [], other: []}
    start = threading.Barrier(2)

    def compete(wmi):
        for _ in range(100):
            start.wait(10.0)
            try:
                locks_in(wmi).acquire(arm.id, wmi, wmi)
            except Refused as refused:
                outcomes[wmi].append(str(refused))
            else:
                outcomes[wmi].append("")
            start.wait(10.0)
            locks_in(wmi).release([arm.id], wmi, wmi)

    threads = [threading.Thread(target=compete, args=(wmi,)) for wmi in outcomes]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60.0)
    assert len(outcomes[other]) == 100
    for mine, theirs in zip(outcomes[bench.wmi], outcomes[other], strict=True):
        assert (mine == "") != (theirs == "")
        assert (mine or theirs).endswith("is locked by /one" if theirs else "is locked by /two")
    assert lock_of(bench, arm) == ("Idle", None)


def test_lock_tolerates_concurrent_change_of_device(bench, other, arm):
    def weigh(_):
        device = other.get_element(arm.id)
        device.setProperty("skiros:Weight", 2.0)
        other.update_element(device)

    bench.wmi.before += [weigh, lambda _: None, weigh]
    task = moving(bench, execute=running_for(1))
    while task.tick() is State.Running:
        pass
    assert task.state is State.Success
    assert lock_of(bench, arm) == ("Idle", None)
    assert bench.wmi.get_element(arm.id).value_of("skiros:Weight") == 2.0


def test_device_locked_by_another_manager_is_not_released(bench, other, arm):
    task = moving(bench)
    device = other.get_element(arm.id)
    device.setProperty(HOLDER, "/two")
    other.update_element(device)
    task.preempt()
    task.tick()
    assert lock_of(bench, arm) == ("Busy", "/two")


# -- freed however it ends ---------------------------------------------------------------------------------------------


def test_refused_release_is_retried(bench, arm, soon):
    task = moving(bench)
    bench.wmi.before += [refuses] * 3
    task.preempt()
    task.tick()
    assert task.ended.is_set()
    wait_until(lambda: lock_of(bench, arm) == ("Idle", None), what="the release")
    assert bench.wmi.before == []


def test_release_that_is_refused_for_long_is_logged_once_a_minute(bench, arm, soon, caplog, monkeypatch):
    task = moving(bench)
    bench.wmi.before += [refuses] * 30
    task.preempt()
    task.tick()
    wait_until(lambda: lock_of(bench, arm) == ("Idle", None), what="the release")
    assert caplog.text.count("stays locked") == 1
    monkeypatch.setattr(devices, "LOG_PERIOD", 0.0)
    locks_in(bench.wmi)._log_refusal(arm.id, "not now")
    locks_in(bench.wmi)._log_refusal(arm.id, "not now")
    assert caplog.text.count("stays locked") == 3


def test_lock_is_refused_while_another_call_hangs(bench, arm, monkeypatch):
    monkeypatch.setattr(devices, "_ACQUIRE_TIMEOUT", 0.05)
    second = bench.add("rparts:ArmDevice", "second", StateProperty="Idle")
    reached, released = threading.Event(), threading.Event()
    bench.wmi.before.append(lambda _: (reached.set(), released.wait(20.0)))
    locks = locks_in(bench.wmi)
    hanging = threading.Thread(target=locks.acquire, args=(arm.id, "a", bench.wmi))
    hanging.start()
    try:
        assert reached.wait(10.0)
        with pytest.raises(Refused, match="has not answered another request"):
            locks.acquire(second.id, "b", bench.wmi)
    finally:
        released.set()
        hanging.join(10.0)
    locks.acquire(second.id, "b", bench.wmi)


def test_failed_release_does_not_block_other_devices(bench, arm):
    second = bench.add("rparts:ArmDevice", "second", StateProperty="Idle")
    bench.load(primitive(describe("Move", [LOCKED_ARM, SECOND_ARM]), "move", execute=lambda self: self.step()))
    task = bench.task(bench.node("move", Arm=arm, Second=second))
    task.tick()
    assert {lock_of(bench, arm), lock_of(bench, second)} == {("Busy", "/one")}
    bench.wmi.before.append(refuses)
    task.preempt()
    task.tick()
    assert {lock_of(bench, arm), lock_of(bench, second)} == {("Busy", "/one"), ("Idle", None)}


def test_lock_with_unknown_outcome_is_released(bench, arm, soon):
    bench.wmi.after.append(refuses)  # it was written, but the answer is lost
    task = moving(bench)
    assert task.state is State.Failure
    assert "not now" in message(task)
    wait_until(lambda: lock_of(bench, arm) == ("Idle", None), what="the release")


def test_late_release_keeps_new_lock_of_same_manager(bench, arm, soon):
    first = moving(bench)
    bench.wmi.after.append(refuses)  # it is free, but that is not known
    first.preempt()
    first.tick()
    second = bench.task(bench.node("move"))
    second.tick()
    wait_until(lambda: locks_in(bench.wmi)._retrying is None, what="the end of the attempts")
    assert lock_of(bench, arm) == ("Busy", "/one")
    second.preempt()
    second.tick()
    assert lock_of(bench, arm) == ("Idle", None)


def test_device_is_released_when_second_lock_fails(bench, arm):
    second = bench.add("rparts:ArmDevice", "second", StateProperty="Idle")
    bench.load(primitive(describe("Move", [LOCKED_ARM, SECOND_ARM]), "move"))
    bench.wmi.before += [lambda _: None, refuses]
    task = bench.run(bench.node("move", Arm=arm, Second=second))
    assert task.state is State.Failure
    assert lock_of(bench, arm) == ("Idle", None)


def test_exception_in_tick_releases_devices(bench, arm):
    task = moving(bench)
    task.root.children[0].visit = raises_anything
    task.tick()
    assert task.state is State.Failure
    assert lock_of(bench, arm) == ("Idle", None)


def test_exception_between_lock_and_start_releases_devices(bench, arm, monkeypatch):
    monkeypatch.setattr(Executor, "_start_run", raises_anything)
    task = moving(bench)
    assert task.state is State.Failure
    assert lock_of(bench, arm) == ("Idle", None)


def test_abandoned_task_releases_devices(bench, arm):
    returns, inside = threading.Event(), threading.Event()

    def hangs(self):
        inside.set()
        returns.wait(30.0)
        return self.success("late")

    bench.load(primitive(describe("Move", [LOCKED_ARM]), "move", execute=hangs))
    scheduler = Scheduler(preempt_timeout=0.2)
    task = scheduler.new_task(bench.wmi, "tests")
    task.root(bench.node("move"))
    try:
        scheduler.start(task.id)
        assert inside.wait(10.0)
        scheduler.preempt(task.id)
        assert task.ended.wait(10.0)
        assert lock_of(bench, arm) == ("Idle", None)
    finally:
        returns.set()
        scheduler.stop()


def test_lock_acquired_after_abandonment_is_released(bench, arm, soon, monkeypatch):
    monkeypatch.setattr(devices, "_RELEASE_TIMEOUT", 0.05)
    goes_on, inside = threading.Event(), threading.Event()

    def hangs(_):
        inside.set()
        goes_on.wait(30.0)

    bench.load(primitive(describe("Move", [LOCKED_ARM]), "move"))
    bench.wmi.before.append(hangs)
    scheduler = Scheduler(preempt_timeout=0.2)
    task = scheduler.new_task(bench.wmi, "tests")
    task.root(bench.node("move"))
    try:
        scheduler.start(task.id)
        assert inside.wait(10.0)
        scheduler.preempt(task.id)
        assert task.ended.wait(10.0)
        changes = []
        bench.wmi.add_listener(lambda change: changes.extend(e.value_of(STATE) for e in change.elements))
        goes_on.set()
        wait_until(lambda: changes == ["Busy", "Idle"], what="the lock and its release")
        assert lock_of(bench, arm) == ("Idle", None)
    finally:
        goes_on.set()
        scheduler.stop()


def test_shutdown_releases_devices(bench, arm):
    bench.load(primitive(describe("Move", [LOCKED_ARM]), "move", execute=lambda self: self.step()))
    scheduler = Scheduler()
    task = scheduler.new_task(bench.wmi, "tests")
    task.root(bench.node("move"))
    scheduler.start(task.id)
    wait_until(lambda: lock_of(bench, arm) == ("Busy", "/one"), what="the lock")
    scheduler.stop()
    assert lock_of(bench, arm) == ("Idle", None)


def test_only_locks_of_former_process_are_released(bench, other, arm):
    moving(bench)
    left = bench.add("rparts:ArmDevice", "left", StateProperty="Busy", LockedBy="/one")
    foreign = bench.add("rparts:ArmDevice", "foreign", StateProperty="Busy", LockedBy="/two")
    release_stale_devices(bench.wmi)
    assert lock_of(bench, left) == ("Idle", None)
    assert lock_of(bench, arm) == ("Busy", "/one")
    assert lock_of(bench, foreign) == ("Busy", "/two")
