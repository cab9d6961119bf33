"""Descriptors of topics that are closed with their topic.

rospy watches the connections of each topic with an epoll descriptor. Its `Poller` holds bound methods of itself: the
descriptor stays open until Python's next full garbage collection, which may be hours away in a busy node.
"""

from __future__ import annotations

import select

from rospy import topics


class _Poller(topics.Poller):  # type: ignore[misc]
    """rospy's poller, without references to itself."""

    add_fd = topics.Poller.add_epoll
    remove_fd = topics.Poller.remove_epoll
    error_iter = topics.Poller.error_epoll_iter

    def __init__(self) -> None:
        self.poller = select.epoll()


def close_polls_with_topics() -> None:
    """Has the topics that are created from now on close their descriptors with them."""
    topics.Poller = _Poller
