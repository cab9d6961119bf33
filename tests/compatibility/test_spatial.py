"""Spatial relations and poses, as libraries written for SkiROS2 read them from elements."""

from __future__ import annotations

import math

import numpy as np
import pytest
import rospy
from geometry_msgs.msg import PoseStamped
from hypothesis import example, given
from hypothesis import strategies as st

from compatibility.rules import rule
from skiros2_common.core.discrete_reasoner import reasoners
from skiros2_common.core.world_element import Element
from skiros2_std_reasoners.aau_spatial_reasoner import AauSpatialReasoner

NO_TURN = (0.0, 0.0, 0.0, 1.0)
REASONER = AauSpatialReasoner()


@pytest.fixture(autouse=True)
def spatial_reasoner() -> None:
    reasoners.add(REASONER)


def placed(position, size=None, orientation=NO_TURN, base="", frame="") -> Element:
    element = Element("skiros:Product", "cup")
    REASONER.addProperties(element)
    REASONER.setData(element, (list(position), list(orientation)), ":Pose")
    if size is not None:
        REASONER.setData(element, list(size), ":Size")
    element.setProperty("skiros:BaseFrameId", base)
    element.setProperty("skiros:FrameId", frame)
    return element


def turned(angle: float, axis: str = "z") -> tuple[float, ...]:
    return (*(math.sin(angle / 2) if axis == a else 0.0 for a in "xyz"), math.cos(angle / 2))


# -- the table -----------------------------------------------------------------------------------------------------


def near(x: float, y: float) -> bool:
    return math.isclose(x, y, rel_tol=1e-6, abs_tol=0.001)


#: The rows of the table: when, the relation, the metric. Of the rows that are alike the first that is near holds.
TABLE = [
    (lambda a1, a2, b1, b2: a2 <= b2 and a2 <= b1 and near(a2, b1), "m", lambda a1, a2, b1, b2: 0.0),
    (lambda a1, a2, b1, b2: a2 <= b2 and a2 <= b1 and not near(a2, b1), "p", lambda a1, a2, b1, b2: b1 - a2),
    (
        lambda a1, a2, b1, b2: a2 <= b2 and b1 < a2 and a1 <= b1 and near(a1, b1) and near(a2, b2),
        "eq",
        lambda a1, a2, b1, b2: 0.0,
    ),
    (
        lambda a1, a2, b1, b2: a2 <= b2 and b1 < a2 and a1 <= b1 and near(a1, b1) and not near(a2, b2),
        "s",
        lambda a1, a2, b1, b2: b2 - a2,
    ),
    (
        lambda a1, a2, b1, b2: a2 <= b2 and b1 < a2 and a1 <= b1 and not near(a1, b1) and near(a2, b2),
        "fi",
        lambda a1, a2, b1, b2: b1 - a1,
    ),
    (
        lambda a1, a2, b1, b2: a2 <= b2 and b1 < a2 and a1 <= b1 and not near(a1, b1) and not near(a2, b2),
        "o",
        lambda a1, a2, b1, b2: [b1 - a1, a2 - b1, b2 - a2],
    ),
    (lambda a1, a2, b1, b2: a2 <= b2 and b1 < a2 and a1 > b1 and near(a2, b2), "f", lambda a1, a2, b1, b2: a1 - b1),
    (
        lambda a1, a2, b1, b2: a2 <= b2 and b1 < a2 and a1 > b1 and not near(a2, b2),
        "d",
        lambda a1, a2, b1, b2: [a1 - b1, b2 - a2],
    ),
    (lambda a1, a2, b1, b2: a2 > b2 and a1 <= b2 and a1 <= b1 and near(a1, b1), "si", lambda a1, a2, b1, b2: a2 - b2),
    (
        lambda a1, a2, b1, b2: a2 > b2 and a1 <= b2 and a1 <= b1 and not near(a1, b1),
        "di",
        lambda a1, a2, b1, b2: [b1 - a1, a2 - b2],
    ),
    (lambda a1, a2, b1, b2: a2 > b2 and a1 <= b2 and a1 > b1 and near(a1, b2), "mi", lambda a1, a2, b1, b2: 0.0),
    (
        lambda a1, a2, b1, b2: a2 > b2 and a1 <= b2 and a1 > b1 and not near(a1, b2),
        "oi",
        lambda a1, a2, b1, b2: [a1 - b1, b2 - a1, a2 - b2],
    ),
    (lambda a1, a2, b1, b2: a2 > b2 and a1 > b2, "pi", lambda a1, a2, b1, b2: a1 - b2),
]

#: Multiples of half a millimetre, so that ends often meet, nearly meet, and do not meet.
LENGTHS = st.integers(0, 12).map(lambda n: n / 2000) | st.floats(0, 5) | st.sampled_from([0.0, 1.0, 2.0, 5000.0])
PLACES = st.integers(-12, 12).map(lambda n: n / 2000) | st.floats(-5, 5) | st.sampled_from([-5000.0, -1.0, 0.0, 1.0])


