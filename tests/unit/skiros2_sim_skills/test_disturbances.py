"""Disturbances of the demo occur once, at their time."""

from random import Random
from types import SimpleNamespace
from typing import Any

import pytest

from skiros2_common.core.errors import Refused
from skiros2_demo.run_check import Thing, WorldState
from skiros2_demo.simulation import Moved, Slip
from skiros2_motion.core.geometry import Pose

IDLE, RUNNING = 4, 3
TRAY_POSE = Pose((1.0, 2.0, 0.77), (0.0, 0.0, 0.0, 1.0))


class FakeHand:
    """Remembers what was done."""

    def __init__(self) -> None:
        self.done: list[Any] = []

    def pose_of(self, element: str) -> Pose:
        assert element == "demo:Tray-3"
        return TRAY_POSE

    def put(self, element: str, pose: Pose) -> None:
        self.done.append((element, pose))

    def slip(self, gripper: str, active: bool) -> None:
        self.done.append((gripper, active))


def thing(eid: str, label: str, *size: float) -> Thing:
    return Thing(eid, eid.partition("-")[0], label, {f"skiros:Size{a}": [s] for a, s in zip("XYZ", size, strict=False)})


def world(neighbour: bool = True) -> WorldState:
    state = WorldState()
    for made in (
        thing("demo:Workstation-1", "Workstation 1", 0.8, 1.2, 0.75),
        thing("demo:Tray-2", "Tray A", 0.4, 0.3, 0.04),
        thing("demo:Tray-3", "Tray C", 0.4, 0.3, 0.04),
        thing("demo:Tray-4", "Tray E", 0.4, 0.3, 0.04),
        thing("skiros:Product-5", "Product A", 0.05, 0.05, 0.08),
        thing("skiros:Product-6", "Product B", 0.05, 0.05, 0.08),
    ):
        state.things[made.id] = made
    for tray, filled in (("demo:Tray-2", "Full"), ("demo:Tray-3", "Empty"), ("demo:Tray-4", "Full")):
        state.things[tray].properties["skiros:ContainerState"] = [filled]
    pairs = [("demo:Workstation-1", "demo:Tray-2"), ("demo:Workstation-1", "demo:Tray-4")]
    pairs += [("demo:Tray-2", "skiros:Product-5"), ("demo:Tray-4", "skiros:Product-6")]
    pairs += [("demo:Workstation-1", "demo:Tray-3")] if neighbour else []
    state.relations = {(a, "skiros:contain", b) for a, b in pairs}
    return state


def step(label: str, state: str) -> dict[str, Any]:
    return {"number": 1, "label": label, "state": state}


def node(label: str, state: int) -> Any:
    return SimpleNamespace(label=label, state=state, RUNNING=RUNNING)


def test_moved_puts_the_product_into_an_empty_neighbour_tray() -> None:
    control = FakeHand()
    moved = Moved(control, world(), "skiros:Product-5", "demo:Tray-9", Random(1))
    assert moved.steps([step("drive", "waiting")]) == ""
    assert moved.tree([node("drive", RUNNING)]) == ""
    assert moved.steps([step("drive", "running")]) == "somebody puts Product A into Tray C"
    assert moved.steps([step("drive", "running")]) == ""  # once
    ((element, pose),) = control.done
    assert element == "skiros:Product-5"
    assert pose.position == pytest.approx((1.0, 2.0, 0.832), abs=0.03)
    assert pose.position[2] == pytest.approx(0.832)  # not in the tray


def test_moved_pose_depends_on_the_seed() -> None:
    poses = []
    for seed in (1, 1, 2):
        control = FakeHand()
        Moved(control, world(), "skiros:Product-5", "", Random(seed)).steps([step("drive", "running")])
        poses.append(control.done[0][1])
    assert poses[0] == poses[1] != poses[2]


@pytest.mark.parametrize(("neighbour", "goal"), [(False, ""), (True, "demo:Tray-3")])
def test_moved_needs_another_empty_tray(neighbour: bool, goal: str) -> None:
    with pytest.raises(Refused, match="no other empty tray on the workstation where Product A is"):
        Moved(FakeHand(), world(neighbour), "skiros:Product-5", goal, Random(0))


def test_slip_lasts_from_the_lift_to_the_failure() -> None:
    control = FakeHand()
    slip = Slip(control, Thing("rparts:Gripper-4", "rparts:GripperEffector", "Gripper"))
    assert slip.tree([node("approach", RUNNING), node("lift", IDLE)]) == ""
    assert slip.steps([step("pick", "failed")]) == ""  # not its doing
    assert slip.tree([node("lift", RUNNING)]) == "Gripper loses its grip"
    assert slip.tree([node("lift", RUNNING)]) == ""
    assert slip.steps([step("pick", "running")]) == ""
    assert slip.steps([step("pick", "failed")]) == "Gripper has its grip back"
    assert slip.tree([node("lift", RUNNING)]) == ""  # the second time it holds
    assert control.done == [("rparts:Gripper-4", True), ("rparts:Gripper-4", False)]
