"""Pictures of a run."""

import math
from pathlib import Path

from skiros2_common.core.errors import Refused
from skiros2_demo.simulation import Pictures, camera_view
from skiros2_motion.core.geometry import Vector

PLACES = [(0.0, 0.0, 0.0), (2.0, 1.5, 0.6), (2.0, -1.5, 0.6)]


class FakePhotographer:
    def __init__(self) -> None:
        self.taken: list[str] = []

    def take_picture(self, file: Path, eye: Vector, target: Vector) -> Path:
        self.taken.append(file.name)
        return file

    def take_robots_picture(self, file: Path, topic: str) -> Path:
        raise Refused(f"no picture came on {topic}")


def test_pictures_are_taken_once_per_moment(tmp_path: Path) -> None:
    by, said = FakePhotographer(), []
    pictures = Pictures(by, tmp_path, PLACES, "/camera", said.append)
    for moment in ("before", "during", "during", "after"):
        pictures.take(moment)
    assert by.taken == ["before_cell.png", "during_cell.png", "after_cell.png"]
    assert said[:2] == [
        f"  picture: {tmp_path / 'before_cell.png'}",
        "  no picture before_robot.png: no picture came on /camera",
    ]


def test_robot_without_camera_takes_no_picture(tmp_path: Path) -> None:
    said: list[str] = []
    Pictures(FakePhotographer(), tmp_path, PLACES, "", said.append).take("before")
    assert len(said) == 1


def test_overview_looks_at_the_centre() -> None:
    eye, target = camera_view(PLACES)
    assert target == (1.0, 0.0, 0.3)
    assert eye[2] > 1.5
    assert all(math.dist(eye, place) > 1.0 for place in PLACES)
    wide, _ = camera_view([(x * 2, y * 2, z) for x, y, z in PLACES])
    assert math.dist(wide, target) > math.dist(eye, target)
