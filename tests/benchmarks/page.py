"""The live view under load: a tree of 1000 nodes and a scene of 1000 elements that change 25 times a second.

A part of `make bench-gateway`. Viewers: four streams of patches, and the page in Debian's chromium.
"""

from __future__ import annotations

import os
import shutil
import statistics
import struct
import threading
import time
import urllib.request
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import rospy
from geometry_msgs.msg import TransformStamped
from tf2_msgs.msg import TFMessage

from skiros2_common.core.world_element import Element
from skiros2_msgs.msg import SkillProgress, TreeProgress
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.job_cell import ROBOT, TOKENS, JobCell
from support.ros import wait_until

NODES, ELEMENTS, FRAMES, RATE = 1000, 1000, 30, 25.0
#: Nodes of which state or message change with each tick.
CHANGED = 50

_ROOT = "skiros:Scene-0"
_POSE = {"PositionX": 0.0, "PositionY": 0.0, "PositionZ": 0.1} | {f"Orientation{a}": float(a == "W") for a in "XYZW"}
_SIZE = {"SizeX": 0.1, "SizeY": 0.1, "SizeZ": 0.1}

#: Notes the delay from the time in the first node's message until it has been drawn (ms).
_WATCH = """() => {
  window.delays = [];
  let last = "";
  new MutationObserver(() => {
    const text = document.querySelector('.tree .row[data-index="1"] .message')?.textContent ?? "";
    if (text === last || !text.startsWith("sent ")) return;
    last = text;
    requestAnimationFrame(() => setTimeout(() => window.delays.push(Date.now() - 1000 * Number(text.slice(5)))));
  }).observe(document.querySelector(".tree"), {subtree: true, childList: true, characterData: true});
}"""


def page(cell: JobCell, seconds: float) -> dict[str, Any]:
    """Measures the gateway's CPU without and with five viewers, the delay from a tick to the picture, the first paint.

    :param seconds: of each measurement.
    """
    pid = cell.ros.master.node_pid("/gateway")
    row: dict[str, Any] = {"nodes": NODES, "elements": ELEMENTS, "rate_hz": RATE}
    with _load():
        wait_until(lambda: _has_everything(cell), what="the live view of the load")
        row["cpu_percent"] = cpu = {}
        with ExitStack() as stack:
            streams = [stack.enter_context(_stream(cell.rest.address)) for _ in range(4)]
            row.update(_look(cell.rest.address, pid, seconds, cpu))
            row["patches_per_s"] = round(statistics.median(stream.rate for stream in streams), 1)
        cpu["0 viewers"] = _cpu(pid, seconds)  # at the end: at first, OPC UA and MQTT take over 1000 elements
    return row


def _has_everything(cell: JobCell) -> bool:
    document = cell.rest.get("/api/live")["document"]
    return len(document["elements"]) >= ELEMENTS and any(r["nodes"] >= NODES for r in document["runs"].values())


def _cpu(pid: int, seconds: float) -> float:
    """Returns the CPU that a process takes, in percent of a core."""

    def used() -> float:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    before, begin = used(), time.monotonic()
    time.sleep(seconds)
    return round(100.0 * (used() - before) / (time.monotonic() - begin), 1)


# -- the load ----------------------------------------------------------------------------------------------------------


class _Progress(TreeProgress):  # type: ignore[misc]
    """A message whose bytes are known: 1000 nodes are not encoded for each tick."""

    parts: list[bytes] = []

    def serialize(self, buff: Any) -> None:
        buff.write(struct.pack("<I", len(self.parts)) + b"".join(self.parts))


def _node(index: int, tick: int) -> bytes:
    """Returns a node in bytes. The root has ten compounds with leaves."""
    parent = -1 if index == 0 else 0 if index <= 10 else (index - 11) % 10 + 1
    message = f"sent {time.time():.4f}" if index == 1 else f"tick {tick}" if tick else ""
    node = SkillProgress(
        robot=ROBOT, task_id=9000, id=9000 + index, parent_id=9000 + parent if index else -1,
        type="skiros:Drive" if index else ":Root", label=f"drive_{index}" if index else "task",
        processor="Sequential", state=SkillProgress.RUNNING, progress_time=tick / RATE, progress_message=message,
    )  # fmt: skip
    buffer = BytesIO()
    node.serialize(buffer)
    return buffer.getvalue()


