"""The skills in the simulated world, in one process."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_motion.core.geometry import Pose
from skiros2_skill.testing import FakeClock, SkillBench
from skiros2_std_reasoners.core.places import Box, is_on
from skiros2_std_reasoners.core.scene_poses import pose_in_scene
from support.physical_drivers import PhysicalDrivers
from support.stand_in_drivers import install

SCENE = Path(__file__).parents[3] / "skiros2_std_lib/demos/pick_and_place/owl" / "sim_scene.ttl"
PRODUCT, TRAY_B, GRIPPER = "skiros:Product-14", "demo:Tray-12", "rparts:GripperEffector-4"
PERIOD = 0.1


class Cell(SkillBench):
    """The scene with physics. `meanwhile` is called at each tick with the simulated time (s)."""

    def __init__(self, clock: FakeClock, **world: Any) -> None:
        super().__init__(SCENE, clock=clock, period=PERIOD)
        start = self.robot.getRelation("-1", "skiros:hasStartLocation")["dst"]
        self.wmi.set_relation(self.robot.id, "skiros:at", start)
        self.import_libraries("skiros2_std_skills", "skiros2_sim_skills")
        self.drivers = PhysicalDrivers(SCENE, self.wmi, **world)
        self.world = self.drivers.world

    def do(self, skill: str, meanwhile: Callable[[Any], None] = lambda task: None, **params: str) -> Any:
        task = self.command(skill, **{key: self.element(label) for key, label in params.items()})
        for _ in range(600):
            if task.tick() is not State.Running:
                break
            meanwhile(task)
            self.drivers.advance(PERIOD)
        return task

    def done(self, skill: str, **params: str) -> None:
        task = self.do(skill, **params)
        assert task.state is State.Success, task.why


@pytest.fixture
def make_cell(fake_clock: FakeClock, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Cell]]:
    made: list[Cell] = []

    def make(**world: Any) -> Cell:
        made.append(Cell(fake_clock, **world))
        install(monkeypatch, made[-1].drivers)
        return made[-1]

    yield make
    for cell in made:
        cell.drivers.close()


def runs(task: Any, label: str) -> bool:
    """Whether a node of that label is running."""
    return any(node.label == label and node.state is State.Running for node in task.nodes())


@pytest.mark.long
def test_skills_bring_a_displaced_product_to_another_tray(make_cell: Callable[..., Cell]) -> None:
    cell = make_cell(seed=7, position_noise=0.03, yaw_noise=0.5)
    cell.done("Drive", TargetLocation="Workstation 1")
    cell.done("Look", Workstation="Workstation 1")
    cell.done("Pick", Object="Product A")
    held = cell.world.pose_of(PRODUCT).position
    assert math.dist(held, pose_in_scene(cell.wmi, cell.element("Product A"))[1].position) < 0.015
    cell.done("Drive", TargetLocation="Workstation 2")
    cell.done("Look", Workstation="Workstation 2")
    cell.done("Place", Object="Product A", Container="Tray B")
    assert cell.holder("Product A") == "Tray B"
    true = cell.world.pose_of(PRODUCT)
    assert is_on(Box(true, (0.05, 0.05, 0.05)), Box(cell.world.pose_of(TRAY_B), (0.25, 0.3, 0.02)))
    assert true.position[2] == pytest.approx(0.545, abs=0.002), "it stands on the tray, not on its edge"
    assert math.dist(true.position, pose_in_scene(cell.wmi, cell.element("Product A"))[1].position) < 0.005


def test_slipped_product_is_found_and_picked_again(make_cell: Callable[..., Cell]) -> None:
    cell = make_cell()
    cell.done("Drive", TargetLocation="Workstation 1")
    cell.done("Look", Workstation="Workstation 1")

    def slip(task: Any) -> None:
        if runs(task, "lift_tool"):
            cell.world.faults.set("slipping_gripper", GRIPPER, 0.0, 2.0)

    task = cell.do("Pick", slip, Object="Product A")
    assert task.state is State.Failure
    assert "Product A is not between the fingers" in task.root.progress_msg
    assert cell.holder("Product A") == "Tray A"
    assert not cell.element("Workstation 1").value_of("demo:Observed")
    cell.done("Look", Workstation="Workstation 1")
    cell.done("Pick", Object="Product A")
    assert cell.world.pose_of(PRODUCT).position[2] > 0.7


def test_unreachable_product_has_a_reason(make_cell: Callable[..., Cell]) -> None:
    cell = make_cell()
    cell.done("Drive", TargetLocation="Workstation 1")
    cell.world.set_pose(PRODUCT, Pose((2.2, 1.2, 0.525), (0.0, 0.0, 0.0, 1.0)))
    cell.done("Look", Workstation="Workstation 1")
    assert cell.holder("Product A") == "Top of workstation 1"
    task = cell.do("Pick", Object="Product A")
    assert task.state is State.Failure
    assert "Moving above Product A failed: out of reach of the arm" in task.root.progress_msg
