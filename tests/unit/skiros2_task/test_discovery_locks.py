"""Waiting for a skill manager and the discovery of one do not block each other."""

from __future__ import annotations

import threading
import time
from typing import Any

import pytest

pytest.importorskip("rospy")

from skiros2_task.ros import step_runner
from skiros2_task.ros.step_runner import ManagerStepRunner


def test_manager_comes_up_while_a_goal_asks_for_the_robots(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(step_runner, "_robot_of", lambda name: name)
    monkeypatch.setattr(step_runner, "_DISCOVERY_TIMEOUT", 20.0)
    runner: Any = object.__new__(ManagerStepRunner)  # without a node
    runner._discovery_lock, runner._discovered = threading.RLock(), threading.Condition()
    runner._agents, runner._absent = {"/one": None}, set()
    found: list[dict[str, str]] = []
    asking = threading.Thread(target=lambda: found.append(runner.robots(["/one", "/two"])), daemon=True)
    with runner._discovery_lock:  # as the thread of ROS that calls `_on_agent`
        asking.start()
        time.sleep(0.2)
        assert runner._discovered.acquire(timeout=5.0)
        runner._agents["/two"] = None
        runner._discovered.notify_all()
        runner._discovered.release()
    asking.join(10.0)
    assert found == [{"/one": "/one", "/two": "/two"}]
