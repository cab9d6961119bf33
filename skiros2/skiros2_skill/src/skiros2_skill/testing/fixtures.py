"""The fixtures of pytest."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from skiros2_skill.testing.bench import SkillBench
from skiros2_skill.testing.fake_clock import FakeClock


@pytest.fixture
def fake_clock() -> Iterator[FakeClock]:
    """The time of this process, which passes as the test says, for all code that asks the module `time` or rospy."""
    with FakeClock() as clock:
        yield clock


@pytest.fixture
def skill_bench(request: pytest.FixtureRequest) -> Iterator[SkillBench]:
    """A blank scene with a robot, and no skills. In a test that also has `fake_clock`, a tick takes a period of it."""
    clock = request.getfixturevalue("fake_clock") if "fake_clock" in request.fixturenames else None
    with SkillBench(clock=clock) as bench:
        yield bench
