"""The poses of a drag that are written."""

from __future__ import annotations

import itertools

from hypothesis import given, settings
from hypothesis import strategies as st

from skiros2_gui.view3d.dragging import PERIOD, Dragging, Target
from skiros2_motion.core.geometry import Pose
from support.fuzz import examples


def target(x: float, eid: str = "a") -> Target:
    return Target(eid, "map", Pose((x, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)))


def test_drag_writes_latest_target_at_most_ten_times_a_second() -> None:
    dragging = Dragging()
    written = []
    for step in range(100):  # 25 Hz for 4 s
        now = step * 0.04
        dragging.move(target(float(step)), now)
        if (taken := dragging.take(now)) is not None:
            written.append((now, taken.pose.position[0]))
    assert written[0] == (0.0, 0.0) and 30 <= len(written) <= 41
    assert all(value == round(now / 0.04) for now, value in written)


def test_release_writes_pending_target_at_once() -> None:
    dragging = Dragging()
    dragging.move(target(1.0), 0.0)
    assert dragging.take(0.0) == target(1.0)
    dragging.move(target(2.0), 0.01)
    assert dragging.take(0.02) is None and dragging.wait(0.02) is not None
    dragging.release()
    assert dragging.wait(0.02) == 0.0 and dragging.take(0.02) == target(2.0)
    assert dragging.wait(0.02) is None


def test_written_target_is_not_written_again() -> None:
    dragging = Dragging()
    dragging.move(target(1.0), 0.0)
    dragging.take(0.0)
    dragging.move(target(1.0), 0.5)
    assert dragging.take(1.0) is None
    dragging.forget()
    dragging.move(target(1.0), 2.0)
    assert dragging.take(2.0) == target(1.0), "it was refused, so it is tried again"


def test_drag_without_feedback_ends_after_timeout() -> None:
    dragging = Dragging(timeout=2.0)
    dragging.hold("a", 0.0)
    assert dragging.is_held("a", 1.9) and not dragging.is_held("b", 1.9)
    assert not dragging.is_held("a", 2.1)
    dragging.move(target(1.0), 3.0)
    assert dragging.is_held("a", 3.1)
    dragging.release()
    assert not dragging.is_held("a", 3.1)


@settings(max_examples=examples(50))
@given(st.lists(st.tuples(st.floats(0.0, 0.3), st.integers(0, 5)), min_size=1, max_size=30))
def test_last_target_of_any_drag_is_written(moves: list[tuple[float, int]]) -> None:
    dragging, now, written, times = Dragging(), 0.0, [], []
    for pause, x in moves:
        now += pause
        dragging.move(target(float(x)), now)
        if (taken := dragging.take(now)) is not None:
            written.append(taken)
            times.append(now)
    assert all(later - earlier >= PERIOD - 1e-9 for earlier, later in itertools.pairwise(times))
    dragging.release()
    if (taken := dragging.take(now)) is not None:
        written.append(taken)
    assert written[-1] == target(float(moves[-1][1]))
