"""Mass and centre of mass from computed wrenches of a known payload."""

from __future__ import annotations

import math

import numpy as np
import pytest

from skiros2_common.core.errors import WrongValue
from skiros2_motion.core.geometry import Vector, conjugated, from_euler, rotated
from skiros2_motion.core.payload_estimate import PayloadSample, estimate_payload

ZERO = np.array([1.0, -2.0, 3.0, 0.1, 0.2, -0.3])
TILT = math.radians(25.0)
TURNS = [(0.0, 0.0), (TILT, 0.0), (-TILT, 0.0), (0.0, TILT), (0.0, -TILT)]


def samples(mass: float, centre: Vector, turns: list[tuple[float, float]] = TURNS) -> list[PayloadSample]:
    made = []
    for roll, pitch in turns:
        orientation = from_euler(math.pi + roll, pitch, 0.3)
        force = rotated(conjugated(orientation), (0.0, 0.0, -9.81 * mass))
        fx, fy, fz, tx, ty, tz = (np.array([*force, *np.cross(centre, force)]) + ZERO).tolist()
        made.append(PayloadSample(orientation, (fx, fy, fz, tx, ty, tz)))
    return made


@pytest.mark.parametrize("mass", [0.1, 0.8, 3.0])
def test_known_payload_is_found_with_any_zero_of_the_sensor(mass: float) -> None:
    found = estimate_payload(samples(mass, (0.01, -0.02, 0.06)))
    assert found.mass == pytest.approx(mass, rel=1e-6)
    assert found.centre == pytest.approx((0.01, -0.02, 0.06), abs=1e-6)
    assert found.residual < 1e-6


def test_empty_hand_has_no_mass() -> None:
    assert estimate_payload(samples(0.0, (0.0, 0.0, 0.0))).mass == pytest.approx(0.0, abs=1e-6)


def test_orientations_that_do_not_differ_are_refused() -> None:
    with pytest.raises(WrongValue, match="do not differ enough"):
        estimate_payload(samples(1.0, (0.0, 0.0, 0.0), [(0.0, 0.0)] * 5))
