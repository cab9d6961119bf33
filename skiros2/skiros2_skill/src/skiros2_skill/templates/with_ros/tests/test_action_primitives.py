"""The skills that use action servers, without a server."""

import pytest


def test_gripper_is_sent_the_opening(skill_bench):
    pytest.importorskip("actionlib")  # needs ROS
    library = skill_bench.import_libraries("my_skills").load("move_gripper").library
    gripper = library.find("move_gripper")()
    gripper.createDescription()
    gripper.params["Opening"].value = 0.03
    assert gripper.buildGoal().command.position == 0.03
