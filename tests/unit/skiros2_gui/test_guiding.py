"""The force of a hand that drags a marker at a tool."""

from __future__ import annotations

import math

import pytest

from skiros2_gui.view3d.dragging import TIMEOUT
from skiros2_gui.view3d.guiding import MAX_FORCE, STIFFNESS, HandGuiding

ORIGIN = (0.0, 0.0, 0.0)


def test_tool_is_drawn_towards_the_dragged_marker() -> None:
    hand = HandGuiding()
    assert hand.force(ORIGIN, 0.0) is None
    hand.drag((0.01, 0.0, -0.02), 1.0)
    assert hand.force(ORIGIN, 1.0) == pytest.approx((0.01 * STIFFNESS, 0.0, -0.02 * STIFFNESS))
    assert hand.force((0.01, 0.0, -0.02), 1.0) == pytest.approx(ORIGIN)


def test_force_of_a_far_marker_is_limited() -> None:
    hand = HandGuiding()
    hand.drag((3.0, 4.0, 0.0), 1.0)
    force = hand.force(ORIGIN, 1.0)
    assert force == pytest.approx((0.6 * MAX_FORCE, 0.8 * MAX_FORCE, 0.0)) and math.hypot(*force) <= MAX_FORCE


def test_force_ends_when_the_marker_is_released() -> None:
    hand = HandGuiding()
    hand.drag((1.0, 0.0, 0.0), 1.0)
    hand.release()
    assert hand.force(ORIGIN, 1.0) is None
    hand.hold(1.1)  # a late message of the view
    assert hand.force(ORIGIN, 1.1) is None


def test_force_ends_when_the_view_is_gone() -> None:
    hand = HandGuiding()
    hand.drag((1.0, 0.0, 0.0), 1.0)
    hand.hold(2.0)
    assert hand.force(ORIGIN, 2.0 + 0.9 * TIMEOUT) is not None
    assert hand.force(ORIGIN, 2.1 + TIMEOUT) is None
