"""Monitors of signals: limits, duration, hysteresis, missing messages; fields of messages; the source in process."""

import math
from types import SimpleNamespace as Message

import pytest

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.signals import (
    LIMIT,
    NOT_A_NUMBER,
    STALE,
    UNREADABLE,
    FieldPath,
    LimitMonitor,
    LocalSignals,
    Signal,
    SignalLimits,
    find_signal,
)
from skiros2_common.core.world_element import Element

FORCE = Signal("skiros:WristForce-7-wrist", "/wrist", "", "N")


def monitor(**limits):
    return LimitMonitor(SignalLimits(**limits), 0.0)


def fed(one, *values, step=0.01):
    """Whether a violation begins with each value; the first one arrives after one step."""
    return [one.update(value, (i + 1) * step) for i, value in enumerate(values)]


# -- limits ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("limits", "inside", "outside", "text"),
    [
        ({"maximum": 30.0}, 30.0, 30.1, "above 30"),
        ({"minimum": -5.0}, -5.0, -5.1, "below -5"),
        ({"minimum": -5.0, "maximum": 5.0}, 0.0, -6.0, "below -5"),
        ({"minimum": -5.0, "maximum": 5.0}, 5.0, math.inf, "above 5"),
    ],
)
def test_value_beyond_a_limit_violates_it(limits, inside, outside, text):
    one = monitor(**limits)
    assert fed(one, inside, outside) == [False, True]
    found = one.violation(0.02)
    assert (found.kind, found.value, found.detail, found.seconds) == (LIMIT, outside, text, 0.0)


def test_value_violates_after_the_duration():
    one = monitor(maximum=30.0, duration=0.02)
    assert fed(one, 31.0, 32.0, 33.0, 34.0) == [False, False, True, False]
    assert one.violation(0.04).seconds == pytest.approx(0.02)


def test_value_inside_the_limits_restarts_the_duration():
    assert not any(fed(monitor(maximum=30.0, duration=0.015), 31.0, 29.0, 31.0, 29.0, 31.0))


def test_value_within_the_hysteresis_does_not_restart_the_duration():
    one = monitor(maximum=30.0, duration=0.015, hysteresis=2.0)
    assert fed(one, 31.0, 29.0, 31.0) == [False, False, True]
    assert not any(fed(monitor(maximum=30.0, duration=0.015, hysteresis=2.0), 31.0, 27.0, 31.0))


def test_duration_ends_without_another_message():
    one = monitor(maximum=30.0, duration=0.1)
    one.update(31.0, 0.0)
    assert one.violation(0.05) is None
    assert one.violation(0.1).kind == LIMIT


def test_violation_stays_until_it_was_read():
    one = monitor(maximum=30.0)
    assert fed(one, 31.0, 20.0, 20.0) == [True, False, False]
    assert one.violation(0.03).value == 31.0
    one.update(20.0, 0.04)
    assert one.violation(0.04) is None


def test_read_violation_ends_inside_the_hysteresis_only():
    one = monitor(maximum=30.0, hysteresis=2.0)
    one.update(31.0, 0.01)
    for value, ends in ((29.0, False), (28.1, False), (28.0, True)):
        assert one.violation(0.02) is not None
        assert not one.update(value, 0.02)
        assert (one.violation(0.02) is None) is ends


def test_missing_messages_violate_after_the_timeout():
    one = monitor(maximum=30.0, timeout=0.5)
    assert one.violation(0.5) is None
    assert (one.violation(0.51).kind, one.violation(0.51).value) == (STALE, None)
    one.update(20.0, 0.6)
    assert one.violation(1.09) is None
    assert one.violation(1.2).kind == STALE
    assert monitor(maximum=30.0, timeout=math.inf).violation(1e9) is None


def test_not_a_number_violates_until_a_number_arrives():
    one = monitor(maximum=30.0, duration=1.0)
    assert one.update(math.nan, 0.01)
    assert one.violation(0.01).kind == NOT_A_NUMBER
    assert not one.update(math.nan, 0.02)
    assert one.violation(0.02).kind == NOT_A_NUMBER
    one.update(1.0, 0.03)
    assert one.violation(0.03) is None


def test_time_that_jumps_back_keeps_the_signal_alive():
    one = monitor(maximum=30.0, duration=0.1)
    one.update(31.0, 100.0)
    assert not one.update(31.0, 5.0)
    assert one.violation(5.05) is None
    assert one.violation(5.1).kind == LIMIT


def test_violations_name_signal_value_unit_limit_and_time():
    one = monitor(maximum=30.0, duration=0.01)
    fed(one, 31.0, 41.25)
    text = one.violation(0.02).text(FORCE)
    assert text.startswith("skiros:WristForce-7-wrist was 41.25 N at ")
    assert text.endswith(", above 30 N for 0.01 s")
    silent = monitor(maximum=30.0)
    silent.update(3.0, 0.0)
    text = silent.violation(0.75).text(FORCE)
    assert text.startswith("skiros:WristForce-7-wrist has sent no message on /wrist for 0.75 s at ")
    assert text.endswith(" (last value 3 N)")


