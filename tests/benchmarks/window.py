"""The window over real nodes: how soon it is up, and what it takes to show a thousand elements and nodes at 25 Hz."""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from benchmarks.measurement import Measurement
from support.ros import ROOT, Ros

STARTS = 3
SECONDS = 10.0
ELEMENTS = NODES = 1000

#: s until it is up, part of one core, ms that the Qt thread is held.
UP, PART, HOLD = 3.0, 0.3, 50.0

#: Of changes and of progress (Hz): with less, nothing was measured.
LEAST_RATE = 20.0

_FOLDER = Path(__file__).parent
_TABS = ("Running", "World model", "Skills")


def measure(ros: Ros, folder: Path) -> Iterator[Measurement]:
    """
    :param folder: not used: what is measured leaves nothing behind.
    """
    ros.launch("skiros2", "world_model_server.launch", gui=False)
    with ExitStack() as stack:
        load = _started(stack, ros, "window_load.py", str(ELEMENTS), str(NODES))
        _told(load, "ready")
        starts = []
        for _ in range(STARTS):
            begin = time.time()
            probe = _started(stack, ros, "window_probe.py")
            starts.append(json.loads(_told(probe))["up"] - begin)
            _end(probe)
        yield _limited("window up and connected", statistics.median(starts), "s", UP, STARTS)
        probe = _started(stack, ros, "window_probe.py")
        _told(probe)
        for title in _TABS:
            found = _measured(probe, title)
            if min(found["changes"], found["progress"]) < LEAST_RATE:
                raise RuntimeError(f"the load did not come 25 times a second, as it should have: {found}")
            name = f"tab {title}, {ELEMENTS} elements, {NODES} nodes, 25 Hz"
            yield _limited(f"{name}: CPU", found["part"], "cores", PART)
            yield _limited(f"{name}: longest hold of the Qt thread", found["longest"], "ms", HOLD)
            # what is left on a machine that has other things to do, too
            yield _limited(f"{name}: longest computing at a stretch", found["longest_computing"], "ms", HOLD)
        _end(probe)


def _limited(name: str, value: float, unit: str, limit: float, runs: int = 1) -> Measurement:
    return Measurement(name, value, unit, runs, "limit", limit, value / limit, 1.0)


def _measured(probe: subprocess.Popen[str], title: str) -> dict[str, Any]:
    assert probe.stdin is not None
    probe.stdin.write(f"{title} {SECONDS}\n")
    probe.stdin.flush()
    return dict(json.loads(_told(probe)))


def _started(stack: ExitStack, ros: Ros, program: str, *arguments: str) -> subprocess.Popen[str]:
    paths = (str(ROOT / "tests"), ros.master.env.get("PYTHONPATH", ""))
    env = {**ros.master.env, "PYTHONPATH": os.pathsep.join(filter(None, paths)), "QT_QPA_PLATFORM": "offscreen"}
    process = subprocess.Popen(
        [sys.executable, str(_FOLDER / program), *arguments],
        env=env, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    stack.callback(process.wait)
    stack.callback(process.kill)
    return process


def _told(process: subprocess.Popen[str], begin: str = "{") -> str:
    """The next line that begins so; rospy prints some of its own."""
    assert process.stdout is not None
    for line in process.stdout:
        if line.startswith(begin):
            return line
    raise RuntimeError(f"{process.args} ended with status {process.wait()}")


def _end(process: subprocess.Popen[str]) -> None:
    assert process.stdin is not None
    process.stdin.close()
    process.wait()
