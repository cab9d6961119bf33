"""Descriptors of topics that are closed with their topic.

rospy watches the connections of each topic with an epoll descriptor. Its `Poller` holds bound methods of itself, and a
closed connection its topic: the descriptor would stay open until Python's next full garbage collection, which may be
hours away in a busy node.
"""

from __future__ import annotations

import select
from collections.abc import Iterator
from typing import Any

from rospy import topics


class _Poller(topics.Poller):  # type: ignore[misc]
    """rospy's poller, without references to itself. Finds nothing once it is closed."""

    add_fd = topics.Poller.add_epoll
    remove_fd = topics.Poller.remove_epoll

    def __init__(self) -> None:
        self.poller = select.epoll()

    def error_iter(self) -> Iterator[int]:
        try:
            yield from self.error_epoll_iter()
        except ValueError:
            if not self.poller.closed:
                raise

    def close(self) -> None:
        self.poller.close()


def close_polls_with_topics() -> None:
    """Has the topics that are created from now on close their descriptors with them."""
    if topics.Poller is _Poller:
        return
    topics.Poller, close = _Poller, topics._TopicImpl.close

    def close_with_poll(topic: Any) -> None:
        close(topic)
        if isinstance(topic.connection_poll, _Poller):
            topic.connection_poll.close()

    topics._TopicImpl.close = close_with_poll
