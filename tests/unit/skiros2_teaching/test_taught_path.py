"""Paths: from recordings, smoothed, stored, adapted to other ends, timed within limits."""

from __future__ import annotations

import itertools
import json
import math

import numpy as np
import pytest

from skiros2_common.core.errors import WrongValue
from skiros2_motion.core.arm_kinematics import distances
from skiros2_motion.core.geometry import IDENTITY, Pose, composed, from_euler, inverted
from skiros2_motion.core.gripper import GripperEvent
from skiros2_teaching.core.taught_path import Sample, TaughtPath
from skiros2_teaching.core.timed_motion import Limits, Line, Section, sections

FRAME = Pose((0.4, -0.2, 0.1), from_euler(0.1, -0.2, 1.3))


def drawn(t: float) -> Pose:
    """A curve of 0.3 m in 4 s with a turn about z; at rest before 0 s and after 4 s."""
    s = min(max(t / 4.0, 0.0), 1.0)
    s = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    position = (0.2 * s, 0.08 * math.sin(math.pi * s), 0.3 - 0.1 * s)
    return Pose(position, from_euler(math.pi, 0.0, 0.8 * s))


def recorded(rate: float = 25.0, tremor: float = 0.0, rest: float = 1.0) -> list[Sample]:
    """The curve as a hand draws it: with a tremor of 9 Hz (m), after a rest and before another one."""
    samples = []
    for i in range(round((4.0 + 2.0 * rest) * rate) + 1):
        t = i / rate
        x, y, z = drawn(t - rest).position
        shaking = tremor * math.sin(2.0 * math.pi * 9.0 * t)
        samples.append(Sample(100.0 + t, Pose((x + shaking, y - shaking, z), drawn(t - rest).orientation)))
    return samples


def deviation(path: TaughtPath) -> tuple[float, float]:
    """Maximum distance (m) and angle (rad) between a path and the nearest poses of the curve."""
    curve = [drawn(0.002 * i) for i in range(2001)]
    points = np.array([pose.position for pose in curve])
    worst = (0.0, 0.0)
    for time in np.linspace(0.0, path.duration, 200):
        pose = path.pose(float(time))
        near = curve[int(np.argmin(np.linalg.norm(points - pose.position, axis=1)))]
        worst = tuple(map(max, worst, distances(pose, near)))  # type: ignore[assignment]
    return worst


def test_smoothed_path_has_no_tremor_and_no_rests_at_its_ends() -> None:
    path = TaughtPath.from_samples(recorded(rate=50.0, tremor=0.001)).smoothed()
    off, turned = deviation(path)
    assert off < 0.0006
    assert turned < 0.01
    assert 3.3 < path.duration < 4.6


def test_smooth_recording_keeps_its_shape_with_few_samples() -> None:
    recording = TaughtPath.from_samples(recorded())
    path = recording.smoothed()
    off, turned = deviation(path)
    assert off < 0.0005
    assert turned < 0.005
    assert len(path.times) < len(recording.times) / 4
    ends = (recording.pose(0.0), recording.pose(recording.duration))
    for pose, end in zip((path.pose(0.0), path.pose(path.duration)), ends, strict=True):
        assert distances(pose, end)[0] < 0.001


def test_events_stay_where_they_were_and_rests_at_events_are_kept() -> None:
    path = TaughtPath.from_samples(
        recorded(), [GripperEvent(100.1, 0.08), GripperEvent(103.0, 0.0, 20.0), GripperEvent(105.9, 0.08)]
    )
    smooth = path.smoothed()
    assert [event.width for event in smooth.events] == [0.08, 0.0, 0.08]
    assert smooth.events[0].time == 0.0
    assert smooth.events[2].time == smooth.duration
    at_event = smooth.pose(smooth.events[1].time).position
    assert math.dist(at_event, drawn(2.0).position) < 0.001


def test_slow_end_of_a_path_is_kept() -> None:
    """As of a hand that creeps into a fit, at 2 mm/s."""
    samples = recorded(rest=0.0)
    x, y, z = samples[-1].pose.position
    for i in range(1, 51):
        at = Pose((x, y, z - 0.002 * i / 25.0), samples[-1].pose.orientation)
        samples.append(Sample(samples[0].time + 4.0 + i / 25.0, at))
    path = TaughtPath.from_samples(samples).smoothed()
    assert distances(path.pose(path.duration), at)[0] < 0.0004


