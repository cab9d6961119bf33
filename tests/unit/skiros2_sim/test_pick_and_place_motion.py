"""Pick and place by motions alone."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from skiros2_sim.core.world import World
from support.moved_robot import MovedRobot, succeeded
from support.simulated_cell import EDGE, PRODUCTS, TRAY_TOP, TRAYS, cell

PRODUCT, TRAY = PRODUCTS[0], TRAYS[2]
ABOVE = 0.15  # m, over what is gripped


@pytest.fixture(scope="module")
def world() -> Iterator[World]:
    with World(cell(), position_noise=0.02, yaw_noise=0.3) as world:
        yield world


@pytest.mark.parametrize(("seed", "controller"), [(1, "position"), (2, "compliant")])
def test_motions_bring_a_product_to_another_tray(world: World, seed: int, controller: str) -> None:
    world.reset(seed)
    bring(world, controller)
    x, y, z = world.pose_of(PRODUCT).position
    tray = world.pose_of(TRAY).position
    assert abs(x - tray[0]) < 0.25 / 2 - EDGE / 2
    assert abs(y - tray[1]) < 0.3 / 2 - EDGE / 2
    assert z == pytest.approx(TRAY_TOP + EDGE / 2, abs=0.003), "it lies in it"
    assert {contact.first for contact in world.contacts(PRODUCT)} == {TRAY}
    assert max(map(abs, world.bodies[PRODUCT].velocity()[0])) < 0.01


def bring(world: World, controller: str) -> None:
    """Brings the product into the tray; each motion must succeed."""
    world.step(60)
    robot = MovedRobot(world)
    home = robot.arm.positions()
    x, y, z = world.pose_of(PRODUCT).position
    succeeded(robot.run(robot.drive(1.05, y)))
    succeeded(robot.run(robot.grip(0.08)))
    succeeded(robot.run(robot.line((x, y, z + ABOVE), controller=controller)))
    succeeded(robot.run(robot.line((x, y, z), speed=0.15, max_force=20.0)))
    close = robot.grip(0.0, 20.0)
    succeeded(robot.run(close))
    assert close.stalled
    succeeded(robot.run(robot.line((x, y, z + ABOVE))))
    robot.controller.switch("position")
    succeeded(robot.run(robot.trajectory(home)))
    tx, ty, _ = world.pose_of(TRAY).position
    succeeded(robot.run(robot.drive(1.05, ty)))
    holds = robot.grip(0.0, 20.0)
    succeeded(robot.run(holds))
    assert holds.width > EDGE - 0.005, "it is still held"
    succeeded(robot.run(robot.line((tx, ty, z + ABOVE), controller=controller)))
    down = robot.line((tx, ty, z - 0.03), speed=0.05, contact_force=3.0, max_force=40.0)
    succeeded(robot.run(down))
    succeeded(robot.run(robot.grip(0.08)))
    succeeded(robot.run(robot.line((tx, ty, z + ABOVE))))
    world.step(60)
