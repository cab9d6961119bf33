"""Poses put after one another give the pose that tf would."""

import math

import pytest

from skiros2_common.core.world_element import Element
from skiros2_demo_skills.poses import composed, get_pose, set_pose

TURN = math.sqrt(0.5)  # a quarter turn, as a quaternion's part


def test_a_pose_is_read_as_it_was_written() -> None:
    element = Element("skiros:Location")
    set_pose(element, (1.0, 2.0, 3.0, 0.0, 0.0, TURN, TURN))
    assert get_pose(element) == (1.0, 2.0, 3.0, 0.0, 0.0, TURN, TURN)


def test_a_pose_of_which_a_part_is_missing_is_none() -> None:
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
def test_the_inner_pose_is_turned_and_moved_by_the_outer_one(
    outer: tuple[float, ...], inner: tuple[float, ...], expected: tuple[float, ...]
) -> None:
    assert composed(outer, inner) == pytest.approx(expected)
