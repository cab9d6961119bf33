"""A plug that has not latched is put back and gripped again: the tree of `connect_plug`, with stand-ins for its
motions."""

from __future__ import annotations

from typing import Any

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.failure_kind import FailureKind
from skiros2_contact_skills import assembly, descriptions, gripping, plugging
from skiros2_motion.core.geometry import IDENTITY
from skiros2_skill.testing import SkillBench
from skiros2_std_reasoners.core.places import move_in_world_model
from support.connector_cell import HOUSING, PLUG, SCENE, SOCKET

HOLDER = "piston:Stand-16"
MOTIONS = (
    descriptions.ApproachTarget,
    descriptions.MoveUntilContact,
    descriptions.RetractTool,
    descriptions.RetractAfterFailure,
    descriptions.HoldPose,
    plugging.PlugIntoSocket,
    gripping.CheckGrip,
    gripping.ReleasePart,
    assembly.PutDownPart,
)


class Cell:
    """Both parts are held. Motions note their names."""

    def __init__(self, bench: SkillBench) -> None:
        self.bench, self.wmi = bench, bench.wmi
        self.done: list[str] = []
        self.kind = FailureKind.RETRYABLE
        self.holds = True
        ends = {
            "HoldPose": lambda skill: skill.step("holding"),
            "PlugIntoSocket": lambda skill: skill.fail("no click", -131, self.kind),
            "CheckGrip": self._check,
            "RetractAfterFailure": lambda skill: skill.fail("retracted", -127),
            "PutDownPart": self._put_down,
        }
        for motion in MOTIONS:
            name = motion.__name__
            end = ends.get(name, lambda skill: skill.success("done"))
            bench.stand_in(motion, execute=self._noted(name, end))
        bench.load(plugging.connect_plug)
        for part, gripper in ((PLUG, "rparts:GripperEffector-5"), (HOUSING, "rparts:GripperEffector-4")):
            move_in_world_model(self.wmi, self.wmi.get_element(part), self.wmi.get_element(gripper), IDENTITY)

    def _noted(self, name: str, end: Any) -> Any:
        def execute(skill: Any) -> State:
            if not self.done or self.done[-1] != name:
                self.done.append(name)
            return end(skill)

        return execute

    def _check(self, skill: Any) -> State:
        if self.holds:
            return skill.success("held")
        return skill.fail("the fingers have closed", -111, FailureKind.LOST)

    def _put_down(self, skill: Any) -> State:
        part, stand = (skill.params[key].value for key in ("Part", "Container"))
        move_in_world_model(self.wmi, part, stand, IDENTITY)
        return skill.success("put down")

    def run(self) -> Any:
        task = self.bench.command("ConnectPlug", Part=self.wmi.get_element(PLUG), Socket=self.wmi.get_element(SOCKET))
        task.tick(60)
        return task


@pytest.fixture
def cell() -> Any:
    with SkillBench(SCENE) as bench:
        yield Cell(bench)


def test_plug_that_does_not_latch_is_put_back_into_its_holder(cell: Cell) -> None:
    task = cell.run()
    assert task.state is State.Failure
    assert cell.done[-4:] == ["RetractTool", "CheckGrip", "PutDownPart", "RetractAfterFailure"]
    assert "no click" in task.why
    (holder,) = cell.wmi.get_element(PLUG).getRelations("", "skiros:contain", "-1")
    assert holder["src"] == HOLDER


def test_plug_that_is_no_longer_held_is_not_put_down(cell: Cell) -> None:
    cell.holds = False
    task = cell.run()
    assert task.state is State.Failure
    assert cell.done[-2:] == ["CheckGrip", "RetractAfterFailure"]


def test_arm_that_was_stopped_only_retracts(cell: Cell) -> None:
    cell.kind = FailureKind.LIMIT
    task = cell.run()
    assert task.state is State.Failure
    assert "CheckGrip" not in cell.done and "PutDownPart" not in cell.done
    assert cell.done[-1] == "RetractAfterFailure"
