"""Composition of poses."""

import math

import pytest

from skiros2_common.core.world_element import Element
from skiros2_demo_skills.poses import composed, get_pose, set_pose

TURN = math.sqrt(0.5)  # a quarter turn, as a quaternion's part


def test_pose_round_trip() -> None:
    element = Element("skiros:Location")
    set_pose(element, (1.0, 2.0, 3.0, 0.0, 0.0, TURN, TURN))
    assert get_pose(element) == (1.0, 2.0, 3.0, 0.0, 0.0, TURN, TURN)


def test_incomplete_pose_is_none() -> None:
    element = Element("skiros:Location")
    set_pose(element, (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0))
    element.removeProperty("skiros:PositionY")
    assert get_pose(element) is None


@pytest.mark.parametrize(
    ("outer", "inner", "expected"),
    [
        ((1, 2, 3, 0, 0, 0, 1), (0.5, 0, 0, 0, 0, 0, 1), (1.5, 2, 3, 0, 0, 0, 1)),
        ((1, 2, 3, 0, 0, TURN, TURN), (0.5, 0, 0, 0, 0, 0, 1), (1, 2.5, 3, 0, 0, TURN, TURN)),
        ((0, 0, 0, 0, 0, TURN, TURN), (1, 0, 0, 0, 0, TURN, TURN), (0, 1, 0, 0, 0, 1, 0)),
        ((0, 0, 0, TURN, 0, 0, TURN), (0, 1, 0, 0, 0, 0, 1), (0, 0, 1, TURN, 0, 0, TURN)),
    ],
)
def test_composition_applies_the_outer_pose(
    outer: tuple[float, ...], inner: tuple[float, ...], expected: tuple[float, ...]
) -> None:
    assert composed(outer, inner) == pytest.approx(expected)
