"""What holds for all tests.

- Every test has the marker of the folder it lies in: `pytest -m "unit or contract"` needs no mark in the files.
- A run that is told to end (SIGTERM) ends like one that is interrupted: with all that it has started.
"""

import signal
from pathlib import Path

import pytest

TESTS = Path(__file__).parent


def pytest_configure(config: pytest.Config) -> None:
    signal.signal(signal.SIGTERM, signal.default_int_handler)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        item.add_marker(item.path.relative_to(TESTS).parts[0])
