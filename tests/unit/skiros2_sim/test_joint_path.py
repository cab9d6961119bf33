"""Trajectories of joints: checks, and interpolation between the points."""

from __future__ import annotations

import math

import numpy as np
import pytest

from skiros2_common.core.errors import SkirosError, UnknownName, WrongValue
from skiros2_sim.core.joint_motion import JointGoal, JointPath, JointPoint, JointTolerance
from skiros2_sim.core.physics import Joint


def joint(name: str, lower: float = -2.0, upper: float = 2.0, velocity: float = 1.0, effort: float = 10.0) -> Joint:
    return Joint(name, 0, "revolute", name + "_link", lower, upper, velocity, effort)


ARM = (joint("a"), joint("b", velocity=2.0))
REST = np.zeros(2)


def path(*points: JointPoint, joints: tuple[str, ...] = ("a", "b"), start: np.ndarray = REST) -> JointPath:
    return JointPath(JointGoal(joints, points), ARM, start, REST)


def point(time: float, *positions: float) -> JointPoint:
    return JointPoint(time, positions)


def test_path_passes_its_points() -> None:
    way = path(point(2.0, 0.5, 0.2), point(4.0, 0.7, 0.4), joints=("b", "a"))
    assert way.duration == 4.0
    assert way.at(2.0)[0] == pytest.approx([0.2, 0.5])
    assert way.at(9.0)[0] == pytest.approx([0.4, 0.7])
    assert way.at(-1.0)[0] == pytest.approx(REST)


def test_path_without_velocities_does_not_overshoot() -> None:
    way = path(point(2.0, 0.5, 0.5), point(4.0, 1.5, 0.5), point(7.0, 0.0, 0.5))
    times = np.linspace(0.0, 7.0, 701)
    positions = np.array([way.at(time)[0] for time in times])
    velocities = np.array([way.at(time)[1] for time in times])
    assert np.max(np.abs(np.gradient(positions, times, axis=0)[1:-1] - velocities[1:-1])) < 0.01
    assert np.max(np.abs(np.diff(velocities, axis=0))) < 0.05, "no jump of the speed"
    assert positions[:, 0].max() == pytest.approx(1.5)
    assert positions[:, 1].max() == pytest.approx(0.5)
    assert way.at(4.0)[1][0] == 0.0, "the joint turns round there"
    assert way.at(2.0)[1][0] > 0.1, "it does not stop in between"


def test_path_keeps_given_velocities_and_accelerations() -> None:
    ends = JointPoint(2.0, (0.5, 0.0), (0.4, 0.0), (0.2, 0.0)), JointPoint(4.0, (1.0, 0.0), (0.1, 0.0), (-0.3, 0.0))
    way = path(JointPoint(0.0, (0.0, 0.0), (0.0, 0.0), (0.0, 0.0)), *ends)
    for end in ends:
        just_before = [way.at(end.time - t) for t in (1e-9, 1e-4)]
        assert just_before[0][0] == pytest.approx(end.positions)
        assert just_before[0][1] == pytest.approx(end.velocities, abs=1e-6)
        acceleration = (just_before[0][1] - just_before[1][1]) / 1e-4
        assert acceleration == pytest.approx(end.accelerations, abs=1e-2)


@pytest.mark.parametrize(
    ("points", "said"),
    [
        ((), "no points"),
        ((point(1.0, 0.1),), "point 0 has 1 positions for 2 joints"),
        ((point(1.0, 0.1, math.nan),), "point 0: positions of b is nan"),
        ((point(math.inf, 0.1, 0.1),), "point 0: time inf"),
        ((point(-1.0, 0.1, 0.1),), "point 0: time -1.0"),
        ((point(1.0, 0.0, 0.1), point(1.0, 0.0, 0.2)), "point 1: time 1.0 is not later than the 1.0 of point 0"),
        ((point(9.0, 0.0, 2.5),), "point 0: b at 2.5000 is beyond its limits -2.0000 to 2.0000"),
        ((point(9.0, 0.0, 1e300),), "point 0: b at .* is beyond"),
        ((JointPoint(9.0, (0.0, 0.0), (1.5, 0.0)),), "point 0: a at 1.5000 per second is faster than its limit 1.0000"),
        ((JointPoint(9.0, (0.0, 0.0), (0.5,)),), "point 0 has 1 velocities for 2 joints"),
        (
            (point(1.0, 0.1, 0.1), point(2.0, 1.1, 0.1)),
            "between points 0 and 1: a would move at 1.* its limit is 1.0000",
        ),
        ((point(1.0, 1.0, 0.0),), "to point 0: a would move at 1.5000 per second"),
        (
            (JointPoint(4.0, (1.9, 0.0), (0.9, 0.0)), JointPoint(8.0, (1.9, 0.0), (-0.9, 0.0))),
            "between points 0 and 1: a would go from 1.* to 2.8000, its limits are -2.0000 to 2.0000",
        ),
    ],
)
def test_errors_name_joint_point_and_value(points: tuple[JointPoint, ...], said: str) -> None:
    with pytest.raises(WrongValue, match=said):
        path(*points)


@pytest.mark.parametrize(
    ("joints", "said"),
    [
        (("a", "c"), "no joint 'c' in this arm; it has a, b"),
        (("a",), "joint b is missing"),
        (("a", "b", "a"), "joint a is named more than once"),
        ((), "joint a, b is missing"),
    ],
)
def test_unknown_joints_are_rejected(joints: tuple[str, ...], said: str) -> None:
    with pytest.raises(UnknownName, match=said):
        path(JointPoint(1.0, (0.0,) * len(joints)), joints=joints)


def test_tolerances_of_unknown_joints_are_rejected() -> None:
    goal = JointGoal(("a", "b"), (point(1.0, 0.0, 0.0),), path_tolerance={"c": JointTolerance(0.1)})
    with pytest.raises(UnknownName, match="path tolerance for 'c'"):
        JointPath(goal, ARM, REST, REST)


def test_joint_beyond_its_limit_may_return() -> None:
    way = path(point(2.0, 1.8, 0.0), start=np.array([2.05, 0.0]))
    assert way.at(way.duration)[0] == pytest.approx([1.8, 0.0])


def test_zero_speed_limit_is_unlimited() -> None:
    arm = (joint("a", velocity=0.0, effort=0.0), joint("b"))
    goal = JointGoal(("a", "b"), (point(0.1, 1.0, 0.0),))
    assert JointPath(goal, arm, REST, REST).duration == 0.1


def test_errors_are_platform_errors() -> None:
    with pytest.raises(SkirosError):
        path()
