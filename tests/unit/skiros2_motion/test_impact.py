"""The peak force of a contact, and the speed that keeps it below a limit."""

from __future__ import annotations

import math

import numpy as np
import pytest

from skiros2_motion.core.arm_abilities import Abilities
from skiros2_motion.core.impact import MIN_SPEED, apparent_mass, peak_force, permitted_speed


def test_permitted_speed_has_the_peak_of_the_limit() -> None:
    speed = permitted_speed(40.0, mass=4.0, stiffness=250e3)
    assert speed == pytest.approx(0.04)
    assert peak_force(speed, mass=4.0, stiffness=250e3) == pytest.approx(40.0)


def test_limit_that_is_noticed_late_lowers_the_permitted_speed() -> None:
    late = Abilities(limits=False, state_period=0.033).added_force(1.0, stiffness=800.0)
    speed = permitted_speed(40.0, mass=4.0, stiffness=250e3, late=late)
    assert peak_force(speed, mass=4.0, stiffness=250e3) + speed * 0.033 * 800.0 == pytest.approx(40.0)
    assert Abilities(limits=True, state_period=0.033).added_force(speed, stiffness=800.0) == 0.0


def test_slide_along_one_axis_has_its_mass_there_and_does_not_move_across() -> None:
    jacobian = np.zeros((6, 1))
    jacobian[2, 0] = 1.0
    masses = np.array([[5.0]])
    assert apparent_mass(jacobian, masses, (0.0, 0.0, 1.0)) == pytest.approx(5.0, rel=1e-4)
    assert apparent_mass(jacobian, masses, (1.0, 0.0, 0.0)) > 1e5


def test_arm_at_a_singularity_may_still_creep() -> None:
    assert permitted_speed(40.0, math.inf) == MIN_SPEED
