"""Stop under full load: 16 plans, 100 readers, six tabs, jobs, and a disk that takes 100 ms for each commit."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from support.job_cell import JobCell
from support.ros import Ros
from support.stop_load import PLANNERS, full_load, stop_times, summary

pytestmark = [pytest.mark.long, pytest.mark.timeout(1800)]

#: From the request to the robot's stop command (ms, p99) where the machine is not shared.
LIMIT = 100.0


def test_robots_stop_in_time_under_full_load(ros: Ros, tmp_path: Path) -> None:
    cell = JobCell(ros, tmp_path, operators=PLANNERS // 2, slow_disk=0.1)
    stop_port = cell.parameter("/gateway/stop_address")
    stop_times(cell, 3, stop_port)
    free = summary(stop_times(cell, 30, stop_port))
    with full_load(cell):
        loaded = summary(stop_times(cell, 100, stop_port))
        shared = summary(stop_times(cell, 5, cell.rest.address))
    load = os.getloadavg()[0] / (os.cpu_count() or 1)
    print(f"free {free}, under load {loaded}, by the gateway's own port {shared}, load per core {load:.1f}")
    # Other programs take the cores away by turns of some ms each; the port itself shares nothing.
    assert loaded["p99_ms"] <= LIMIT * max(1.0, load / 2), (free, loaded, load)
