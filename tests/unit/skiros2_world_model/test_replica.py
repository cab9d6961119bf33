"""A client's replica follows the server, also when changes arrive late, twice or not at all."""

import threading

import pytest

from skiros2_common.core.world_element import Element
from skiros2_world_model.core.local_world_model import LocalWorldModel
from skiros2_world_model.core.replica import Replica, Snapshot
from skiros2_world_model.core.world_model import WorldModel


class Server:
    """A world model, its published changes, and the number of fetched snapshots."""

    def __init__(self, model):
        self.model = model
        self.wm = LocalWorldModel("server", model)
        self.published = []
        self.fetched = 0
        model.add_listener(self.published.append)

    def snapshot(self):
        self.fetched += 1
        scene = self.model.scene()
        return Snapshot(self.model.snapshot_id, self.model.number, [scene.element(n.id) for n in scene])

    def add(self, label, parent="skiros:Scene-0"):
        element = Element("skiros:Product", label)
        element.addRelation(parent, "skiros:contain", "-1")
        self.wm.add_element(element)
        return element


@pytest.fixture
def server(model):
    return Server(model)


@pytest.fixture
def replica(server):
    replica = Replica(server.snapshot, timeout=0.05)
    replica.refresh()
    return replica


def content(scene):
    return (
        {n.id: (n.type, n.label, {k: p.values for k, p in n.properties.items()}) for n in scene},
        set(scene.relations()),
    )


def same(replica, server):
    replica.refresh()
    return content(replica.scene()) == content(server.model.scene())


def test_it_starts_from_a_snapshot(server, replica):
    assert same(replica, server)
    assert server.fetched == 1


def test_it_follows_changes_without_asking(server, replica):
    tray = server.add("tray")
    part = server.add("part", tray.id)
    part.setProperty("skiros:Weight", 2.0)
    server.wm.update_element(part)
    server.wm.set_relation("skiros:Scene-0", "skiros:at", part.id)
    server.wm.set_relation("skiros:Scene-0", "skiros:at", part.id, False)
    server.wm.remove_element(tray)
    for change in server.published:
        replica.follow(change)
    assert same(replica, server)
    assert server.fetched == 1


def test_a_change_that_was_missed_is_noticed_at_the_next_one(server, replica):
    for label in "abc":
        server.add(label)
    replica.follow(server.published[0])
    replica.follow(server.published[2])
    assert same(replica, server)
    assert server.fetched == 2


def test_changes_between_the_snapshot_and_the_first_that_it_hears_are_noticed(server, replica):
    for label in "ab":
        server.add(label)
    replica.follow(server.published[1])  # as of a topic that keeps the last message for those who come late
    assert same(replica, server)
    assert server.fetched == 2


def test_changes_before_those_that_come_during_the_fetch_are_noticed(server):
    def fetch():
        snapshot = server.snapshot()
        if server.fetched == 1:
            for label in "ab":
                server.add(label)
            replica.follow(server.published[1])
        return snapshot

    replica = Replica(fetch, timeout=0.05)
    replica.refresh()
    assert same(replica, server)
    assert server.fetched == 2


def test_a_gap_before_the_snapshot_does_no_harm(server, replica):
    for label in "abc":
        server.add(label)
    replica.follow(server.published[0])
    replica.follow(server.published[2])
    replica.refresh()
    replica.follow(server.published[2])
    server.add("d")
    replica.follow(server.published[3])
    assert same(replica, server)
    assert server.fetched == 2


def test_a_change_that_comes_twice_counts_once(server, replica):
    server.add("a")
    server.add("b")
    for change in (server.published[0], server.published[0], server.published[1], server.published[1]):
        replica.follow(change)
    assert same(replica, server)
    assert server.fetched == 1


def test_its_own_change_is_read_at_once_and_counts_once_when_it_is_published(server, replica):
    server.add("a")
    replica.include(server.published)
    assert same(replica, server)
    version = replica.version
    replica.follow(server.published[0])
    assert replica.version == version
    assert server.fetched == 1


def test_its_own_change_waits_for_those_of_others_before_it(server):
    replica = Replica(server.snapshot, timeout=10.0)
    replica.refresh()
    server.add("other's")
    server.add("own")
    others, own = server.published
    writer = threading.Thread(target=replica.include, args=([own],))
    writer.start()
    replica.follow(others)
    writer.join(5.0)
    assert not writer.is_alive()
    assert same(replica, server)
    assert server.fetched == 1


def test_missing_earlier_changes_lead_to_a_new_fetch(server, replica):
    server.add("other's")
    server.add("own")
    replica.include([server.published[1]])
    assert same(replica, server)
    assert server.fetched == 2


def test_a_change_during_the_fetch_is_not_lost(server, model):
    taken = []

    def fetch():
        snapshot = server.snapshot()
        server.add("meanwhile")
        replica.follow(server.published[-1])
        taken.append(snapshot)
        return snapshot

    replica = Replica(fetch, timeout=0.05)
    replica.refresh()
    assert same(replica, server)
    assert len(taken) == 1


def test_a_loaded_scene_is_fetched(server, replica, workspace):
    server.wm.save("scene.ttl")
    server.add("gone with the reset")
    server.wm.load("scene.ttl")
    for change in server.published:
        replica.follow(change)
    assert same(replica, server)


def test_restarted_server_with_equal_numbers_is_detected(server, replica, workspace):
    server.add("a")
    replica.follow(server.published[0])
    server.__init__(WorldModel(None, workspace))
    server.add("b")
    replica.follow(server.published[0])
    assert same(replica, server)


def test_its_version_changes_with_every_change_that_it_sees(server, replica):
    versions = [replica.version]
    for label in "ab":
        server.add(label)
        replica.follow(server.published[-1])
        versions.append(replica.version)
    assert len(set(versions)) == 3


def test_nothing_piles_up_in_a_replica_that_nobody_reads(server):
    replica = Replica(server.snapshot)
    for label in "abc":
        server.add(label)
        replica.follow(server.published[-1])
    assert replica._waiting == {}
    assert same(replica, server)
