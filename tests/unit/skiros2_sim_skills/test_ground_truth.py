"""Checking the placement of a product by true poses."""

import math

import pytest

from skiros2_demo.simulation import Body, check_placement
from skiros2_motion.core.geometry import IDENTITY, Pose, from_euler

TRAY = Body("Tray B", Pose((2.0, -1.5, 0.77), from_euler(0.0, 0.0, 0.5)), (0.4, 0.3, 0.04))
SIZE = (0.05, 0.05, 0.08)
STILL = (0.0, 0.0, 0.0)


def product(x: float = 2.0, y: float = -1.5, z: float = 0.83, roll: float = 0.0, yaw: float = 0.0) -> Body:
    return Body("Product A", Pose((x, y, z), from_euler(roll, 0.0, yaw)), SIZE)


def wrong(body: Body, velocity=STILL, spin=STILL, touched_by=()) -> list[str]:
    return [finding.text for finding in check_placement(body, TRAY, velocity, spin, touched_by) if not finding.holds]


def test_placed_product_passes() -> None:
    assert wrong(product()) == []
    assert [finding.text for finding in check_placement(product(), TRAY, STILL, STILL, ())] == [
        "Product A is within Tray B, 0 mm from its middle",
        "it stands on it: its underside is 0 mm above the tray's top",
        "it is upright: it leans by 0.0 degrees",
        "it is at rest: it moves with 0.0 mm/s",
        "no robot touches it",
    ]


@pytest.mark.parametrize("yaw", [0.3, 2.0, -1.0])
def test_yaw_does_not_matter(yaw: float) -> None:
    assert wrong(product(yaw=yaw)) == []


def test_tray_with_a_rim_has_a_lower_floor() -> None:
    assert wrong(product(z=0.80)) == []


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (product(x=2.22), "within"),  # its edge is over the tray's
        (product(y=-0.5), "within"),
        (product(z=0.93), "stands on"),  # in the air
        (product(z=0.70), "stands on"),  # under it
        (product(roll=math.radians(20), z=0.85), "upright"),
        (product(roll=math.pi / 2), "upright"),  # on its side
    ],
)
def test_misplaced_product_fails(body: Body, words: str) -> None:
    assert any(words in text for text in wrong(body))


def test_cube_is_upright_on_any_side() -> None:
    for roll, pitch in ((math.pi / 2, 0.0), (0.0, -math.pi / 2), (math.pi, 0.0)):
        cube = Body("Product A", Pose((2.0, -1.5, 0.815), from_euler(roll, pitch, 0.3)), (0.05, 0.05, 0.05))
        assert wrong(cube) == []


def test_moving_product_fails() -> None:
    assert wrong(product(), velocity=(0.0, 0.02, 0.0)) == ["it is at rest: it moves with 20.0 mm/s"]
    assert len(wrong(product(), spin=(0.0, 0.0, 0.2))) == 1


def test_held_product_fails() -> None:
    assert wrong(product(), touched_by=["robot/b", "robot/a"]) == ["it is held by robot/a, robot/b"]


def test_invalid_pose_fails() -> None:
    nan = Body("Product A", Pose((math.nan,) * 3, IDENTITY.orientation), SIZE)
    assert len(wrong(nan, velocity=(math.nan,) * 3)) >= 3
    turned = Body("Product A", Pose((2.0, -1.5, 0.83), (math.nan,) * 4), SIZE)
    assert any("upright" in text for text in wrong(turned))
