"""The skills `estimate_pose` and `observe_scene` with a simulated camera, in one process."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import WrongValue
from skiros2_motion.core.geometry import Pose, composed, from_euler
from skiros2_perception.camera_skill import NO_VIEW, NOT_KNOWN, REFUSED, CameraSkill
from skiros2_perception.core.transforms import difference
from skiros2_perception.core.view import View
from skiros2_perception.ros.depth_camera import Topics
from skiros2_sim.core.camera import picture_of
from skiros2_sim.core.scene_reader import load_scene
from skiros2_sim.core.world import World
from skiros2_skill.testing import SkillBench
from skiros2_std_reasoners.core import spatial_data as space
from skiros2_std_reasoners.core.scene_poses import pose_in_scene
from support.moved_robot import MovedRobot, succeeded
from support.perception_cell import BLOCK, CAMERA, CUBE, POSTURES, SCENE


class Cell(SkillBench):
    """The cell in physics and in a world model; skills see it with the robot's camera."""

    def __init__(self) -> None:
        super().__init__(SCENE)
        self.import_libraries("skiros2_std_skills", "skiros2_perception")
        self.world = World(load_scene(SCENE.name, SCENE.parent))
        self.arm = MovedRobot(self.world)
        self.random = np.random.default_rng(0)
        #: Called with each view that the camera takes.
        self.change: Callable[[View], View | None] = lambda view: view
        self.opened: list[tuple[Topics, str]] = []
        self.closed = 0

    def look_from(self, posture: str) -> None:
        succeeded(self.arm.run(self.arm.trajectory(POSTURES[posture])))
        self.world.step(120)

    def do(self, skill: str, **params: Any) -> Any:
        return finished(self.command(skill, Camera=self.element("Camera"), **params))

    def estimate(self, **params: Any) -> Any:
        return self.do("EstimatePose", Object=self.element("Engine block"), **params)

    def known_pose(self, label: str) -> Pose:
        return pose_in_scene(self.wmi, self.element(label))[1]

    def error(self, label: str, eid: str) -> tuple[float, float]:
        """How far the world model is from the truth: m, degrees."""
        error = difference(self.known_pose(label), self.world.pose_of(eid))
        return float(np.linalg.norm(error[:3])), math.degrees(float(np.linalg.norm(error[3:])))

    def poll(self) -> View | None:
        picture = picture_of(self.world, CAMERA)
        f, _, cx, _, _, cy, *_ = picture.lens.matrix
        depth = picture.depth + self.random.normal(0.0, 0.001, picture.depth.shape)
        return self.change(View(depth, (f, f), (cx, cy), picture.pose, "map", self.world.time, picture.rgb))


def finished(task: Any) -> Any:
    """Ticks a task to its end, each time after a thread of a skill has woken it."""
    woken = threading.Event()
    task.waker = woken.set
    while task.tick() is State.Running:
        woken.wait(0.1)
        woken.clear()
    return task


class SimulatedCamera:
    """Stands in for the camera's topics."""

    waiting = "no message on /stationary/camera/depth/image_raw"

    def __init__(self, cell: Cell) -> None:
        self._cell = cell

    def poll(self) -> View | None:
        return self._cell.poll()

    def close(self) -> None:
        self._cell.closed += 1


@pytest.fixture
def cell(monkeypatch: pytest.MonkeyPatch) -> Iterator[Cell]:
    made = Cell()

    def open_camera(skill: CameraSkill, topics: Topics, frame: str) -> SimulatedCamera:
        made.opened.append((topics, frame))
        return SimulatedCamera(made)

    monkeypatch.setattr(CameraSkill, "open_camera", open_camera)
    with made:
        yield made
    made.world.close()


def displace_block(cell: Cell, dx: float, dy: float, yaw: float) -> None:
    x, y, z = cell.world.pose_of(BLOCK).position
    cell.world.set_pose(BLOCK, Pose((x + dx, y + dy, z), from_euler(0.0, 0.0, math.pi / 2 + yaw)))
    cell.world.step(60)


