"""Clearing a stop of the robot."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import actionlib
import rospy
from actionlib_msgs.msg import GoalStatus

from skiros2_common.core.abstract_skill import SkillDescription, State
from skiros2_common.core.errors import SkirosError
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.ros.connections import send_goal
from skiros2_msgs.msg import SafetyStatus
from skiros2_skill.core.runtime.safety import Safety
from skiros2_skill.core.runtime.safety_sources import Recovery
from skiros2_skill.ros.safety import SAFETY_TOPIC, find_type
from skiros2_std_skills.client_primitive import NO_ANSWER, NO_SERVER, STOPPED


class RecoverFromStop(SkillDescription):
    """Clears a stop of the robot: calls the driver, and waits until no source reports a stop. Starts while the robot is
    stopped.
    """

    def createDescription(self) -> None:
        self.addParam(
            "Call", "", ParamTypes.Optional, description="The driver's service or action; by default ~recovery"
        )
        self.addParam("Type", Recovery.type, ParamTypes.Optional, description="package/Type, or package/TypeAction")
        self.addParam("Timeout", 10.0, ParamTypes.Optional, description="For call and end", unit="s", minimum=0.0)
        self.setAvailableForPlanning(False)
        self.allowed_when_stopped = True


class recover_from_stop(PrimitiveBase):
    """Calls a service or an action with an empty request, in a thread. A false `success` in an answer is a failure."""

    def createDescription(self) -> None:
        self.setDescription(RecoverFromStop(), self.__class__.__name__)
        self._call: _Call | None = None
        self._status: Any = None
        self._subscriber: Any = None

    def onStart(self) -> bool:
        recovery = Recovery(self.params["Call"].value, self.params["Type"].value)
        if not recovery.call:
            recovery = Recovery(**rospy.get_param("~recovery", {}))
        cls = find_type(recovery.type, "msg" if recovery.is_action else "srv")
        if cls is None:
            return self.startError(f"there is no service or action type {recovery.type!r}", NO_SERVER)
        self._status = None
        self._began_at = time.monotonic()
        self._subscriber = rospy.Subscriber(SAFETY_TOPIC, SafetyStatus, self._on_status)
        timeout = self.params["Timeout"].value
        self._call = _Call(recovery, cls, timeout, self.wake) if recovery.call else None
        return True

    def execute(self) -> State:
        call, status = self._call, self._status
        if call is not None and call.error:
            return self.fail(call.error, NO_SERVER)
        answered = call is None or call.ended
        if answered and status is not None and status.state == Safety.RUNNING:
            return self.success("No stop is active")
        stop = "; ".join(status.stops) if status is not None else "the safety state is unknown"
        timeout = self.params["Timeout"].value
        if time.monotonic() - self._began_at > timeout:
            waited = stop if answered or call is None else f"no answer from {call.name}; {stop}"
            return self.fail(f"Not recovered within {timeout:g} s: {waited}", NO_ANSWER)
        return self.step(f"Waiting for the end of: {stop}" if answered or call is None else f"Waiting for {call.name}")

    def onPreempt(self) -> State:
        return self.fail("Stopped while recovering", STOPPED)

    def onEnd(self) -> bool:
        self._subscriber.unregister()
        if self._call is not None:
            self._call.abandon()
        return True

    def _on_status(self, status: Any) -> None:
        self._status = status
        self.wake()


class _Call:
    """One call of a service or an action in its own thread. `error` is set before `ended`.

    :param timeout: s for an action's server and its result.
    """

    def __init__(self, recovery: Recovery, cls: type, timeout: float, on_end: Callable[[], None]) -> None:
        self.name = rospy.resolve_name(recovery.call)
        self.error = ""
        self.ended = False
        self._client: Any = None
        self._cls = cls
        self._timeout = timeout
        self._on_end = on_end
        work = self._run_action if recovery.is_action else self._run_service
        threading.Thread(target=self._run, args=(work,), name="recovery call", daemon=True).start()

    def abandon(self) -> None:
        """Cancels an action that has not ended; the answer of a service is discarded."""
        if self._client is not None and not self.ended:
            self._client.cancel_goal()

    def _run(self, work: Callable[[], str]) -> None:
        try:
            self.error = work()
        except (rospy.ROSException, rospy.ServiceException, SkirosError, OSError) as error:
            self.error = f"{self.name}: {error}"
        self.ended = True
        self._on_end()

    def _run_service(self) -> str:
        answer = rospy.ServiceProxy(self.name, self._cls)()
        if getattr(answer, "success", True):
            return ""
        return f"{self.name} has failed: {getattr(answer, 'message', '') or 'no reason given'}"

    def _run_action(self) -> str:
        client = self._client = actionlib.SimpleActionClient(self.name, self._cls)
        if not client.wait_for_server(rospy.Duration(self._timeout)):
            return f"action server {self.name} is not available"
        send_goal(client, type(self._cls().action_goal.goal)())
        if not client.wait_for_result(rospy.Duration(self._timeout)):
            return f"no result from {self.name} within {self._timeout:g} s"
        if client.get_state() == GoalStatus.SUCCEEDED:
            return ""
        return f"{self.name} has failed: {client.get_goal_status_text() or 'no reason given'}"
