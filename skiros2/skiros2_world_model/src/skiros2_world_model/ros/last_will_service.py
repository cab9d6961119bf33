"""`~last_will`: what nodes leave to be done when they are gone, and who notices that."""

from __future__ import annotations

import logging
import threading
from typing import Any

import rospy

from skiros2_msgs import srv as srvs
from skiros2_world_model.core.last_wills import LastWills
from skiros2_world_model.core.wills import Life, Will
from skiros2_world_model.ros.errors import answering
from skiros2_world_model.ros.node_watch import NodeWatch
from skiros2_world_model.ros.will_messages import msg2will

log = logging.getLogger(__name__)


class LastWillService:
    """The service, and a watch for each node that has left a will: also for those of the journal.

    :param wills: what it keeps and carries out.
    """

    def __init__(self, wills: LastWills) -> None:
        self._wills = wills
        self._watches: dict[str, tuple[Life, NodeWatch]] = {}
        self._lock = threading.Lock()
        with self._lock:
            for will in wills.all():
                self._watch(will).start()
        self._service = rospy.Service("~last_will", srvs.WmLastWill, answering(self._on_last_will))

    def _on_last_will(self, request: Any) -> Any:
        will = msg2will(request)
        with self._lock:
            if will.bequests:
                self._wills.leave(will)
                self._meet(will)
            else:
                self._wills.take_back(will.owner)
                self._stop(will.owner)
        return srvs.WmLastWillResponse()

    def _meet(self, will: Will) -> None:
        """Watches a node that is there now, unless that life of it is watched already."""
        life, watch = self._watches.get(will.owner, (None, None))
        if watch is not None and life == will.life and watch.is_alive():
            return
        watch = self._watch(will)
        try:
            watch.meet()
        except OSError as error:
            text = "%s cannot be reached at %s (%s): its last will waits for another node of its name to leave one"
            log.warning(text, will.owner, will.life.uri, error)
        else:
            watch.start()

    def _watch(self, will: Will) -> NodeWatch:
        self._stop(will.owner)
        owner, life = will.owner, will.life
        watch = NodeWatch(life.uri, life.pid, lambda: self._wills.carry_out(owner, life))
        self._watches[owner] = life, watch
        return watch

    def _stop(self, owner: str) -> None:
        if owner in self._watches:
            self._watches.pop(owner)[1].stop()
