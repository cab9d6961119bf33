"""Postures and openings of devices in the world model."""

from __future__ import annotations

from skiros2_common.core.world_element import Element
from skiros2_std_skills.core.devices import opening, posture


def arm_with(prefix: str) -> Element:
    arm = Element("rparts:ArmDevice", "Arm")
    arm.setProperty(f"{prefix}:JointNames", '["a", "b"]')
    arm.setProperty(f"{prefix}:Postures", '{"home": [0.5, -1]}')
    return arm


def test_posture_has_a_position_for_each_joint() -> None:
    assert posture(arm_with("skiros"), "home") == {"a": 0.5, "b": -1.0}


def test_opening_has_a_default() -> None:
    gripper = Element("rparts:GripperEffector", "Gripper")
    assert opening(gripper) == 0.08
    gripper.setProperty("skiros:Opening", 0.05)
    assert opening(gripper) == 0.05


def test_earlier_names_are_read() -> None:
    gripper = Element("rparts:GripperEffector", "Gripper")
    gripper.setProperty("demo:Opening", 0.04)
    assert posture(arm_with("demo"), "home") == {"a": 0.5, "b": -1.0}
    assert opening(gripper) == 0.04
