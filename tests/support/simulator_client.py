"""A simulator node shared by tests, with its requests."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import actionlib
import rospy
from geometry_msgs.msg import Pose, PoseStamped
from std_srvs.srv import SetBool

from skiros2_sim_msgs import srv as srvs
from support.programs import Program
from support.ros import ROOT, Ros

#: Of the scene.
ROBOT, ARM, GRIPPER, CAMERA = "cora:Robot-1", "rparts:ArmDevice-3", "rparts:GripperEffector-4", "skiros:DepthCamera-20"
TRAY, PRODUCT = "demo:Tray-10", "skiros:Product-14"
WORKSPACE = ROOT / "skiros2_std_lib/demos/pick_and_place/owl"
SCENE = "sim_scene.ttl"

WAIT = 60.0  # s of wall time


class SimulatorClient:
    """A simulator on the scene of the demo, as fast as it can, paused at first. It is there when this is made.

    :param arguments: of the launch file.
    """

    def __init__(self, ros: Ros, **arguments: Any) -> None:
        self.ros = ros
        wanted = {"workspace_dir": WORKSPACE, "scene": SCENE, "rate": 0.0, "paused": True} | arguments
        self.program: Program = ros.launch("skiros2_sim", "sim.launch", **wanted)
        self.get_pose = self._service("get_pose", srvs.GetPose)
        self.set_pose = self._service("set_pose", srvs.SetPose)
        self.push = self._service("push", srvs.Push)
        self.set_fault = self._service("set_fault", srvs.SetFault)
        self.detect = self._service("detect", srvs.Detect)
        self.take_picture = self._service("take_picture", srvs.TakePicture)
        self.step = self._service("step", srvs.Step)
        self.set_rate = self._service("set_rate", srvs.SetRate)
        self.pause = self._service("pause", SetBool)
        self._reset = self._service("reset", srvs.Reset)
        self._clients: dict[str, Any] = {}

    def reset(self, seed: int = -1) -> None:
        """Everything as at the start, and paused."""
        assert self.pause(True).success
        answer = self._reset(seed)
        assert answer.ok, answer.message

    @contextmanager
    def running(self) -> Iterator[None]:
        """A context manager that lets time advance."""
        assert self.pause(False).success
        try:
            yield
        finally:
            assert self.pause(True).success

    def position(self, element: str) -> tuple[float, float, float]:
        answer = self.get_pose(element, "")
        assert answer.ok, answer.message
        at = answer.pose.pose.position
        return at.x, at.y, at.z

    def client(self, name: str, kind: Any) -> Any:
        """A client of an action, connected."""
        if name not in self._clients:
            client = actionlib.SimpleActionClient(name, kind)
            assert client.wait_for_server(rospy.Duration(WAIT)), name
            self._clients[name] = client
        return self._clients[name]

    def close(self) -> None:
        """Closes the clients; the simulator is its user's."""
        for client in self._clients.values():
            client.action_client.stop()

    def _service(self, name: str, kind: Any) -> Callable[..., Any]:
        return self.ros.service(f"/sim/{name}", kind, WAIT)


def pose_stamped(position: tuple[float, ...], orientation: tuple[float, ...] = (0, 0, 0, 1), frame: str = "") -> Any:
    message = PoseStamped(pose=Pose())
    message.header.frame_id = frame
    message.pose.position.x, message.pose.position.y, message.pose.position.z = position
    q = message.pose.orientation
    q.x, q.y, q.z, q.w = orientation
    return message
