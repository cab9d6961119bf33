"""The film of a run: its pictures show the cell, and change with the tree and the plan."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest
from PIL import Image, ImageChops

from skiros2_common.core.errors import Refused, SkirosError
from skiros2_demo.film import Film
from skiros2_local.progress import LocalProgress
from skiros2_runs.core.states import NodeState

RED = (255, 0, 0)
#: The areas of the film: picture, tree, plan.
CELL, TREE, PLAN = (20, 20, 500, 330), (530, 10, 1000, 340), (0, 375, 1000, 470)


def tree(state: NodeState) -> list[LocalProgress]:
    root = LocalProgress("/robot", 7, 7, -1, "root", "task", (), "", state, 0, 0.0, "")
    return [root, LocalProgress("/robot", 7, 8, 7, "skiros:Drive", "drive", (), "", state, 1, 0.5, "driving")]


def step(number: int, state: str) -> dict[str, object]:
    return {"number": number, "label": "drive", "state": state, "arguments": {"TargetLocation": "x:Shelf-3"}}


class Camera:
    """Takes a red picture each time the test wants one."""

    def __init__(self) -> None:
        self._wanted, self._taken = threading.Semaphore(0), threading.Semaphore(0)

    def __call__(self) -> Image.Image:
        assert self._wanted.acquire(timeout=30)
        self._taken.release()
        return Image.new("RGB", (640, 480), RED)

    def take(self) -> None:
        """Waits for a picture."""
        self._wanted.release()
        assert self._taken.acquire(timeout=30)

    def release(self) -> None:
        """Lets a picture that has begun, and the last one, be taken."""
        self._wanted.release(2)


def test_pictures_show_the_cell_and_follow_tree_and_plan(tmp_path: Path) -> None:
    camera = Camera()
    with Film("on shelf", camera, 0.0, str, lambda text: None) as film:
        camera.take()
        film.tree(tree(NodeState.RUNNING))
        film.steps([step(1, "running"), step(2, "waiting")])
        camera.release()
    frames = images(film.save(tmp_path / "film.gif"))
    assert len(frames) >= 2
    first, last = frames[0], frames[-1]
    assert first.size == (1000, 470)
    assert first.crop(CELL).getcolors() == [(480 * 310, RED)]
    for area in (TREE, PLAN):
        assert ImageChops.difference(first.crop(area), last.crop(area)).getbbox()


def test_steps_of_an_earlier_plan_are_forgotten_unless_they_started(tmp_path: Path) -> None:
    plans = {}
    for name, earlier in (("without", [step(1, "failed")]), ("with", [step(1, "failed"), step(2, "waiting")])):
        camera = Camera()
        with Film("on shelf", camera, 0.0, str, lambda text: None) as film:
            film.steps(earlier)
            film.steps([step(3, "running")])
            camera.release()
        plans[name] = images(film.save(tmp_path / f"{name}.gif"))[-1].crop(PLAN)
    assert not ImageChops.difference(plans["with"], plans["without"]).getbbox()


def test_error_of_the_camera_is_reported_and_ends_the_film(tmp_path: Path) -> None:
    def broken() -> Image.Image:
        raise Refused("sim/take_picture: no world")

    said: list[str] = []
    film = Film("on shelf", broken, 0.0, str, said.append)
    with film:
        pass
    assert said == ["  the film ends: sim/take_picture: no world"]
    with pytest.raises(SkirosError, match=r"film\.gif: no picture"):
        film.save(tmp_path / "film.gif")


def images(file: Path) -> list[Image.Image]:
    with Image.open(file) as film:
        found = []
        for number in range(film.n_frames):
            film.seek(number)
            found.append(film.convert("RGB"))
        return found
