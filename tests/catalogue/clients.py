"""Primitives that have servers do their work: the servers of `CatalogueServers` have to run."""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

import actionlib
import rospy
from actionlib_msgs.msg import GoalStatus
from std_srvs.srv import SetBool, SetBoolRequest, Trigger

from catalogue.case import PREEMPT, Tree, case
from catalogue.parts import REQUIRED
from skiros2_common.core.abstract_skill import SkillDescription, State
from skiros2_msgs.msg import AssignTaskAction, AssignTaskFeedback, AssignTaskGoal, AssignTaskResult
from skiros2_std_skills.action_client_primitive import PrimitiveActionClient
from skiros2_std_skills.service_client_primitive import PrimitiveServiceClient

ACTION, LISTENS, SERVICE = "/catalogue/errand", "/catalogue/listens", "/catalogue/ask"


class CatalogueServers:
    """An action server and a service, in this process.

    The goal `good` succeeds after one feedback, `bad` aborts after one, `long` goes on until it is cancelled. Before
    the feedback, and before the result, it waits for the client to say that it listens: what comes before `send_goal`
    has returned, and a feedback that comes after the result, does not reach a client. The other service says yes to
    True and no to False.
    """

    def __init__(self) -> None:
        self._action = actionlib.SimpleActionServer(ACTION, AssignTaskAction, self._work, auto_start=False)
        self._action.start()
        self._listens = threading.Semaphore(0)
        self._services = [
            rospy.Service(LISTENS, Trigger, lambda _: (self._listens.release() is None, "")),
            rospy.Service(SERVICE, SetBool, lambda request: (request.data, "")),
        ]

    def close(self) -> None:
        for service in self._services:
            service.shutdown()
        server = self._action.action_server
        for end in (server.status_pub, server.result_pub, server.feedback_pub, server.goal_sub, server.cancel_sub):
            end.unregister()
        server.publish_status = lambda: None

    def _work(self, goal: AssignTaskGoal) -> None:
        if goal.goals == "long":
            while not self._action.is_preempt_requested() and not rospy.is_shutdown():
                time.sleep(0.01)
            self._action.set_preempted()
            return
        self._listens.acquire()
        publisher = self._action.action_server.feedback_pub
        client = self._action.current_goal.get_goal_id().id.partition("-")[0]
        _wait_for(lambda: any(c.endpoint_id == client for c in publisher.impl.connections))
        self._action.publish_feedback(AssignTaskFeedback())
        self._listens.acquire()
        if goal.goals == "good":
            self._action.set_succeeded(AssignTaskResult())
        else:
            self._action.set_aborted()


def _wait_for(what: Callable[[], bool]) -> None:
    """Waits in the tick, as no skill should: so the trace does not depend on how quick the server is."""
    end = time.monotonic() + 5.0
    while not what() and time.monotonic() < end:
        time.sleep(0.005)


class Errand(SkillDescription):
    """Has an action server do something."""

    def createDescription(self) -> None:
        self.addParam("Wish", str, REQUIRED)


class errand(PrimitiveActionClient):
    """Sends its wish in its first tick and hears of the end in its second; `again` fails first, and is tried again."""

    build_client_onstart = False  # one connection, made once, so that nothing is lost at a new one

    def createDescription(self) -> None:
        self.setDescription(Errand(), "errand")

    def buildClient(self) -> Any:
        return actionlib.SimpleActionClient(ACTION, AssignTaskAction)

    def buildGoal(self) -> AssignTaskGoal:
        wish = self.params["Wish"].value
        return AssignTaskGoal(goals="bad" if wish == "again" else wish)

    def execute(self) -> State:
        if self._goal is not None:
            _wait_for(self._watch.is_connected)
        else:
            for answers in (self.fb, self.res):
                rospy.ServiceProxy(LISTENS, Trigger)()
                _wait_for(lambda answers=answers: not answers.empty())
        return super().execute()

    def onDone(self, status: int, msg: Any) -> State:
        if status == GoalStatus.SUCCEEDED:
            return self.success()
        if self.params["Wish"].value == "again" and self.progress_code < 4:
            return self.restart(AssignTaskGoal(goals="good"))
        return self.fail("", status)

    def onPreempt(self) -> State:
        super().onPreempt()
        return self.fail("stopped", 9)


class Ask(SkillDescription):
    """Asks a service."""

    def createDescription(self) -> None:
        self.addParam("Question", bool, REQUIRED)


class ask(PrimitiveServiceClient):
    """Has its answer in its first tick."""

    def createDescription(self) -> None:
        self.setDescription(Ask(), "ask")

    def buildClient(self) -> Any:
        return rospy.ServiceProxy(SERVICE, SetBool)

    def buildRequest(self) -> SetBoolRequest:
        return SetBoolRequest(self.params["Question"].value)

    def execute(self) -> State:
        _wait_for(lambda: self._call is not None and self._call.ended)
        return super().execute()

    def onDone(self, response: Any) -> State:
        return self.success() if response.success else self.fail("no", 6)


class Errands(Tree, ABC):
    """One errand, then something else."""

    @property
    @abstractmethod
    def wish(self) -> str:
        """What the server is sent."""

    def expand(self, skill: Any) -> None:
        skill(self.skill("Errand", "", specify={"Wish": self.wish}), self.act("S"))


@case(
    """
    root           R   S1
      errand_good  R   S1
        errand     R1  S3
        act        .   S1
    """,
    servers=True,
)
class errand_good(Errands):
    """One step when the goal is sent, one with the feedback, and the end."""

    wish = "good"


@case(
    """
    root          R   F-1
      errand_bad  R   F-4
        errand    R1  F-4
        act       .   .
    """,
    servers=True,
)
class errand_bad(Errands):
    """The server aborts (4)."""

    wish = "bad"


@case(
    """
    root            R   R   R   S1
      errand_again  R   R   R   S1
        errand      R1  R3  R4  S6
        act         .   .   .   S1
    """,
    servers=True,
)
class errand_again(Errands):
    """`restart` sends another goal: feedback and restart, the goal sent, feedback and end."""

    wish = "again"


@case(
    """
    root              R   F-1
      errand_stopped  R   F-1
        errand        R1  F-9
        act           .   .
    """,
    events={2: PREEMPT},
    servers=True,
)
class errand_stopped(Errands):
    """Preempted while the server works."""

    wish = "long"


@case(
    """
    root     F-1
      asks   F-6
        ask  S1
        ask  F-6
    """,
    servers=True,
)
class asks(Tree):
    """A yes and a no."""

    def expand(self, skill: Any) -> None:
        skill(*(self.skill("Ask", "", specify={"Question": question}) for question in (True, False)))
