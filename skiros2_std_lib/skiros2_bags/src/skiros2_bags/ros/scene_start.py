"""The whole scene at the start of a bag: where it was told before the recorder was there, the world model is asked."""

from __future__ import annotations

import json
import logging
from typing import Any

import rospy

from skiros2_bags.core.selection import ACTION_PROPERTIES, is_graph_name
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_world_model.core.changes import RESET, snapshot_number

log = logging.getLogger(__name__)

#: How long the world model may take to answer (s).
PATIENCE = 5.0

#: Who tells of a scene that was asked for.
AUTHOR = "recorder"


class SceneStart:
    """The changes of one world model, as a chain that begins with the whole scene.

    :param topic: its monitor, such as `/wm/monitor`.
    """

    def __init__(self, topic: str) -> None:
        self._service = topic.removesuffix("monitor") + "snapshot"
        self._known = ""

    def following(self, change: Any) -> list[Any]:
        """What is to be written when a change has come: it; or before it the scene, when changes before it are missing.

        Nothing, when it is in a scene that was asked for. Waits for the world model.
        """
        if change.action != RESET and change.prev_snapshot_id != self._known:
            if self._has(change):
                return []
            scene = self._whole_scene(change)
            if scene is not None:
                self._known = scene.snapshot_id
                if self._has(change):
                    return [scene]
                self._known = change.snapshot_id
                return [scene, change]
        self._known = change.snapshot_id
        return [change]

    def _has(self, change: Any) -> bool:
        """Whether what is known is no older than a change."""
        same_session = self._known.rpartition("-")[0] == change.snapshot_id.rpartition("-")[0]
        return same_session and 0 < snapshot_number(change.snapshot_id) <= snapshot_number(self._known)

    def _whole_scene(self, change: Any) -> Any:
        """The scene as a reset, as the world model tells it at its own start; None when it does not answer."""
        try:
            rospy.wait_for_service(self._service, PATIENCE)
            answer = rospy.ServiceProxy(self._service, srvs.WmSnapshot)("scene")
        except (rospy.ServiceException, rospy.ROSException) as error:
            log.warning("the scene before %s is not known: %s: %s", change.snapshot_id, self._service, error)
            return None
        log.info("the scene is taken from %s, as changes before %s are missing", self._service, change.snapshot_id)
        state = answer.snapshot_id
        return msgs.WmMonitor(state, state, change.stamp, AUTHOR, RESET, answer.elements, [])


def actions_named(change: Any) -> list[str]:
    """The actions of drivers that the elements of a change name."""
    names = []
    for element in change.elements:
        for prop in element.properties:
            if prop.key in ACTION_PROPERTIES:
                names += [rospy.resolve_name(name) for name in _values(prop.dataValue) if is_graph_name(name)]
    return names


def _values(text: str) -> list[Any]:
    try:
        values = json.loads(text)
    except ValueError:  # whoever reads the bag is told of it
        return []
    return values if isinstance(values, list) else [values]
