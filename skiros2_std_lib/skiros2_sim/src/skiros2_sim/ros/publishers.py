"""Publishes the state of the simulated world: clock, tf, joints, odometry, wrenches, contacts, images."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable

import numpy as np
import rospy
from genpy import Message
from geometry_msgs.msg import Point, WrenchStamped
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image, JointState
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

from skiros2_sim.core.camera import Picture, picture_of, with_depth_noise
from skiros2_sim.core.robot import Robot
from skiros2_sim.core.robot_model import BASE_LINK
from skiros2_sim.core.scene_spec import CameraSpec
from skiros2_sim.core.stepper import Stepper
from skiros2_sim.core.world import World
from skiros2_sim.ros.frames import ODOM, Frames
from skiros2_sim.ros.messages import camera_info, colour_image, depth_image, pose_message, twist_message, wrench_message
from skiros2_sim_msgs.msg import Contact, Contacts
from skiros2_std_reasoners.ros.packed_transforms import PackedTransforms

#: Rates of messages (Hz of simulated time).
_CLOCK, _STATE, _CONTACTS = 60, 30, 20


class SimulatedClock:
    """The ROS time of the simulated world, also of this node. Not reset with the world.

    :param stepper: counts the steps.
    """

    def __init__(self, stepper: Stepper) -> None:
        self._stepper = stepper
        # latched for nodes that start while the world is paused
        # A full queue drops its oldest message: the time would jump for all nodes.
        self._topic = rospy.Publisher("/clock", Clock, queue_size=2 * _CLOCK, latch=True)
        self._is_used = not rospy.rostime.is_wallclock()
        if self._is_used:
            # its own messages would wake two threads in this node, for which the stepping thread waits
            rospy.impl.simtime._clock_sub.unregister()

    @property
    def now(self) -> rospy.Time:
        """The current time. Starts with the first step, as rospy treats 0 as "no time"."""
        seconds, steps = divmod(self._stepper.count + 1, self._stepper.step_rate)
        return rospy.Time(seconds, steps * 1_000_000_000 // self._stepper.step_rate)

    @property
    def seconds(self) -> float:
        return (self._stepper.count + 1) / self._stepper.step_rate

    def publish(self) -> None:
        """Publishes the current time. Called in the stepping thread."""
        now = self.now
        if self._is_used:
            rospy.rostime._set_rostime(now)
        self._topic.publish(now)


class LateTopic:
    """A sensor's topic, which a fault may delay.

    :param targets: ids of the elements of the fault.
    """

    def __init__(self, name: str, kind: type[Message], targets: Iterable[str], queue_size: int = 10) -> None:
        self._publisher = rospy.Publisher(name, kind, queue_size=queue_size)
        self._targets = tuple(targets)
        self._waiting: deque[tuple[float, Message]] = deque()  # measurements with their times (s)

    @property
    def has_subscribers(self) -> bool:
        return bool(self._publisher.get_num_connections() > 0)

    def put(self, world: World, message: Message) -> None:
        """Adds a measurement with the current time."""
        self._waiting.append((world.time, message))

    def send(self, world: World) -> None:
        """Publishes the measurements that are due. Discards those from before a reset of the world."""
        if not self._waiting:
            return
        lag = max(map(world.faults.lag, self._targets), default=0.0)
        while self._waiting and not world.time - lag < self._waiting[0][0] <= world.time:
            time, message = self._waiting.popleft()
            if time <= world.time:
                self._publisher.publish(message)


class StatePublisher:
    """Publishes the state of the world after its steps, in the stepping thread."""

    def __init__(self, world: World, stepper: Stepper, clock: SimulatedClock, frames: Frames) -> None:
        self._world = world
        self._stepper = stepper
        self._clock = clock
        self._frames = frames
        self._tf = rospy.Publisher("/tf", TFMessage, queue_size=10)
        self._packed = PackedTransforms()
        self._contacts = rospy.Publisher("~contacts", Contacts, queue_size=10, latch=True)
        self._pairs: list[tuple[str, str]] = []
        self._contacts_count = 0
        self._state_count = -1
        self._sensors: list[tuple[LateTopic, Callable[[], Message]]] = []
        for robot in world.robots.values():
            self._add_sensors(robot)

    def after_step(self) -> None:
        """Publishes what is due."""
        if self._is_due(_CLOCK):
            self._clock.publish()
        if self._is_due(_STATE):
            self._publish_state()
        if self._is_due(_CONTACTS):
            self._publish_contacts()

    def publish_all(self) -> None:
        """Publishes everything now: after a change of the world, or before a pause."""
        self._clock.publish()
        self._publish_state()
        self._publish_contacts()

    def _is_due(self, rate: int) -> bool:
        return self._stepper.count % (self._stepper.step_rate // rate) == 0

    def _add_sensors(self, robot: Robot) -> None:
        base = robot.spec.base
        late = [robot.id, *([base.id] if base is not None else [])]
        self._add(LateTopic(f"/{robot.name}/joint_states", JointState, (robot.id, *robot.arms)), self._joints, robot.id)
        if robot.mobile:
            self._add(LateTopic(f"/{robot.name}/odom", Odometry, late), self._odometry, robot.id)
        for arm in robot.spec.arms:
            if arm.id in robot.arms:
                self._add(LateTopic(arm.wrench_topic, WrenchStamped, (robot.id, arm.id)), self._wrench, arm.id)

    def _add(self, topic: LateTopic, message: Callable[[str], Message], eid: str) -> None:
        self._sensors.append((topic, lambda: message(eid)))

    def _publish_state(self) -> None:
        if self._state_count == self._stepper.count:
            return  # tf accepts one transform per time
        self._state_count = self._stepper.count
        now = self._clock.now
        for parent, name, pose in self._frames.moved(self._world):
            self._packed.put(name, parent, name, pose)
        self._tf.publish(self._packed.message(now, 0.0))
        for topic, message in self._sensors:
            if topic.has_subscribers:
                topic.put(self._world, message())
            topic.send(self._world)

    def _joints(self, eid: str) -> JointState:
        robot = self._world.robots[eid]
        states = robot.joint_states()
        return JointState(
            header=Header(stamp=self._clock.now),
            name=list(robot.joints),
            position=[state.position for state in states],
            velocity=[state.velocity for state in states],
            effort=[state.effort for state in states],
        )

    def _odometry(self, eid: str) -> Odometry:
        robot = self._world.robots[eid]
        message = Odometry()
        message.header = Header(stamp=self._clock.now, frame_id=f"{robot.name}/{ODOM}")
        message.child_frame_id = f"{robot.name}/{BASE_LINK}"
        message.pose.pose = pose_message(robot.pose())
        vx, vy, turn = robot.velocity()
        message.twist.twist = twist_message((vx, vy, 0.0), (0.0, 0.0, turn))
        return message

    def _wrench(self, eid: str) -> WrenchStamped:
        arm = self._world.arms[eid]
        robot = next(robot for robot in self._world.robots.values() if eid in robot.arms)
        header = Header(stamp=self._clock.now, frame_id=f"{robot.name}/{arm.name}/tool")
        return WrenchStamped(header, wrench_message(arm.wrench()))

    def _publish_contacts(self) -> None:
        contacts = self._world.contacts()
        pairs = [(contact.first, contact.second) for contact in contacts]
        count = self._stepper.count
        if pairs == self._pairs and not (pairs and count - self._contacts_count >= self._stepper.step_rate):
            return
        self._pairs, self._contacts_count = pairs, count
        self._contacts.publish(
            Contacts(
                Header(stamp=self._clock.now, frame_id=self._frames.map),
                [Contact(c.first, c.second, Point(*c.position), c.force) for c in contacts],
            )
        )


class Cameras:
    """Publishes images in the stepping thread, while there are subscribers.

    :param rate: Hz of simulated time; 0 for never.
    :param depth_noise: standard deviation of the depth of each pixel (m); depends only on the seed and the time of the
        world.
    """

    def __init__(
        self, world: World, stepper: Stepper, clock: SimulatedClock, frames: Frames, rate: float, depth_noise: float
    ) -> None:
        self._world = world
        self._stepper = stepper
        self._clock = clock
        self._frames = frames
        self._depth_noise = depth_noise
        self._period = max(1, round(world.rate / rate)) if rate else 0
        self._topics = {camera.id: _camera_topics(camera) for camera in world.cameras.values()} if rate else {}

    def after_step(self) -> None:
        """Publishes what is due."""
        if not self._period or self._stepper.count % self._period:
            return
        for number, (camera, topics) in enumerate(self._topics.items()):
            if any(topic.has_subscribers for topic, _ in topics):
                picture = picture_of(self._world, camera)
                if self._depth_noise:
                    random = np.random.default_rng((self._world.seed, number, self._world.steps))
                    picture = with_depth_noise(picture, self._depth_noise, random)
                header = Header(stamp=self._clock.now, frame_id=self._frames.camera(camera))
                for topic, message in topics:
                    topic.put(self._world, message(picture, header))
            for topic, _ in topics:
                topic.send(self._world)


def _camera_topics(camera: CameraSpec) -> list[tuple[LateTopic, Callable[[Picture, Header], Message]]]:
    """Returns the topics of a camera with the functions that make their messages: colour, depth, and a camera_info
    beside each."""
    folders = sorted({topic.rpartition("/")[0] or "/" for topic in (camera.rgb_topic, camera.depth_topic)})
    infos = [(rospy.names.ns_join(folder, "camera_info"), CameraInfo, camera_info) for folder in folders]
    topics = [(camera.rgb_topic, Image, colour_image), (camera.depth_topic, Image, depth_image), *infos]
    # images are large: a slow subscriber gets the newest one
    return [(LateTopic(name, kind, (camera.id,), queue_size=2), message) for name, kind, message in topics]
