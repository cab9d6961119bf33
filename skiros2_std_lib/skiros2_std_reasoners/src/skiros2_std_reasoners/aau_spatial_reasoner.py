"""The spatial reasoner: poses and sizes of elements, their spatial relations, and tf."""

from __future__ import annotations

import logging
import time
from typing import Any

import rospy

from skiros2_common.core.discrete_reasoner import DiscreteReasoner
from skiros2_common.core.errors import SkirosError, UnknownName
from skiros2_common.core.world_element import Element
from skiros2_motion.core.geometry import Pose, composed, inverted
from skiros2_std_reasoners.core import spatial_data as space
from skiros2_std_reasoners.core.pose_keeper import PoseKeeper, ReasonerModel
from skiros2_std_reasoners.core.relations import ALL, relations_between
from skiros2_std_reasoners.ros.codes import CODES, Code
from skiros2_std_reasoners.ros.frame_publisher import FramePublisher
from skiros2_std_reasoners.ros.transforms import Transforms

log = logging.getLogger(__name__)

#: Rate of publishing frames, and maximum rate of writing poses that follow a frame or move (Hz).
RATE = 25.0

#: Maximum fraction of time spent on writing poses that follow or move; with many of them, the rate decreases.
_FOLLOWING = 0.05


class AauSpatialReasoner(DiscreteReasoner):
    """Owns poses and tf. Its codes: `:Position`, `:Orientation`, `:OrientationEuler`, `:Pose`, `:Size`, and as
    messages of geometry_msgs `:PoseMsg`, `:PoseStampedMsg`, `:TransformMsg` (TransformStamped).

    In the server, `parse` receives each change and `run` publishes on tf. In all processes, data and relations are
    computed from the elements; lookups use tf.
    """

    def __init__(self) -> None:
        self._transforms = Transforms(lambda name: self._keeper.moving(name))
        self._keeper = PoseKeeper(self.__class__.__name__, self._transforms, _now)
        self._publisher: FramePublisher | None = None

    def init(self, wmi: ReasonerModel) -> None:
        super().init(wmi)
        self._keeper.wmi = wmi

    # -- in the server -----------------------------------------------------------------------------------------

    def parse(self, element: Element, action: str) -> bool | None:
        """Assigns a frame to a new element, and converts the pose of an element with a new parent to the parent's
        frame.

        Ignores elements that do not name this reasoner.

        :param action: `add`, `update` or `remove`.
        """
        self._keeper.parse(element, action)
        return None

    def execute(self) -> None:
        """Reads the frames of the scene, and starts `run`."""
        try:
            self._keeper.read_scene()
        except SkirosError as error:
            log.error("poses of the scene could not be completed: %s", error)
        super().execute()

    def run(self) -> None:
        """Publishes the frames, and writes poses that follow or move, until it is stopped."""
        if self._publisher is None:  # kept while the reasoner is stopped for a load, so that subscribers stay connected
            self._publisher = FramePublisher(self._keeper.tracker, self._transforms, _now)
        self._transforms.listen()
        self._wmi.add_listener(self._keeper.on_change)
        try:
            self._publish(self._publisher)
        finally:
            self._wmi.remove_listener(self._keeper.on_change)

    def _publish(self, publisher: FramePublisher) -> None:
        period, refusal = 1.0 / RATE, ""
        next_time = next_follow = time.monotonic()
        while not self.stopRequested and not rospy.is_shutdown():
            time.sleep(max(0.0, next_time - time.monotonic()))
            begin = time.monotonic()
            next_time = max(next_time + period, begin)
            try:
                self._keeper.settle()
                if begin >= next_follow:
                    spent = time.thread_time()
                    self._keeper.follow()
                    next_follow = begin + (time.thread_time() - spent) / _FOLLOWING
                refusal = ""
            except SkirosError as error:
                if str(error) != refusal:  # logged once, not 25 times per second
                    log.error("poses could not be written: %s", error)
                refusal = str(error)
            try:
                publisher.publish()
            except rospy.ROSException:
                if not rospy.core.is_shutdown_requested():
                    raise

    # -- transforms --------------------------------------------------------------------------------------------

    def get_transform(
        self,
        base_frm: str,
        target_frm: str,
        duration: Any = rospy.Duration(0.0),  # noqa: B008 - the contract's default
    ) -> tuple[Any, Any]:
        """Returns the pose of a tf frame in another one: (position, quaternion), or (None, None) if it is unknown.

        :param duration: timeout (a ROS duration, or s).
        """
        seconds = duration.to_sec() if hasattr(duration, "to_sec") else float(duration)
        found = self._transforms.find(base_frm, target_frm, seconds)
        return (None, None) if found is None else (found.position, found.orientation)

    def transform(
        self,
        element: Element,
        target_frm: str,
        duration: Any = rospy.Duration(0.0),  # noqa: B008 - the contract's default
    ) -> bool:
        """Converts the pose of an element to another frame, in place. Returns False if the transform is unknown.

        :param duration: timeout (a ROS duration, or s).
        """
        pose = space.pose_of(element)
        base = space.text(element, space.BASE_FRAME)
        if pose is None or not base:
            return False
        position, orientation = self.get_transform(target_frm, base, duration)
        if position is None:
            return False
        if base != target_frm:
            space.set_pose(element, composed(Pose(position, orientation), pose))
            space.set_text(element, space.BASE_FRAME, target_frm)
        return True

    # -- data --------------------------------------------------------------------------------------------------

    def onAddProperties(self, element: Element) -> None:
        """Adds the properties of poses and sizes without values, with publishing enabled."""
        for key in (*space.POSITION, *space.ORIENTATION, *space.SIZE):
            if not element.hasProperty(key):
                element.setProperty(key, float)
        for key in (space.BASE_FRAME, space.FRAME):
            if not element.hasProperty(key):
                element.setProperty(key, str)
        if not element.hasProperty(space.TIME_STAMP):
            element.setProperty(space.TIME_STAMP, float)
        if not element.hasProperty(space.PUBLISH):
            element.setProperty(space.PUBLISH, True)

    def onRemoveProperties(self, element: Element) -> None:
        """Removes all properties of the reasoner."""
        for key in space.PROPERTIES:
            element.removeProperty(key)

    def hasData(self, element: Element, get_code: str) -> bool:
        """Whether all numbers of a code exist.

        :raises UnknownName: there is no such code.
        """
        return None not in space.numbers(element, self._code(get_code).keys)

    def getData(self, element: Element, get_code: str) -> Any:
        """Returns the data of a code: lists with None for missing numbers, or a message.

        :raises UnknownName: there is no such code.
        :raises WrongValue: a message is requested, and the pose is incomplete.
        """
        return self._code(get_code).get(element)

    def setData(self, element: Element, data: Any, set_code: str) -> None:
        """Writes the data of a code: lists, tuples or arrays, or a message.

        :raises UnknownName: there is no such code.
        :raises WrongValue: the number of values is wrong.
        :raises WrongType: the data has another type.
        """
        self._code(set_code).set(element, data)

    def getAssociatedData(self) -> list[str]:
        return list(space.PROPERTIES)

    def getAssociatedRelations(self) -> list[str]:
        return list(ALL)

    def getAssociatedProperties(self) -> list[str]:
        return list(CODES)

    # -- relations ---------------------------------------------------------------------------------------------

    def computeRelations(self, sub: Element, obj: Element, with_metrics: bool = False) -> list[Any]:
        """Returns the relations between the boxes of `sub` and `obj`, along the axes of the frame of `sub`.

        One of Allen's relations per axis, and `:eqA` or `:pA`; only `:unknownT` if `obj` has no position, or the
        transform is unknown. With metrics, pairs with the distance or a list of distances (m, rad). A missing size
        counts as 0, a missing orientation as no rotation.
        """
        sizes = [[v or 0.0 for v in space.numbers(e, space.SIZE)] for e in (sub, obj)]
        found = relations_between(self._relative(sub, obj), *sizes)
        return found if with_metrics else [name for name, _ in found]

    # -- shared ------------------------------------------------------------------------------------------------

    def _relative(self, sub: Element, obj: Element) -> Pose | None:
        """Returns the pose of `obj` in the frame of `sub`."""
        own, other = space.placement_of(sub), space.placement_of(obj)
        frame, base, own_base = (
            space.text(sub, space.FRAME),
            space.text(obj, space.BASE_FRAME),
            space.text(sub, space.BASE_FRAME),
        )
        if other is None or base == frame:
            return other
        if not base:
            return None
        frame = frame or sub.id
        if base == frame:
            return other
        if own is not None and own_base == base:
            return composed(inverted(own), other)
        between = self._transforms.find(frame, base) if frame else None
        if between is None and own is not None and own_base:  # not every frame of an element is published
            to_base = self._transforms.find(own_base, base)
            between = composed(inverted(own), to_base) if to_base is not None else None
        return composed(between, other) if between is not None else None

    def _code(self, code: str) -> Code:
        if code not in CODES:
            raise UnknownName(f"{self.__class__.__name__} has no code {code!r}; it has: {', '.join(CODES)}")
        return CODES[code]


def _now() -> float:
    """Returns the ROS time, which may be simulated; in a process that is not a node, the system time (s)."""
    return float(rospy.get_time()) if rospy.core.is_initialized() else time.time()
