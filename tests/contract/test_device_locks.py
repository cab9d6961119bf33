"""Locks on devices through each adapter of the world model: of several managers one has a device."""

from __future__ import annotations

import threading

import pytest

from skiros2_common.core.errors import Refused
from skiros2_skill.core.engine.devices import locks_in, release_stale_devices

ROUNDS = 30


@pytest.fixture
def arm(world):
    return world.add("rparts:ArmDevice", "arm", StateProperty="Idle")


def state(wm, arm):
    wm.catch_up()
    found = wm.get_element(arm.id)
    return found.value_of("skiros:StateProperty"), found.value_of("skiros:LockedBy")


def test_one_of_two_concurrent_device_locks_succeeds(world, arm):
    managers = [world.connect("/one"), world.connect("/two")]
    outcomes = {manager.author: [] for manager in managers}
    together = threading.Barrier(2)

    def compete(manager):
        locks = locks_in(manager)
        for _ in range(ROUNDS):
            together.wait(30.0)
            try:
                locks.acquire(arm.id, manager, manager)
                outcomes[manager.author].append("")
            except Refused as refused:
                outcomes[manager.author].append(str(refused))
            together.wait(30.0)
            locks.release([arm.id], manager, manager)
            manager.catch_up()
            together.wait(30.0)
            manager.catch_up()

    threads = [threading.Thread(target=compete, args=(manager,)) for manager in managers]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60.0)
    one, two = (outcomes[manager.author] for manager in managers)
    assert (len(one), len(two)) == (ROUNDS, ROUNDS)
    for mine, theirs in zip(one, two, strict=True):
        assert sorted([bool(mine), bool(theirs)]) == [False, True]
        assert (mine or theirs).endswith("is locked by /one" if theirs else "is locked by /two")
    assert state(world.wm, arm) == ("Idle", None)


def test_restarted_manager_releases_the_devices_of_its_former_process(world, arm):
    locks_in(former := world.connect("/one")).acquire(arm.id, former, former)
    assert state(world.wm, arm) == ("Busy", "/one")
    another, again = world.connect("/two"), world.connect("/one")
    release_stale_devices(another)
    assert state(world.wm, arm) == ("Busy", "/one")
    release_stale_devices(again)
    assert state(world.wm, arm) == ("Idle", None)
