"""The selected element is movable in rviz."""

from __future__ import annotations

from pytestqt.qtbot import QtBot

from skiros2_gui.app.events import ElementSelected, EventQueue, ProblemReported
from skiros2_gui.app.widgets.main_widget import MainWidget
from support.window.local_system import LocalSystem


def test_selection_is_movable_in_rviz_and_failures_are_reported(qtbot: QtBot) -> None:
    event_queues: list[EventQueue] = []

    def connect(event_queue: EventQueue) -> LocalSystem:
        event_queues.append(event_queue)
        return LocalSystem(event_queue)

    window = MainWidget(connect)
    qtbot.addWidget(window, before_close_func=MainWidget.shut_down)
    window.shared.publish(ElementSelected("skiros:Scene-0"))
    assert window.system.movable == "skiros:Scene-0"
    event_queues[0].put(ProblemReported("moving skiros:Part-1", "it is gone"))
    qtbot.waitUntil(lambda: window.shared.problems.newest is not None)
    assert window.shared.problems.newest.line == "moving skiros:Part-1: it is gone"
