"""The visuals of a robot description."""

from __future__ import annotations

import math

import pytest

from skiros2_common.core.errors import WrongValue
from skiros2_live.core.markers import BOX, CYLINDER, MESH, SPHERE, read_robot

URDF = """<robot name="r">
  <material name="blue"><color rgba="0 0 1 1"/></material>
  <link name="base"><visual><origin xyz="1 2 3" rpy="0 0 1.5707963"/><geometry><box size="1 2 3"/></geometry>
    <material name="blue"/></visual></link>
  <link name="wheel"><visual><geometry><cylinder radius="0.5" length="0.1"/></geometry>
    <material name=""><color rgba="1 0 0 0.5"/></material></visual>
    <visual><geometry><sphere radius="0.1"/></geometry></visual></link>
  <link name="arm"><visual><geometry><mesh filename="/a/arm.stl" scale="0.1 0.1 0.1"/></geometry></visual>
    <visual><geometry><mesh filename="package://p/arm.dae"/></geometry></visual></link>
  <link name="empty"/>
</robot>"""


def test_visuals_have_frame_pose_shape_and_colour() -> None:
    base, wheel, ball, arm, coloured = read_robot(URDF, "robot_1")
    assert (base.frame, base.shape, base.size) == ("robot_1/base", BOX, (1.0, 2.0, 3.0))
    assert base.colour == (0.0, 0.0, 1.0, 1.0)
    assert base.pose.position == (1.0, 2.0, 3.0)
    assert base.pose.orientation == pytest.approx((0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)), abs=1e-6)
    assert (wheel.shape, wheel.size, wheel.colour) == (CYLINDER, (1.0, 1.0, 0.1), (1.0, 0.0, 0.0, 0.5))
    assert (ball.shape, ball.size) == (SPHERE, (0.2, 0.2, 0.2))
    assert (arm.shape, arm.mesh, arm.size) == (MESH, "file:///a/arm.stl", (0.1, 0.1, 0.1))
    assert coloured.mesh == "package://p/arm.dae" and coloured.colour is None


def test_frames_without_prefix_are_link_names() -> None:
    assert {part.frame for part in read_robot(URDF)} == {"base", "wheel", "arm"}


@pytest.mark.parametrize("text", ["", "no xml", URDF.replace('"1 2 3"', '"1 2"')])
def test_text_that_is_no_urdf_is_refused(text: str) -> None:
    with pytest.raises(WrongValue, match="not a URDF"):
        read_robot(text)
