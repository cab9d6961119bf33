"""Poses, sizes and spatial relations of elements, and the reaction to changes, without a ROS master."""

import math
import threading

import numpy as np
import pytest
import rospy
from geometry_msgs.msg import Pose, PoseStamped, TransformStamped

from skiros2_common.core.discrete_reasoner import reasoners
from skiros2_common.core.errors import SkirosError, UnknownName, WrongValue
from skiros2_common.core.world_element import Element
from skiros2_std_reasoners.aau_spatial_reasoner import AauSpatialReasoner
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.reasoner_world_model import ReasonerWorldModel
from skiros2_world_model.core.world_model import WorldModel

SCENE = "skiros:Scene-0"
NO_TURN = [0.0, 0.0, 0.0, 1.0]
QUARTER = [0.0, 0.0, math.sin(math.pi / 4), math.cos(math.pi / 4)]


class Clock:
    """A time (s) that tests set."""

    now = 0.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def reasoner(clock):
    reasoner = AauSpatialReasoner()
    reasoner._keeper._clock = clock
    reasoners.add(reasoner)
    return reasoner


@pytest.fixture
def wm(reasoner, tmp_path):
    model = WorldModel(source_ontologies(), tmp_path)
    wm = LocalWorldModel("AauSpatialReasoner", model)
    reasoner.init(ReasonerWorldModel(model))
    model.add_reasoner(reasoner)
    return wm


def placed(label="", position=(0, 0, 0), orientation=NO_TURN, size=None, base="map"):
    element = Element("skiros:Product", label)
    element.setData(":Pose", (position, orientation))
    element.setProperty("skiros:BaseFrameId", base)
    if size is not None:
        element.setData(":Size", size)
    return element


def added(wm, parent=SCENE, **pose):
    element = placed(base="", **pose)
    element.addRelation(getattr(parent, "id", parent), "skiros:contain", "-1")
    wm.add_element(element)
    return element


# -- data ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("values", [[1, 2.5, 3], (1, 2.5, 3), np.array([1, 2.5, 3])])
def test_set_data_accepts_sequences_and_get_data_returns_lists(reasoner, values):
    element = Element("skiros:Product")
    element.setData(":Position", values)
    assert element.getData(":Position") == [1.0, 2.5, 3.0]
    assert type(element.getData(":Position")) is list
    assert element.value_of("skiros:PositionY") == 2.5


def test_element_gets_the_properties_of_its_reasoner(reasoner):
    element = Element("skiros:Product")
    element.setData(":Position", [1, 2, 3])
    assert element.hasProperty("skiros:DiscreteReasoner", "AauSpatialReasoner")
    assert set(reasoner.getAssociatedData()) >= set(element.available_properties) - {"skiros:DiscreteReasoner"}
    assert element.value_of("skiros:PublishTf") is True
    reasoner.removeProperties(element)
    assert element.available_properties == []


def test_missing_data_is_none(reasoner):
    element = Element("skiros:Product")
    element.setProperty("skiros:PositionX", 1.5)
    assert element.getData(":Position") == [1.5, None, None]
    assert element.getData(":Orientation") == [None] * 4
    assert element.getData(":OrientationEuler") == [None] * 3
    assert element.getData(":Pose") == ([1.5, None, None], [None] * 4)
    assert not element.hasData(":Position")
    assert not element.hasData(":Pose")


def test_none_removes_a_value(reasoner):
    element = placed(position=(1, 2, 3))
    element.setData(":Position", [1, None, 3])
    assert element.getData(":Position") == [1.0, None, 3.0]


def test_numbers_as_text_are_read(reasoner):
    element = Element("skiros:Product")
    for axis, value in zip("XYZ", ("0.5", "1", ""), strict=True):
        element.setProperty(f"skiros:Size{axis}", value)
    assert element.getData(":Size") == [0.5, 1.0, None]
    element.setData(":Size", [1, 2, 3])
    assert element.getData(":Size") == [1.0, 2.0, 3.0]


def test_euler_angles_are_about_fixed_axes(reasoner):
    element = Element("skiros:Product")
    element.setData(":OrientationEuler", [0.0, 0.0, math.pi / 2])
    assert element.getData(":Orientation") == pytest.approx(QUARTER)
    assert element.getData(":OrientationEuler") == pytest.approx([0.0, 0.0, math.pi / 2])
    assert element.hasData(":OrientationEuler")


