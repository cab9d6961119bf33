"""Widgets are drawn offscreen, unless a platform is set."""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator

import pytest

from unit.skiros2_gui.conftest import window

__all__ = ["garbage_of_this_thread", "window"]

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")


@pytest.fixture(scope="module", autouse=True)
def garbage_of_this_thread() -> Iterator[None]:
    """Closed windows are collected in this thread: in another one, Qt crashes (see `Collector`)."""
    gc.disable()
    yield
    gc.collect()
    gc.enable()
