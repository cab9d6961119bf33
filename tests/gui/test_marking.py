"""What is selected can be moved in rviz, and the window says what could not be moved."""

from __future__ import annotations

from pytestqt.qtbot import QtBot

from skiros2_gui.core.events import ElementSelected, ProblemHeard
from skiros2_gui.core.inbox import Inbox
from skiros2_gui.qt.main_widget import MainWidget
from skiros2_gui.testing.local_system import LocalSystem


def test_views_beside_the_window_are_told_what_is_selected_and_tell_what_went_wrong(qtbot: QtBot) -> None:
    inboxes: list[Inbox] = []

    def connect(inbox: Inbox) -> LocalSystem:
        inboxes.append(inbox)
        return LocalSystem(inbox)

    window = MainWidget(connect)
    qtbot.addWidget(window, before_close_func=MainWidget.shut_down)
    window.shared.tell(ElementSelected("skiros:Scene-0"))
    assert window.system.marked == "skiros:Scene-0"
    inboxes[0].put(ProblemHeard("moving skiros:Part-1", "it is gone"))
    qtbot.waitUntil(lambda: window.shared.problems.newest is not None)
    assert window.shared.problems.newest.line == "moving skiros:Part-1: it is gone"
