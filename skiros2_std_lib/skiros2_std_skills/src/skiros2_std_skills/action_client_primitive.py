"""Base of primitives that use an action server."""

from __future__ import annotations

import queue
from typing import Any

from actionlib import CommState
from actionlib_msgs.msg import GoalStatus

from skiros2_common.core.abstract_skill import State
from skiros2_common.ros.connections import ServerWatch, send_goal
from skiros2_std_skills.client_primitive import LOST, NO_ANSWER, NO_SERVER, ClientPrimitive

__all__ = ["PrimitiveActionClient"]

#: Timeout of an action server that is missing or silent (s of wall time).
SERVER_TIMEOUT = 5.0

#: Timeout of the connections to a known server (s of wall time).
_CONNECTION_TIMEOUT = 10.0

#: Progress messages of the tick in which a goal is sent, and of the ticks before. Re-runs of bags find the tick of a
#: goal by them, since nothing else in a recording shows it exactly.
GOAL_SENT, WAITING = "Goal sent", "Waiting for the action server"


class PrimitiveActionClient(ClientPrimitive):
    """Sends a goal to an action server and follows it. Override `buildClient` and `buildGoal`, and where needed
    `onFeedback` and `onDone`.

    No hook blocks: the tree continues while the primitive waits for the server.

    Attributes for subclasses:

    - `client`: the `actionlib.SimpleActionClient`;
    - `build_client_onstart`: True makes a client at each start, so that it may depend on the parameters; False makes
      one when the skill is loaded;
    - `fb`, `res`: queues that `_feedbackCb` and `_doneCb` fill from the client's thread, with feedback messages and
      with (status, result message). An `onStart` of a subclass passes the two to `client.send_goal`, or to
      `skiros2_common.ros.connections.send_goal`, which hears all answers.
    """

    build_client_onstart = True

    def __init__(self) -> None:
        super().__init__()
        self.fb: queue.Queue[Any] = queue.Queue()
        self.res: queue.Queue[tuple[int, Any]] = queue.Queue()
        self._goal: Any = None  # not sent yet
        self._seen_ended = False  # whether the goal had ended in an earlier tick
        self._watch: ServerWatch | None = None

    # -- to override -------------------------------------------------------------------------------------------

    def buildClient(self) -> Any:
        """To override: returns the `actionlib.SimpleActionClient`."""
        return super().buildClient()

    def buildGoal(self) -> Any:
        """To override: returns the goal message for the parameters. Called at each start. None makes the start fail."""
        return None

    def onFeedback(self, msg: Any) -> State:
        """To override: called with each feedback message, in the ticking thread. Returns a state."""
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
        """Cancels all goals of the server, if one was sent."""
        if self._goal is None and self.client is not None:
            self.client.cancel_all_goals()
            self.client.stop_tracking_goal()
        self._goal = None
        return self.success("Stopped")

    def execute(self) -> State:
        if self._watch is None:  # the onStart of a subclass has sent the goal
            self._watch = ServerWatch(self.client)
        if self._goal is not None:
            return self._send(self._watch)
        while not self.fb.empty():
            state = self.onFeedback(self.fb.get())
            if state not in (State.Running, None):
                return state
        if not self.res.empty() or self._result_missed():
            status, result = self.res.get()
            return self.onDone(status, result)
        if self.client.gh is not None and self._watch.time_without_result(self.client.gh) > SERVER_TIMEOUT:
            return self.fail(f"The action server {self._watch.name} has ended the goal, but its result was lost", LOST)
        if self.client.gh is not None and self._watch.time_without_ack(self.client.gh) > SERVER_TIMEOUT:
            return self.fail(f"The action server {self._watch.name} did not accept the goal: it was lost", LOST)
        if self._watch.time_since_status() > SERVER_TIMEOUT:
            text = f"The action server {self._watch.name} has sent no status for {SERVER_TIMEOUT} s"
            return self.fail(text, NO_ANSWER)
        return self.step(self._progress_msg)

    def onEnd(self) -> bool:
        # The client is kept until the next start: closing it now might discard an unsent cancel request.
        self._goal = self._watch = None
        self._clear_answers()
        return True

    # -- for subclasses ----------------------------------------------------------------------------------------

    def restart(self, goal: Any, text: str = "Restarting action.") -> State:
        """For `execute`, `onFeedback` and `onDone`: abandons the current goal and sends another. Returns Running."""
        if self._goal is None:
            self.client.cancel_goal()
            self.client.stop_tracking_goal()
        self._clear_answers()
        self._goal = goal
        self._watch = ServerWatch(self.client)
        return self.step(text)

    def get_result_msg(self) -> Any:
        """Returns the result message; None before the end of the goal."""
        return self.client.get_result()

    def status_text(self) -> str:
        """Returns how the goal ended: the server's text, or the name of the status."""
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

    # -- internal ----------------------------------------------------------------------------------------------

    def _close(self, client: Any) -> None:
        if client is not None:
            client.action_client.stop()

    def _clear_answers(self) -> None:
        self.fb = queue.Queue()
        self.res = queue.Queue()
        self._seen_ended = False

    def _send(self, watch: ServerWatch) -> State:
        """Sends the goal once the server is connected."""
        if watch.is_connected():
            goal, self._goal = self._goal, None
            send_goal(self.client, goal, done_cb=self._doneCb, feedback_cb=self._feedbackCb)
            return self.step(GOAL_SENT)
        if watch.time_since_status() > SERVER_TIMEOUT or watch.age() > _CONNECTION_TIMEOUT:
            return self.fail(f"Action server {watch.name} is not available.", NO_SERVER)
        return self.step(f"{WAITING} {watch.name}")

    def _result_missed(self) -> bool:
        # `client.send_goal`, if a subclass calls it, drops answers that arrive before it has returned.
        handle = self.client.gh
        if handle is None or handle.get_comm_state() != CommState.DONE:
            return False
        ended_before, self._seen_ended = self._seen_ended, True
        if not ended_before:
            return False  # the callback may be pending
        self.res.put((handle.get_terminal_state(), handle.get_result()))
        return True
