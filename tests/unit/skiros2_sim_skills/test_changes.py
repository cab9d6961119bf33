"""Descriptions of changes in the world."""

import json
from typing import Any

from skiros2_common.core.world_element import Element
from skiros2_demo.run_check import WorldState, changes
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


def test_moved_thing_changes_its_relation() -> None:
    after = [*scene()[1:2], element(TRAY_A, "Tray A", ContainerState=["Full"])]
    product = element(PRODUCT, "Product A", [("-1", "skiros:at", TRAY_B)], PositionX=[0.0])
    assert changes(world(*scene()), world(*after, product)) == [
        "- Tray A skiros:contain Product A",
        "+ Product A skiros:at Tray B",
    ]


def test_changed_property_has_both_values() -> None:
    before, after = world(element(TRAY_A, "Tray A", ContainerState=["Full"])), world(element(TRAY_A, "Tray A"))
    assert changes(before, after) == ["~ Tray A skiros:ContainerState: Full -> (none)"]


def test_changed_pose_is_omitted() -> None:
    def at(x: float) -> WorldState:
        return world(element(PRODUCT, "Product A", PositionX=[x], BaseFrameId=[str(x)], TfTimeStamp=[x]))

    assert changes(at(0.0), at(0.5)) == []
