"""Kinematics from the text of a URDF."""

from __future__ import annotations

import pytest

from skiros2_common.core.errors import ConfigurationError
from skiros2_motion.core.urdf_chain import read_chain

ARM = """<robot name="arm"><link name="base"/><link name="upper"/><link name="tool"/>
  <joint name="turn" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 1" rpy="0 0 0"/>
    <axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="2"/></joint>
  <joint name="end" type="fixed"><parent link="upper"/><child link="tool"/><origin xyz="0.5 0 0"/></joint></robot>"""


def test_tip_is_where_the_joints_put_it() -> None:
    chain = read_chain(ARM, "base", "tool")
    assert (chain.joints, chain.velocities) == (("turn",), (2.0,))
    assert chain.kinematics.forward([0.0]).position == pytest.approx((0.5, 0.0, 1.0))


@pytest.mark.parametrize(
    ("right", "wrong"),
    [('xyz="0 0 1" rpy', 'xyz="0 0 nan" rpy'), ('xyz="0.5 0 0"', 'xyz="0.5 0"'), ('axis xyz="0 0 1"', 'axis xyz="z"')],
)
def test_origin_or_axis_without_three_finite_numbers_is_refused(right: str, wrong: str) -> None:
    with pytest.raises(ConfigurationError, match=r"joint (turn|end): "):
        read_chain(ARM.replace(right, wrong), "base", "tool")
