"""The demo's client of the simulator: true poses, placement checks, pictures and disturbances (`--disturb NAME`)."""

from __future__ import annotations

import argparse
import math
import threading
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any, Protocol

import rospy
from geometry_msgs.msg import Point, PoseStamped, Vector3, Wrench
from PIL import Image as Picture
from sensor_msgs.msg import Image

from skiros2_bags.core.run import Finding
from skiros2_common.core.errors import Refused, SkirosError, TimedOut
from skiros2_demo.run_check import Step, Thing, WorldState, name_of
from skiros2_motion.core.geometry import (
    Pose,
    Quaternion,
    Vector,
    composed,
    from_euler,
    half_extents,
    inverted,
    rotated,
)
from skiros2_sim_msgs.msg import Contacts
from skiros2_sim_msgs.srv import GetPose, Push, SetFault, SetFaultRequest, SetPose, TakePicture

#: Timeout of a camera image (s).
PICTURE_TIMEOUT = 5.0


class Simulation:
    """A client of the simulator. Needs an initialised node."""

    def __init__(self) -> None:
        self._contacts: list[Any] = []
        self._lock = threading.Lock()
        rospy.Subscriber("sim/contacts", Contacts, self._on_contacts)

    def is_ready(self) -> bool:
        """Whether the simulator is running."""
        try:
            rospy.wait_for_service("sim/get_pose", 0.01)
        except rospy.ROSException:
            return False
        return True

    def pose_of(self, element: str) -> Pose:
        """Returns the true pose of an element in the map.

        :raises Refused: it is not in the simulated world.
        """
        return _pose(self._call("get_pose", GetPose, element=element).pose.pose)

    def check_placement(self, product: Thing, tray: Thing) -> list[Finding]:
        """Checks that a product lies in a tray; see `ground_truth.check_placement`.

        :raises Refused: one of them is not in the simulated world.
        """
        answer = self._call("get_pose", GetPose, element=product.id)
        with self._lock:
            pairs = [(contact.first, contact.second) for contact in self._contacts]
        touching = {other for pair in pairs if product.id in pair for other in pair if other != product.id}
        return check_placement(
            Body(product.name, _pose(answer.pose.pose), product.size),
            Body(tray.name, self.pose_of(tray.id), tray.size),
            _vector(answer.twist.linear),
            _vector(answer.twist.angular),
            {other for other in touching if "/" in other},  # ROBOT/LINK, where things have ids
        )

    def put(self, element: str, pose: Pose) -> None:
        """Moves an element to a pose in the map.

        :raises Refused: the simulator rejects it.
        """
        target = PoseStamped()
        (target.pose.position.x, target.pose.position.y, target.pose.position.z) = pose.position
        turn = target.pose.orientation
        turn.x, turn.y, turn.z, turn.w = pose.orientation
        self._call("set_pose", SetPose, element=element, pose=target)

    def slip(self, gripper: str, active: bool) -> None:
        """Starts or ends the slipping of a gripper.

        :raises Refused: the simulator rejects it.
        """
        self._call("set_fault", SetFault, kind=SetFaultRequest.SLIPPING_GRIPPER, target=gripper, active=active)

    def push(self, element: str, force: Vector, duration: float) -> None:
        """Pushes an element with a force in the map (N) for some seconds.

        :raises Refused: the simulator rejects it.
        """
        wrench = Wrench(force=Vector3(*force))
        self._call("push", Push, element=element, wrench=wrench, duration=rospy.Duration.from_sec(duration))

    def take_picture(self, file: Path, eye: Vector, target: Vector) -> Path:
        """Saves a picture of the world from a given camera position.

        :raises Refused: the simulator rejects it.
        """
        self.picture(eye, target).save(file)
        return file

    def picture(self, eye: Vector, target: Vector) -> Picture.Image:
        """Returns a picture of the world from a given camera position.

        :raises Refused: the simulator rejects it.
        """
        return _decoded(self._call("take_picture", TakePicture, eye=Point(*eye), target=Point(*target)).image)

    def take_robots_picture(self, file: Path, topic: str) -> Path:
        """Saves an image of the robot's camera.

        :raises TimedOut: there is no image.
        """
        try:
            _decoded(rospy.wait_for_message(topic, Image, PICTURE_TIMEOUT)).save(file)
        except rospy.ROSException:
            raise TimedOut(f"no picture came on {topic} within {PICTURE_TIMEOUT:g} s") from None
        return file

    def _call(self, name: str, service: Any, **request: Any) -> Any:
        answer = rospy.ServiceProxy(f"sim/{name}", service)(**request)
        if not answer.ok:
            raise Refused(f"sim/{name}: {answer.message}")
        return answer

    def _on_contacts(self, message: Any) -> None:
        with self._lock:
            self._contacts = message.contacts


