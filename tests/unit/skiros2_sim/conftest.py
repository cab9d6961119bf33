"""Simulated worlds shared by the tests of a file: created once, reset for each test."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from skiros2_sim.core.world import World
from support.moved_robot import MovedRobot
from support.simulated_cell import bench, cell


@pytest.fixture(scope="module")
def shared_cell() -> Iterator[World]:
    with World(cell()) as world:
        yield world


@pytest.fixture(scope="module")
def shared_bench() -> Iterator[World]:
    with World(bench()) as world:
        yield world


@pytest.fixture
def world(shared_cell: World) -> World:
    """A mobile manipulator between two workstations."""
    shared_cell.reset(seed=0)
    return shared_cell


@pytest.fixture
def panda(shared_bench: World) -> World:
    """A fixed robot before a table."""
    shared_bench.reset(seed=0)
    return shared_bench


@pytest.fixture
def robot(panda: World) -> MovedRobot:
    """The fixed robot, at rest."""
    panda.step(60)
    return MovedRobot(panda)
