"""Regions that no tool enters, in physics. The judge is the engine's pose of the tool in each step."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.world_element import Element
from skiros2_contact_skills import contact_primitive as codes
from skiros2_contact_skills.force_motions import hold_pose
from skiros2_contact_skills.free_motions import approach_target, retract_tool
from skiros2_contact_skills.never_regions import NEVER
from skiros2_motion.core.compliant_arm import KeepsOut
from skiros2_motion.core.geometry import IDENTITY, Pose
from skiros2_motion.core.regions import Region
from skiros2_std_reasoners.core import spatial_data as space
from support.contact_cell import TABLE_TOP, ContactCell, contact_cell
from support.simulated_cell import GRIPPER, bench

#: Where the tool starts, and a target behind the regions, in the map.
START, BEHIND = (0.5, 0.0, TABLE_TOP + 0.25), (0.5, 0.3, TABLE_TOP + 0.24)
MIDDLE = (0.5, 0.15, TABLE_TOP + 0.25)
BOX = {"SizeX": 0.3, "SizeY": 0.1, "SizeZ": 0.6}, (0.3, 0.1, 0.6), False
ROUND = {"Diameter": 0.1, "SizeZ": 0.6}, (0.1, 0.1, 0.6), True
Shape = tuple[dict[str, float], tuple[float, ...], bool]


class Cell:
    """A contact cell with regions. A motion of the world.

    :ivar least: smallest true distance of the tool from the region since `place` (m).
    """

    outcome = None

    def __init__(self, cell: ContactCell) -> None:
        self.made, self.skills = cell, cell.skills
        self.least, self._region = 1.0, Region("", IDENTITY)
        self._added: list[Element] = []
        cell.world.motions.add(self)  # type: ignore[arg-type]

    def update(self, dt: float) -> None:
        """Called before each step."""
        self.least = min(self.least, self._region.plane(self.made.robot.arm.tool_pose().position)[0])

    def place(self) -> None:
        self.made.place(START)
        self.least = 1.0

    def add(self, shape: Shape, position: Sequence[float] = MIDDLE) -> Element:
        """Adds a region to the scene."""
        values, size, is_round = shape
        x, y, z = position
        self._region = Region("", Pose((x, y, z), IDENTITY.orientation), size, is_round)
        element = self.pose(NEVER, position)
        for key, value in values.items():
            element.setProperty(f"skiros:{key}", value)
        self.skills.wmi.update_element_properties(element)
        return element

    def pose(self, kind: str, position: Sequence[float]) -> Element:
        """Adds a pose to the scene."""
        x, y, z = position
        element = self.skills.add(kind, f"{kind} of the cell")
        space.set_pose(element, Pose((x, y, z), IDENTITY.orientation))
        self.skills.wmi.update_element_properties(element)
        self._added.append(element)
        return element

    def approach(self, position: Sequence[float], **params: object) -> object:
        target = self.pose("skiros:TransformationPose", position)
        return self.made.run("ApproachTarget", Target=target, Height=0.0, Speed=0.2, Tolerance=0.01, **params)

    def close(self) -> None:
        for element in self._added:
            self.skills.wmi.remove_element(element)
        assert isinstance(self.made.compliant, KeepsOut)
        self.made.compliant.set_regions([])
        self.made.world.motions.remove(self)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def shared_cell() -> Iterator[ContactCell]:
    with contact_cell(bench(), approach_target, retract_tool, hold_pose) as cell:
        yield cell


@pytest.fixture
def cell(shared_cell: ContactCell) -> Iterator[Cell]:
    made = Cell(shared_cell)
    made.place()
    yield made
    made.close()


def test_target_behind_a_region_is_reached_without_it(cell: Cell) -> None:
    task = cell.approach(BEHIND)
    assert task.state is State.Success, task.why


@pytest.mark.parametrize("shape", [BOX, ROUND], ids=["box", "cylinder"])
def test_tool_that_is_commanded_through_a_region_stays_outside(cell: Cell, shape: Shape) -> None:
    cell.add(shape)
    task = cell.approach(BEHIND)
    assert 0.015 < cell.least < 0.03
    y = cell.made.robot.arm.tool_pose().position[1]
    if shape is BOX:
        assert task.skill.progress_code == codes.NOT_REACHED
        assert y < 0.1, "before it"
    else:
        assert task.state is State.Success, "round it"


def test_tool_that_is_pushed_at_a_half_space_stays_outside(cell: Cell) -> None:
    cell.add(({}, (), False), (0.0, 0.0, START[2] - 0.05))
    cell.made.world.push(GRIPPER, (0.0, 0.0, -80.0), duration=1.5)
    cell.made.run("HoldPose", seconds=2.0, Duration=1.5, MaxDistance=0.2, MaxForce=120.0, MaxTorque=60.0)
    assert 0.005 < cell.least < 0.025
    cell.made.world.step(1000)


def test_goal_in_a_region_is_refused(cell: Cell) -> None:
    cell.add(BOX)
    task = cell.approach(MIDDLE)
    assert task.skill.progress_code == codes.NOT_READY
    assert "the goal is 50 mm inside" in task.why
    assert cell.least > 0.08, "it has not moved"


def test_tool_that_is_in_a_region_does_not_start(cell: Cell) -> None:
    cell.add(BOX, START)
    task = cell.approach(BEHIND)
    assert task.skill.progress_code == codes.NOT_READY
    assert "50 mm inside 'skiros:NeverRegion of the cell', which no tool enters" in task.why


@pytest.mark.parametrize("values", [{"SizeX": 0.1}, {"Diameter": 0.1}, {"SizeX": 0.1, "SizeY": 0.1, "SizeZ": 0.0}])
def test_region_without_a_usable_size_is_refused(cell: Cell, values: dict[str, float]) -> None:
    cell.add((values, (), False))
    task = cell.approach(BEHIND)
    assert task.skill.progress_code == codes.NOT_READY
    assert "expected skiros:Diameter and SizeZ; SizeX, SizeY and SizeZ" in task.why
