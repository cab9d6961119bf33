"""Paths of a base around obstacles."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skiros2_common.core.errors import Refused
from skiros2_sim.core.drive_path import Floor, Footprint, Leg, Obstacle, Pose2D, heading
from support.fuzz import examples

HUSKY = Footprint(front=0.5, back=0.5, side=0.35)
TABLE = Obstacle("table", 2.0, 0.0, 0.0, 0.4, 0.6)


def walls(half: float) -> list[Obstacle]:
    """Four around the origin."""
    sides = {"north": (0.0, half), "south": (0.0, -half), "east": (half, 0.0), "west": (-half, 0.0)}
    return [Obstacle(name, x, y, 0.0, half if y else 0.1, half if x else 0.1) for name, (x, y) in sides.items()]


def end_of(start: Pose2D, legs: list[Leg]) -> tuple[float, float]:
    return (legs[-1].x, legs[-1].y) if legs else (start.x, start.y)


def test_free_path_is_straight() -> None:
    assert Floor(HUSKY, [TABLE]).find_path(Pose2D(-1.0, 0.0, 2.0), Pose2D(1.0, 0.0, 0.0)) == [Leg(1.0, 0.0, False)]


def test_path_to_the_same_position_is_a_turn() -> None:
    assert Floor(HUSKY, []).find_path(Pose2D(1.0, 1.0, 0.0), Pose2D(1.0, 1.0, 2.0)) == []


def test_path_around_a_table_backs_out_and_enters_straight() -> None:
    start, goal = Pose2D(1.05, 0.0, 0.0), Pose2D(2.95, 0.0, math.pi)
    floor = Floor(HUSKY, [TABLE])
    legs = floor.find_path(start, goal)
    assert legs[0].backward, "it cannot turn at the table"
    assert legs[0].y == pytest.approx(0.0)
    assert end_of(start, legs) == (2.95, 0.0)
    assert not legs[-1].backward
    before = Pose2D(legs[-2].x, legs[-2].y, 0.0)
    assert abs(heading(before, legs[-1])) == pytest.approx(math.pi), "the last leg has the goal's yaw"
    assert floor.first_collision(start, legs, 100.0) is None


@pytest.mark.parametrize("yaw", [0.0, 0.7, math.pi / 2])
def test_goal_inside_an_obstacle_is_rejected(yaw: float) -> None:
    with pytest.raises(Refused, match="the goal is inside 'table'"):
        Floor(HUSKY, [TABLE]).find_path(Pose2D(0.0, 0.0, 0.0), Pose2D(1.5, 0.3, yaw))


def test_goal_is_checked_with_the_rectangle() -> None:
    beside = Pose2D(1.2, 0.0, math.pi / 2)
    assert Floor(HUSKY, [TABLE]).collision_at(beside) is None
    assert Floor(HUSKY, [TABLE]).collision_at(beside._replace(yaw=0.0)) == "table"


def test_missing_path_names_the_obstacles() -> None:
    with pytest.raises(Refused, match=r"no path to the goal: 'east', .*and 1 more are in the way"):
        Floor(HUSKY, walls(3.0)).find_path(Pose2D(0.0, 0.0, 0.0), Pose2D(6.0, 0.0, 0.0))


def test_start_without_exit_is_rejected() -> None:
    cage = [
        Obstacle("left", 0.0, 0.5, 0.0, 1.5, 0.05),
        Obstacle("right", 0.0, -0.5, 0.0, 1.5, 0.05),
        Obstacle("front", 0.8, 0.0, 0.0, 0.05, 0.4),
        Obstacle("back", -0.8, 0.0, 0.0, 0.05, 0.4),
    ]
    with pytest.raises(Refused, match=r"no way out of the start: '(front|back|left|right)' is in the way"):
        Floor(HUSKY, cage).find_path(Pose2D(0.0, 0.0, 0.0), Pose2D(5.0, 0.0, 0.0))


def test_base_may_leave_an_obstacle() -> None:
    floor = Floor(HUSKY, [TABLE])
    start = Pose2D(1.2, 0.0, 0.0)
    assert floor.collision_at(start) == "table"
    legs = floor.find_path(start, Pose2D(-1.0, 0.0, 0.0))
    assert legs[0].backward
    assert floor.first_collision(start, legs, 10.0) is None


def test_collision_check_respects_its_range() -> None:
    floor = Floor(HUSKY, [Obstacle("box", 3.0, 0.0, 0.5, 0.2, 0.2)])
    legs = [Leg(5.0, 0.0, False)]
    assert floor.first_collision(Pose2D(0.0, 0.0, 0.0), legs, 1.5) is None
    assert floor.first_collision(Pose2D(1.5, 0.0, 0.0), legs, 1.5) == "box"


def test_distant_goal_does_not_enlarge_the_map() -> None:
    start, goal = Pose2D(0.0, 0.0, 0.0), Pose2D(100.0, 0.0, 0.0)
    floor = Floor(HUSKY, [Obstacle("wall", 50.0, 0.0, 0.0, 1.0, 20.0)])
    legs = floor.find_path(start, goal)
    assert floor.first_collision(start, legs, 1000.0) is None
    assert max(abs(leg.y) for leg in legs) > 20.0


coordinate = st.floats(-4.0, 4.0)
angle = st.floats(-math.pi, math.pi)
poses = st.builds(Pose2D, coordinate, coordinate, angle)
things = st.lists(
    st.builds(
        Obstacle, st.sampled_from("abc"), coordinate, coordinate, angle, st.floats(0.1, 1.0), st.floats(0.1, 1.0)
    ),
    max_size=4,
)


@settings(max_examples=examples(60))
@given(start=poses, goal=poses, obstacles=things)
def test_paths_reach_the_goal_without_collision(start: Pose2D, goal: Pose2D, obstacles: list[Obstacle]) -> None:
    floor = Floor(HUSKY, obstacles)
    try:
        legs = floor.find_path(start, goal)
    except Refused as rejection:
        assert "'" in str(rejection), "it names what is in the way"
        return
    assert math.dist(end_of(start, legs), (goal.x, goal.y)) < 0.002
    assert floor.collision_at(goal) is None
    assert floor.first_collision(start, legs, 1000.0) is None