@pytest.mark.parametrize(
    ("samples", "said"),
    [
        ([], "a path needs at least 2 samples, got 0"),
        ([Sample(0.0, IDENTITY)], "a path needs at least 2 samples, got 1"),
        ([Sample(0.0, IDENTITY), Sample(1.0, Pose((math.nan, 0.0, 0.0), IDENTITY.orientation))], "sample 1: .*finite"),
        ([Sample(0.0, IDENTITY), Sample(0.0, FRAME), Sample(-1.0, IDENTITY)], "samples 1, 2: .*times that increase"),
        ([Sample(0.0, IDENTITY), Sample(1.0, IDENTITY)], "moves by 0.0 mm and 0.000 rad: expected at least 2 mm"),
        ([Sample(0.0, IDENTITY), Sample(1.0, Pose((99.0, 0.0, 0.0), (1.0, 1.0, 1.0, 1.0)))], "10 m.*; .*unit quat"),
    ],
)
def test_unusable_recording_is_refused_with_all_problems(samples: list[Sample], said: str) -> None:
    with pytest.raises(WrongValue, match=said):
        TaughtPath.from_samples(samples)


@pytest.mark.parametrize(
    "event", [GripperEvent(9.0, 0.0), GripperEvent(0.0, math.nan), GripperEvent(0.0, 0.1, -1.0), GripperEvent(0.0, 2.0)]
)
def test_unusable_gripper_event_is_refused(event: GripperEvent) -> None:
    with pytest.raises(WrongValue, match=r"gripper event 0 .*expected times on the path, 0 to 0.5 m and 0 to 1000 N"):
        TaughtPath.from_samples([Sample(0.0, IDENTITY), Sample(1.0, FRAME)], [event])


def test_stored_path_is_read_back() -> None:
    path = TaughtPath.from_samples(recorded(), [GripperEvent(102.0, 0.04, 15.0)]).smoothed()
    again = TaughtPath.from_json(*path.to_json())
    assert again.events[0] == pytest.approx(path.events[0], abs=1e-3)
    for time in (0.0, 0.31, 1.7, path.duration):
        off, turned = distances(again.pose(time), path.pose(time))
        assert off < 5e-5
        assert turned < 5e-4
    assert len(path.to_json()[0]) < 4000


@pytest.mark.parametrize("text", ["", "{}", "[1]", '[["a"]]', "[[0,1]]", "null", json.dumps([[0] * 8])])
def test_unreadable_path_is_refused(text: str) -> None:
    with pytest.raises(WrongValue):
        TaughtPath.from_json(text)


def test_path_moves_with_its_frame() -> None:
    path = TaughtPath.from_samples(recorded())
    moved = path.transformed(FRAME)
    for time in (0.0, 2.3, 4.0):
        assert distances(moved.pose(time), composed(FRAME, path.pose(time)))[0] < 1e-9
    assert distances(moved.from_start().pose(3.0), composed(inverted(path.pose(0.0)), path.pose(3.0)))[0] < 1e-6


def test_adapted_path_has_the_new_ends_and_keeps_its_details() -> None:
    path = TaughtPath.from_samples(recorded(rest=0.0))
    goal = Pose((0.25, 0.03, 0.22), from_euler(math.pi, 0.1, 0.6))
    adapted = path.adapted(goal=goal)
    assert distances(adapted.pose(0.0), path.pose(0.0)) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert distances(adapted.pose(adapted.duration), goal) == pytest.approx((0.0, 0.0), abs=1e-6)
    middle = np.subtract(adapted.pose(2.0).position, path.pose(2.0).position)
    whole = np.subtract(goal.position, path.pose(4.0).position)
    assert middle == pytest.approx(whole / 2.0, abs=0.002)
    start = Pose((0.0, 0.05, 0.3), path.pose(0.0).orientation)
    assert distances(path.adapted(start=start).pose(0.0), start)[0] < 1e-6
    unchanged = path.adapted()
    assert distances(unchanged.pose(1.0), path.pose(1.0)) == pytest.approx((0.0, 0.0), abs=1e-9)


