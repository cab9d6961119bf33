"""Motions with a regulated force, in physics, with joint friction. The judge is the true contact force."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_contact_skills import contact_primitive as codes
from skiros2_contact_skills.regulated_motions import follow_surface, press, screw, wipe
from skiros2_motion.core.arm_abilities import Abilities
from skiros2_motion.core.force_control import ForceGoal
from skiros2_sim.core.simulated_arm import SimulatedArm
from support.contact_cell import TABLE_TOP, Button, ContactCell, Nut, contact_cell, slopes
from support.simulated_cell import at, bench, box, with_body

#: Of each joint (Nm).
FRICTION = 0.5
#: Beside the tray: where the tool presses, and where the button is.
FREE, BUTTON = (0.5, -0.3), (0.6, 0.3)
SLOPE = math.radians(8.0)


@pytest.fixture(scope="module")
def shared_cell() -> Iterator[ContactCell]:
    wall = box("demo:Wall-30", at(0.62, -0.3, TABLE_TOP + 0.05), (0.02, 0.2, 0.1))
    with contact_cell(with_body(bench(), wall), press, follow_surface, screw) as cell:
        Button(cell.world, BUTTON, stiffness=2000.0)
        cell.world.step(50)
        yield cell


@pytest.fixture
def cell(shared_cell: ContactCell) -> Iterator[ContactCell]:
    driver = shared_cell.compliant
    yield shared_cell
    shared_cell.compliant = driver


class DriverWithoutLoop:
    """An arm whose driver does not regulate forces."""

    def __init__(self, arm: SimulatedArm) -> None:
        self._arm = arm

    def __getattr__(self, name: str) -> Any:
        if name == "set_force_control":
            raise AttributeError(name)
        return getattr(self._arm, name)


class SlowAdapter(DriverWithoutLoop):
    """An arm whose adapter regulates forces at a low rate."""

    def __init__(self, arm: SimulatedArm, rate: float) -> None:
        super().__init__(arm)
        self._rate = rate

    def set_force_control(self, goal: ForceGoal | None) -> None:
        self._arm.set_force_control(goal)

    def abilities(self) -> Abilities:
        return Abilities(state_period=1.0 / self._rate, force_rate=self._rate)


def place(cell: ContactCell, position: tuple[float, float], height: float) -> None:
    cell.place((*position, TABLE_TOP + height))
    cell.add_friction(FRICTION)


@pytest.mark.parametrize("speed", [0.005, 0.05])
def test_button_is_pressed_without_overshoot(cell: ContactCell, speed: float) -> None:
    place(cell, BUTTON, 0.036)
    task = cell.run("Press", ContactSpeed=speed, ContactStiffness=2000.0, Force=8.0)
    assert task.state is State.Success, task.why
    assert "slowed" not in task.skill.progress_msg
    assert cell.peak < 1.2 * 8.0
    assert cell.pressed[-1] == pytest.approx(8.0, abs=1.0)


def test_arm_without_a_loop_in_its_driver_presses_at_the_ticks(cell: ContactCell) -> None:
    place(cell, BUTTON, 0.036)
    assert isinstance(cell.compliant, SimulatedArm)
    cell.compliant = DriverWithoutLoop(cell.compliant)  # type: ignore[assignment]
    task = cell.run("Press", ContactSpeed=0.01, ContactStiffness=2000.0, Force=8.0)
    assert task.state is State.Success, task.why
    assert cell.peak < 1.2 * 8.0


def test_rate_of_an_adapter_that_regulates_is_logged(cell: ContactCell, caplog: pytest.LogCaptureFixture) -> None:
    place(cell, BUTTON, 0.036)
    assert isinstance(cell.compliant, SimulatedArm)
    cell.compliant = SlowAdapter(cell.compliant, 30.0)  # type: ignore[assignment]
    with caplog.at_level("INFO"):
        cell.run("Press", seconds=0.2)
    assert "the driver does not regulate forces, its adapter does at 30 Hz" in caplog.text


def test_adapter_whose_rate_is_too_low_is_refused(cell: ContactCell) -> None:
    place(cell, BUTTON, 0.036)
    assert isinstance(cell.compliant, SimulatedArm)
    cell.compliant = SlowAdapter(cell.compliant, 3.0)  # type: ignore[assignment]
    task = cell.run("Press", seconds=0.5)
    assert task.skill.progress_code == codes.NOT_READY
    assert "forces are not regulated at 3.0 Hz, the rate of its states: 5 Hz are needed" in task.why
    assert cell.peak < 1.0, "it has not moved"


def test_press_without_a_surface_fails(cell: ContactCell) -> None:
    place(cell, FREE, 0.06)
    task = cell.run("Press", MaxDistance=0.01)
    assert task.skill.progress_code == codes.NO_CONTACT


@pytest.mark.long
def test_surface_is_followed_to_a_wall(cell: ContactCell) -> None:
    place(cell, FREE, 0.015)
    task = cell.run("FollowSurface", Direction=0.0, Distance=0.2, WallForce=12.0)
    assert task.state is State.Success, task.why
    assert task.skill.params["End"].value == "wall"
    assert cell.peak < 1.2 * 40.0


@pytest.mark.long
def test_surface_is_followed_to_an_edge(cell: ContactCell) -> None:
    place(cell, (0.5, -0.37), 0.015)  # the table ends at y = -0.4; the tool points down, its y is -y of the map
    task = cell.run("FollowSurface", Direction=90.0, Distance=0.2, WallForce=30.0)
    assert task.state is State.Success, task.why
    assert task.skill.params["End"].value == "edge"


def test_screw_turns_until_the_torque(cell: ContactCell) -> None:
    place(cell, FREE, 0.015)
    task = cell.run("Screw", Torque=0.08)
    assert task.state is State.Success, task.why


@pytest.mark.parametrize(("torque", "most"), [pytest.param(0.5, 0.75, marks=pytest.mark.long), (1.0, 1.5)])
def test_screw_that_stops_at_once_gets_at_most_half_more_than_its_torque(torque: float, most: float) -> None:
    with contact_cell(bench(), screw) as cell:
        nut = Nut(cell.world, BUTTON, resistance=20.0)
        place(cell, BUTTON, 0.03)
        task = cell.run("Screw", Torque=torque, ContactStiffness=1e5)
        assert task.state is State.Success, task.why
        assert torque < max(map(abs, cell.torques)) < most
        assert abs(nut.angle()) < 0.02


def test_screw_that_turns_freely_fails(cell: ContactCell) -> None:
    place(cell, FREE, 0.015)
    task = cell.run("Screw", Torque=3.0, Angle=-20.0)
    assert task.skill.progress_code == codes.NOT_REACHED


@pytest.mark.parametrize(("angle", "height"), [(SLOPE, 0.03), (-SLOPE, 0.06)])
def test_unknown_slope_is_wiped_with_the_force(angle: float, height: float) -> None:
    scene = dataclasses.replace(bench(), bodies=bench().bodies[:1])
    with contact_cell(with_body(scene, *slopes(0.37, [angle], 0.35, height)), wipe) as cell:
        place(cell, (0.40, 0.0), height + 0.02)
        started: list[int] = []

        def note() -> None:
            if cell.task.skill.progress_msg.startswith("Wiping") and not started:
                started.append(len(cell.pressed))

        task = cell.run("Wipe", each=note, Force=5.0, Speed=0.1, Distance=0.2, MaxDistance=0.1)
        assert task.state is State.Success, task.why
        off = np.abs(np.array(cell.pressed[started[0] :]) - 5.0)
        assert np.mean(off < 1.0) > 0.97
