"""The reasoner for space: poses and sizes of elements, their spatial relations, and tf."""

from __future__ import annotations

import logging
import time
from typing import Any

import rospy
from tf2_msgs.msg import TFMessage

from skiros2_common.core.discrete_reasoner import DiscreteReasoner
from skiros2_common.core.errors import SkirosError, UnknownName
from skiros2_common.core.world_element import Element
from skiros2_std_reasoners.core import spatial_data as space
from skiros2_std_reasoners.core.geometry import Pose, composed, inverted
from skiros2_std_reasoners.core.pose_tracker import Frame, PoseTracker, frame_of
from skiros2_std_reasoners.core.relations import ALL, relations_between
from skiros2_std_reasoners.ros.codes import CODES, Code
from skiros2_std_reasoners.ros.transforms import Transforms, messages

log = logging.getLogger(__name__)

#: Frames are published, and what follows or moves is written, this often (Hz).
RATE = 25.0

#: A linked pose is written when it has changed by more (m, and in parts of a quaternion).
_NOTICEABLE = 1e-4

_NAME = "AauSpatialReasoner"
_SPATIAL = "skiros:spatiallyRelated"


class AauSpatialReasoner(DiscreteReasoner):
    """Owns poses and tf. Its codes: `:Position`, `:Orientation`, `:OrientationEuler`, `:Pose`, `:Size`, and as messages
    of geometry_msgs `:PoseMsg`, `:PoseStampedMsg`, `:TransformMsg` (TransformStamped).

    In the server, `parse` sees each change and `run` publishes on tf. Everywhere, data and relations are computed from
    the elements alone, and look-ups ask tf.
    """

    def __init__(self) -> None:
        self._tracker = PoseTracker()
        self._transforms = Transforms()

    # -- the server's side -------------------------------------------------------------------------------------

    def parse(self, element: Element, action: str) -> bool | None:
        """Gives a new element its frame, and an element with another parent the pose in that one's frame.

        :param action: `add`, `update` or `remove`.
        """
        before = self._tracker.get(element.id)
        if action == "remove":
            self._tracker.drop(element.id)
            if before is not None:
                self._transforms.drop(before.name)
            return None
        if not space.text(element, space.FRAME):
            space.set_text(element, space.FRAME, element.id)
        parent = self._parent_frame(element)
        base = space.text(element, space.BASE_FRAME)
        if parent and parent != base and not space.text(element, space.LINKED_TO):
            self._rebase(element, base, parent)
        frame = frame_of(element, parent)
        self._tracker.put(frame)
        if frame.is_own and (before is None or not _same_place(before, frame)):
            assert frame.pose is not None
            self._transforms.put(frame.base, frame.name, frame.pose)
        return None

    def run(self) -> None:
        """Publishes the frames, and writes what follows or moves, at 25 Hz of wall time until it is asked to end."""
        publisher = rospy.Publisher("/tf", TFMessage, queue_size=10)
        self._transforms.listen()
        period = 1.0 / RATE
        before = next_time = time.monotonic()
        while not self._stop_event.wait(max(0.0, next_time - time.monotonic())) and not rospy.is_shutdown():
            now = time.monotonic()
            next_time = max(next_time + period, now)
            try:
                self._write_moved(now - before)
            except SkirosError as error:
                log.error("poses could not be written: %s", error)
            before = now
            try:
                self._publish(publisher)
            except rospy.ROSException:
                if not rospy.core.is_shutdown_requested():
                    raise
        publisher.unregister()

    def _publish(self, publisher: Any) -> None:
        """Tells tf, in one message, where all frames are."""
        stamp = rospy.Time.now()
        known = [(f, f.pose) for f in self._tracker.all() if f.pose is not None and f.is_known]
        told = [(f.base, f.name, pose) for f, pose in known if f.published and f.is_own]
        told += [(f.base, f.pushed_to, pose) for f, pose in known if f.pushed_to]
        if told and stamp != rospy.Time(0):  # simulated time may not have begun
            publisher.publish(messages(told, stamp))

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
        """How the box of `obj` lies to that of `sub`, along the axes of the frame of `sub`.

        One of Allen's relations on each axis and `:eqA` or `:pA`; `:unknownT` alone when no transform is known. With
        metrics, pairs with the distance or distances (m, rad). A size that is missing counts as 0.
        """
        sizes = [[v or 0.0 for v in space.numbers(e, space.SIZE)] for e in (sub, obj)]
        found = relations_between(self._relative(sub, obj), *sizes)
        return found if with_metrics else [name for name, _ in found]

    # -- shared ------------------------------------------------------------------------------------------------

    def _relative(self, sub: Element, obj: Element) -> Pose | None:
        """Where `obj` is in the frame of `sub`."""
        own, other = space.pose_of(sub), space.pose_of(obj)
        if other is None:
            return None
        own_base, other_base = (
            space.text(sub, space.BASE_FRAME),
            space.text(obj, space.BASE_FRAME),
        )
        if other_base and other_base == (space.text(sub, space.FRAME) or sub.id):
            return other
        if own is None:
            return None
        if own_base != other_base:
            between = self._transforms.find(own_base, other_base) if own_base and other_base else None
            if between is None:
                return None
            other = composed(between, other)
        return composed(inverted(own), other)

    def _parent_frame(self, element: Element) -> str:
        """The frame of the nearest element above that has one, "" when there is none."""
        relations = [_SPATIAL, *self._wmi.get_sub_properties(_SPATIAL)]
        seen = {element.id}
        waiting = [r["src"] for r in element.getRelations("", relations, "-1")]
        while waiting:
            eid = waiting.pop(0)
            above = self._wmi.find_element(eid) if eid not in seen else None
            seen.add(eid)
            if above is not None:
                if above.hasProperty("skiros:DiscreteReasoner", _NAME):
                    return space.text(above, space.FRAME) or str(above.id)
                waiting += [r["src"] for r in above.getRelations("", relations, "-1")]
        return ""

    def _rebase(self, element: Element, base: str, parent: str) -> bool:
        """Expresses the pose in the parent's frame; False when the transform is not known yet."""
        pose = space.pose_of(element)
        if pose is not None and base:
            between = self._transforms.find(parent, base)
            if between is None:
                return False
            space.set_pose(element, composed(between, pose))
        space.set_text(element, space.BASE_FRAME, parent)
        return True

    def _write_moved(self, seconds: float) -> None:
        """Writes, in one change, the poses that follow a frame, move, or waited for a transform."""
        changed: list[Element] = []
        for frame in self._tracker.all():
            if not (frame.linked_to or frame.moves or frame.waits):
                continue
            pose = self._new_pose(frame, seconds)
            element = self._wmi.find_element(frame.id) if pose is not None else None
            if element is not None and pose is not None:
                space.set_pose(element, pose[1])
                space.set_text(element, space.BASE_FRAME, pose[0])
                changed.append(element)
        if changed:
            self._wmi.update_elements(changed)

    def _new_pose(self, frame: Frame, seconds: float) -> tuple[str, Pose] | None:
        """The base and pose that a frame has got; None when there is nothing new."""
        if frame.linked_to:
            base = frame.parent or frame.base
            found = self._transforms.find(base, frame.linked_to) if base else None
            if found is None or (frame.base == base and frame.pose is not None and _close(found, frame.pose)):
                return None
            return base, found
        if frame.waits:
            assert frame.pose is not None
            between = self._transforms.find(frame.parent, frame.base)
            return None if between is None else (frame.parent, composed(between, frame.pose))
        moved = frame.moved(seconds)
        assert moved.pose is not None
        return frame.base, moved.pose

    def _code(self, code: str) -> Code:
        if code not in CODES:
            raise UnknownName(f"{_NAME} has no code {code!r}; it has: {', '.join(CODES)}")
        return CODES[code]


def _same_place(one: Frame, other: Frame) -> bool:
    return (one.base, one.name, one.pose) == (other.base, other.name, other.pose)


def _close(one: Pose, other: Pose) -> bool:
    pairs = zip((*one.position, *one.orientation), (*other.position, *other.orientation), strict=True)
    return all(abs(a - b) <= _NOTICEABLE for a, b in pairs)