def test_pose_message_round_trip(reasoner):
    element = placed(position=(1, 2, 3), orientation=QUARTER, base="table")
    element.setProperty("skiros:FrameId", "cup")
    element.setProperty("skiros:TfTimeStamp", 12.5)
    stamped = element.getData(":PoseStampedMsg")
    assert isinstance(element.getData(":PoseMsg"), Pose)
    assert isinstance(stamped, PoseStamped)
    assert (stamped.header.frame_id, stamped.header.stamp.to_sec()) == ("table", 12.5)
    transform = element.getData(":TransformMsg")
    assert isinstance(transform, TransformStamped)
    assert (transform.header.frame_id, transform.child_frame_id) == ("table", "cup")
    for code in (":PoseMsg", ":PoseStampedMsg", ":TransformMsg"):
        other = Element("skiros:Product")
        other.setData(code, element.getData(code))
        assert other.getData(":Pose") == ([1.0, 2.0, 3.0], pytest.approx(QUARTER))
    assert other.value_of("skiros:BaseFrameId") == "table"


def test_message_of_incomplete_pose_is_rejected(reasoner):
    element = Element("skiros:Product", "cup")
    element.setProperty("skiros:PositionX", 1.0)
    with pytest.raises(WrongValue, match="cup has no complete pose"):
        element.getData(":PoseMsg")


@pytest.mark.parametrize(
    ("code", "value"),
    [
        (":Position", [1, 2]),
        (":Position", [1, 2, "left"]),
        (":Position", 5),
        (":Orientation", [0, 0, 1]),
        (":OrientationEuler", [0, 0]),
        (":Pose", [1, 2, 3]),
        (":PoseMsg", [1, 2, 3]),
    ],
)
def test_data_of_wrong_shape_is_rejected(reasoner, code, value):
    element = placed(position=(1, 2, 3))
    with pytest.raises(SkirosError, match="expected"):
        element.setData(code, value)
    assert element.getData(":Position") == [1.0, 2.0, 3.0]


def test_unknown_code_is_a_key_error(reasoner):
    with pytest.raises(KeyError):
        placed().getData(":NoSuchCode")
    with pytest.raises(UnknownName, match=":NoSuchCode"):
        reasoner.getData(placed(), ":NoSuchCode")


# -- relations -----------------------------------------------------------------------------------------------------


def test_relations_are_one_per_axis_and_orientation(reasoner):
    subject = placed(size=[1, 1, 1])
    apart = placed(position=(3, 3, 0), orientation=QUARTER, size=[1, 1, 2])
    assert reasoner.computeRelations(subject, apart) == [":pX", ":pY", ":dZ", ":pA"]
    assert reasoner.computeRelations(subject, placed(size=[1, 1, 1])) == [":eqX", ":eqY", ":eqZ", ":eqA"]
    assert set(reasoner.computeRelations(subject, apart)) <= set(reasoner.getAssociatedRelations())


@pytest.mark.parametrize(
    ("x", "size", "name"),
    [
        (3.0, 1, "p"), (1.0, 1, "m"), (0.5, 1, "o"), (0.5, 2, "s"), (0.0, 3, "d"), (-0.5, 2, "f"), (0.0, 1, "eq"),
        (-3.0, 1, "pi"), (-1.0, 1, "mi"), (-0.5, 1, "oi"), (-0.25, 0.5, "si"), (0.0, 0.5, "di"), (0.25, 0.5, "fi"),
        (1.0009, 1, "m"), (1.0011, 1, "p"), (0.9995, 1, "o"),
    ],
)  # fmt: skip
def test_relation_is_from_subject_to_object(reasoner, x, size, name):
    found = reasoner.computeRelations(placed(size=[1, 1, 1]), placed(position=(x, 0, 0), size=[size, 1, 1]))
    assert found[0] == f":{name}X"


def test_relations_use_the_axes_of_the_subject(reasoner):
    turned = placed(orientation=QUARTER, size=[1, 1, 1])
    ahead = placed(position=(0, 2, 0), orientation=QUARTER, size=[1, 1, 1])
    assert reasoner.computeRelations(turned, ahead) == [":pX", ":eqY", ":eqZ", ":eqA"]


