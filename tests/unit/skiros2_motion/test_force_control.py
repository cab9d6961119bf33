"""The loop for a force: on a spring, in the air, with its bounds."""

from __future__ import annotations

import math

import numpy as np
import pytest

from skiros2_common.core.errors import WrongValue
from skiros2_motion.core.force_control import ForceControl, ForceGoal, checked_goal

DT, STIFFNESS = 0.002, np.full(3, 2000.0)
DAMPING = 2.0 * np.sqrt(STIFFNESS)
GOAL = ForceGoal((0.0, 0.0, 8.0), speed=0.05, admittance=0.01)


def pressed_against(spring: float, loop: ForceControl, seconds: float, start: float = 0.0) -> tuple[list[float], float]:
    """Returns the forces on a tool of 4 kg that is pulled by the lead against a spring, and its largest speed."""
    position, speed, forces, largest = start, 0.0, [], 0.0
    for _ in range(round(seconds / DT)):
        force = spring * max(0.0, position)
        lead = loop.update(np.array([0.0, 0.0, force]), np.array([0.0, 0.0, speed]), STIFFNESS, DAMPING, DT)[2]
        for _ in range(20):
            force = spring * max(0.0, position)
            speed += (STIFFNESS[2] * lead - DAMPING[2] * speed - force) / 4.0 * DT / 20
            position += speed * DT / 20
        forces.append(force)
        largest = max(largest, speed)
    return forces, largest


@pytest.mark.parametrize("spring", [500.0, 5000.0, 100e3])
def test_force_is_reached_on_soft_and_hard_contacts(spring: float) -> None:
    forces, _ = pressed_against(spring, ForceControl(GOAL), 4.0)
    assert forces[-1] == pytest.approx(8.0, abs=0.1)


def test_tool_in_the_air_moves_with_about_the_speed_of_the_goal() -> None:
    _, largest = pressed_against(0.0, ForceControl(GOAL), 2.0)
    assert largest == pytest.approx(0.05, rel=0.2)


def test_lead_of_a_blocked_tool_is_bounded() -> None:
    loop = ForceControl(GOAL)
    for _ in range(5000):
        lead = loop.update(np.zeros(3), np.zeros(3), STIFFNESS, DAMPING, DT)
    assert STIFFNESS[2] * lead[2] == pytest.approx(18.0)
    assert lead[:2].tolist() == [0.0, 0.0]


def test_loop_without_energy_adds_none() -> None:
    loop = ForceControl(GOAL)
    loop.tank = 0.0
    for _ in range(2000):
        lead = loop.update(np.zeros(3), np.zeros(3), STIFFNESS, DAMPING, DT)
    assert STIFFNESS[2] * lead[2] < 9.0, "the work of the wanted force, and no more"


def test_force_that_is_not_finite_ends_the_lead() -> None:
    loop = ForceControl(GOAL)
    assert not loop.update(np.array([0.0, 0.0, math.nan]), np.zeros(3), STIFFNESS, DAMPING, DT).any()


def test_goal_out_of_range_is_refused_with_all_problems() -> None:
    with pytest.raises(WrongValue, match=r"force 50.0 N: expected -30 to 30; speed nan m/s"):
        checked_goal(ForceGoal((0.0, 0.0, 50.0), speed=math.nan))
