"""Bodies with bores in the simulated world: a peg fits, and jams with an offset."""

from __future__ import annotations

from pathlib import Path

import pytest

from skiros2_motion.core.bore import Bore
from skiros2_sim.core.scene_spec import BodySpec, SceneSpec
from skiros2_sim.core.world import World
from support.simulated_cell import at

BLOCK, PEG = "skiros:Product-1", "skiros:Product-2"
SIZE, TOP = (0.2, 0.1, 0.06), 0.06
BORE = Bore(0.04, 0.01, 0.0402, 0.05)
PEG_MODEL = """<robot name="peg"><link name="peg">
  <inertial><mass value="0.3"/><inertia ixx="2e-4" ixy="0" ixz="0" iyy="2e-4" iyz="0" izz="6e-5"/></inertial>
  <visual><geometry><cylinder radius="0.02" length="0.08"/></geometry></visual>
  <collision><geometry><cylinder radius="0.02" length="0.08"/></geometry></collision>
</link></robot>"""


@pytest.fixture
def peg(tmp_path: Path) -> str:
    file = tmp_path / "peg.urdf"
    file.write_text(PEG_MODEL)
    return str(file)


def world(peg: str, x: float, movable: bool = False) -> World:
    block = BodySpec(BLOCK, pose=at(0.0, 0.0, TOP / 2), size=SIZE, movable=movable, mass=5.0, bores=(BORE,))
    above = BodySpec(PEG, pose=at(x, 0.01, TOP + 0.041), model=peg, movable=True)
    return World(SceneSpec((block, above)), rate=1000)


@pytest.mark.parametrize("movable", [False, True])
def test_peg_with_a_clearance_of_a_fifth_millimetre_falls_to_the_floor_of_the_bore(peg: str, movable: bool) -> None:
    with world(peg, 0.04, movable) as made:
        assert made.problems == []
        made.step(1500)
        x, y, z = made.pose_of(PEG).position
        assert (x, y) == pytest.approx((0.04, 0.01), abs=0.0005)
        assert z == pytest.approx(TOP - 0.05 + 0.04, abs=0.001)


def test_peg_beside_the_bore_stays_on_the_face(peg: str) -> None:
    with world(peg, -0.05) as made:
        made.step(1000)
        assert made.pose_of(PEG).position[2] == pytest.approx(TOP + 0.04, abs=0.001)


def test_peg_with_an_offset_of_a_millimetre_does_not_fall_in(peg: str) -> None:
    with world(peg, 0.041) as made:
        made.step(1000)
        assert made.pose_of(PEG).position[2] > TOP + 0.035


def test_block_with_bores_rests_on_the_ground(peg: str) -> None:
    with world(peg, -0.05, movable=True) as made:
        made.step(1000)
        assert made.pose_of(BLOCK).position == pytest.approx((0.0, 0.0, TOP / 2), abs=0.001)


def test_seated_peg_has_few_contacts(peg: str) -> None:
    with world(peg, 0.04) as made:
        made.step(1500)
        assert len(made.physics.contacts(made.bodies[PEG].body)) <= 8


def test_world_with_longer_steps_in_the_same_process_changes_nothing(peg: str) -> None:
    def run(beside: World | None) -> list[object]:
        with world(peg, 0.04) as made:
            for _ in range(30):
                made.step(10)
                if beside is not None:
                    beside.step()
            return [made.pose_of(PEG), made.physics.contacts()]

    with World(SceneSpec(), rate=240) as slow:
        assert run(slow) == run(None)
