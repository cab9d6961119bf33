"""What it costs the world model node to publish poses on tf at 25 Hz, beside a bare publisher of as many transforms.

Both have one subscriber, which takes the messages and does not look at them. A figure is the CPU time of the process
over some seconds, in % of one core.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from benchmarks.measurement import Measurement, cpu_seconds
from skiros2_common.core.world_element import Element
from skiros2_msgs import srv as srvs
from support.ros import Ros

ELEMENTS = 1000
#: How many of them have a velocity.
MOVING = (0, 100, 1000)
RUNS = 3
#: How long the CPU time is measured (s).
PERIOD = 10.0
#: Of one core (%).
TARGET = 15.0

BARE_PUBLISHER = '''#!/usr/bin/env python3
"""Publishes so many transforms in one message at 25 Hz."""
import sys
import rospy
from geometry_msgs.msg import TransformStamped
from tf2_msgs.msg import TFMessage

rospy.init_node("bare_tf")
publisher = rospy.Publisher("/bare_tf", TFMessage, queue_size=10)
rate = rospy.Rate(25)
while not rospy.is_shutdown():
    message = TFMessage()
    for number in range(int(sys.argv[1])):
        transform = TransformStamped()
        transform.header.stamp = rospy.Time.now()
        transform.header.frame_id = "map"
        transform.child_frame_id = f"skiros:Product-{number}"
        transform.transform.translation.x = float(number)
        transform.transform.rotation.w = 1.0
        message.transforms.append(transform)
    publisher.publish(message)
    rate.sleep()
'''


def measure(ros: Ros, folder: Path) -> Iterator[Measurement]:
    import rospy

    from skiros2_world_model.ros.world_model_interface import WorldModelInterface

    workspace = folder / "tf"
    workspace.mkdir()
    params = {"workspace_dir": str(workspace), "reasoners_pkgs": ["skiros2_std_reasoners"]}
    ros.run("skiros2_world_model", "world_model_server_node", name="wm", params=params)
    ros.service("/wm/get", srvs.WmGet)
    wm = WorldModelInterface("bench")
    wm.add_elements([_placed(number) for number in range(ELEMENTS)])
    script = folder / "bare_tf"
    script.write_text(BARE_PUBLISHER)
    ros.program(sys.executable, str(script), str(ELEMENTS))
    ros.wait_for_node("/bare_tf")
    counts = {"/tf": 0, "/bare_tf": 0}
    subscribers = [rospy.Subscriber(topic, rospy.AnyMsg, _count, (counts, topic)) for topic in counts]
    pids = [ros.master.node_pid(name) for name in ("/wm", "/bare_tf")]
    for moving in MOVING:
        elements = wm.resolve_elements(Element("skiros:Product"))[:moving]
        for element in elements:
            element.setProperty("skiros:VelocityX", 0.1, "xsd:float")
        wm.update_elements(elements)
        pairs = [_cpu_time(pids, counts) for _ in range(RUNS)]
        ours, peer = (statistics.median(pair[i] for pair in pairs) for i in (0, 1))
        ratio = statistics.median(a / b for a, b in pairs)
        yield Measurement(
            f"tf of {ELEMENTS} elements at 25 Hz, {moving} of them moving", ours, "% of a core", RUNS,
            "a bare publisher of as many transforms", peer, ratio, round(TARGET / peer, 2),
        )  # fmt: skip
    for subscriber in subscribers:
        subscriber.unregister()


def _placed(number: int) -> Element:
    element = Element("skiros:Product", f"product {number}")
    element.setData(":Pose", ([float(number), 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]))
    element.addRelation("skiros:Scene-0", "skiros:contain", "-1")
    return element


def _count(_message: object, where: tuple[dict[str, int], str]) -> None:
    counts, topic = where
    counts[topic] += 1


def _cpu_time(pids: list[int], counts: dict[str, int]) -> tuple[float, float]:
    """The CPU time of both processes over the period, in % of one core, while both publish at their rate."""
    before, begin, published = [cpu_seconds(pid) for pid in pids], time.monotonic(), dict(counts)
    time.sleep(PERIOD)  # the period of a measurement
    took = time.monotonic() - begin
    for topic, count in counts.items():
        rate = (count - published[topic]) / took
        if not 20.0 < rate < 30.0:
            raise RuntimeError(f"{topic} came at {rate:.1f} Hz, expected 25")
    ours, peer = (100.0 * (cpu_seconds(pid) - was) / took for pid, was in zip(pids, before, strict=True))
    return ours, peer
