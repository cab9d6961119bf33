"""Latches of bores in the simulated world: a force that grows, a click, and a hold up to the retention force."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path

import pytest

from skiros2_motion.core.bore import Bore, Latch
from skiros2_sim.core.scene_spec import BodySpec, SceneSpec
from skiros2_sim.core.world import World
from support.simulated_cell import at

SOCKET, PLUG = "skiros:Product-1", "skiros:Product-2"
TOP, LENGTH, WEIGHT = 0.06, 0.08, 0.1 * 9.81
LATCH = Latch(depth=0.03, force=18.0, retention=30.0)
BORE = Bore(0.0, 0.0, 0.0402, 0.033, latch=LATCH)
PLUG_MODEL = """<robot name="plug"><link name="plug">
  <contact><lateral_friction value="0.1"/></contact>
  <inertial><mass value="0.1"/><inertia ixx="7e-5" ixy="0" ixz="0" iyy="7e-5" iyz="0" izz="2e-5"/></inertial>
  <collision><geometry><cylinder radius="0.02" length="0.08"/></geometry></collision>
</link></robot>"""


@pytest.fixture(scope="module")
def connector(tmp_path_factory: pytest.TempPathFactory) -> Iterator[World]:
    """A plug that stands in a socket, before its latch."""
    file: Path = tmp_path_factory.mktemp("models") / "plug.urdf"
    file.write_text(PLUG_MODEL)
    socket = BodySpec(SOCKET, pose=at(0.0, 0.0, TOP / 2), size=(0.1, 0.1, TOP), bores=(BORE,))
    size = (0.04, 0.04, LENGTH)
    plug = BodySpec(PLUG, pose=at(0.0, 0.0, TOP + LENGTH / 2 - 0.02), size=size, model=str(file), movable=True)
    with World(SceneSpec((socket, plug)), rate=1000) as world:
        yield world


@pytest.fixture
def world(connector: World) -> World:
    connector.reset()
    connector.step(300)
    return connector


def depth(world: World) -> float:
    return TOP - (world.pose_of(PLUG).position[2] - LENGTH / 2)


def push(world: World, force: float, seconds: float = 0.5) -> float:
    """Pushes the plug down (N); returns its depth after it came to rest."""
    world.push(PLUG, (0.0, 0.0, -force), duration=seconds)
    world.step(round(seconds * world.rate))
    return depth(world)


def test_plug_rests_on_the_latch(world: World) -> None:
    assert 0.026 < depth(world) < LATCH.depth


def test_latch_resists_up_to_its_force(world: World) -> None:
    assert push(world, 0.8 * LATCH.force - WEIGHT) < LATCH.depth


def test_plug_passes_the_latch_to_the_floor(world: World) -> None:
    assert push(world, 1.3 * LATCH.force) == pytest.approx(BORE.depth, abs=0.0005)
    world.step(500)
    assert depth(world) == pytest.approx(BORE.depth, abs=0.0005)


def pull(world: World, force: float) -> float:
    """Pulls the plug up with a force that grows slowly to its end (N); returns its depth."""
    for part in range(1, 21):
        push(world, -(force * part / 20 + WEIGHT), 0.02)
    return depth(world)


def test_latched_plug_is_held_up_to_the_retention_force(world: World) -> None:
    push(world, 1.3 * LATCH.force)
    assert pull(world, 0.8 * LATCH.retention) == pytest.approx(LATCH.depth, abs=0.002)
    assert pull(world, 1.3 * LATCH.retention) < LATCH.depth - 0.005


def test_plug_before_the_latch_is_not_held(world: World) -> None:
    assert push(world, -(0.2 * LATCH.retention + WEIGHT), 0.3) < 0.01


def test_plug_that_was_pulled_out_latches_again(world: World) -> None:
    push(world, 1.3 * LATCH.force)
    pull(world, 1.3 * LATCH.retention)
    world.set_pose(PLUG, at(0.0, 0.0, TOP + LENGTH / 2 - 0.02))
    world.step(300)
    assert depth(world) < LATCH.depth
    push(world, 1.3 * LATCH.force)
    assert pull(world, 0.8 * LATCH.retention) == pytest.approx(LATCH.depth, abs=0.002)


def test_latched_plug_lifts_its_socket(connector: World) -> None:
    loose = dataclasses.replace(connector.scene.bodies[0], movable=True, mass=1.0)
    with World(SceneSpec((loose, connector.scene.bodies[1])), rate=1000) as world:
        world.step(300)
        push(world, 1.3 * LATCH.force)
        pull(world, 0.6 * LATCH.retention)
        lifted = world.pose_of(SOCKET).position[2] - TOP / 2
        assert lifted > 0.03
        assert depth(world) + lifted == pytest.approx(LATCH.depth, abs=0.002)
