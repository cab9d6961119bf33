"""How nodes end when a signal asks them to.

rospy runs the shutdown hooks on top of whatever the main thread is at. When that holds a lock, of logging for example,
and a hook or a thread that the hook waits for needs it, the node never ends. Here they run in a thread of their own.
"""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from queue import SimpleQueue

import rospy

_PERIOD = 0.5  # s, how often is looked whether ROS has shut the node down by itself

_ender: _Ender | None = None


class _Ender(threading.Thread):
    """Shuts the node down when it is told to."""

    def __init__(self) -> None:
        super().__init__(name="end")
        self._told: SimpleQueue[str] = SimpleQueue()
        self.began = threading.Event()

    def tell(self, reason: str) -> None:
        """For signal handlers too: holds no lock that the thread below the handler may hold."""
        self._told.put(reason)

    def run(self) -> None:
        reason = self._told.get()
        self.began.set()
        rospy.signal_shutdown(reason)


@contextlib.contextmanager
def shutdown_in_thread() -> Iterator[None]:
    """Within it a signal to end shuts the node down in a thread of its own, and so does the end of it.

    For the main thread, with `rospy.init_node(..., disable_signals=True)` inside. The main thread goes on meanwhile: it
    has to ask `rospy.is_shutdown`, or to call `spin`.
    """
    global _ender
    _ender = ender = _Ender()
    ender.start()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: ender.tell(f"signal {number}"))
    try:
        yield
    finally:
        ender.tell("the program is over")
        ender.join()


def spin() -> None:
    """As `rospy.spin`, within `shutdown_in_thread`: returns when a signal has shut the node down, hooks and all."""
    assert _ender is not None, "spin is for within ended_beside_main"
    while not rospy.is_shutdown() and not _ender.began.wait(_PERIOD):
        pass
    if _ender.began.is_set():
        _ender.join()
