"""A plug is pushed into a socket with a latch, in physics: the force tells whether it has latched."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_contact_skills import contact_primitive as codes
from skiros2_contact_skills.arms import provided_arms
from skiros2_motion.core.compliant_arm import ArmState
from skiros2_sim.core.arm_controller import ArmController
from skiros2_sim.core.simulated_arm import SimulatedArm
from skiros2_sim.core.world import World
from skiros2_skill.testing import SkillBench
from support import connector_cell
from support.connector_cell import HOUSING, LEFT, RATE, RIGHT, SCENE, ConnectorCell, connector_scene

pytestmark = pytest.mark.timeout(180)

#: Of the socket in the scene (m, N).
LATCH_DEPTH, DEPTH, LATCH_FORCE = 0.017, 0.020, 12.0
#: Limit of the force (N), exceeded by a fifth at most.
LIMIT = 40.0 * 1.2

MakeCell = Callable[..., ConnectorCell]


@pytest.fixture
def cell() -> Iterator[MakeCell]:
    """Makes a cell; the numbers are those of a true latch that differs from the one in the world model."""
    with ExitStack() as ends:

        def make(**latch: float) -> ConnectorCell:
            world = ends.enter_context(World(connector_scene(**latch), rate=RATE, visuals=False))
            made = ConnectorCell(world, ends.enter_context(SkillBench(SCENE)))
            ends.enter_context(provided_arms(made))
            return made

        yield make


def signature(task: object) -> list[float]:
    """Returns the result of `plug_in`."""
    nodes = [task.skill]  # type: ignore[attr-defined]
    while nodes:
        node = nodes.pop()
        if node.label == "plug_in":
            return list(node.params["Signature"].values)
        nodes += node.children
    raise AssertionError("plug_in did not run")


def code(task: object) -> int:
    return int(task.skill.progress_code)  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("x", "y"), [(0.0007, -0.0007), pytest.param(-0.0005, 0.0006, marks=pytest.mark.long)], ids=["+-", "-+"]
)
def test_plug_that_is_displaced_by_a_millimetre_latches_and_holds(cell: MakeCell, x: float, y: float) -> None:
    made = cell()
    made.misplace(x, y)
    task = made.run(made.plug_into_socket(), made.hold())
    assert task.state is State.Success, task.why
    peak, at, low, end = signature(task)
    assert peak == pytest.approx(LATCH_FORCE, abs=1.5)
    assert at == pytest.approx(LATCH_DEPTH, abs=0.0015)
    assert low < 3.0
    assert end - at == pytest.approx(DEPTH - LATCH_DEPTH, abs=0.0005)
    assert LATCH_DEPTH - 0.001 < made.depth() < DEPTH, "the true plug was pulled back to the latch, and holds"
    assert made.most[RIGHT] < 30.0, "the plug is not thrown at the floor behind the latch"
    assert made.most[LEFT] < LIMIT


class KeepingArm(SimulatedArm):
    """Keeps its states at 100 Hz, as an adapter over ROS does. A motion of the world."""

    outcome = None

    def __init__(self, controller: ArmController) -> None:
        super().__init__(controller)
        self._kept: list[ArmState] = []
        self._steps = 0
        controller.world.motions.add(self)

    def update(self, dt: float) -> None:
        """Called before each step."""
        self._steps += 1
        if self._steps % 10 == 0:
            self._kept.append(self.state())

    def take_states(self) -> list[ArmState]:
        kept, self._kept = self._kept, []
        return kept


def plugged(made: ConnectorCell, pause: Callable[[int], int]) -> Any:
    """Plugs in, with pauses (steps of the simulation) that depend on the number of the tick. Returns the task."""
    task, hold = made.plug_into_socket(), made.hold()
    for tick in range(400):
        task.tick()
        hold.tick()
        if task.state is not State.Running:
            break
        made.world.step(pause(tick))
    assert task.state is State.Success, task.why
    return task


@pytest.mark.long
@pytest.mark.parametrize("late", [300, 500])
def test_plug_does_not_hit_the_floor_when_ticks_are_late(
    cell: MakeCell, late: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connector_cell, "SimulatedArm", KeepingArm)
    made = cell()
    task = plugged(made, lambda tick: late if tick % 5 == 0 else 40)
    (peak,) = (node.params["PeakForce"].value for node in task.nodes() if node.label == "plug_in")
    assert peak < 35.0


@pytest.mark.long
@pytest.mark.parametrize("late", [50, 100])
def test_click_is_felt_at_late_ticks_by_an_arm_that_keeps_no_states(
    cell: MakeCell, late: int, caplog: pytest.LogCaptureFixture
) -> None:
    made = cell()
    task = plugged(made, lambda tick: late)
    assert signature(task)[0] == pytest.approx(LATCH_FORCE, abs=1.0)
    assert "keeps no states between ticks" in caplog.text


@pytest.mark.long
def test_stiff_latch_is_not_passed(cell: MakeCell) -> None:
    made = cell(force=40.0)
    task = made.run(made.plug_into_socket(), made.hold())
    assert (task.state, code(task)) == (State.Failure, codes.NO_CLICK)
    peak, _, low, end = signature(task)
    assert 18.0 < peak < LIMIT
    assert low > 0.9 * peak, "no drop"
    assert end < LATCH_DEPTH
    assert "no click: peak of" in task.why
    assert "expected a click at 12.0 N and 3.0 mm before the floor" in task.why


@pytest.mark.long
def test_missing_latch_is_no_click(cell: MakeCell) -> None:
    made = cell(force=0.5)
    task = made.run(made.plug_into_socket(), made.hold())
    assert (task.state, code(task)) == (State.Failure, codes.NO_CLICK)
    assert made.depth() == pytest.approx(DEPTH, abs=0.001), "deep enough, but not latched"


@pytest.mark.long
def test_weak_latch_is_a_click_at_a_wrong_force(cell: MakeCell) -> None:
    made = cell(force=6.5)
    task = made.run(made.plug_into_socket(), made.hold())
    assert (task.state, code(task)) == (State.Failure, codes.WRONG_CLICK)
    assert signature(task)[0] == pytest.approx(6.5, abs=1.5)


@pytest.mark.long
def test_latch_that_clicks_and_does_not_hold_fails_the_pull_test(cell: MakeCell) -> None:
    made = cell(retention=4.0)
    task = made.run(made.plug_into_socket(), made.hold())
    assert (task.state, code(task)) == (State.Failure, codes.NOT_HELD)
    assert signature(task)[0] == pytest.approx(LATCH_FORCE, abs=1.5)
    assert "does not hold" in task.why


@pytest.mark.long
def test_housing_that_nobody_holds_is_lifted_by_the_pull(cell: MakeCell) -> None:
    made = cell()
    made.world.arms[LEFT].gripper.drive(0.08)
    task = made.run(made.plug_into_socket())
    assert (task.state, code(task)) == (State.Failure, codes.NOT_HELD)
    assert abs(made.world.pose_of(HOUSING).orientation[1]) > 0.005, "its end with the socket is lifted"


def test_socket_without_a_latch_is_named(cell: MakeCell) -> None:
    made = cell()
    socket = made.wmi.get_element("skiros:Bore-23")
    socket.setProperty("skiros:LatchDepth", 0.02)
    made.wmi.update_element_properties(socket)
    task = made.run(made.command("PlugIn", Socket=socket), seconds=1.0)
    assert (task.state, code(task)) == (State.Failure, codes.WRONG_SOCKET)
    assert "Power socket has no latch: expected skiros:LatchForce" in task.why
