"""The contact forces of the engine, with their friction, on both bodies."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from skiros2_learning.local.insertion_study import ARM, PISTON, InsertionStudy
from skiros2_motion.core.geometry import Pose, rotated
from skiros2_sim.core.bullet import Bullet
from skiros2_sim.core.physics import Part
from support.insertion_cells import write_cell

#: Weight of the box (N), and force that pulls it along the floor, less than friction takes (N).
WEIGHT, PULL = 9.81, (2.0, 1.0, 0.0)
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


def force_on(physics: Bullet, body: int) -> np.ndarray:
    """The force that all contacts exert on a body (N)."""
    points = physics.contacts(body)
    assert points
    assert {point.body for point in points} == {body}
    return np.sum([point.exerted(True)[1] for point in points], axis=0)


@pytest.mark.parametrize("order", ["floor, box", "box, floor"])
def test_friction_has_the_right_sign_whichever_body_the_engine_has_first(order: str) -> None:
    physics = Bullet()
    try:
        physics.reset(0.001)
        made = {}
        for name in order.split(", "):
            mass, size, z = (0.0, (2.0, 2.0, 0.2), -0.1) if name == "floor" else (1.0, (0.1, 0.1, 0.1), 0.05)
            made[name] = physics.add_box(size, mass, Pose((0.0, 0.0, z), UPRIGHT), (0.5, 0.5, 0.5, 1.0))
            physics.set_surface(made[name], -1, 0.8)
        for _ in range(500):
            physics.push(Part(made["box"], -1), PULL, (0.0, 0.0, 0.0))
            physics.step()
        x, y, z = PULL
        assert force_on(physics, made["box"]) == pytest.approx([-x, -y, WEIGHT - z], abs=0.05)
        assert force_on(physics, made["floor"]) == pytest.approx([x, y, z - WEIGHT], abs=0.05)
    finally:
        physics.close()


@pytest.mark.parametrize("arm", ["panda", "iiwa", "xarm6"])
def test_weight_of_the_held_part_is_compensated_with_each_gripper(arm: str, tmp_path: Path) -> None:
    """Friction holds the part: with its sign wrong the arm was driven without a load, and sank."""
    with InsertionStudy(write_cell(tmp_path / "cell", arm)) as study:
        felt: list[float] = []

        def watch(study: InsertionStudy, seconds: float) -> None:
            hand = study.world.arms[ARM]
            force = rotated(hand.tool_pose().orientation, hand.wrench()[:3])
            if seconds < 0.2:  # above the bore, without contact
                felt.append(force[2])

        study.run(seed=1, disturb=watch, time_limit=0.2)
        mass = study.world.physics.mass(Part(study.world.bodies[PISTON].body, -1))
        assert felt
        assert np.mean(felt) == pytest.approx(-9.81 * mass, rel=0.3)
