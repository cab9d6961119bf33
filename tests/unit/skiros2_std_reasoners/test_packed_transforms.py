"""Serialised transforms."""

from __future__ import annotations

import io

import genpy
import numpy as np
import pytest
import rospy
from geometry_msgs.msg import TransformStamped
from tf2_msgs.msg import TFMessage

from skiros2_motion.core.geometry import Pose
from skiros2_std_reasoners.ros.packed_transforms import IncomingMessage, PackedTransforms
from skiros2_std_reasoners.ros.transforms import Transforms, transform_message

TURN = (0.5, 0.5, 0.5, 0.5)
STAMP = genpy.Time(1_800_000_000, 123_456_789)


def pose(x: float) -> Pose:
    return Pose((x, 2.0, 3.0), TURN)


def unpacked(packed: PackedTransforms, now: float = 0.0) -> TFMessage:
    return TFMessage().deserialize(_bytes(packed.message(STAMP, now)))


def _bytes(message: TFMessage) -> bytes:
    buffer = io.BytesIO()
    message.serialize(buffer)
    return buffer.getvalue()


def positions(packed: PackedTransforms, now: float = 0.0) -> dict[str, float]:
    return {t.child_frame_id: t.transform.translation.x for t in unpacked(packed, now).transforms}


@pytest.fixture
def packed() -> PackedTransforms:
    packed = PackedTransforms()
    packed.put("a", "map", "skiros:Part-1", pose(1.0))
    packed.put("b", "/skiros:Part-1", "/größe", pose(2.0))
    return packed


def test_bytes_equal_the_serialised_message(packed: PackedTransforms) -> None:
    transforms = [
        transform_message("map", "skiros:Part-1", pose(1.0), STAMP),
        transform_message("skiros:Part-1", "größe", pose(2.0), STAMP),
    ]
    assert _bytes(packed.message(STAMP, 0.0)) == _bytes(TFMessage(transforms))
    assert unpacked(PackedTransforms()) == TFMessage()


def test_pose_is_updated_in_place(packed: PackedTransforms) -> None:
    unpacked(packed)
    packed.put("a", "map", "skiros:Part-1", pose(7.0))
    assert positions(packed) == {"skiros:Part-1": 7.0, "größe": 2.0}
    packed.put("b", "map", "größe", pose(8.0))
    assert [t.header.frame_id for t in unpacked(packed).transforms] == ["map", "map"]
    assert positions(packed) == {"skiros:Part-1": 7.0, "größe": 8.0}


def test_moving_transform_has_its_current_position(packed: PackedTransforms) -> None:
    packed.put("a", "map", "a", pose(1.0), (0.5, 0.0, -1.0), since=10.0)
    assert positions(packed, 10.0)["a"] == 1.0
    moved = unpacked(packed, 14.0).transforms[0].transform
    assert (moved.translation.x, moved.translation.y, moved.translation.z) == (3.0, 2.0, -1.0)
    assert moved.rotation.w == 0.5
    packed.put("c", "map", "c", pose(5.0))
    assert positions(packed, 14.0) == {"a": 3.0, "größe": 2.0, "c": 5.0}
    packed.put("a", "map", "a", pose(4.0))
    assert positions(packed, 20.0)["a"] == 4.0, "it has stopped"


def test_removed_transform_is_not_in_the_message(packed: PackedTransforms) -> None:
    packed.put("a", "map", "a", pose(1.0), (0.5, 0.0, 0.0), since=0.0)
    unpacked(packed)
    packed.drop("a")
    packed.drop("never there")
    assert positions(packed, 5.0) == {"größe": 2.0}
    packed.drop("b")
    assert len(packed) == 0


def test_random_changes_equal_new_serialisation() -> None:
    chance = np.random.default_rng(3)
    packed, held = PackedTransforms(), {}
    for step in range(400):
        key = int(chance.integers(12))
        if chance.random() < 0.2:
            packed.drop(key)
            held.pop(key, None)
        else:
            velocity = (float(chance.integers(2)), 0.0, 0.0)
            held[key] = ("map" * int(chance.integers(1, 3)), f"f{key}", pose(float(step)), velocity, float(step))
            packed.put(key, *held[key])
        if chance.random() < 0.5:
            fresh = PackedTransforms()
            for key, transform in held.items():
                fresh.put(key, *transform)
            found = sorted(unpacked(packed, step + 1.0).transforms, key=lambda t: t.child_frame_id)
            assert found == sorted(unpacked(fresh, step + 1.0).transforms, key=lambda t: t.child_frame_id)


def test_incoming_message_equals_a_tf_message() -> None:
    sent = TFMessage([TransformStamped(child_frame_id="a")])
    read = IncomingMessage().deserialize(_bytes(sent))
    assert read.transforms == sent.transforms
    assert isinstance(read, TFMessage) and IncomingMessage().transforms == []
    assert (IncomingMessage._type, IncomingMessage._md5sum) == (TFMessage._type, TFMessage._md5sum)


def test_own_messages_are_ignored(packed: PackedTransforms) -> None:
    transforms = Transforms()
    message = packed.message(STAMP, 0.0)
    transforms.sent(message)
    transforms._on_tf(IncomingMessage().deserialize(_bytes(message)), False)
    assert transforms.find("map", "skiros:Part-1") is None
    transforms._on_tf(IncomingMessage().deserialize(_bytes(packed.message(rospy.Time(7), 0.0))), False)
    assert transforms.find("map", "größe") is not None
    transforms.drop("größe")
    assert transforms.find("map", "größe") is None
    transforms._on_tf(TFMessage([transform_message("map", "größe", pose(1.0), rospy.Time(8))]), False)
    assert transforms.find("map", "größe") == pose(1.0)
