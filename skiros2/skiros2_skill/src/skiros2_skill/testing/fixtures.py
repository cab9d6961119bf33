"""Fixtures for pytest."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from skiros2_skill.testing.bench import SkillBench
from skiros2_skill.testing.fake_clock import FakeClock


@pytest.fixture
def fake_clock() -> Iterator[FakeClock]:
    """The time of this process, for all code that uses the module `time` or rospy; the test advances it."""
    with FakeClock() as clock:
        yield clock


@pytest.fixture
def skill_bench(request: pytest.FixtureRequest) -> Iterator[SkillBench]:
    """A blank scene with a robot and no skills. With `fake_clock`, each tick advances the clock by one period."""
    clock = request.getfixturevalue("fake_clock") if "fake_clock" in request.fixturenames else None
    with SkillBench(clock=clock) as bench:
        yield bench
