"""Profiles of other controllers: conversion of their messages, stiffness, settings."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import Vector3, Wrench, WrenchStamped
from scipy.spatial.transform import Rotation
from std_msgs.msg import Header

from skiros2_common.core.errors import ConfigurationError
from skiros2_contact_skills.ros.driver_calls import message_class
from skiros2_contact_skills.ros.profiled_arms import checked_settings
from skiros2_contact_skills.ros.profiles import PROFILES, along_base
from skiros2_motion.core.geometry import Pose, from_euler

FRANKA, FZI = PROFILES["franka_ros"], PROFILES["cartesian_controllers"]


class Errors:
    __slots__ = ("cartesian_reflex", "joint_reflex")

    def __init__(self, *active: str) -> None:
        for name in self.__slots__:
            setattr(self, name, name in active)


def franka_state(mode: int = 2, *errors: str) -> Any:
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_euler("xyz", (math.pi, 0.0, 0.3)).as_matrix()
    matrix[:3, 3] = (0.4, 0.1, 0.5)
    return SimpleNamespace(
        O_T_EE=matrix.T.ravel().tolist(),  # column-major
        O_F_ext_hat_K=[1.0, 2.0, -9.0, 0.1, 0.0, 0.0],
        robot_mode=mode,
        current_errors=Errors(*errors),
    )


def lookup(poses: dict[str, Pose]) -> Any:
    return lambda frame: poses[frame]


def test_pose_of_a_franka_arm_is_read_by_columns_and_its_wrench_is_that_of_the_environment() -> None:
    reading = FRANKA.read(franka_state(), lookup({}), "")
    assert reading.pose.position == pytest.approx((0.4, 0.1, 0.5))
    assert np.abs(np.dot(reading.pose.orientation, from_euler(math.pi, 0.0, 0.3))) == pytest.approx(1.0)
    assert reading.wrench == pytest.approx((-1.0, -2.0, 9.0, -0.1, 0.0, 0.0))
    assert not reading.stopped


@pytest.mark.parametrize(
    ("mode", "errors", "reason"),
    [
        (4, ("cartesian_reflex", "joint_reflex"), "reflex: cartesian_reflex, joint_reflex"),
        (5, (), "user stop"),
        (3, (), "it is guided by hand"),
    ],
)
def test_mode_of_a_franka_arm_is_the_reason_of_a_stop(mode: int, errors: tuple[str, ...], reason: str) -> None:
    assert FRANKA.read(franka_state(mode, *errors), lookup({}), "").stopped == reason


def test_wrench_of_a_sensor_is_turned_to_the_base_and_moved_to_the_tool() -> None:
    tool = Pose((0.5, 0.0, 0.3), from_euler(math.pi, 0.0, 0.0))
    sensor = Pose((0.5, 0.0, 0.4), from_euler(math.pi, 0.0, math.pi / 2))  # 0.1 m above the tool
    # a force along x of the base that acts at the tool: at the sensor with a torque
    turn = Rotation.from_quat(sensor.orientation).inv()
    force, torque = Vector3(*turn.apply((5.0, 0.0, 0.0))), Vector3(*turn.apply(np.cross((0, 0, -0.1), (5.0, 0.0, 0.0))))
    message = WrenchStamped(Header(frame_id="sensor"), Wrench(force, torque))
    reading = FZI.read(message, lookup({"sensor": sensor, "tool0": tool}), "tool0")
    assert reading.pose == tool
    assert reading.wrench == pytest.approx((5.0, 0.0, 0.0, 0.0, 0.0, 0.0), abs=1e-9)


def test_one_parameter_for_several_axes_is_their_least_stiffness() -> None:
    wanted = (300.0, 200.0, 2000.0, 100.0, 20.0, 60.0)
    assert FRANKA.stiffness.values(wanted) == {"translational_stiffness": 200.0, "rotational_stiffness": 20.0}
    assert FRANKA.stiffness.effective(wanted) == [200.0] * 3 + [20.0] * 3
    assert FZI.stiffness.effective(wanted) == list(wanted)


def test_stiffness_is_at_most_that_of_the_driver() -> None:
    assert FRANKA.stiffness.effective((2000.0,) * 3 + (300.0,) * 3) == [400.0] * 3 + [30.0] * 3


def test_stiffness_of_a_tool_is_turned_to_a_driver_that_takes_it_along_the_axes_of_its_base() -> None:
    wanted = (300.0, 200.0, 1000.0, 10.0, 20.0, 30.0)
    assert along_base(from_euler(math.pi, 0.0, 0.0), wanted) == pytest.approx(wanted)
    quarter = from_euler(0.0, math.pi / 2, 0.0)  # z of the tool is along x of the base
    assert along_base(quarter, wanted) == pytest.approx((1000.0, 200.0, 300.0, 30.0, 20.0, 10.0))


def test_missing_package_of_a_message_is_named() -> None:
    with pytest.raises(ConfigurationError, match=r"message no_msgs/State is not installed: .* package no_msgs"):
        message_class("no_msgs/State")


def test_settings_are_checked_with_all_problems() -> None:
    assert checked_settings({"profile": "franka_ros"}, "~arms/left") == {"profile": "franka_ros"}
    with pytest.raises(ConfigurationError, match=r"parameter ~arms/left: speed: expected one of .*; state is 3"):
        checked_settings({"speed": "fast", "state": 3}, "~arms/left")
    with pytest.raises(ConfigurationError, match="expected a table"):
        checked_settings("franka_ros", "~arms/left")