def test_relations_with_metrics_have_distances(reasoner):
    found = dict(reasoner.computeRelations(placed(size=[1, 1, 1]), placed(position=(3, 0, 0), size=[1, 1, 1]), True))
    assert found[":pX"] == pytest.approx(2.0)
    assert found[":eqY"] == 0.0
    assert found[":eqA"] == pytest.approx(0.0)


def test_small_rotations_are_equal(reasoner):
    def relation(angle):
        other = placed()
        other.setData(":OrientationEuler", [0, 0, angle])
        return reasoner.computeRelations(placed(), other)[-1]

    assert (relation(0.049), relation(-0.049), relation(0.051)) == (":eqA", ":eqA", ":pA")


def test_relation_without_transform_is_unknown(reasoner):
    for other in (placed(base="elsewhere"), Element("skiros:Product")):
        assert reasoner.computeRelations(placed(), other) == [":unknownT"]
    assert reasoner.computeRelations(placed(), placed(base="elsewhere"), True) == [(":unknownT", -1.0)]


def test_relations_use_the_frames_of_the_scene(wm, reasoner):
    box = {"size": [1, 1, 1]}
    table = added(wm, position=(1, 0, 0), orientation=QUARTER, **box)
    cup = added(wm, table, position=(2, 0, 0), orientation=NO_TURN, **box)
    lamp = added(wm, position=(1, 5, 0), orientation=QUARTER, **box)
    assert reasoner.computeRelations(table, cup) == [":pX", ":eqY", ":eqZ", ":eqA"]
    assert reasoner.computeRelations(cup, lamp, True)[0] == (":pX", pytest.approx(2.0))
    assert wm.check_relation(table, ":pX", cup, True, False)
    assert wm.check_relation(table, "skiros:pX", Element("skiros:Product"), True, False)
    assert not wm.check_relation(table, ":eqX", cup, True, False)
    assert [r["type"] for r in wm.get_relations(table, ":pX", cup)] == [":pX"]


# -- frames --------------------------------------------------------------------------------------------------------


def test_new_element_has_default_frame_and_base(wm):
    table = added(wm)
    shelf = Element("skiros:LargeBox", "no place of its own")
    shelf.addRelation(table.id, "skiros:contain", "-1")
    wm.add_element(shelf)
    cup = added(wm, shelf)
    assert (table.value_of("skiros:FrameId"), table.value_of("skiros:BaseFrameId")) == (table.id, "map")
    assert cup.value_of("skiros:BaseFrameId") == table.id


def test_pose_is_converted_to_the_parent_frame(wm):
    table = added(wm, position=(1, 0, 0), orientation=QUARTER)
    cup = placed(position=(1, 2, 0), base="map")
    cup.addRelation(table.id, "skiros:contain", "-1")
    wm.add_element(cup)
    assert cup.value_of("skiros:BaseFrameId") == table.id
    assert cup.getData(":Position") == pytest.approx([2.0, 0.0, 0.0])


def test_new_parent_keeps_the_world_pose(wm, reasoner):
    table, shelf = added(wm, position=(1, 0, 0), orientation=QUARTER), added(wm, position=(0, 5, 1))
    cup = added(wm, table, position=(2, 0, 0))
    before = reasoner.get_transform("map", cup.id)
    cup.removeRelation2(table.id, "skiros:contain", "-1")
    cup.addRelation(shelf.id, "skiros:contain", "-1")
    wm.update_element(cup)
    assert cup.value_of("skiros:BaseFrameId") == shelf.id
    assert cup.getData(":Position") == pytest.approx([1.0, -3.0, -1.0])
    after = reasoner.get_transform("map", cup.id)
    assert [*after[0], *after[1]] == pytest.approx([*before[0], *before[1]])


@pytest.fixture
def shelf_between(wm):
    """Two tables, a shelf without a place of its own on the first, and a cup on the shelf."""
    tables = added(wm, position=(1, 0, 0)), added(wm, position=(0, 5, 1))
    shelf = Element("skiros:LargeBox", "no place of its own")
    shelf.addRelation(tables[0].id, "skiros:contain", "-1")
    wm.add_element(shelf)
    return *tables, shelf, added(wm, shelf, position=(2, 0, 0))


