"""Limits of a wrench along and about single axes of the tool."""

from __future__ import annotations

import math

import numpy as np
import pytest

from skiros2_common.core.errors import WrongValue
from skiros2_motion.core.compliant_arm import checked_limits
from skiros2_motion.core.geometry import IDENTITY, Pose, rotated
from skiros2_motion.core.impedance import rotation_vector
from skiros2_motion.core.reference_lead import bounded_reference
from skiros2_motion.core.wrench_guard import Limits, WrenchGuard, exceeded_limit, is_limit, limited_wrench

#: 40 N and 15 Nm in all; 5 N across, 20 N along, 2 Nm about the axis of the tool.
LIMITS = Limits(40.0, 15.0, (5.0, 5.0, 20.0, 0.0, 0.0, 2.0))


@pytest.mark.parametrize(
    ("wrench", "text"),
    [
        ((4.0, -4.0, 19.0, 9.0, 9.0, 1.9), ""),
        ((0.0, -6.0, 0.0, 0.0, 0.0, 0.0), "force of 6.0 N along y above the limit of 5 N"),
        ((0.0, 0.0, 21.0, 0.0, 0.0, 0.0), "force of 21.0 N along z above the limit of 20 N"),
        ((0.0, 0.0, 0.0, 0.0, 0.0, -2.5), "torque of 2.5 Nm about z above the limit of 2 Nm"),
        ((0.0, 0.0, 0.0, 12.0, 12.0, 0.0), "torque of 17.0 Nm above the limit of 15 Nm"),
    ],
)
def test_exceeded_axis_is_named(wrench: tuple[float, ...], text: str) -> None:
    found = exceeded_limit(wrench, LIMITS)
    assert str(found or "") == text
    assert found is None or is_limit(found.quantity)


@pytest.mark.parametrize("axis", [0, 1, 2, 5])
def test_number_that_is_not_finite_exceeds_the_limit_of_its_axis(axis: int) -> None:
    wrench = [math.nan if number == axis else 0.0 for number in range(6)]
    assert exceeded_limit(wrench, Limits(axes=LIMITS.axes)) is not None
    assert WrenchGuard(is_noisy=False).check(wrench, Limits(axes=LIMITS.axes), 0.0) is not None


def test_guard_stops_at_an_axis_without_other_limits() -> None:
    guard = WrenchGuard(is_noisy=False)
    checks = [guard.check((6.0, 0.0, 0.0, 0.0, 0.0, 0.0), Limits(axes=LIMITS.axes), 0.002 * i) for i in range(2)]
    assert checks[0] is None, "a single measurement may be the impact of rigid bodies"
    assert checks[1] is not None and checks[1].quantity == "force_x"


def test_wrench_is_shortened_along_limited_axes_only() -> None:
    wrench = limited_wrench(np.array([9.0, 0.0, -25.0, 3.0, 0.0, 3.0]), LIMITS)
    assert wrench.tolist() == pytest.approx([5.0, 0.0, -20.0, 3.0, 0.0, 2.0])


def test_reference_leads_by_the_limit_of_each_axis_over_its_stiffness() -> None:
    turned = Pose((0.1, 0.2, 0.3), (1.0, 0.0, 0.0, 0.0))  # tool pointing down
    reference = Pose((0.15, 0.2, 0.2), (1.0, 0.0, 0.0, 0.0))
    found = bounded_reference(reference, turned, (500.0,) * 3 + (40.0,) * 3, (0.0,) * 6, LIMITS)
    lead = [a - b for a, b in zip(found.position, turned.position, strict=True)]
    assert rotated((-1.0, 0.0, 0.0, 0.0), lead) == pytest.approx((0.01, 0.0, 0.04))


def test_turn_of_the_reference_is_bounded_about_a_limited_axis() -> None:
    reference = Pose((0.0, 0.0, 0.0), (0.0, 0.0, math.sin(0.15), math.cos(0.15)))
    found = bounded_reference(reference, IDENTITY, (500.0,) * 3 + (40.0,) * 3, (0.0,) * 6, LIMITS)
    assert rotation_vector(found.orientation) == pytest.approx((0.0, 0.0, 0.05))


@pytest.mark.parametrize("axes", [(1.0, 2.0), (math.nan,) * 6, (-1.0,) * 6])
def test_limits_of_axes_that_are_not_six_numbers_are_refused(axes: tuple[float, ...]) -> None:
    with pytest.raises(WrongValue, match="limits along and about x, y, z"):
        checked_limits(40.0, 15.0, axes)
