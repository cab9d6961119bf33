"""The reasoner for space: poses and sizes of elements, their spatial relations, and tf."""

from __future__ import annotations

import logging
import time
from typing import Any

import rospy

from skiros2_common.core.discrete_reasoner import DiscreteReasoner
from skiros2_common.core.errors import SkirosError, UnknownName
from skiros2_common.core.world_element import Element
from skiros2_std_reasoners.core import spatial_data as space
from skiros2_std_reasoners.core.geometry import Pose, composed, inverted
from skiros2_std_reasoners.core.pose_keeper import PoseKeeper
from skiros2_std_reasoners.core.relations import ALL, relations_between
from skiros2_std_reasoners.ros.codes import CODES, Code
from skiros2_std_reasoners.ros.frame_publisher import FramePublisher
from skiros2_std_reasoners.ros.transforms import Transforms

log = logging.getLogger(__name__)

#: Frames are published this often, and what follows or moves is written at most as often (Hz).
RATE = 25.0

#: What follows or moves is written in this part of the time at most: with many such elements, less often.
_FOLLOWING = 0.05


class AauSpatialReasoner(DiscreteReasoner):
    """Owns poses and tf. Its codes: `:Position`, `:Orientation`, `:OrientationEuler`, `:Pose`, `:Size`, and as messages
    of geometry_msgs `:PoseMsg`, `:PoseStampedMsg`, `:TransformMsg` (TransformStamped).

    In the server, `parse` sees each change and `run` publishes on tf. Everywhere, data and relations are computed from
    the elements alone, and look-ups ask tf.
    """

    def __init__(self) -> None:
        self._transforms = Transforms(lambda name: self._keeper.moving(name))
        self._keeper = PoseKeeper(self.__class__.__name__, self._transforms, _now)
        self._publisher: FramePublisher | None = None

    def init(self, wmi: Any) -> None:
        super().init(wmi)
        self._keeper.wmi = wmi

    # -- the server's side -------------------------------------------------------------------------------------

    def parse(self, element: Element, action: str) -> bool | None:
        """Gives a new element its frame, and an element with another parent the pose in that one's frame.

        Elements that do not name this reasoner are ignored.

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
        """Publishes the frames, and writes what follows or moves, until it is asked to end."""
        if self._publisher is None:  # kept while the reasoner stops for a load, so that listeners stay connected
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
                if str(error) != refusal:  # told once, not 25 times a second
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
        """Where a tf frame is in another one: (position, quaternion), or (None, None) when that is not known.

        :param duration: how long to wait for it (a ROS duration, or s).
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
        """Expresses the pose of an element in another frame, in place. False when the transform is not known.

        :param duration: how long to wait for it (a ROS duration, or s).
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
        """Adds the properties of poses and sizes, without values; the element is to be published."""
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
        """Removes all of the reasoner's properties."""
        for key in space.PROPERTIES:
            element.removeProperty(key)

    def hasData(self, element: Element, get_code: str) -> bool:
        """Whether all numbers behind a code are there.

        :raises UnknownName: it is none of the codes.
        """
        return None not in space.numbers(element, self._code(get_code).keys)

    def getData(self, element: Element, get_code: str) -> Any:
        """The data behind a code: lists, in which None stands for what is missing, or a message.

        :raises UnknownName: it is none of the codes.
        :raises WrongValue: a message is asked for, and the pose is not complete.
        """
        return self._code(get_code).get(element)

    def setData(self, element: Element, data: Any, set_code: str) -> None:
        """Writes the data behind a code: lists, tuples or arrays, or a message.

        :raises UnknownName: it is none of the codes.
        :raises WrongValue: there are too many or too few numbers.
        :raises WrongType: it is no such data.
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
        """How the box of `sub` lies to that of `obj`, along the axes of the frame of `sub`.

        One of Allen's relations on each axis and `:eqA` or `:pA`; `:unknownT` alone when `obj` has no position, or no
        transform is known. With metrics, pairs with the distance or a list of distances (m, rad). A missing size counts
        as 0, a missing orientation as no rotation.
        """
        sizes = [[v or 0.0 for v in space.numbers(e, space.SIZE)] for e in (sub, obj)]
        found = relations_between(self._relative(sub, obj), *sizes)
        return found if with_metrics else [name for name, _ in found]

    # -- shared ------------------------------------------------------------------------------------------------

    def _relative(self, sub: Element, obj: Element) -> Pose | None:
        """The pose of `obj` in the frame of `sub`."""
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
    """The time of ROS, which may be simulated; in a process that is no node, the clock's (s)."""
    return float(rospy.get_time()) if rospy.core.is_initialized() else time.time()