def _decoded(image: Any) -> Picture.Image:
    if image.encoding != "rgb8":
        raise Refused(f"the picture is {image.encoding}, expected rgb8")
    return Picture.frombytes("RGB", (image.width, image.height), bytes(image.data), "raw", "RGB", image.step, 1)


def _pose(message: Any) -> Pose:
    turn = message.orientation
    return Pose(_vector(message.position), (turn.x, turn.y, turn.z, turn.w))


def _vector(message: Any) -> Vector:
    return message.x, message.y, message.z


#: Maximum gap between product and tray, and maximum overhang of its edges (m).
GAP = 0.01
#: Maximum tilt (rad).
TILT = math.radians(5.0)
#: Maximum speed at rest (m/s, rad/s).
SPEED, SPIN = 0.005, 0.05


@dataclass(frozen=True)
class Body:
    """A box.

    :param name: for people.
    :param pose: of its centre, in the map.
    :param size: edge lengths along its own axes (m).
    """

    name: str
    pose: Pose
    size: Vector


def check_placement(
    product: Body, tray: Body, velocity: Iterable[float], spin: Iterable[float], touched_by: Iterable[str]
) -> list[Finding]:
    """Checks that a product is in a tray, upright, at rest, and not held.

    :param velocity, spin: of the product (m/s, rad/s).
    :param touched_by: links of robots in contact with it.
    """
    x, y, z = composed(inverted(tray.pose), product.pose).position
    reach = half_extents(composed(inverted(tray.pose), product.pose).orientation, product.size)
    within = all(abs(at) + half <= edge / 2 + GAP for at, half, edge in zip((x, y), reach, tray.size, strict=False))
    lean = min(_tilt(product.pose.orientation, axis) for axis in _upright_axes(product.size))
    gap = z - reach[2] - tray.size[2] / 2
    # on top of a solid tray; on the floor of a tray with a rim, which is lower
    on_it = -tray.size[2] - GAP <= gap <= GAP
    speed, turning = math.hypot(*velocity), math.hypot(*spin)
    holders = sorted(touched_by)
    return [
        Finding(within, f"{product.name} is within {tray.name}, {math.hypot(x, y) * 1e3:.0f} mm from its middle"),
        Finding(on_it, f"it stands on it: its underside is {gap * 1e3:z.0f} mm above the tray's top"),
        Finding(lean <= TILT, f"it is upright: it leans by {math.degrees(lean):.1f} degrees"),
        Finding(speed <= SPEED and turning <= SPIN, f"it is at rest: it moves with {speed * 1e3:.1f} mm/s"),
        Finding(not holders, f"it is held by {', '.join(holders)}" if holders else "no robot touches it"),
    ]


def _upright_axes(size: Vector) -> list[Vector]:
    """Returns the axes of a box that may be vertical: z, and axes with edges of the same length."""
    axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    return [axis for axis, edge in zip(axes, size, strict=True) if math.isclose(edge, size[2], rel_tol=0.01)]


def _tilt(orientation: Quaternion, axis: Vector) -> float:
    """Returns the angle between an axis of a box and the vertical (rad), ignoring its sign."""
    upward = abs(rotated(orientation, axis)[2])
    return math.acos(min(1.0, upward)) if math.isfinite(upward) else math.nan


#: Direction from the centre of the cell to the camera, relative to the width of the cell.
VIEW = (-0.5, -0.26, 0.5)


class PictureSource(Protocol):
    """The part of `Simulation` that takes pictures."""

    def picture(self, eye: Vector, target: Vector) -> Picture.Image: ...

    def take_picture(self, file: Path, eye: Vector, target: Vector) -> Path: ...

    def take_robots_picture(self, file: Path, topic: str) -> Path: ...


class Pictures:
    """Saves two pictures per moment of a run: `MOMENT_cell.png` and `MOMENT_robot.png`. Errors are reported, not
    raised.

    :param places: positions of the things in the cell, in the map (m).
    :param say: prints a message.
    :param view: direction to the camera, see `camera_view`.
    """

    def __init__(
        self,
        by: PictureSource,
        folder: Path,
        places: Iterable[Vector],
        topic: str,
        say: Callable[[str], None],
        view: Vector = VIEW,
    ) -> None:
        self._by = by
        self._folder = folder
        self._topic = topic
        self._say = say
        self._taken: set[str] = set()
        self._eye, self._target = camera_view(places, view)

    def take(self, moment: str) -> None:
        """Saves the pictures of a moment, once."""
        if moment in self._taken:
            return
        self._taken.add(moment)
        cell, robot = (self._folder / f"{moment}_{of}.png" for of in ("cell", "robot"))
        self._try(cell, lambda: self._by.take_picture(cell, self._eye, self._target))
        if self._topic:
            self._try(robot, lambda: self._by.take_robots_picture(robot, self._topic))

    def cell(self) -> Picture.Image:
        """Returns a picture of the cell.

        :raises SkirosError: there is none.
        """
        return self._by.picture(self._eye, self._target)

    def _try(self, file: Path, take: Callable[[], Path]) -> None:
        try:
            self._say(f"  picture: {take()}")
        except SkirosError as error:
            self._say(f"  no picture {file.name}: {error}")


