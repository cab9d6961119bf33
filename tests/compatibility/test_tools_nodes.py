"""Reasoners and the logger in programs without set-up. Compatibility, sections 9 and 11."""

import os
import subprocess
import sys

from compatibility.rules import rule
from support.programs import PATIENCE
from support.ros import wait_until

_DATA = """
from skiros2_common.core.world_element import Element
part = Element("skiros:Part")
part.setData(":Position", [1.0, 2.0, 3.0])
print(part.getData(":Position"), part.getProperty("skiros:DiscreteReasoner").value)
"""
_LOG = """
import rospy, threading
from skiros2_common.tools import logger as log
rospy.init_node("compatible_logger")
heard = threading.Event()
threading.Thread(target=lambda: (input(), heard.set())).start()
while not heard.wait(0.05):
    log.info("[ready]", "")
log.warn("[pick]", "careful")
log.debug("[pick]", "detail")
input()
"""


def environment(**more):
    return {**os.environ, "PYTHONPATH": ":".join(sys.path), **more}


@rule(
    "reasoners",
    "Element data needs no `init_node`: the parameter `wm/reasoners_pkgs` of the process's namespace is read",
)
def test_data_without_a_node(ros_master):
    import rospy

    rospy.set_param("/compatible_cell/wm/reasoners_pkgs", ["skiros2_std_reasoners"])
    try:
        ran = subprocess.run(
            [sys.executable, "-c", _DATA],
            env=environment(ROS_NAMESPACE="/compatible_cell"), capture_output=True, text=True, timeout=60,
        )  # fmt: skip
    finally:
        rospy.delete_param("/compatible_cell")
    assert ran.stdout == "[1.0, 2.0, 3.0] AauSpatialReasoner\n", ran.stderr


@rule("tools", "In a ROS node the logger's messages reach rosout too, once")
def test_messages_reach_rosout(ros_master):
    import rospy
    from rosgraph_msgs.msg import Log

    heard = []
    subscriber = rospy.Subscriber("/rosout", Log, heard.append)
    program = subprocess.Popen(
        [sys.executable, "-c", _LOG], env=environment(), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    try:
        wait_until(lambda: [m for m in heard if "[ready]" in m.msg], what="the connection to rosout")
        program.stdin.write("\n")
        program.stdin.flush()
        wait_until(lambda: [m for m in heard if "detail" in m.msg], what="the last message")
        shown, _ = program.communicate("\n", timeout=PATIENCE)
    finally:
        program.kill()
        program.wait()
        subscriber.unregister()
    own = [(m.level, m.msg) for m in heard if m.name == "/compatible_logger" and "[pick]" in m.msg]
    assert own == [(Log.WARN, f"{'[pick]':<20} careful"), (Log.DEBUG, f"{'[pick]':<20} detail")]
    assert shown.count("careful") == shown.count("detail") == 1
