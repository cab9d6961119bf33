"""`~last_will`: what nodes leave to be done when they are gone, and who notices that."""

from __future__ import annotations

import threading
from typing import Any

import rospy

from skiros2_msgs import srv as srvs
from skiros2_world_model.core.last_wills import LastWills
from skiros2_world_model.core.wills import Will
from skiros2_world_model.ros.errors import answering
from skiros2_world_model.ros.node_watch import NodeWatch
from skiros2_world_model.ros.will_messages import msg2will


class LastWillService:
    """The service, and a watch for each node that has left a will: also for those of the journal.

    :param wills: what it keeps and carries out.
    """

    def __init__(self, wills: LastWills) -> None:
        self._wills = wills
        self._watches: dict[str, NodeWatch] = {}
        self._lock = threading.Lock()
        with self._lock:
            for will in wills.all():
                self._watch(will)
        self._service = rospy.Service("~last_will", srvs.WmLastWill, answering(self._on_last_will))

    def _on_last_will(self, request: Any) -> Any:
        will = msg2will(request)
        with self._lock:
            if will.bequests:
                self._wills.leave(will)
                self._watch(will)
            else:
                self._wills.take_back(will.owner)
                self._stop(will.owner)
        return srvs.WmLastWillResponse()

    def _watch(self, will: Will) -> None:
        self._stop(will.owner)
        watch = NodeWatch(will.life.uri, will.life.pid, lambda: self._wills.carry_out(will))
        self._watches[will.owner] = watch
        watch.start()

    def _stop(self, owner: str) -> None:
        watch = self._watches.pop(owner, None)
        if watch is not None:
            watch.stop()
