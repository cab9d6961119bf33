"""A window without widgets, of a system in this process."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from skiros2_gui.app.window import Window
from support.window.local_system import LocalSystem
from support.window.synchronous import make_window


@pytest.fixture
def window() -> Iterator[Window]:
    made = make_window(LocalSystem)
    yield made
    made.system.close()