def camera_view(places: Iterable[Vector], view: Vector = VIEW) -> tuple[Vector, Vector]:
    """Returns camera position and target for a picture of all positions (m).

    :param view: direction to the camera, relative to the width of the cell.
    """
    sides = [(min(axis), max(axis)) for axis in zip(*places, strict=True)]
    if not sides:
        return (-3.0, -2.0, 3.0), (0.0, 0.0, 0.0)
    width = max(high - low for low, high in sides) + 1.0
    x, y, z = ((low + high) / 2 for low, high in sides)
    dx, dy, dz = (part * width for part in view)
    return (x + dx, y + dy, z + dz), (x, y, z)


CONTAIN = "skiros:contain"


class WorldControl(Protocol):
    """The part of `Simulation` that disturbances use."""

    def pose_of(self, element: str) -> Pose: ...

    def put(self, element: str, pose: Pose) -> None: ...

    def slip(self, gripper: str, active: bool) -> None: ...


class Disturbance(Protocol):
    """A disturbance that occurs once, when the execution reaches a certain state.

    :ivar done: whether it has occurred.
    :ivar needs_plan: whether the goal is only reached with another plan.
    """

    done: bool
    needs_plan: bool

    def steps(self, steps: Sequence[Step]) -> str:
        """Called when the steps of the plan or their states change. Returns a description of what it did; "" for
        nothing."""

    def tree(self, nodes: Sequence[Any]) -> str:
        """Called when a task changes, with a `SkillProgress` per node. Returns the same as `steps`."""


class Moved:
    """Moves a product to another tray of the same workstation while the robot drives there.

    :param goal: the target tray of the product, which is not used.
    :param random: for the exact pose.
    """

    needs_plan = True

    def __init__(self, control: WorldControl, world: WorldState, product: str, goal: str, random: Random) -> None:
        self._control = control
        self._product = world.things[product]
        self._tray = _empty_neighbour(world, product, goal)
        self._random = random
        self.done = False

    def steps(self, steps: Sequence[Step]) -> str:
        if self.done or not any(name_of(step) == "drive" and step["state"] == "running" for step in steps):
            return ""
        self.done = True
        above = (self._tray.size[2] + self._product.size[2]) / 2 + 0.002
        x, y = (self._random.uniform(-0.02, 0.02) for _ in range(2))
        place = Pose((x, y, above), from_euler(0.0, 0.0, self._random.uniform(-0.2, 0.2)))
        self._control.put(self._product.id, composed(self._control.pose_of(self._tray.id), place))
        return f"somebody puts {self._product.name} into {self._tray.name}"

    def tree(self, nodes: Sequence[Any]) -> str:
        return ""


class Slip:
    """Makes a gripper slip once; its friction is restored after the failure.

    :param during: part of the label of the node that runs then.
    """

    needs_plan = True

    def __init__(self, control: WorldControl, gripper: Thing, during: str = "lift") -> None:
        self._control = control
        self._gripper = gripper
        self._during = during
        self._slips = False
        self.done = False

    def steps(self, steps: Sequence[Step]) -> str:
        if not self._slips or not any(step["state"] == "failed" for step in steps):
            return ""
        self._slips = False
        self._control.slip(self._gripper.id, False)
        return f"{self._gripper.name} has its grip back"

    def tree(self, nodes: Sequence[Any]) -> str:
        if self.done or not any(self._during in node.label and node.state == node.RUNNING for node in nodes):
            return ""
        self.done = self._slips = True
        self._control.slip(self._gripper.id, True)
        return f"{self._gripper.name} loses its grip"


def _empty_neighbour(world: WorldState, product: str, goal: str) -> Thing:
    """Returns an empty tray on the workstation of a product.

    :raises Refused: there is none.
    """
    trays = world.holders(product, CONTAIN)
    stations = {station for tray in trays for station in world.holders(tray, CONTAIN)}
    neighbours = sorted(o for s, p, o in world.relations if p == CONTAIN and s in stations and o not in (*trays, goal))
    for thing in (world.things[other] for other in neighbours):
        if thing.properties.get("skiros:ContainerState") == ["Empty"]:
            return thing
    raise Refused(f"there is no other empty tray on the workstation where {world.name(product)} is")


def simulated_launch(options: argparse.Namespace, package: str, file: str) -> list[str]:
    """Returns package, file and arguments to launch a simulated cell.

    :param options: of the demo's command.
    """
    simulated = [f"seed:={options.seed}", f"rate:={options.rate}", f"sim_gui:={str(options.gui).lower()}"]
    scene = [f"init_scene:={options.scene}"] if options.scene else []
    return [package, file, "gui:=false", *simulated, *scene]