@contextmanager
def _load() -> Iterator[None]:
    """Publishes ticks and transforms, and moves elements, until the block ends."""
    world = WorldModelInterface("tests")
    moved = []
    for number in range(ELEMENTS):
        element = Element("skiros:Product", f"box {number}")
        pose = {**_POSE, **_SIZE, "PositionX": 0.2 * (number % 40), "PositionY": 0.2 * (number // 40)}
        for key, value in {**pose, "BaseFrameId": "map"}.items():
            element.setProperty(f"skiros:{key}", value)
        element.addRelation(_ROOT, "skiros:contain", "-1")
        moved.append(world.add_element(element))
    progress = rospy.Publisher(f"{ROBOT}/monitor", _Progress, queue_size=1)
    tf = rospy.Publisher("/tf", TFMessage, queue_size=1)
    wait_until(lambda: progress.get_num_connections() and tf.get_num_connections(), what="subscribers")
    is_over = threading.Event()

    def run() -> None:
        parts, tick, due = [_node(index, 0) for index in range(NODES)], 0, time.monotonic()
        while not is_over.wait(max(0.0, due - time.monotonic())):
            tick, due = tick + 1, due + 1.0 / RATE
            for index in (0, 1, *(11 + (tick * CHANGED + k) % (NODES - 11) for k in range(CHANGED - 2))):
                parts[index] = _node(index, tick)
            message = _Progress()
            message.parts = parts
            progress.publish(message)
            tf.publish(TFMessage([_frame(number, tick) for number in range(FRAMES)]))

    def move() -> None:
        tick = 0
        while not is_over.wait(1.0 / RATE):
            tick += 1
            element = moved[tick % 10]
            element.setProperty("skiros:PositionZ", 0.1 + 0.01 * (tick % 10))
            world.update_element_properties(element)

    threads = [threading.Thread(target=target, daemon=True) for target in (run, move)]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        is_over.set()
        for thread in threads:
            thread.join()
        progress.unregister()
        tf.unregister()


def _frame(number: int, tick: int) -> TransformStamped:
    frame = TransformStamped(child_frame_id=f"link_{number}")
    frame.header.frame_id = f"link_{number - 1}" if number else "map"
    frame.transform.translation.x = 0.001 * (tick % 100)
    frame.transform.rotation.w = 1.0
    return frame


# -- viewers -----------------------------------------------------------------------------------------------------------


class _Stream:
    def __init__(self) -> None:
        self.begin = time.monotonic()
        self.patches = 0

    @property
    def rate(self) -> float:
        return self.patches / (time.monotonic() - self.begin)


@contextmanager
def _stream(address: str) -> Iterator[_Stream]:
    """Reads the patches in a thread until the block ends."""
    stream, is_over = _Stream(), threading.Event()
    headers = {"Authorization": f"Bearer {TOKENS['view']}"}
    answer = urllib.request.urlopen(urllib.request.Request(f"{address}/api/live/patches", headers=headers), timeout=60)

    def read() -> None:
        for line in answer:
            stream.patches += line.startswith(b"event: patch")
            if is_over.is_set():
                return

    thread = threading.Thread(target=read, daemon=True)
    thread.start()
    try:
        yield stream
    finally:
        is_over.set()
        thread.join()
        answer.close()


def _look(address: str, pid: int, seconds: float, cpu: dict[str, float]) -> dict[str, Any]:
    """Measures in the browser, with the list of elements and with the 3D view beside the tree."""
    from playwright.sync_api import sync_playwright

    row: dict[str, Any] = {}
    with sync_playwright() as started:
        arguments = ["--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]
        browser = started.chromium.launch(executable_path=shutil.which("chromium"), args=arguments)
        context = browser.new_context(viewport={"width": 1280, "height": 800})
        context.request.post(f"{address}/api/session", data={"token": TOKENS["view"]})
        shown = context.new_page()
        begin = time.monotonic()
        shown.goto(address)
        shown.locator(".tree .row").first.wait_for()
        row["first_tree_ms"] = round(1000 * (time.monotonic() - begin))
        row["first_paint_ms"] = round(
            shown.evaluate("performance.getEntriesByName('first-contentful-paint')[0].startTime")
        )
        shown.uncheck(".check input")  # else it scrolls to the last running node
        shown.evaluate("() => document.querySelector('.tree').scrollTop = 0")
        shown.evaluate(_WATCH)
        for tab in ("World", "3D"):
            shown.click(f"nav[data-region=right] >> text={tab}")
            time.sleep(1.0)  # not measured: the first drawing of that panel
            shown.evaluate("() => window.delays.length = 0")
            cpu[f"5 viewers, {tab}"] = _cpu(pid, seconds)
            delays = sorted(shown.evaluate("() => window.delays"))
            row[f"tick_to_picture_ms, {tab}"] = {
                "median": round(statistics.median(delays)), "p90": round(delays[int(0.9 * (len(delays) - 1))]),
                "pictures_per_s": round(len(delays) / seconds, 1),
            }  # fmt: skip
        browser.close()
    return row
