"""Recorded messages of types that have changed since."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import genpy.dynamic
import pytest

from skiros2_bags.core.bag_file import BagError, Message
from skiros2_bags.testing.ros_messages import ros_message

HEADER = "=" * 80 + "\nMSG: skiros2_msgs/ResourceDescription\nstring type\nstring name\nParam[] params\n"
PARAM = "=" * 80 + "\nMSG: skiros2_msgs/Param\nstring param\n"


def recorded(text: str, **values: object) -> Message:
    """A goal of `ExecuteSkills`, recorded when it had these fields."""
    name = "skiros2_msgs/ExecuteSkillsGoal"
    cls = genpy.dynamic.generate_dynamic(name, text)[name]
    buffer = BytesIO()
    cls(**values).serialize(buffer)
    return Message(1.0, "/goal", name, "0" * 32, "", text, buffer.getvalue(), Path("a.bag"), lambda message: None)


def test_fields_that_came_later_have_their_defaults() -> None:
    found = ros_message(recorded(f"string author\nResourceDescription[] skills\n{HEADER}{PARAM}", author="me"))
    assert (found.author, found.skills, found.goal) == ("me", [], "")


def test_field_that_does_not_exist_any_more_is_named() -> None:
    with pytest.raises(BagError, match="was recorded with int32 number, and has no field number here"):
        ros_message(recorded("int32 number\n", number=1))


def test_field_of_another_type_is_named() -> None:
    with pytest.raises(BagError, match="was recorded with int32 author, and has string author here"):
        ros_message(recorded("int32 author\n", author=1))
