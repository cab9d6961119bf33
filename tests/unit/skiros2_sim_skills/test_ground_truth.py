"""A product counts as put down only when it lies in the tray, upright, at rest, and nobody holds it."""

import math

import pytest

from skiros2_demo.ground_truth import Body, check_placement
from skiros2_std_reasoners.core.geometry import IDENTITY, Pose, from_euler

TRAY = Body("Tray B", Pose((2.0, -1.5, 0.77), from_euler(0.0, 0.0, 0.5)), (0.4, 0.3, 0.04))
SIZE = (0.05, 0.05, 0.08)
STILL = (0.0, 0.0, 0.0)


def product(x: float = 2.0, y: float = -1.5, z: float = 0.83, roll: float = 0.0, yaw: float = 0.0) -> Body:
    return Body("Product A", Pose((x, y, z), from_euler(roll, 0.0, yaw)), SIZE)


def wrong(body: Body, velocity=STILL, spin=STILL, touched_by=()) -> list[str]:
    return [finding.text for finding in check_placement(body, TRAY, velocity, spin, touched_by) if not finding.holds]


def test_a_product_that_stands_in_the_tray_is_there() -> None:
    assert wrong(product()) == []
    assert [finding.text for finding in check_placement(product(), TRAY, STILL, STILL, ())] == [
        "Product A is within Tray B, 0 mm from its middle",
        "it stands on it: its underside is 0 mm above the tray's top",
        "it is upright: it leans by 0.0 degrees",
        "it is at rest: it moves with 0.0 mm/s",
        "no robot touches it",
    ]


@pytest.mark.parametrize("yaw", [0.3, 2.0, -1.0])
def test_how_it_is_turned_about_the_vertical_does_not_matter(yaw: float) -> None:
    assert wrong(product(yaw=yaw)) == []


def test_a_tray_with_a_rim_has_its_floor_lower() -> None:
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
def test_one_that_is_elsewhere_or_otherwise_is_not(body: Body, words: str) -> None:
    assert any(words in text for text in wrong(body))


def test_a_cube_stands_upright_on_any_of_its_sides() -> None:
    for roll, pitch in ((math.pi / 2, 0.0), (0.0, -math.pi / 2), (math.pi, 0.0)):
        cube = Body("Product A", Pose((2.0, -1.5, 0.815), from_euler(roll, pitch, 0.3)), (0.05, 0.05, 0.05))
        assert wrong(cube) == []


def test_one_that_moves_is_not_there_yet() -> None:
    assert wrong(product(), velocity=(0.0, 0.02, 0.0)) == ["it is at rest: it moves with 20.0 mm/s"]
    assert len(wrong(product(), spin=(0.0, 0.0, 0.2))) == 1


def test_one_that_a_robot_holds_is_not_put_down() -> None:
    assert wrong(product(), touched_by=["robot/b", "robot/a"]) == ["it is held by robot/a, robot/b"]


def test_a_pose_that_is_no_pose_never_counts() -> None:
    nan = Body("Product A", Pose((math.nan,) * 3, IDENTITY.orientation), SIZE)
    assert len(wrong(nan, velocity=(math.nan,) * 3)) >= 3
    turned = Body("Product A", Pose((2.0, -1.5, 0.83), (math.nan,) * 4), SIZE)
    assert any("upright" in text for text in wrong(turned))
