"""Names of a hostile length in the window: it shows a part of them, and stays fast and as large as it is."""

from __future__ import annotations

import time
from collections.abc import Iterator

import pytest
from pytestqt.qtbot import QtBot

from gui.test_world_tab import BOX, Desk
from skiros2_gui.world.widgets.dialogs import RemoveDialog

#: The most time (s), on a loaded machine; without limits on names it took a minute, and some ended the process.
PATIENCE = 20.0


@pytest.fixture
def desk(qtbot: QtBot) -> Iterator[Desk]:
    yield Desk(qtbot)


@pytest.mark.parametrize(
    ("label", "etype"),
    [
        ("x" * 1_000_000, BOX),
        ("<b>y</b> " * 100_000, BOX),
        ("a\n" * 100_000, BOX),
        ("\u202e" * 100_000, BOX),
        ("", "skiros:" + "X" * 100_000),
    ],
)
def test_long_names_leave_the_window_usable(desk: Desk, label: str, etype: str) -> None:
    size, width = desk.tab.size(), max(desk.tab.minimumSizeHint().width(), 2000)
    start = time.monotonic()
    box = desk.add(label, etype=etype)
    desk.select(box)
    desk.tab.remove_button.click()
    dialog = desk.dialog(RemoveDialog)
    desk.window.process_events()
    assert len(dialog.text.text()) < 300
    dialog.reject()
    desk.tab.grab()
    assert (desk.tab.size(), desk.tab.minimumSizeHint().width() <= width) == (size, True)
    assert desk.tab.presenter.selected == box
    assert time.monotonic() - start < PATIENCE
