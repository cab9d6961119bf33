"""Detected objects compared with their true poses."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest

from skiros2_common.core.errors import UnknownName
from skiros2_motion.core.geometry import (
    IDENTITY,
    Pose,
    Vector,
    from_euler,
)
from skiros2_sim.core.camera import looking_at
from skiros2_sim.core.perception import Detection, Noise, Source, detect
from skiros2_sim.core.scene_spec import BodySpec, CameraSpec, SceneSpec
from skiros2_sim.core.world import World
from support.box_symmetry import turn_between

TOP = 0.5
SIZES: dict[str, Vector] = {
    "skiros:Product-2": (0.05, 0.05, 0.05),
    "skiros:Product-3": (0.05, 0.05, 0.08),
    "skiros:Product-4": (0.04, 0.06, 0.05),
}
CUBE, TALL, FLAT = SIZES
CAMERA = CameraSpec("skiros:DepthCamera-5", "above", pose=looking_at((-0.3, 0.1, TOP + 0.5), (0.0, 0.0, TOP)))


def lying(x: float, y: float, size: Vector, yaw: float = 0.0) -> Pose:
    return Pose((x, y, TOP + size[2] / 2), from_euler(0.0, 0.0, yaw))


def scene() -> SceneSpec:
    table = BodySpec(
        "demo:Workstation-1",
        "demo:Workstation",
        pose=Pose((0.0, 0.0, TOP / 2), IDENTITY.orientation),
        size=(1.0, 1.0, TOP),
    )
    products = [
        BodySpec(id, "skiros:Product", f"Product {n}", pose=lying(0.0, 0.2 * (n - 1), size), size=size, movable=True)
        for n, (id, size) in enumerate(SIZES.items())
    ]
    return SceneSpec(bodies=(table, *products), cameras=(CAMERA,))


@pytest.fixture(scope="module")
def shared() -> Iterator[World]:
    with World(scene()) as world:
        yield world


@pytest.fixture
def world(shared: World) -> World:
    shared.reset()
    return shared


def by_id(found: list[Detection]) -> dict[str, Detection]:
    return {detection.id: detection for detection in found}


def errors(world: World, detection: Detection) -> tuple[float, float]:
    """How far a detection is from the truth (m), and how much it is turned from it (rad), looks the same aside."""
    true = world.pose_of(detection.id)
    turned = turn_between(detection.pose, true, SIZES[detection.id])
    return math.dist(detection.pose.position, true.position), turned


def scattered(world: World, random: np.random.Generator) -> None:
    """Puts the products anywhere on the part of the table that the camera sees, apart from each other."""
    for n, (id, size) in enumerate(SIZES.items()):
        world.set_pose(
            id,
            lying(random.uniform(-0.1, 0.1), 0.14 * (n - 1) + random.uniform(-0.02, 0.02), size, random.uniform(-3, 3)),
        )


def test_visible_object_has_type_and_label(world: World) -> None:
    found = detect(world, CAMERA.id)
    assert [(d.id, d.type, d.label) for d in found] == [
        (CUBE, "skiros:Product", "Product 0"),
        (TALL, "skiros:Product", "Product 1"),
        (FLAT, "skiros:Product", "Product 2"),
    ]
    assert all(0.8 < d.confidence <= 1 for d in found)


def test_poses_are_accurate(world: World) -> None:
    random = np.random.default_rng(7)
    of_all = []
    for _ in range(12):
        scattered(world, random)
        found = detect(world, CAMERA.id)
        assert len(found) == len(SIZES)
        of_all += [errors(world, detection) for detection in found]
    distances, angles = np.array(of_all).T
    assert np.median(distances) < 0.0005
    assert distances.max() < 0.003
    assert np.median(angles) < 0.002
    assert angles.max() < 0.05


def test_pose_error_with_noisy_depth_is_bounded(world: World) -> None:
    random = np.random.default_rng(8)
    of_all = []
    for _ in range(8):
        scattered(world, random)
        found = detect(world, CAMERA.id, noise=Noise(depth=0.003))
        of_all += [errors(world, detection) for detection in found]
    distances, angles = np.array(of_all).T
    assert 0.0001 < np.median(distances) < 0.003
    assert distances.max() < 0.01
    assert np.median(angles) < 0.1


def test_fallen_object_is_found_lying(world: World) -> None:
    pose = Pose((0.0, 0.0, TOP + 0.025), from_euler(0.0, math.pi / 2, 0.6))
    world.set_pose(TALL, pose)
    far, turned = errors(world, by_id(detect(world, CAMERA.id))[TALL])
    assert far < 0.003
    assert turned < 0.05


@pytest.mark.parametrize("source", Source)
def test_filter_selects_the_reported_objects(world: World, source: Source) -> None:
    assert [d.id for d in detect(world, CAMERA.id, lambda body: body.label == "Product 1", source)] == [TALL]
    assert detect(world, CAMERA.id, lambda body: False, source) == []


@pytest.mark.parametrize("source", Source)
def test_hidden_object_is_not_found(world: World, source: Source) -> None:
    world.set_pose(CUBE, Pose((0.0, 0.0, 0.1), IDENTITY.orientation))  # in the table
    world.set_pose(FLAT, Pose((3.0, 0.0, 0.025), IDENTITY.orientation))
    assert [d.id for d in detect(world, CAMERA.id, source=source)] == [TALL]


@pytest.mark.parametrize("source", Source)
def test_partly_hidden_object_has_less_confidence(world: World, source: Source) -> None:
    whole = by_id(detect(world, CAMERA.id, source=source))[CUBE].confidence
    eye, (x, y, z) = np.array(CAMERA.pose.position), world.pose_of(CUBE).position
    before = np.array((x, y, z)) + 0.35 * (eye - (x, y, z)) + (0.0, 0.02, 0.0)
    world.set_pose(TALL, Pose((float(before[0]), float(before[1]), float(before[2])), IDENTITY.orientation))
    partly = by_id(detect(world, CAMERA.id, source=source)).get(CUBE)
    assert partly is None or partly.confidence < whole - 0.2


def test_truth_noise_has_the_given_deviation(world: World) -> None:
    noise = Noise(position=0.004, angle=0.05)
    found = [d for _ in range(100) for d in detect(world, CAMERA.id, source=Source.TRUTH, noise=noise)]
    distances, angles = np.array([errors(world, detection) for detection in found]).T
    assert np.sqrt(np.mean(distances**2) / 3) == pytest.approx(0.004, rel=0.15)
    assert np.sqrt(np.mean(angles**2) / 3) == pytest.approx(0.05, rel=0.15)


@pytest.mark.parametrize("source", Source)
def test_detection_is_deterministic_for_a_seed(world: World, source: Source) -> None:
    noise = Noise(depth=0.002, position=0.002, angle=0.02)
    world.reset(seed=5)
    once = detect(world, CAMERA.id, source=source, noise=noise)
    world.reset(seed=5)
    assert detect(world, CAMERA.id, source=source, noise=noise) == once
    world.reset(seed=6)
    assert detect(world, CAMERA.id, source=source, noise=noise) != once


@pytest.mark.parametrize("source", Source)
def test_unknown_camera_is_rejected(world: World, source: Source) -> None:
    with pytest.raises(UnknownName, match="DepthCamera-9"):
        detect(world, "skiros:DepthCamera-9", source=source)