@pytest.mark.long
def test_displaced_block_is_located_and_further_views_are_fused(cell: Cell) -> None:
    displace_block(cell, 0.02, -0.015, 0.12)
    sizes = []
    for posture, fuse in (("left", False), ("right", True), ("home", True)):
        cell.look_from(posture)
        task = cell.estimate(Fuse=fuse)
        assert task.state is State.Success, task.why
        assert "of the points match" in task.skill.progress_msg
        covariance = cell.element("Engine block").value_of("skiros:PoseCovariance")
        sizes.append(len(covariance) and float(np.linalg.det(np.array(_numbers(covariance)).reshape(6, 6))))
    position, angle = cell.error("Engine block", BLOCK)
    assert position < 0.001 and angle < 0.3
    assert sizes == sorted(sizes, reverse=True)
    block = cell.element("Engine block")
    assert block.value_of("skiros:EstimateViews") == 3
    assert block.value_of("skiros:EstimateFitness") > 0.9
    assert 0.0001 < block.value_of("skiros:EstimateResidual") < 0.002
    assert block.value_of("skiros:Confidence") == 1.0
    assert cell.opened[0] == (Topics("/stationary/camera/depth/image_raw"), "map")
    assert cell.closed == 3


def test_bores_move_with_the_located_block(cell: Cell) -> None:
    displace_block(cell, 0.02, 0.0, 0.1)
    cell.look_from("left")
    assert cell.estimate().state is State.Success
    true = composed(cell.world.pose_of(BLOCK), Pose((-0.12, 0.0, 0.05), (0.0, 0.0, 0.0, 1.0)))
    assert math.dist(cell.known_pose("Bore 1").position, true.position) < 0.001


@pytest.mark.long
def test_view_that_disagrees_with_the_estimate_is_refused_and_changes_nothing(cell: Cell) -> None:
    cell.look_from("left")
    assert cell.estimate().state is State.Success
    displace_block(cell, 0.02, 0.0, 0.0)
    cell.look_from("right")
    before = cell.element("Engine block")
    task = cell.estimate(Fuse=True)
    assert task.state is State.Failure and task.skill.progress_code == REFUSED
    assert "the object may have moved" in task.skill.progress_msg
    assert cell.element("Engine block").version == before.version
    assert cell.estimate(Fuse=False).state is State.Success


def test_missing_block_is_refused_with_reason_and_changes_nothing(cell: Cell) -> None:
    cell.look_from("left")
    cell.world.set_pose(BLOCK, Pose((3.0, 3.0, 0.2), (0.0, 0.0, 0.0, 1.0)))
    before = cell.element("Engine block")
    task = cell.estimate()
    assert task.state is State.Failure and task.skill.progress_code == REFUSED
    text = task.skill.progress_msg
    assert "0% of the points match the shape" in text and "the camera sees through" in text
    assert cell.element("Engine block").version == before.version


def test_block_beyond_the_limits_is_refused(cell: Cell) -> None:
    displace_block(cell, 0.0, 0.04, 0.0)
    cell.look_from("left")
    task = cell.estimate(MaxShift=0.02)
    assert "mm from the expected position: expected up to 20 mm" in task.skill.progress_msg


def test_without_a_view_the_skill_fails_with_what_is_missing(cell: Cell) -> None:
    cell.change = lambda view: None
    task = cell.estimate(Timeout=0.05)
    assert task.state is State.Failure and task.skill.progress_code == NO_VIEW
    assert task.skill.progress_msg == "No view within 0.05 s: no message on /stationary/camera/depth/image_raw"
    assert cell.closed == 1


def test_unusable_message_is_refused(cell: Cell) -> None:
    def refuse(view: View) -> View:
        raise WrongValue("depth image with encoding 'rgb8': expected 32FC1, 16UC1, mono16")

    cell.change = refuse
    task = cell.estimate()
    assert task.skill.progress_code == NO_VIEW and "expected 32FC1" in task.skill.progress_msg


def test_preempted_skill_leaves_the_world_model_as_it_is(cell: Cell) -> None:
    cell.look_from("left")
    before = cell.element("Engine block")
    task = cell.command("EstimatePose", Camera=cell.element("Camera"), Object=before)
    task.tick()
    task.preempt()
    finished(task)
    assert task.state is State.Failure and cell.closed == 1
    assert cell.element("Engine block").version == before.version


