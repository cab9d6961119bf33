"""A simulated table with an engine block, shared by the tests of a file."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from skiros2_perception.core.shape import Shape
from skiros2_sim.core.world import World
from support import depth_scene


@pytest.fixture(scope="session")
def block() -> Shape:
    return depth_scene.block_shape()


@pytest.fixture(scope="module")
def shared_table() -> Iterator[World]:
    with World(depth_scene.scene()) as world:
        yield world


@pytest.fixture
def table(shared_table: World) -> World:
    """The block is at its expected pose."""
    shared_table.reset()
    return shared_table
