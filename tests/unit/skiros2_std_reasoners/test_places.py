"""Poses for grasping and placing objects."""

from __future__ import annotations

import math

import pytest

from skiros2_common.core.errors import WrongValue
from skiros2_motion.core.geometry import IDENTITY, Pose, Vector, composed, from_euler, half_extents, rotated
from skiros2_skill.testing import SkillBench
from skiros2_std_reasoners.core.places import Box, grasp_of, in_grasp, is_on, release_of
from skiros2_std_reasoners.core.scene_poses import pose_in_scene

AHEAD: Vector = (1.0, 0.0, 0.0)
CUBE = (0.05, 0.05, 0.05)


def turned(yaw: float, roll: float = 0.0, pitch: float = 0.0) -> Pose:
    return Pose((0.5, 0.1, 0.6), from_euler(roll, pitch, yaw))


def axis(pose: Pose, index: int) -> Vector:
    return rotated(pose.orientation, [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)][index])


@pytest.mark.parametrize("yaw", [0.0, 0.3, -0.7, 1.2, 2.0, 3.1])
def test_grasp_of_a_cube_points_down_with_small_yaw(yaw: float) -> None:
    grasp = grasp_of(Box(turned(yaw), CUBE), AHEAD)
    assert grasp.position == pytest.approx((0.5, 0.1, 0.6))
    assert axis(grasp, 2) == pytest.approx((0.0, 0.0, -1.0), abs=1e-9)
    assert axis(grasp, 0)[0] >= math.cos(math.pi / 4) - 1e-9


@pytest.mark.parametrize("yaw", [0.0, 0.4, 1.5, -2.5])
@pytest.mark.parametrize(("size", "narrow"), [((0.04, 0.07, 0.05), 0), ((0.07, 0.04, 0.05), 1)])
def test_grasp_is_across_the_narrower_side(yaw: float, size: Vector, narrow: int) -> None:
    pose = turned(yaw)
    grasp = grasp_of(Box(pose, size), AHEAD)
    fingers, side = axis(grasp, 1), axis(pose, narrow)
    assert abs(sum(a * b for a, b in zip(fingers, side, strict=True))) == pytest.approx(1.0)
    assert axis(grasp, 0)[0] >= -1e-9, "never backwards"


def test_grasp_of_a_lying_box_uses_its_horizontal_edges() -> None:
    # Its long edge, z, lies along the y axis of the scene.
    pose = turned(0.0, roll=math.pi / 2)
    grasp = grasp_of(Box(pose, (0.05, 0.05, 0.12)), AHEAD)
    assert abs(axis(grasp, 1)[0]) == pytest.approx(1.0)


def test_tall_object_is_grasped_near_its_top() -> None:
    grasp = grasp_of(Box(turned(0.0), (0.05, 0.05, 0.2)), AHEAD)
    assert grasp.position[2] == pytest.approx(0.6 + 0.1 - 0.04)


@pytest.mark.parametrize("yaw", [0.0, 0.5, -1.0])
@pytest.mark.parametrize("size", [CUBE, (0.04, 0.06, 0.15)])
def test_released_object_is_centred_in_the_tray(yaw: float, size: Vector) -> None:
    thing = Box(turned(yaw), size)
    held = Box(in_grasp(thing, grasp_of(thing, AHEAD)), size)
    tray = Box(Pose((1.0, -2.0, 0.5), from_euler(0.0, 0.0, 0.2)), (0.3, 0.25, 0.02))
    released = composed(release_of(tray, held, AHEAD), held.pose)
    foot = released.position[2] - half_extents(released.orientation, size)[2]
    assert released.position[:2] == pytest.approx((1.0, -2.0))
    assert foot == pytest.approx(0.51)
    assert is_on(Box(released, size), tray)


@pytest.mark.parametrize(
    ("position", "on"),
    [
        ((0.0, 0.0, 0.035), True),
        ((0.14, 0.11, 0.035), True),
        ((0.16, 0.0, 0.035), False),
        ((0.0, 0.13, 0.035), False),
        ((0.0, 0.0, 0.085), True),  # on top of another one
        ((0.0, 0.0, 0.3), False),
        ((0.0, 0.0, -0.05), False),
    ],
)
def test_object_above_the_top_is_on_a_box(position: Vector, on: bool) -> None:
    tray = Box(Pose((3.0, 1.0, 0.5), from_euler(0.0, 0.0, 1.0)), (0.3, 0.25, 0.02))
    there = composed(tray.pose, Pose(position, IDENTITY.orientation))
    assert is_on(Box(there, CUBE), tray) is on


def test_pose_in_scene_composes_all_ancestors() -> None:
    def place(parent: object, label: str, x: float, yaw: float) -> object:
        q = from_euler(0.0, 0.0, yaw)
        numbers = dict(zip(("PositionX", "PositionY", "PositionZ"), (x, 0.0, 0.0), strict=True))
        numbers |= {f"Orientation{a}": v for a, v in zip("XYZW", q, strict=True)}
        return bench.add("skiros:Location", label, parent, **numbers)

    with SkillBench() as bench:
        table = place(None, "table", 1.0, math.pi / 2)
        tray = place(table, "tray", 2.0, math.pi / 2)
        frame, pose = pose_in_scene(bench.wmi, bench.element("tray"))
        assert (frame, pose.position) == ("map", pytest.approx((1.0, 2.0, 0.0)))
        assert axis(pose, 0) == pytest.approx((-1.0, 0.0, 0.0), abs=1e-9)
        bench.add("skiros:Product", "lost", tray)
        with pytest.raises(WrongValue, match="'lost' has no pose"):
            pose_in_scene(bench.wmi, bench.element("lost"))
