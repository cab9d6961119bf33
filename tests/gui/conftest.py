"""Widgets are drawn offscreen, unless a platform is set."""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator
from functools import partial

import pytest
from pytestqt.qtbot import QtBot

from unit.skiros2_gui.conftest import window

__all__ = ["garbage_of_this_thread", "qtbot", "window"]

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")


@pytest.fixture(scope="module", autouse=True)
def garbage_of_this_thread() -> Iterator[None]:
    """Closed windows are collected in this thread: in another one, Qt crashes (see `Collector`)."""
    gc.disable()
    yield
    gc.collect()
    gc.enable()


@pytest.fixture
def qtbot(qtbot: QtBot, monkeypatch: pytest.MonkeyPatch) -> QtBot:
    """Waits up to 60 s instead of 5 s: other processes may hold up the machine."""
    monkeypatch.setattr(qtbot, "waitUntil", partial(qtbot.waitUntil, timeout=60_000))
    return qtbot