@pytest.mark.parametrize("call", ["set_relation", "update_element"])
def test_moved_ancestor_keeps_the_world_pose(wm, reasoner, shelf_between, call):
    table, other, shelf, cup = shelf_between
    wm.add_listener(reasoner._keeper.on_change)
    if call == "set_relation":
        wm.set_relation(table, "skiros:contain", shelf, False)
        wm.set_relation(other, "skiros:contain", shelf)
    else:
        shelf.removeRelation2(table.id, "skiros:contain", "-1")
        shelf.addRelation(other.id, "skiros:contain", "-1")
        wm.update_element(shelf)
    write(reasoner)
    cup = wm.get_element(cup.id)
    assert cup.value_of("skiros:BaseFrameId") == other.id
    assert cup.getData(":Position") == pytest.approx([3.0, -5.0, -1.0])


def test_ancestor_with_changing_pose_keeps_the_world_pose(wm, reasoner, shelf_between):
    table, _, shelf, cup = shelf_between
    shelf.setData(":Pose", ((0, 0, 1), NO_TURN))
    shelf.setProperty("skiros:BaseFrameId", table.id)
    wm.update_element(shelf)
    write(reasoner)
    assert wm.get_element(cup.id).value_of("skiros:BaseFrameId") == shelf.id
    assert wm.get_element(cup.id).getData(":Position") == pytest.approx([2.0, 0.0, -1.0])
    reasoner.removeProperties(shelf)
    wm.update_element(shelf)
    write(reasoner)
    assert wm.get_element(cup.id).value_of("skiros:BaseFrameId") == shelf.id, "where that was is not known any more"


def test_renamed_parent_frame_keeps_the_world_pose(wm, reasoner):
    table = added(wm, position=(1, 0, 0), orientation=QUARTER)
    cup = added(wm, table, position=(2, 0, 0))
    table.setProperty("skiros:FrameId", "kitchen_table")
    wm.update_element(table)
    write(reasoner)
    cup = wm.get_element(cup.id)
    assert cup.value_of("skiros:BaseFrameId") == "kitchen_table"
    assert cup.getData(":Position") == pytest.approx([2.0, 0.0, 0.0])


def test_pose_waits_for_an_unknown_transform(wm, reasoner):
    cup = placed(position=(1, 0, 0), base="camera")
    cup.addRelation(SCENE, "skiros:contain", "-1")
    wm.add_element(cup)
    assert cup.value_of("skiros:BaseFrameId") == "camera"
    reasoner._transforms.put("map", "camera", _pose((0, 0, 2)))
    write(reasoner)
    cup = wm.get_element(cup.id)
    assert cup.value_of("skiros:BaseFrameId") == "map"
    assert cup.getData(":Position") == pytest.approx([1.0, 0.0, 2.0])


def test_linked_element_follows_its_frame(wm, reasoner):
    hand = Element("skiros:Product", "in the hand")
    hand.setReasoner("AauSpatialReasoner")
    hand.setProperty("skiros:LinkedToFrameId", "gripper")
    hand.addRelation(SCENE, "skiros:contain", "-1")
    wm.add_element(hand)
    for x in (1.0, 2.0):
        reasoner._transforms.put("map", "gripper", _pose((x, 0, 0)))
        write(reasoner)
        assert wm.get_element(hand.id).getData(":Position") == pytest.approx([x, 0.0, 0.0])
    version = wm.version
    write(reasoner)
    assert wm.version == version, "nothing has moved: nothing is written"


def test_element_with_velocity_moves(wm, reasoner, clock):
    belt = moving(wm, 0.5)
    for clock.now in (0.25, 0.5, 0.75, 1.0):
        write(reasoner)
    assert wm.get_element(belt.id).getData(":Position") == pytest.approx([1.5, 0.0, 0.0])


def test_invalid_velocity_is_zero(wm, reasoner, clock):
    belt = moving(wm, 0.5)
    belt.setProperty("skiros:VelocityX", math.nan)
    belt.setProperty("skiros:VelocityY", math.inf)
    wm.update_element(belt)
    clock.now = 2.0
    assert reasoner.get_transform("map", belt.id)[0] == pytest.approx((1.0, 0.0, 0.0))
    assert not reasoner._keeper.tracker.busy()


