"""Clients of a world model node that hangs: their calls end, and it serves them when it continues."""

from __future__ import annotations

import signal
import threading
import time
from pathlib import Path
from typing import Any

import pytest

from skiros2_common.core.world_element import Element
from skiros2_world_model.core.wm_errors import WmException
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.programs import Program
from support.ros import INSTALL, Ros

NODE = INSTALL / "lib/skiros2_world_model/world_model_server_node"


@pytest.fixture
def node(ros: Ros, tmp_path: Path) -> Program:
    ros.master.set_parameter("/wm/workspace_dir", str(tmp_path))
    node = ros.program(str(NODE), "__name:=wm")
    node.wait_for_line("the world model is ready")
    return node


def limit(wmi: WorldModelInterface, seconds: float) -> None:
    """Sets the time in which services have to answer."""
    services = wmi.remote.services
    for pool in (services.get, services.transaction, services.validation, services.files):
        pool._answer_timeout = pool.timeout = seconds
        for proxy in pool._idle:
            proxy.transport.set_limit(seconds)


def test_calls_of_a_server_that_hangs_end(node: Program) -> None:
    known, fresh = WorldModelInterface("known"), WorldModelInterface("fresh")
    element = known.add_element(Element("skiros:Part", "part"))
    assert known.validate() is not None
    for wmi in (known, fresh):
        limit(wmi, 0.3)
    node.signal(signal.SIGSTOP)
    try:
        for wmi in (known, fresh):  # one has connections, the other connects now
            calls: list[Any] = [
                lambda: wmi.get_element(element.id),  # noqa: B023
                lambda: wmi.add_element(Element("skiros:Part", "lost")),  # noqa: B023
                wmi.validate,
                wmi.save,
            ]
            for call in calls:
                start = time.monotonic()
                with pytest.raises(WmException, match=r"has not answered for 0\.3 s|does not answer"):
                    call()
                assert time.monotonic() - start < 8.0
    finally:
        node.signal(signal.SIGCONT)
    limit(known, 30.0)  # the server may be slow after that
    assert known.find_element(element.id) is not None


def test_listener_that_raises_does_not_skip_the_others(node: Program, caplog: pytest.LogCaptureFixture) -> None:
    wmi, seen, told = WorldModelInterface("listener", make_cache=True), threading.Event(), threading.Event()

    def raises(change: Any) -> None:
        raise RuntimeError("a listener's mistake")

    wmi.add_listener(raises)
    wmi.add_listener(lambda change: seen.set())
    wmi.set_monitor_cb(lambda message: told.set())
    wmi.add_element(Element("skiros:Part", "part"))
    assert seen.wait(10.0)
    assert told.wait(10.0)
    assert "a listener failed on a change" in caplog.text
