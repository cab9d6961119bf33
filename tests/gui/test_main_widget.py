"""The window's content as a whole: tabs, what is up, what went wrong, keys."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from pytestqt.qtbot import QtBot

from skiros2_gui.qt.main_widget import MainWidget
from skiros2_gui.testing.local_system import LocalSystem


@pytest.fixture
def window(qtbot: QtBot) -> Iterator[MainWidget]:
    made = MainWidget(LocalSystem)
    qtbot.addWidget(made, before_close_func=MainWidget.shut_down)
    made.show()
    yield made


def test_it_has_a_tab_for_skills_for_what_runs_and_for_the_world(window: MainWidget) -> None:
    assert [window.tabs.tabText(i) for i in range(window.tabs.count())] == ["Skills", "Running", "World model"]


def test_a_world_model_that_goes_and_comes_greys_its_tab_out_meanwhile(window: MainWidget, qtbot: QtBot) -> None:
    page = window.pages[2]
    assert page.tab.isEnabled()
    window.system.set_up(False)
    qtbot.waitUntil(lambda: not page.tab.isEnabled())
    assert "has not been there since" in page.banner.text()
    assert window.status.parts[0].text() == "✕ world model"
    window.system.set_up(True)
    qtbot.waitUntil(page.tab.isEnabled)
    assert page.banner.text() == ""
