"""Which topics a run is recorded from."""

from __future__ import annotations

import pytest

from skiros2_bags.core.selection import Selection, is_graph_name, pattern
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


def test_what_a_run_needs_is_chosen_and_no_pictures() -> None:
    assert Selection().chosen(SYSTEM) == [
        "/wm/monitor", "/r2/monitor", "/r2/arm/joint_states", "/r2/move_base/goal", "/r2/move_base/cancel",
        "/r2/move_base/status",
    ]  # fmt: skip


def test_further_topics_and_those_left_out() -> None:
    selection = Selection(pattern("/r2/camera/.*"), pattern("/r2/arm/.*|/tf"))
    chosen = selection.chosen(SYSTEM)
    assert "/r2/camera/image_raw" in chosen and "/r2/arm/joint_states" not in chosen
    assert "/tf" not in selection.named([]) and "/tf_static" in selection.named([])


def test_what_is_listened_to_from_the_start() -> None:
    named = Selection().named(["/r1", "r2"])
    assert {
        "/wm/monitor",
        "/clock",
        "/tm/achieve/goal",
        "/tm/task_plan/result",
        "/r1/monitor",
        "/r2/execute/cancel",
    } <= {*named}


def test_a_pattern_that_is_none() -> None:
    with pytest.raises(WrongValue, match=r"'\(' is no regular expression"):
        pattern("(")


@pytest.mark.parametrize("name", ["", "/", "a b", "/a//b", "1a", 7, None, "/a/" + "é"])
def test_what_is_no_name_of_an_action(name: object) -> None:
    assert not is_graph_name(name)
    assert is_graph_name("/robot/move_base") and is_graph_name("move_base")
