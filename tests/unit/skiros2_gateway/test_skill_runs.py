"""What the start of a skill would change, as a person approves it."""

from __future__ import annotations

import pytest

pytest.importorskip("rospy")

from skiros2_gateway.ros.skill_runs import expected_changes
from skiros2_skill.core.start_preview import StartPreview
from support.planning_world import INFERRED, REQUIRED, made, related, skill, transport_world


def test_element_that_a_skill_will_make_is_named_without_an_id() -> None:
    """Others may get the id meanwhile: the start would be refused as another one than approved."""
    world = transport_world()
    bake = skill(
        "Bake",
        [("Object", "skiros:Product", REQUIRED), ("Place", "skiros:Location", INFERRED)],
        [related("Robot", "skiros:at", "Place")],
        [made("Object"), related("Place", "skiros:contain", "Object")],
    )
    cook = world.robot("cook", bake, at=world.places[0])
    start = StartPreview("bake", values={"Robot": [cook], "Place": [world.places[0]]})
    lines = expected_changes("/cook", world.wm, start)
    assert f"{world.places[0]} contains new skiros:Product 1" in lines
    world.thing("skiros:Product")
    assert expected_changes("/cook", world.wm, start) == lines