def speeds(motion: Section | Line, period: float = 0.005) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Speeds (m/s), angular speeds (rad/s) and accelerations (m/s2) by differences."""
    poses = [motion.pose(period * i) for i in range(math.ceil(motion.duration / period) + 2)]
    points = np.array([pose.position for pose in poses])
    turns = np.array([distances(a, b)[1] for a, b in itertools.pairwise(poses)]) / period
    velocity = np.diff(points, axis=0) / period
    return np.linalg.norm(velocity, axis=1), turns, np.linalg.norm(np.diff(velocity, axis=0), axis=1) / period


@pytest.mark.parametrize("limits", [Limits(), Limits(speed=0.03), Limits(angular_speed=0.1), Limits(0.5, 2.0, 0.2)])
@pytest.mark.parametrize("scaling", [0.5, 1.0, 10.0])
def test_timed_path_keeps_its_limits_and_starts_and_ends_at_rest(limits: Limits, scaling: float) -> None:
    path = TaughtPath.from_samples(recorded()).smoothed()
    section = Section(path, 0.0, path.duration, limits, scaling)
    speed, turn, acceleration = speeds(section)
    assert np.max(speed) <= limits.speed * 1.02
    assert np.max(turn) <= limits.angular_speed * 1.02
    assert np.percentile(acceleration, 98) <= limits.acceleration * 1.1
    assert max(speed[0], speed[-1]) < 0.02
    assert distances(section.pose(section.duration), path.pose(path.duration))[0] < 1e-6


def test_path_is_not_faster_than_taught_without_a_factor() -> None:
    path = TaughtPath.from_samples(recorded()).smoothed()
    fast = Limits(1.0, 3.0, 5.0, 20.0)
    assert Section(path, 0.0, path.duration, fast).duration == pytest.approx(path.duration, rel=0.1)
    assert Section(path, 0.0, path.duration, fast, 0.5).duration == pytest.approx(2.0 * path.duration, rel=0.1)


def test_pause_in_a_path_is_dropped() -> None:
    samples = [Sample(0.1 * i, drawn(0.1 * i)) for i in range(21)]
    samples += [Sample(2.0 + 0.1 * i, drawn(2.0)) for i in range(1, 100)]
    samples += [Sample(12.0 + 0.1 * i, drawn(2.0 + 0.1 * i)) for i in range(21)]
    path = TaughtPath.from_samples(samples).smoothed()
    assert path.duration > 13.0
    assert Section(path, 0.0, path.duration, Limits(1.0, 3.0, 5.0, 20.0)).duration < 6.0


def test_tool_rests_at_each_event() -> None:
    path = TaughtPath.from_samples(recorded(), [GripperEvent(100.0, 0.08), GripperEvent(103.0, 0.0)]).smoothed()
    first, one, event, two = sections(path, Limits())
    assert (first, event) == path.events
    assert isinstance(one, Section)
    assert isinstance(two, Section)
    assert distances(one.pose(one.duration), two.pose(0.0))[0] < 1e-9
    assert math.dist(two.pose(0.0).position, drawn(2.0).position) < 0.001


def test_line_keeps_its_limits() -> None:
    limits = Limits(0.1, 0.3, 0.2, 1.0)
    for goal in (drawn(4.0), Pose(drawn(0.0).position, drawn(4.0).orientation), Pose((0.004, 0.0, 0.3), drawn(0.0)[1])):
        line = Line(drawn(0.0), goal, limits)
        speed, turn, acceleration = speeds(line)
        assert np.max(speed) <= 0.1 * 1.01
        assert np.max(turn) <= 0.3 * 1.01
        assert np.max(acceleration) <= 0.2 * 1.05
        assert line.pose(line.duration) == goal
    assert Line(goal, goal, limits).duration == 0.0


@pytest.mark.parametrize("wrong", [{"speed": 0.0}, {"acceleration": math.nan, "angular_speed": -1.0}])
def test_unusable_limits_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(WrongValue, match=", ".join(reversed([*map(str, wrong)])).replace(", ", ".*")):
        Limits(**wrong)
