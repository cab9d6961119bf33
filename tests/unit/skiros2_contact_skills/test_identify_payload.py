"""Payloads of known masses are identified in physics, with a noisy sensor: weights that pull at the hand."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_contact_skills import contact_primitive as codes
from skiros2_contact_skills.payload import identify_payload
from skiros2_sim.core.wrist_sensor import SensorModel
from support.contact_cell import TABLE_TOP, ContactCell, contact_cell
from support.simulated_cell import GRIPPER, PRODUCTS, bench


@pytest.fixture(scope="module")
def cell() -> Iterator[ContactCell]:
    sensor = SensorModel(force_noise=0.05, torque_noise=0.002)
    with contact_cell(bench(), identify_payload, sensor=sensor) as made:
        yield made


@pytest.mark.parametrize("mass", [*(pytest.param(mass, marks=pytest.mark.long) for mass in (0.0, 0.3)), 1.2])
def test_known_mass_is_identified_and_written_to_the_part(cell: ContactCell, mass: float) -> None:
    cell.place((0.5, 0.05, 0.65))
    part = cell.skills.add("skiros:Product", f"product of {mass} kg", cell.element, "skiros:contain")
    cell.world.push(GRIPPER, (0.0, 0.0, -9.81 * mass), duration=14.0)
    task = cell.run("IdentifyPayload", Part=part)
    assert task.state is State.Success, task.why
    assert task.skill.params["Mass"].value == pytest.approx(mass, rel=0.02, abs=0.02)
    if mass:
        x, y, z = task.skill.params["CentreOfMass"].values
        assert (x, y) == pytest.approx((0.0, 0.0), abs=0.005)
        assert -0.12 < z < 0.0, "the weight pulls at the hand, which is behind the tool"
    weight = cell.skills.wmi.get_element(part.id).getProperty("skiros:Weight").value
    assert weight == pytest.approx(mass, rel=0.02, abs=0.02)


@pytest.mark.long
def test_held_block_is_identified_although_the_coupling_of_the_fingers_bears_its_weight(cell: ContactCell) -> None:
    cell.place((0.5, 0.05, 0.65))
    world, robot = cell.world, cell.robot
    mass = world.physics.mass(world.part_of(PRODUCTS[0]))
    robot.gripper.drive(0.0)
    for _ in range(400):
        world.set_pose(PRODUCTS[0], robot.arm.tool_pose())
        world.step()
    world.step(400)
    task = cell.run("IdentifyPayload", MaxForce=100.0)
    assert task.state is State.Success, task.why
    assert task.skill.params["Mass"].value == pytest.approx(mass, rel=0.1)
    robot.gripper.drive(0.08)
    world.step(400)


@pytest.mark.long
def test_hand_that_touches_something_is_not_identified(cell: ContactCell) -> None:
    cell.place((0.62, 0.3, TABLE_TOP + 0.001))
    task = cell.run("IdentifyPayload", MaxForce=100.0, MaxTorque=50.0)
    assert task.skill.progress_code == codes.NOT_REACHED
    assert "may touch something" in task.why
