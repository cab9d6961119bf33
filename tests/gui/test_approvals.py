"""Approvals in the window, at a gateway that runs in another thread."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Coroutine, Iterator
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import pytest
from pytestqt.qtbot import QtBot

from skiros2_common.core.errors import Refused
from skiros2_common.core.world_element import Element
from skiros2_gateway.agents.server import AgentServer
from skiros2_gateway.core.access import Caller, Role
from skiros2_gateway.core.approvals import Request
from skiros2_gui.app.widgets.main_widget import MainWidget
from support.http_gateway import served
from support.window.driver import Driver
from support.window.local_system import LocalSystem
from unit.skiros2_gateway.conftest import TOKENS, Gateway

_ROBOT = "/arm"


class Served:
    """A gateway at `address`, in the thread of its own loop."""

    def __init__(self, folder: Path) -> None:
        self.address = ""
        self._folder = folder
        self._loop = asyncio.new_event_loop()
        self._is_up, self._end = threading.Event(), asyncio.Event()
        self._thread = threading.Thread(target=self._loop.run_until_complete, args=(self._serve(),))
        self._thread.start()
        assert self._is_up.wait(60.0)

    async def _serve(self) -> None:
        self.gateway = Gateway(self._folder / "jobs.sqlite")
        server = AgentServer(self.gateway.service)
        async with server.running(), served(self.gateway.service, routers=[server.router()]) as self.address:
            self._is_up.set()
            await self._end.wait()

    def _start(self, work: Coroutine[Any, Any, str]) -> Future[str]:
        return asyncio.run_coroutine_threadsafe(work, self._loop)

    def ask(self, user: str = "agent", **what: Any) -> Future[str]:
        """Asks for an approval. The result is the name of the user who approves."""
        reason = what.pop("reason", "")
        request = Request(what, {}, (_ROBOT,), reason)
        return self._start(self.gateway.service.approvals.request(Caller(user, Role.AGENT, "mcp"), request))

    def user_that_answered(self) -> list[tuple[str, str]]:
        """Returns who has answered, of the audit log, with the answer."""

        async def read() -> str:
            log = self.gateway.access.audit_log(0, 100)
            return "\n".join(f"{each['user']} {each['action']}" for each in log if each["outcome"] == "done")

        lines = self._start(read()).result(30.0).splitlines()
        return [(user, action) for user, _, action in (line.partition(" ") for line in lines)]

    def close(self) -> None:
        self._loop.call_soon_threadsafe(self._end.set)
        self._thread.join()
        self._loop.close()


@pytest.fixture
def served_gateway(tmp_path: Path) -> Iterator[Served]:
    made = Served(tmp_path)
    yield made
    made.close()


@pytest.fixture
def driver(qtbot: QtBot, served_gateway: Served) -> Iterator[Driver]:
    window = MainWidget(LocalSystem)
    qtbot.addWidget(window, before_close_func=MainWidget.shut_down)
    window.show()
    assert not window.approvals.isVisible()
    window.system.gateway = served_gateway.address
    window.approvals.presenter.refresh()
    yield Driver(window)


def _log_in(driver: Driver, secret: str) -> None:
    driver.click("approvalsButton")
    driver.wait_until(lambda: driver.widget("gateway").text(), "the address")
    driver.write("secret", secret)
    driver.click("logIn")


def _text(driver: Driver) -> str:
    return str(driver.widget("approvalText").toPlainText())


def test_button_is_hidden_without_a_gateway(qtbot: QtBot) -> None:
    window = MainWidget(LocalSystem)
    qtbot.addWidget(window, before_close_func=MainWidget.shut_down)
    window.show()
    Driver(window).process_for(0.1)
    assert not window.approvals.isVisible()


def test_person_reads_what_an_agent_asks_for_and_approves_it(driver: Driver, served_gateway: Served) -> None:
    world = driver.window.system.world
    tray = world.add_element(Element("skiros:Location", "Tray B")).id
    part = world.add_element(Element("skiros:Product", "Part A")).id
    step = {"label": "place", "arguments": {"Tray": tray, "Object": part}, "robot": _ROBOT}
    answer = served_gateway.ask(
        goal=f"(skiros:contain {tray} {part})", order={"id": "order-7"}, plan=[step],
        changes=[f"{tray} contains {part}"], reason="the tray is needed",
    )  # fmt: skip
    _log_in(driver, TOKENS["approve"])
    driver.wait_until(lambda: _text(driver), "the request")
    assert _text(driver).startswith("Tray B contains Part A\n")
    expected = (
        "Agent: agent",
        "Reason: the tray is needed",
        "Robots: arm",
        "Job: order-7",
        "1. place: Tray B, Part A (arm)",
    )
    for text in (*expected, "Expected changes:\n  Tray B contains Part A"):
        assert text in _text(driver)
    assert tray in driver.widget("approvalText").toolTip(), "a label may be misleading"
    assert driver.widget("approvalsButton").text() == "1 approval waits"
    driver.click("approveButton")
    driver.wait_until(answer.done, "the answer")
    assert answer.result() == "approve"
    driver.wait_until(lambda: not driver.rows("approvalList"), "the end")
    assert ("approve", "approve") in served_gateway.user_that_answered()


def test_agent_learns_the_reason_of_a_rejection(driver: Driver, served_gateway: Served) -> None:
    answer = served_gateway.ask(skill="place", robot=_ROBOT, implementation="place_fast", values={"Speed": "2.0"})
    _log_in(driver, TOKENS["approve"])
    driver.wait_until(lambda: _text(driver), "the request")
    assert "place_fast" in _text(driver) and "Parameters: Speed 2.0" in _text(driver)
    driver.write("answerReason", "too fast")
    driver.click("rejectButton")
    driver.wait_until(answer.done, "the answer")
    with pytest.raises(Refused, match="approve has rejected it: too fast"):
        answer.result()


def test_who_may_not_answer_reads(driver: Driver, served_gateway: Served) -> None:
    answer = served_gateway.ask(skill="place")
    _log_in(driver, "a wrong token")
    driver.wait_until(lambda: "token" in driver.widget("approvalNote").text(), "the reason")
    driver.write("secret", TOKENS["operate"])
    driver.click("logIn")
    driver.wait_until(lambda: _text(driver), "the request")
    assert not driver.widget("approveButton").isEnabled()
    assert "role approve" in driver.widget("approvalNote").text()
    driver.click("logOut")
    assert not answer.done() and driver.widget("secret").isVisible()


def test_selection_does_not_move_to_another_request_when_one_ends(driver: Driver, served_gateway: Served) -> None:
    first, second = served_gateway.ask(skill="first"), served_gateway.ask(skill="second")
    _log_in(driver, TOKENS["approve"])
    driver.wait_until(lambda: len(driver.rows("approvalList")) == 2, "both")
    driver.choose("approvalList", "agent: first")
    first.cancel()
    driver.wait_until(lambda: len(driver.rows("approvalList")) == 1, "the end of one")
    assert not driver.widget("approveButton").isEnabled() and not _text(driver)
    driver.choose("approvalList", "agent: second")
    driver.click("approveButton")
    driver.wait_until(second.done, "the answer")