@pytest.mark.long
def test_object_with_a_mesh_is_located(cell: Cell, tmp_path: Path) -> None:
    cube = cell.element("Cube")
    half = 0.5 * cube.value_of("skiros:SizeX")
    corners = [f"v {x} {y} {z}" for x in (-half, half) for y in (-half, half) for z in (-half, half)]
    faces = ["f 1 2 4 3", "f 5 7 8 6", "f 1 5 6 2", "f 3 4 8 7", "f 1 3 7 5", "f 2 6 8 4"]
    (tmp_path / "cube.obj").write_text("\n".join(corners + faces))
    cube.setProperty("skiros:CadModel", str(tmp_path / "cube.obj"), "xsd:string")
    cell.wmi.update_element_properties(cube)
    x, y, z = cell.world.pose_of(CUBE).position
    cell.world.set_pose(CUBE, Pose((x + 0.01, y - 0.005, z), from_euler(0.0, 0.0, 0.1)))
    cell.look_from("home")
    task = cell.do("EstimatePose", Object=cube)
    assert task.state is State.Success, task.why
    assert cell.error("Cube", CUBE)[0] < 0.002


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"skiros:SizeX": None}, "has no size"),
        ({"skiros:PositionX": None}, "has no pose"),
        ({"skiros:LinkedToFrameId": "somewhere"}, "follows the tf frame 'somewhere'"),
        ({"skiros:CadModel": "/none/block.stl"}, "model /none/block.stl does not exist"),
        ({"skiros:CadModel": str(SCENE)}, "perception_scene.ttl: expected one of .obj, .stl"),
        ({"skiros:PoseCovariance": "[]"}, "expected a JSON list of 36 finite numbers"),
    ],
)
def test_object_that_cannot_be_located_is_refused_at_the_start(cell: Cell, change: dict[str, Any], reason: str) -> None:
    block = cell.element("Engine block")
    for key, value in change.items():
        if value is None:
            space.set_numbers(block, [key], [None])
        else:
            block.setProperty(key, value, "xsd:string")
    cell.wmi.update_element_properties(block)
    task = cell.estimate()
    assert task.state is State.Failure and task.skill.progress_code == NOT_KNOWN, task.why
    assert reason in task.skill.progress_msg


def test_camera_with_unusable_properties_is_refused_with_all_problems(cell: Cell) -> None:
    camera = cell.element("Camera")
    space.set_numbers(camera, ["skiros:DepthNoise", "skiros:CameraAngleError"], [-1.0, 7.0])
    cell.wmi.update_element_properties(camera)
    text = cell.estimate().skill.progress_msg
    assert "noise -1.0: expected" in text and "angle 7.0: expected" in text


def test_camera_without_a_topic_is_refused(cell: Cell) -> None:
    camera = cell.element("Camera")
    camera.setProperty("skiros:DepthTopic", "", "xsd:string")
    cell.wmi.update_element_properties(camera)
    assert "expected skiros:DepthTopic or skiros:PointCloudTopic" in cell.estimate().skill.progress_msg


def test_observed_scene_updates_poses_and_adds_an_unknown_object(cell: Cell) -> None:
    cell.look_from("home")
    element = cell.element("Cube")
    cell.wmi.remove_element(element)
    displace_block(cell, 0.01, 0.01, 0.0)
    task = cell.do("ObserveScene", Place=cell.element("Table"))
    assert task.state is State.Success, task.why
    assert "1 objects in view; new: skiros:UnknownObject-" in task.skill.progress_msg
    assert cell.error("Engine block", BLOCK)[0] < 0.002
    assert cell.holder("Unknown object") == "Table"
    assert math.dist(cell.known_pose("Unknown object").position, cell.world.pose_of(CUBE).position) < 0.01
    assert cell.opened[-1][0].colour == "/stationary/camera/color/image_raw"


@pytest.mark.long
def test_removed_object_becomes_missing_after_several_views(cell: Cell) -> None:
    cell.look_from("home")
    cell.world.set_pose(CUBE, Pose((3.0, 3.0, 0.2), (0.0, 0.0, 0.0, 1.0)))
    texts = [cell.do("ObserveScene").skill.progress_msg for _ in range(4)]
    assert "not seen: Cube" in texts[0] and "missing: Cube" in texts[-1]
    assert cell.element("Cube").value_of("skiros:Missing") is True


def test_class_that_is_not_manipulatable_is_refused(cell: Cell) -> None:
    task = cell.do("ObserveScene", Class="skiros:Location")
    assert task.skill.progress_code == NOT_KNOWN
    assert "expected skiros:Manipulatable or a subclass" in task.skill.progress_msg


def _numbers(text: str) -> list[float]:
    return [float(number) for number in text.strip("[]").split(",")]
