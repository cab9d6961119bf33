"""A topic that is closed leaves no descriptor behind, also without a garbage collection."""

from __future__ import annotations

import gc
import os
import socket
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from rospy import topics
from std_msgs.msg import String

from skiros2_common.ros.topic_polls import close_polls_with_topics


@pytest.fixture(autouse=True)
def no_collection(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(topics, "Poller", topics.Poller)
    monkeypatch.setattr(topics._TopicImpl, "close", topics._TopicImpl.close)
    gc.disable()
    yield
    gc.enable()


def polls() -> int:
    links = [os.readlink(file) for file in Path("/proc/self/fd").iterdir() if file.is_symlink()]
    return links.count("anon_inode:[eventpoll]")


@pytest.mark.parametrize("kind", [topics._SubscriberImpl, topics._PublisherImpl])
def test_closed_topic_closes_its_descriptor(kind: Any) -> None:
    close_polls_with_topics()
    before = polls()
    for number in range(5):
        kind(f"/topic_{number}", String).close()
    assert polls() == before


def test_topic_that_somebody_holds_closes_its_descriptor() -> None:
    close_polls_with_topics()
    close_polls_with_topics()
    before = polls()
    topic = topics._PublisherImpl("/topic", String)
    topic.close()
    assert polls() == before
    topic.check()


def test_lost_connection_is_still_noticed() -> None:
    close_polls_with_topics()
    topic = topics._SubscriberImpl("/topic", String)
    ours, theirs = socket.socketpair()
    with ours:
        connection = SimpleNamespace(
            endpoint_id="/other", fileno=ours.fileno, close=ours.close, cleanup_cb=None,
            set_cleanup_callback=lambda callback: None,
        )  # fmt: skip
        topic.add_connection(connection)
        topic.check()
        assert topic.get_num_connections() == 1
        theirs.close()
        topic.check()
        assert topic.get_num_connections() == 0
    topic.close()
