"""Base of primitives that have an action server do the work."""

from __future__ import annotations

import queue
from typing import Any

from actionlib import CommState
from actionlib_msgs.msg import GoalStatus

from skiros2_common.core.abstract_skill import State
from skiros2_common.ros.action_server_watch import ServerWatch
from skiros2_std_skills.client_primitive import LOST, NO_ANSWER, NO_SERVER, ClientPrimitive

__all__ = ["PrimitiveActionClient"]

#: How long an action server may take to appear, or be silent, before it counts as missing (s of wall time).
SERVER_TIMEOUT = 5.0

#: How long the connections to a server that is heard of may take (s of wall time).
_CONNECTION_TIMEOUT = 10.0


class PrimitiveActionClient(ClientPrimitive):
    """Sends a goal to an action server and follows it. Override `buildClient` and `buildGoal`, and where needed
    `onFeedback` and `onDone`.

    No hook waits: the tree goes on while the server is looked for and while it works.

    Attributes for subclasses:

    - `client`: the `actionlib.SimpleActionClient`;
    - `build_client_onstart`: True makes a client at each start, so that it may depend on the parameters; False makes
      one when the skill is loaded;
    - `fb`, `res`: queues that `_feedbackCb` and `_doneCb` fill from the client's thread, with feedback messages and
      with (status, result message). An `onStart` of a subclass passes the two to `client.send_goal`.
    """

    build_client_onstart = True

    def __init__(self) -> None:
        super().__init__()
        self.fb: queue.Queue[Any] = queue.Queue()
        self.res: queue.Queue[tuple[int, Any]] = queue.Queue()
        self._goal: Any = None  # waits to be sent
        self._seen_ended = False  # the goal, at an earlier tick
        self._watch: ServerWatch | None = None

    # -- to override -------------------------------------------------------------------------------------------

    def buildClient(self) -> Any:
        """To override: the `actionlib.SimpleActionClient`."""
        return super().buildClient()

    def buildGoal(self) -> Any:
        """To override: the goal message, from the parameters. Called at each start. None: there is none, it fails."""
        return None

    def onFeedback(self, msg: Any) -> State:
        """To override: called with each feedback message, by the thread that ticks. Returns a state."""
        return self.step()

    def onDone(self, status: int, msg: Any) -> State:
        """To override: called once at the end, with the status (`actionlib_msgs/GoalStatus`) and the result message.

        Returns `success(...)` or `fail(...)`, or `restart(...)` to go on.
        """
        if status == GoalStatus.SUCCEEDED:
            return self.success(self.status_text())
        return self.fail(self.status_text(), status)

    # -- hooks of the skill ------------------------------------------------------------------------------------

    def onStart(self) -> bool:
        if not super().onStart():
            return False
        self._goal = self.buildGoal()
        self._watch = ServerWatch(self.client)
        if self._goal is None:
            self.fail(f"{self.__class__.__name__}.buildGoal gave no goal", NO_SERVER)
        return self._goal is not None

    def onPreempt(self) -> State:
        """Cancels all goals of the server, where one was sent."""
        if self._goal is None and self.client is not None:
            self.client.cancel_all_goals()
            self.client.stop_tracking_goal()
        self._goal = None
        return self.success("Stopped")

    def execute(self) -> State:
        if self._watch is None:  # an onStart of a subclass has sent the goal
            self._watch = ServerWatch(self.client)
        if self._goal is not None:
            return self._send(self._watch)
        while not self.fb.empty():
            state = self.onFeedback(self.fb.get())
            if state not in (State.Running, None):
                return state
        if not self.res.empty() or self._ended_untold():
            status, result = self.res.get()
            return self.onDone(status, result)
        if self.client.gh is not None and self._watch.time_without_result(self.client.gh) > SERVER_TIMEOUT:
            return self.fail(f"The action server {self._watch.name} has ended the goal, but its result was lost", LOST)
        if self.client.gh is not None and self._watch.time_without_ack(self.client.gh) > SERVER_TIMEOUT:
            return self.fail(f"The action server {self._watch.name} has not taken the goal: it was lost", LOST)
        if self._watch.time_since_status() > SERVER_TIMEOUT:
            text = f"The action server {self._watch.name} has not been heard of for {SERVER_TIMEOUT} s"
            return self.fail(text, NO_ANSWER)
        return self.step(self._progress_msg)

    def onEnd(self) -> bool:
        # The client stays until the next start: closed now, it might take an unsent cancellation with it.
        self._goal = self._watch = None
        self._forget_answers()
        return True

    # -- for subclasses ----------------------------------------------------------------------------------------

    def restart(self, goal: Any, text: str = "Restarting action.") -> State:
        """For `execute`, `onFeedback` and `onDone`: gives up the present goal and sends another. Returns Running."""
        self._give_up()
        self._forget_answers()
        self._goal = goal
        self._watch = ServerWatch(self.client)
        return self.step(text)

    def get_result_msg(self) -> Any:
        """The result message of the client; None before there is one."""
        return self.client.get_result()

    def status_text(self) -> str:
        """How the goal ended: the server's text, or the name of the status."""
        text = self.client.get_goal_status_text()
        status = self.client.get_state()
        names = {value: name for name, value in vars(GoalStatus).items() if name.isupper()}
        return str(text) if text else f"{self.client.action_client.ns}: {names.get(status, status)}"

    def _feedbackCb(self, msg: Any) -> None:
        self.fb.put(msg)
        self.wake()

    def _doneCb(self, status: int, msg: Any) -> None:
        self.res.put((status, msg))
        self.wake()

    # -- inside ------------------------------------------------------------------------------------------------

    def _give_up(self) -> None:
        if self._goal is None:
            self.client.cancel_goal()
            self.client.stop_tracking_goal()

    def _close_client(self) -> None:
        if self.client is not None:
            self.client.action_client.stop()

    def _forget_answers(self) -> None:
        self.fb = queue.Queue()
        self.res = queue.Queue()
        self._seen_ended = False

    def _send(self, watch: ServerWatch) -> State:
        """Sends the goal as soon as the server is connected."""
        if watch.is_connected():
            goal, self._goal = self._goal, None
            self.client.send_goal(goal, done_cb=self._doneCb, feedback_cb=self._feedbackCb)
            return self.step("Goal sent")
        if watch.time_since_status() > SERVER_TIMEOUT or watch.age() > _CONNECTION_TIMEOUT:
            return self.fail(f"Action server {watch.name} is not available.", NO_SERVER)
        return self.step(f"Waiting for the action server {watch.name}")

    def _ended_untold(self) -> bool:
        # What a server says before `send_goal` has returned does not reach the callbacks.
        handle = self.client.gh
        if handle is None or handle.get_comm_state() != CommState.DONE:
            return False
        ended_before, self._seen_ended = self._seen_ended, True
        if not ended_before:
            return False  # the callback may be on its way
        self.res.put((handle.get_terminal_state(), handle.get_result()))
        return True
