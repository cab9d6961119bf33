"""Selection of topics to record."""

from __future__ import annotations

import pytest

from skiros2_bags.core.bag_writer import Selection, is_graph_name, pattern
from skiros2_common.core.errors import WrongValue

SYSTEM = [
    ("/wm/monitor", "skiros2_msgs/WmMonitor"),
    ("/r2/monitor", "skiros2_msgs/TreeProgress"),
    ("/r2/tick_rate", "std_msgs/Empty"),
    ("/r2/arm/joint_states", "sensor_msgs/JointState"),
    ("/r2/camera/image_raw", "sensor_msgs/Image"),
    ("/r2/move_base/goal", "move_base_msgs/MoveBaseActionGoal"),
    ("/r2/move_base/cancel", "actionlib_msgs/GoalID"),
    ("/r2/move_base/status", "actionlib_msgs/GoalStatusArray"),
    ("/light/status", "std_msgs/String"),
    ("/shop/goal", "std_msgs/String"),
    ("/rosout_agg", "rosgraph_msgs/Log"),
]


def test_pictures_are_not_selected() -> None:
    assert Selection().select(SYSTEM) == [
        "/wm/monitor", "/r2/monitor", "/r2/arm/joint_states", "/r2/move_base/goal", "/r2/move_base/cancel",
        "/r2/move_base/status",
    ]  # fmt: skip


def test_patterns_add_and_exclude_topics() -> None:
    selection = Selection(pattern("/r2/camera/.*"), pattern("/r2/arm/.*|/tf"))
    select = selection.select(SYSTEM)
    assert "/r2/camera/image_raw" in select and "/r2/arm/joint_states" not in select
    assert "/tf" not in selection.initial_topics([]) and "/tf_static" in selection.initial_topics([])


def test_initial_topics_include_those_of_named_robots() -> None:
    initial_topics = Selection().initial_topics(["/r1", "r2"])
    assert {
        "/wm/monitor",
        "/clock",
        "/tm/achieve/goal",
        "/tm/task_plan/result",
        "/r1/monitor",
        "/r2/execute/cancel",
    } <= {*initial_topics}


def test_invalid_pattern_is_rejected() -> None:
    with pytest.raises(WrongValue, match=r"'\(' is not a regular expression"):
        pattern("(")


@pytest.mark.parametrize("name", ["", "/", "a b", "/a//b", "1a", 7, None, "/a/" + "é"])
def test_invalid_graph_names(name: object) -> None:
    assert not is_graph_name(name)
    assert is_graph_name("/robot/move_base") and is_graph_name("move_base")