@rule(
    "spatial",
    "On each axis the relation, and with metrics its distance or list of distances, is that of SkiROS2's table, with "
    "ends equal within 1 mm; a missing size counts as 0",
)
@given(st.tuples(PLACES, PLACES, PLACES), st.tuples(LENGTHS, LENGTHS, LENGTHS), st.tuples(LENGTHS, LENGTHS, LENGTHS))
@example((3.0, 1.0, -1.0), (1.0, 1.0, 1.0), (1.0, 1.0, 1.0))
@example((0.0, 0.5, -0.5), (1.0, 1.0, 1.0), (1.0, 2.0, 2.0))
@example((0.0, 0.0, 0.0), (0.0, 1.0, 2.0), (0.0, 2.0, 1.0))
def test_the_relation_on_each_axis_is_that_of_the_table(position, own, other):
    subject, obj = placed((0, 0, 0), own, frame="table"), placed(position, other, base="table")
    found = REASONER.computeRelations(subject, obj, True)
    assert len(found) == 4
    for axis, at, a, b, (name, metric) in zip("XYZ", position, own, other, found[:3], strict=True):
        ends = (-a / 2, a / 2, at - b / 2, at + b / 2)
        ((relation, distance),) = [(label, value(*ends)) for when, label, value in TABLE if when(*ends)]
        assert name == f":{relation}{axis}"
        assert metric == pytest.approx(distance, abs=1e-9)
        assert isinstance(metric, list) == isinstance(distance, list)
    assert REASONER.computeRelations(subject, obj) == [name for name, _ in found]


@rule("spatial", "The size of the object counts along the axes of the subject, however the object is turned")
def test_the_size_of_the_object_is_not_turned():
    subject = placed((0, 0, 0), (1, 1, 1), frame="table")
    obj = placed((0, 0, 0), (4, 1, 1), turned(math.pi / 2), base="table")
    assert REASONER.computeRelations(subject, obj) == [":dX", ":eqY", ":eqZ", ":pA"]


@rule("spatial", "The orientation is `:eqA` up to 0.05 rad between the two, else `:pA`; the metric is the angle")
@given(st.floats(-math.pi, math.pi), st.sampled_from("xyz"), st.booleans())
@example(0.0499, "z", False)
@example(-0.0501, "x", True)
def test_the_orientation_is_equal_up_to_a_small_angle(angle, axis, negated):
    quaternion = turned(angle, axis)
    if abs(abs(angle) - 0.05) < 1e-6:
        return
    obj = placed((0, 0, 0), (1, 1, 1), [-q for q in quaternion] if negated else quaternion, base="table")
    name, metric = REASONER.computeRelations(placed((0, 0, 0), frame="table"), obj, True)[3]
    assert name == (":eqA" if abs(angle) <= 0.05 else ":pA")
    assert metric == pytest.approx(abs(angle), abs=1e-6)


# -- frames --------------------------------------------------------------------------------------------------------


@rule("spatial", "A missing position of the object gives `:unknownT` alone, with metrics `(':unknownT', -1.0)`")
@pytest.mark.parametrize("position", [(None, None, None), (1.0, None, 0.0)])
def test_a_missing_position_is_unknown(position):
    subject, obj = placed((0, 0, 0), frame="table"), placed(position, base="table")
    assert REASONER.computeRelations(subject, obj) == [":unknownT"]
    assert REASONER.computeRelations(subject, obj, with_metrics=True) == [(":unknownT", -1.0)]


@rule(
    "spatial",
    'With the `FrameId` of the subject equal to the `BaseFrameId` of the object (also both "") the object\'s position '
    "counts as it stands",
)
@pytest.mark.parametrize("frame", ["", "table"])
def test_object_in_the_frame_of_the_subject_is_not_transformed(frame):
    subject = placed((9, 9, 9), (1, 1, 1), turned(1.0), base=frame, frame=frame)
    obj = placed((3, 0, 0), (1, 1, 1), base=frame)
    assert REASONER.computeRelations(subject, obj, True)[0] == (":pX", 2.0)


@rule("spatial", "A `BaseFrameId` of the object that is empty, while the subject has a `FrameId`, is unknown")
def test_an_object_without_a_base_frame_is_unknown():
    for base in ("", "map"):
        subject, obj = placed((0, 0, 0), base=base, frame="table"), placed((3, 0, 0))
        assert REASONER.computeRelations(subject, obj) == [":unknownT"]


