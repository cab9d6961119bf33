"""Shutdown of a node by a signal, with the shutdown hooks in a separate thread.

rospy runs the hooks in the signal handler, on top of the main thread's current frame. If that frame holds a lock, for
example of logging, that a hook needs, the node deadlocks.
"""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from queue import SimpleQueue

import rospy

_POLL_PERIOD = 0.5  # s, for a shutdown by ROS itself

_shutdown_thread: _ShutdownThread | None = None


class _ShutdownThread(threading.Thread):
    """Shuts the node down on request."""

    def __init__(self) -> None:
        super().__init__(name="shutdown")
        self._reasons: SimpleQueue[str] = SimpleQueue()
        self.started = threading.Event()

    def request(self, reason: str) -> None:
        """Requests the shutdown. Safe in signal handlers: it takes no lock that the interrupted thread may hold."""
        self._reasons.put(reason)

    def run(self) -> None:
        reason = self._reasons.get()
        self.started.set()
        rospy.signal_shutdown(reason)


@contextlib.contextmanager
def shutdown_in_thread() -> Iterator[None]:
    """A context manager: SIGINT, SIGTERM and its end shut the node down in a separate thread.

    For the main thread, with `rospy.init_node(..., disable_signals=True)` inside. The main thread continues during the
    shutdown: it has to check `rospy.is_shutdown` or to call `spin`.
    """
    global _shutdown_thread
    _shutdown_thread = thread = _ShutdownThread()
    thread.start()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: thread.request(f"signal {number}"))
    try:
        yield
    finally:
        thread.request("the program has ended")
        thread.join()


def spin() -> None:
    """Same as `rospy.spin`, for use in `shutdown_in_thread`: returns after all shutdown hooks have run."""
    assert _shutdown_thread is not None, "spin requires shutdown_in_thread"
    while not rospy.is_shutdown() and not _shutdown_thread.started.wait(_POLL_PERIOD):
        pass
    if _shutdown_thread.started.is_set():
        _shutdown_thread.join()
