"""Nodes shut down on a signal, even while the main thread holds a lock."""

from __future__ import annotations

import signal

import pytest

from support.programs import Program
from support.ros import ROOT, Ros

#: A node whose shutdown needs a lock that its main thread holds until it is told to end.
HELD_UP = """
import threading, time
import rospy
from skiros2_common.ros.node import run_node, spin

lock = threading.Lock()

def shut_down():
    with lock:
        print("shut down", flush=True)

def main():
    rospy.on_shutdown(shut_down)
    with lock:
        print("busy", flush=True)
        while not rospy.core.is_shutdown_requested():
            time.sleep(0.01)
    spin()
    print("main is over", flush=True)

run_node("busy", main)
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_shutdown_waits_for_a_lock_of_the_main_thread(ros: Ros, number: int) -> None:
    node = ros.program(str(ROOT / ".venv/bin/python3"), "-c", HELD_UP)
    node.wait_for_line("busy")
    node.signal(number)
    assert node.wait() == 0
    assert node.output.splitlines()[-2:] == ["shut down", "main is over"]
    assert "/busy" not in ros.master.nodes()


def test_messages_reach_a_pipe_at_once(ros: Ros) -> None:
    env = {key: value for key, value in ros.master.env.items() if key != "PYTHONUNBUFFERED"}
    node = Program(["rosrun", "skiros2_world_model", "ontology_server_node"], env)
    ros.programs.append(node)  # it ends with the test
    node.wait_for_line("ontologies are served")


def test_node_that_waits_for_the_world_model_ends_without_a_traceback(ros: Ros) -> None:
    node = ros.program("rosrun", "skiros2_task", "task_manager_node")
    node.wait_for_line("waiting for the world model")
    node.signal(signal.SIGINT)
    assert node.wait() == 0
    assert "Traceback" not in node.output