def test_moving_pose_is_known_between_writes(wm, reasoner, clock):
    belt = moving(wm, 0.5)
    cup = added(wm, belt, position=(0, 1, 0))
    clock.now = 2.0
    assert wm.get_element(belt.id).getData(":Position") == [1.0, 0.0, 0.0]
    assert reasoner.get_transform("map", cup.id)[0] == pytest.approx((2.0, 1.0, 0.0))
    assert reasoner.get_transform(belt.id, "map")[0] == pytest.approx((-2.0, 0.0, 0.0))


def test_other_change_does_not_reset_a_moving_element(wm, reasoner, clock):
    belt = moving(wm, 0.5)
    clock.now = 2.0
    belt.label = "renamed"
    wm.update_element(belt)
    assert reasoner.get_transform("map", belt.id)[0] == pytest.approx((2.0, 0.0, 0.0))
    belt.setProperty("skiros:VelocityX", 1.0)
    wm.update_element(belt)
    clock.now = 3.0
    assert reasoner.get_transform("map", belt.id)[0] == pytest.approx((3.0, 0.0, 0.0))
    belt.setProperty("skiros:VelocityX", 0.0)
    wm.update_element(belt)
    clock.now = 9.0
    write(reasoner)
    assert wm.get_element(belt.id).getData(":Position") == pytest.approx([3.0, 0.0, 0.0])
    assert not reasoner._keeper.tracker.busy()


def test_moving_element_continues_from_a_new_pose(wm, reasoner, clock):
    belt = moving(wm, 0.5)
    clock.now = 2.0
    belt.setData(":Position", [10, 0, 0])
    wm.update_element(belt)
    clock.now = 4.0
    write(reasoner)
    assert wm.get_element(belt.id).getData(":Position") == pytest.approx([11.0, 0.0, 0.0])


def test_computed_pose_does_not_overwrite_a_newer_one(wm, reasoner, clock):
    belt = moving(wm, 0.5)
    clock.now = 2.0

    def put_elsewhere():
        element = wm.get_element(belt.id)
        element.setData(":Position", [10, 0, 0])
        wm.update_element(element)

    class Late:
        """The world model, in which somebody is faster."""

        def __getattr__(self, name):
            return getattr(reasoner._wmi, name)

        def update_elements(self, elements, author):
            thread = threading.Thread(target=put_elsewhere)
            thread.start()
            thread.join()
            reasoner._wmi.update_elements(elements, author)

    reasoner._keeper.wmi = Late()
    write(reasoner)
    assert wm.get_element(belt.id).getData(":Position") == [10.0, 0.0, 0.0]
    clock.now = 3.0
    assert reasoner.get_transform("map", belt.id)[0] == pytest.approx((10.5, 0.0, 0.0))


def test_moving_element_with_new_parent_keeps_its_world_pose(wm, reasoner, clock):
    belt, shelf = moving(wm, 0.5), added(wm, position=(0, 5, 0))
    clock.now = 2.0
    belt.removeRelation2(SCENE, "skiros:contain", "-1")
    belt.addRelation(shelf.id, "skiros:contain", "-1")
    wm.update_element(belt)
    assert belt.getData(":Position") == pytest.approx([2.0, -5.0, 0.0])
    assert reasoner.get_transform("map", belt.id)[0] == pytest.approx((2.0, 0.0, 0.0))


def test_moving_element_continues_after_a_clock_reset(wm, reasoner, clock):
    clock.now = 100.0
    belt = moving(wm, 0.5)
    write(reasoner)
    clock.now = 102.0
    write(reasoner)
    clock.now = 0.0
    write(reasoner)
    clock.now = 2.0
    assert reasoner.get_transform("map", belt.id)[0] == pytest.approx((3.0, 0.0, 0.0))


def test_transform_converts_a_pose_in_place(wm, reasoner):
    table = added(wm, position=(1, 0, 0), orientation=QUARTER)
    cup = added(wm, table, position=(2, 0, 0))
    assert reasoner.transform(cup, "map")
    assert cup.getData(":Position") == pytest.approx([1.0, 2.0, 0.0])
    assert cup.value_of("skiros:BaseFrameId") == "map"
    assert not reasoner.transform(cup, "nowhere")
    assert not reasoner.transform(Element("skiros:Product"), "map")
    assert cup.value_of("skiros:BaseFrameId") == "map"