@pytest.mark.parametrize(
    ("limits", "problem"),
    [
        ({}, "neither a minimum nor a maximum"),
        ({"maximum": math.nan}, "the maximum is nan, expected a number"),
        ({"maximum": 1.0, "duration": -1.0}, "the duration is -1.0, expected a number from 0"),
        ({"maximum": 1.0, "timeout": 0.0}, "the timeout is 0.0, expected seconds"),
        ({"minimum": 2.0, "maximum": 1.0}, "no value is between 2 and 1"),
        ({"minimum": 0.0, "maximum": 1.0, "hysteresis": 0.5}, "by a hysteresis of 0.5"),
    ],
)
def test_unusable_limits_are_named(limits, problem):
    (found,) = SignalLimits(**limits).problems()
    assert problem in found


# -- messages ----------------------------------------------------------------------------------------------------------

WRENCH = Message(wrench=Message(force=Message(x=3.0, y=0.0, z=-4.0)))
JOINTS = Message(name=["a", "b"], effort=[1.5, -7.0])


@pytest.mark.parametrize(
    ("path", "message", "value"),
    [
        ("wrench.force.z", WRENCH, -4.0),
        ("wrench.force", WRENCH, 5.0),
        ("effort[0]", JOINTS, 1.5),
        ("effort[b]", JOINTS, -7.0),
        ("effort", JOINTS, -7.0),
        ("data", Message(data=True), 1.0),
        ("", 2.5, 2.5),
    ],
)
def test_path_reads_a_number(path, message, value):
    assert FieldPath(path).read(message) == value


def test_list_with_a_value_that_is_no_number_is_no_number():
    assert math.isnan(FieldPath("effort").read(Message(effort=[1.0, math.nan, -7.0])))


@pytest.mark.parametrize("path", ["wrench.torque", "wrench", "effort[0]", "wrench.force.x.y"])
def test_missing_field_is_named(path):
    with pytest.raises(WrongValue, match="has no number at"):
        FieldPath(path).read(WRENCH)


@pytest.mark.parametrize("path", ["effort[2]", "effort[c]", "position"])
def test_missing_item_is_named(path):
    with pytest.raises(WrongValue, match="has no number at"):
        FieldPath(path).read(Message(name=["a", "b"], effort=[1.5, -7.0], position=[]))


def test_malformed_signal_names_all_problems():
    element = Element("skiros:WristForce", "wrist")
    element.setProperty("skiros:MessageField", "wrench..z")
    with pytest.raises(WrongValue, match=r"Topic is None, expected a topic; .*Field: 'wrench\.\.z' is not a path"):
        Signal.of(element)


def test_signal_is_found_by_class_or_label():
    class Ontology:
        def is_subclass(self, child, parent):
            return (child, parent) in {("skiros:WristForce", "skiros:Signal"), ("skiros:Distance", "skiros:Signal")}

    arm = Element("rparts:ArmDevice", "arm", "rparts:ArmDevice-1")
    force = Element("skiros:WristForce", "f", "skiros:WristForce-2")
    far = Element("skiros:Distance", "far", "skiros:Distance-3")
    near = Element("skiros:Distance", "near", "skiros:Distance-4")
    branch = [arm, force, far, near]
    assert find_signal("skiros:WristForce", branch, Ontology()) is force
    assert find_signal("near", branch, Ontology()) is near
    with pytest.raises(WrongValue, match=r"has several signals skiros:Distance: .*far, .*near"):
        find_signal("skiros:Distance", branch, Ontology())
    with pytest.raises(WrongValue, match=r"arm has no signal arm; it has: .*-f, "):
        find_signal("arm", branch, Ontology())


# -- source ------------------------------------------------------------------------------------------------------------


def test_source_delivers_to_subscribers_until_they_end():
    source, got = LocalSignals(), []
    end = source.subscribe(FORCE, lambda value, arrival, problem: got.append((value, problem)))
    source.publish("wrist", 1.0)
    assert source.topics() == ["/wrist"]
    end()
    end()
    source.publish("/wrist", 2.0)
    assert got == [(1.0, "")]
    assert source.topics() == []


def test_subscriber_gets_the_last_message_at_once():
    source, got = LocalSignals(), []
    source.publish("/wrist", 1.0)
    source.subscribe(FORCE, lambda value, arrival, problem: got.append(value))
    assert got == [1.0]


def test_unreadable_message_is_a_problem():
    source, one = LocalSignals(), monitor(maximum=1.0)
    source.subscribe(Signal("s", "/wrist", "force"), one.update)
    source.publish("/wrist", 1.0)
    found = one.violation(source.now())
    assert (found.kind, found.detail) == (UNREADABLE, "a message of type float has no number at 'force'")
