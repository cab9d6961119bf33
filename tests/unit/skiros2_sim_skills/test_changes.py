"""Descriptions of changes in the world."""

import json
from typing import Any

from skiros2_common.core.world_element import Element
from skiros2_demo.changes import changes
from skiros2_demo.world_state import WorldState
from support.recorded_run import PRODUCT, TRAY_A, TRAY_B, element, scene

ROBOT, HERE, THERE = "cora:Robot-1", "skiros:Location-5", "skiros:Location-6"


def world(*elements: Any) -> WorldState:
    made = []
    for message in elements:
        thing = Element(message.type, message.label, message.id)
        for told in message.properties:
            thing.setProperty(told.key, json.loads(told.dataValue))
        for told in message.relations:
            thing.addRelation(told.subjectId, told.predicate, told.objectId)
        made.append(thing)
    return WorldState.of(made)


def test_equal_states_have_no_changes() -> None:
    assert changes(world(*scene()), world(*scene())) == []


def test_moved_thing_is_one_line_with_both_places() -> None:
    after = [*scene()[1:2], element(TRAY_A, "Tray A", ContainerState=["Full"])]
    product = element(PRODUCT, "Product A", [(TRAY_B, "skiros:contain", "-1")], PositionX=[0.0])
    assert changes(world(*scene()), world(*after, product)) == ["Product A is in Tray B; it was in Tray A"]


def test_location_is_described_for_the_robot() -> None:
    places = [element(HERE, "Dock"), element(THERE, "Table")]
    before = world(*places, element(ROBOT, "demo:robot", [("-1", "skiros:at", HERE)]))
    after = world(*places, element(ROBOT, "demo:robot", [("-1", "skiros:at", THERE)]))
    assert changes(before, after) == ["robot is at Table; it was at Dock"]


def test_changed_property_has_both_values() -> None:
    before, after = world(element(TRAY_A, "Tray A", ContainerState=["Full"])), world(element(TRAY_A, "Tray A"))
    assert changes(before, after) == ["Tray A has ContainerState nothing; it was Full"]
    assert changes(after, before) == ["Tray A has ContainerState Full; it was nothing"]


def test_changed_pose_is_one_line() -> None:
    def at(x: float, turned: float) -> WorldState:
        pose = {"PositionX": [x], "PositionY": [0.0], "PositionZ": [0.1], "OrientationZ": [turned]}
        return world(element(PRODUCT, "Product A", **pose, BaseFrameId=[str(x)], TfTimeStamp=[x]))

    expected = ["Product A is at (0.50, 0.00, 0.10) m relative to its parent"]
    assert changes(at(0.0, 0.0), at(0.5, 0.7)) == expected
    assert changes(at(0.5, 0.0), at(0.5, 0.7)) == expected
    assert changes(at(0.5, 0.7), at(0.503, 0.704)) == [], "as a camera sees it from look to look"


def test_added_and_removed_things_and_relations_are_described() -> None:
    before = world(element(HERE, "Dock"), element(THERE, "Table"), element(ROBOT, "robot"))
    after = world(
        element(HERE, "Dock"),
        element(ROBOT, "robot", [("-1", "skiros:hasStartLocation", HERE)]),
        element(TRAY_A, "Tray A"),
    )
    assert changes(before, after) == [
        "robot now hasStartLocation Dock",
        "Table is gone",
        "Tray A is new",
    ]
