"""The age of a driver's state, by a simulated and a wall clock."""

from __future__ import annotations

import pytest

from skiros2_motion.core.compliant_arm import STALE
from skiros2_motion.core.state_age import CONFIRMATION, SILENT, StateAge


class Clocks:
    """Two clocks and an age that uses them."""

    def __init__(self) -> None:
        self.arm = self.wall = 10.0
        self.age = StateAge(lambda: self.arm, lambda: self.wall)

    def overdue_after(self, arm: float, wall: float) -> float:
        self.arm += arm
        self.wall += wall
        return self.age.overdue()


@pytest.fixture
def clocks() -> Clocks:
    return Clocks()


def test_driver_that_stays_silent_is_reported_with_the_time(clocks: Clocks) -> None:
    assert clocks.overdue_after(STALE - 0.1, 0.4) == 0.0
    assert clocks.overdue_after(0.2, 0.2) == 0.0
    assert clocks.overdue_after(0.3, CONFIRMATION + 0.01) == pytest.approx(STALE + 0.4)
    clocks.age.receive()
    assert clocks.overdue_after(0.1, 0.1) == 0.0


def test_process_that_was_held_up_reads_the_waiting_states_first(clocks: Clocks) -> None:
    assert clocks.overdue_after(3.0, 3.0) == 0.0
    clocks.age.receive()
    assert clocks.overdue_after(0.1, CONFIRMATION + 0.1) == 0.0
    assert clocks.overdue_after(3.0, 3.0) == 0.0, "each time"


def test_paused_simulator_that_sends_its_state_again_is_not_dead(clocks: Clocks) -> None:
    for _ in range(20):
        clocks.age.receive()
        assert clocks.overdue_after(0.0, 0.5) == 0.0


def test_dead_simulator_is_found_by_wall_time_while_its_clock_stands(clocks: Clocks) -> None:
    assert clocks.overdue_after(0.0, SILENT - 0.1) == 0.0
    assert clocks.overdue_after(0.0, 0.2) == 0.0
    assert clocks.overdue_after(0.0, CONFIRMATION + 0.01) == pytest.approx(SILENT + 0.31)


def test_dead_simulator_is_found_after_its_clock_has_begun_again(clocks: Clocks) -> None:
    clocks.arm = 0.1
    assert clocks.overdue_after(0.0, SILENT + 0.1) == 0.0
    assert clocks.overdue_after(0.1, CONFIRMATION + 0.01) > SILENT
