"""A simulator that the tests of a file share, reset before each test."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from support.ros import Ros, RosMaster
from support.simulator_client import SimulatorClient


@pytest.fixture(scope="module")
def shared_sim(ros_master: RosMaster) -> Iterator[SimulatorClient]:
    ros = Ros(ros_master)
    try:
        client = SimulatorClient(ros)
        yield client
        client.close()
    finally:
        ros.stop()


@pytest.fixture
def sim(shared_sim: SimulatorClient) -> SimulatorClient:
    shared_sim.reset()
    return shared_sim
