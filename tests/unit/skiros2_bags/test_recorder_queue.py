"""The recorder's memory for messages that wait for the disk is bounded."""

from __future__ import annotations

import queue
import threading

import pytest

pytest.importorskip("rospy")

from skiros2_bags.ros import recorder
from skiros2_bags.ros.recorder import Recorder


def test_messages_beyond_the_limit_are_counted_and_logged_once(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(recorder, "MAX_WAITING", 1000)
    waiting = object.__new__(Recorder)  # without a node
    waiting.lost = waiting._waiting = 0
    waiting._queue, waiting._arrival = queue.Queue(), threading.Lock()
    for _ in range(100):
        waiting._put("/said", {}, b"x" * 100)
    assert (waiting._queue.qsize(), waiting.lost) == (10, 90)
    assert caplog.text.count("some are lost") == 1