@rule(
    "spatial",
    "Otherwise the position is transformed with tf; without a transform it is unknown",
    better="two poses in one base frame need no tf",
)
def test_other_frames_are_transformed_with_tf():
    subject = placed((1, 0, 0), (1, 1, 1), turned(math.pi / 2), base="map", frame="table")
    beside = placed((1, 3, 0), (1, 1, 1), turned(math.pi / 2), base="map", frame="cup")
    assert REASONER.computeRelations(subject, beside, True)[0] == (":pX", pytest.approx(2.0))
    assert REASONER.computeRelations(subject, placed((3, 0, 0), base="nowhere")) == [":unknownT"]


@rule("spatial", "`getAssociatedRelations()` has all 13 relations for each axis, `:eqA`, `:pA` and `:unknownT`")
def test_associated_relations_are_complete():
    relations = REASONER.getAssociatedRelations()
    expected = {f":{row[1]}{axis}" for row in TABLE for axis in "XYZ"} | {":eqA", ":pA", ":unknownT"}
    assert set(relations) == expected
    assert len(relations) == len(expected)


# -- data ----------------------------------------------------------------------------------------------------------


@rule("spatial", '`getData(":Pose")` is a pair of lists: three numbers and four; None stands for a missing one')
def test_a_pose_is_a_pair_of_lists():
    element = placed((1, 2, 3))
    position, orientation = element.getData(":Pose")
    assert (type(position), type(orientation)) == (list, list)
    assert (position, orientation) == ([1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 1.0])
    partial = Element("skiros:Product")
    partial.setProperty("skiros:PositionX", 1.5)
    assert partial.getData(":Pose") == ([1.5, None, None], [None] * 4)
    assert (partial.hasData(":Position"), partial.hasData(":Pose"), element.hasData(":Pose")) == (False, False, True)


@rule(
    "spatial", "`setData` takes lists, tuples and NumPy arrays; `getData` gives lists of floats, which can be changed"
)
@pytest.mark.parametrize("kind", [list, tuple, np.array])
def test_data_are_taken_in_any_shape_and_given_as_lists(kind):
    element = Element("skiros:Product")
    element.setData(":Position", kind([1, 2, 3]))
    element.setData(":Orientation", kind([0, 0, 0, 1]))
    element.setData(":Size", kind([0.5, 0.5, 0.25]))
    position = element.getData(":Position")
    position[2] += 0.5
    assert element.getData(":Position") == [1.0, 2.0, 3.0]
    element.setData(":Position", position)
    element.setData(":Pose", (kind([1, 2, 4]), kind(turned(math.pi))))
    assert element.getData(":Position") == [1.0, 2.0, 4.0]
    assert element.getData(":OrientationEuler") == pytest.approx([0.0, 0.0, math.pi])
    assert all(type(value) is float for value in element.getData(":Size"))


@rule("spatial", "An element gains the reasoner and its properties with the first `setData`, and is published on tf")
def test_set_data_makes_the_reasoner_one_of_the_element():
    element = Element("skiros:Product")
    element.setData(":Position", [1, 2, 3])
    assert element.getProperty("skiros:DiscreteReasoner").value == "AauSpatialReasoner"
    assert element.getProperty("skiros:PublishTf").value is True
    assert element.hasProperty("skiros:FrameId")
    assert not element.hasProperty("skiros:FrameId", not_none=True)


@rule("spatial", "`:PoseStampedMsg` has the `BaseFrameId` as frame; set from one, the element has its frame")
def test_a_stamped_pose_carries_the_base_frame():
    element = placed((1, 2, 3), base="map")
    message = element.getData(":PoseStampedMsg")
    assert isinstance(message, PoseStamped)
    assert (message.header.frame_id, message.pose.position.y) == ("map", 2.0)
    message.header.frame_id = "camera"
    message.pose.position.x = 7
    other = Element("skiros:Product")
    other.setData(":PoseStampedMsg", message)
    assert other.getProperty("skiros:BaseFrameId").value == "camera"
    assert other.getData(":Pose") == ([7.0, 2.0, 3.0], [0.0, 0.0, 0.0, 1.0])


@rule("spatial", "`get_transform` of frames that tf does not know gives `(None, None)`; `transform` gives False")
def test_an_unknown_transform_is_none_twice():
    reasoner = placed((1, 2, 3))._getReasoner(":Pose")
    position, orientation = reasoner.get_transform("map", "nowhere", rospy.Duration(0.0))
    assert position is None
    assert orientation is None
    element = placed((1, 2, 3), base="map")
    assert reasoner.transform(element, "nowhere") is False
    assert element.getData(":Position") == [1.0, 2.0, 3.0]
    assert reasoner.transform(element, "map") is True


@rule("spatial", "A code that no reasoner has is a `KeyError`")
def test_an_unknown_code_is_a_key_error():
    with pytest.raises(KeyError):
        placed((0, 0, 0)).getData(":NoSuchCode")