def test_unknown_transform_is_none_twice(wm, reasoner):
    assert reasoner.get_transform("map", "nowhere", rospy.Duration(0.01)) == (None, None)
    assert reasoner.get_transform("nowhere", "nowhere")[0] == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("properties", "told"),
    [
        ({}, {"id"}),
        ({"skiros:FrameId": "cup"}, {"cup"}),
        ({"skiros:PublishTf": False}, set()),
        ({"skiros:PushToFrameId": "also"}, {"id", "also"}),
        ({"skiros:PositionX": float("nan")}, set()),
        ({"skiros:OrientationW": float("inf")}, set()),
        ({"skiros:LinkedToFrameId": "gripper"}, {"id"}),
        ({"skiros:LinkedToFrameId": "gripper", "skiros:FrameId": "gripper"}, set()),
    ],
)
def test_finite_poses_are_published_on_tf(wm, reasoner, properties, told):
    cup = placed(base="map")
    for key, value in properties.items():
        cup.setProperty(key, value)
    cup.addRelation(SCENE, "skiros:contain", "-1")
    wm.add_element(cup)
    frame = reasoner._keeper.tracker.get(cup.id)
    assert set(frame.published_names.values()) == {cup.id if name == "id" else name for name in told}


def test_part_is_in_the_frame_of_its_parent(wm):
    robot, arm = added(wm, position=(1, 0, 0)), placed(base="")
    arm.addRelation(robot.id, "skiros:hasA", "-1")
    wm.add_element(arm)
    assert arm.value_of("skiros:BaseFrameId") == robot.id


def test_lookup_waits_for_its_timeout(wm, reasoner):
    assert reasoner.get_transform("map", "late") == (None, None)
    later = threading.Timer(0.05, lambda: reasoner._transforms.put("map", "late", _pose((1, 2, 3))))
    later.start()
    position, orientation = reasoner.get_transform("map", "late", rospy.Duration(20.0))
    later.join()
    assert (position, orientation) == ((1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0))
    cup = added(wm)
    threading.Timer(0.05, lambda: reasoner._transforms.put("map", "later", _pose((1, 2, 3)))).start()
    assert reasoner.transform(cup, "later", rospy.Duration(20.0))
    assert cup.getData(":Position") == pytest.approx([-1.0, -2.0, -3.0])


def test_reasoner_is_found_by_name_code_and_relation(wm, reasoner):
    for name in ("AauSpatialReasoner", ":Pose", ":pX", ":unknownT", "skiros:PositionX"):
        assert wm.get_reasoner(name) is reasoner


def test_removed_element_has_no_frame(wm, reasoner):
    cup = added(wm, position=(1, 0, 0))
    assert reasoner.get_transform("map", cup.id)[0] == (1.0, 0.0, 0.0)
    wm.remove_element(cup)
    assert reasoner._keeper.tracker.get(cup.id) is None
    assert reasoner.get_transform("map", cup.id) == (None, None)


def test_frame_can_be_added_again(wm, reasoner):
    cup = added(wm, position=(1, 0, 0))
    eid = cup.id
    wm.remove_element(cup)
    again = placed(position=(2, 0, 0), base="")
    again._id = eid
    again.addRelation(SCENE, "skiros:contain", "-1")
    wm.add_element(again)
    assert again.id == eid
    assert reasoner.get_transform("map", eid)[0] == (2.0, 0.0, 0.0)


def test_rejected_change_keeps_the_frames(wm, reasoner):
    cup = added(wm, position=(1, 0, 0))
    moved = wm.get_element(cup.id)
    moved.setData(":Position", [5, 0, 0])
    bad = Element("skiros:Product", "bad", "skiros:Product-999")
    with pytest.raises(SkirosError):
        wm.update_elements([moved, bad])
    assert reasoner.get_transform("map", cup.id)[0] == pytest.approx((1.0, 0.0, 0.0))


def write(reasoner):
    reasoner._keeper.settle()
    reasoner._keeper.follow()


def moving(wm, velocity):
    """An element at x = 1 m that moves along x."""
    belt = added(wm, position=(1, 0, 0))
    belt.setProperty("skiros:VelocityX", velocity)
    wm.update_element(belt)
    return belt


def _pose(position):
    from skiros2_motion.core.geometry import Pose as CorePose

    return CorePose(position, (0.0, 0.0, 0.0, 1.0))
