"""Stand-ins for the clients of actions: what a server said is in the recording."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from typing import Any

import genpy
from actionlib import CommState
from actionlib_msgs.msg import GoalStatus

from skiros2_bags.core.normal import Tolerance, same_text
from skiros2_bags.testing.recording import Acted, Recording, Seen, Told

#: How far apart in the bag a message of an action and the progress of the tick that it belongs to may be (s). Recorders
#: and nodes on a busy machine lag; what was told of the node says which tick it was.
LAG = 0.25

#: What a primitive tells in the tick in which it sends a goal, and in those before.
GOAL_SENT, WAITING = "Goal sent", "Waiting for the action server"

#: Fields of goals that are other ones at each run.
_VOLATILE = frozenset({"header", "stamp", "goal_id", "seq"})


class Actions:
    """The actions of a recording, as the clients of a replay see them.

    Goals are matched with the recorded ones of the same sender in their order; what was said of these is given to the
    client before the ticks (`answer`). To be used by one thread.

    :param tolerance: of numbers in goals.
    """

    def __init__(self, recording: Recording, tolerance: Tolerance) -> None:
        self._goals = [e for e in recording.acted if e.part == "goal"]
        self._tolerance = tolerance
        self._sent: dict[str, SimpleClient] = {}  # by the recorded goal's id
        self._answers: dict[str, list[Acted]] = {}  # by the recorded goal's id
        for event in recording.acted:
            if event.part in ("feedback", "result"):
                self._answers.setdefault(event.goal_id, []).append(event)
        self._matched: set[str] = set()  # ids of recorded goals
        self._now = 0.0  # the time of the tick
        self._messages: set[str] = set()  # of nodes that run
        self._sends = False  # whether a node tells in it that it has sent a goal
        #: The manager that is being ticked.
        self.sender = ""
        #: What was wrong with the goals that were sent: what it is, as recorded, and now.
        self.wrong: list[tuple[str, str, str]] = []

    def client(self, name: str, kind: Any) -> SimpleClient:
        """What `actionlib.SimpleActionClient(name, kind)` is meanwhile."""
        return SimpleClient(self, name if name.startswith("/") else f"/{name}")

    def answer(self, before: Told, told: Told, node_of: Callable[[Any], tuple[Seen | None, Seen | None]]) -> None:
        """Gives the clients what their servers had said by a tick.

        :param before, told: what was told before and after that tick; the same in the first.
        :param node_of: what was told, before and then, of the node that a skill belongs to.
        """
        self._now = told.time
        old = {node.place for node in before.nodes if _tells_goal(node)} if before is not told else set()
        self._messages = {node.message for node in told.nodes if node.state == "R"}
        self._sends = any(_tells_goal(node) and node.place not in old for node in told.nodes)
        for client in self._sent.values():
            client.catch_up(told, node_of)

    # -- for the clients ---------------------------------------------------------------------------------------------

    def is_due(self, action: str) -> bool:
        """Whether the recorded sender has sent its next goal to that action by the present tick."""
        goal = next(self._waiting(action), None)
        if goal is None or abs(goal.time - self._now) > LAG:
            return goal is not None and goal.time < self._now
        return self._sends and f"{WAITING} {action}" not in self._messages  # it came close to the tick

    def send(self, client: SimpleClient, goal: Any) -> None:
        """Matches a goal with the recorded one."""
        expected = next(self._waiting(client.ns), None)
        if expected is None:
            self.wrong.append((f"a goal to {client.ns}", "no further goal", _shown(goal)))
            return
        differences = list(message_differences(expected.content, goal, self._tolerance))
        if differences:
            field, wanted, found = differences[0]
            self.wrong.append((f"a goal to {client.ns}, field {field}", wanted, found))
        self._sent = {i: c for i, c in self._sent.items() if c is not client}
        self._sent[expected.goal_id] = client
        self._matched.add(expected.goal_id)
        # A recorder hears a result and the last feedback, of two topics, in any order; a client too.
        client.awaited = sorted(self._answers.get(expected.goal_id, []), key=lambda event: event.part == "result")

    def _waiting(self, action: str) -> Iterator[Acted]:
        """The recorded goals of the present sender that were not sent yet."""
        return (
            goal
            for goal in self._goals
            if goal.action == action and goal.caller == self.sender and goal.goal_id not in self._matched
        )


class SimpleClient:
    """As an `actionlib.SimpleActionClient`, as far as skills use it without waiting."""

    _instants = itertools.count()

    def __init__(self, actions: Actions, name: str) -> None:
        self.ns = name
        self.action_client = self
        self.gh: SimpleClient | None = None  # the goal's handle, which is the client itself
        self._actions = actions
        #: What the server is still to say, in order.
        self.awaited: list[Acted] = []
        self._result: Acted | None = None
        self._done_cb: Callable[[int, Any], None] | None = None
        self._feedback_cb: Callable[[Any], None] | None = None

    # -- what `ServerWatch` looks at ---------------------------------------------------------------------------------

    @property
    def last_status_msg(self) -> Any:
        """Another one at each look once the server is there, so that it never counts as silent."""
        return next(self._instants) + 1 if self.gh is not None or self.is_connected() else None

    def is_connected(self) -> bool:
        """Whether the recorded client could send its goal by now."""
        return self._actions.is_due(self.ns)

    def wait_for_server(self, timeout: Any = None) -> bool:
        return self.is_connected()

    # -- the goal ----------------------------------------------------------------------------------------------------

    def send_goal(
        self,
        goal: Any,
        done_cb: Callable[[int, Any], None] | None = None,
        active_cb: Callable[[], None] | None = None,
        feedback_cb: Callable[[Any], None] | None = None,
    ) -> None:
        self.gh, self._result = self, None
        self._done_cb, self._feedback_cb = done_cb, feedback_cb
        self._actions.send(self, goal)
        if active_cb is not None:
            active_cb()

    def catch_up(self, told: Told, node_of: Callable[[Any], tuple[Seen | None, Seen | None]]) -> None:
        """Hears what the server had said by a tick.

        What came close to the tick may have been heard in it or later. A primitive steps once for each feedback and
        once more, so its progress code tells how many it has heard; and it has heard the result when it has ended.
        """
        surely = sum(event.time <= told.time - LAG for event in self.awaited)
        at_most = sum(event.time <= told.time + LAG for event in self.awaited)
        number = sum(event.order < told.order for event in self.awaited)
        before, now = node_of(getattr(self._feedback_cb or self._done_cb, "__self__", None))
        if now is not None and now.state in "SF":
            number = at_most
            if now.state == "S" and before is not None and before.state == "R":
                number -= self._forget_late_feedback(at_most, now.code - before.code - 1)
        elif now is not None and before is not None and before.state == now.state == "R":
            number = now.code - before.code - 1
            if number == 0 and now.message != before.message:
                # the result, after which it goes on with another goal
                number = 1
                self._forget_late_feedback(at_most, 0)
            elif not surely:
                number = min(number, sum(event.part == "feedback" for event in self.awaited))
        for _ in range(min(max(number, surely), at_most)):
            if self.awaited:
                self._hear(self.awaited.pop(0))

    def _forget_late_feedback(self, of: int, heard: int) -> int:
        """A server may tell its result before its last feedback, which nobody hears then. Returns how many those are.

        :param of: how many of the answers have come.
        :param heard: how many of them are feedback that was heard.
        """
        feedback = [event for event in self.awaited[:of] if event.part == "feedback"]
        late = feedback[heard:] if 0 <= heard < len(feedback) < of else []
        self.awaited = [event for event in self.awaited if event not in late]
        return len(late)

    def _hear(self, event: Acted) -> None:
        if event.part == "feedback" and self._feedback_cb is not None:
            self._feedback_cb(event.content)
        if event.part == "result":
            self._result = event
            if self._done_cb is not None:
                self._done_cb(event.status, event.content)

    def cancel_goal(self) -> None:
        """What the server made of it is in the recording."""

    cancel_all_goals = cancel_goal

    def stop_tracking_goal(self) -> None:
        self.gh, self.awaited = None, []

    def stop(self) -> None:
        """Nothing is connected."""

    def get_state(self) -> int:
        if self._result is not None:
            return self._result.status
        return int(GoalStatus.ACTIVE if self.gh is not None else GoalStatus.LOST)

    get_terminal_state = get_state

    def get_comm_state(self) -> int:
        return int(CommState.DONE if self._result is not None else CommState.ACTIVE)

    def get_result(self) -> Any:
        return self._result.content if self._result is not None else None

    def get_goal_status_text(self) -> str:
        return self._result.text if self._result is not None else ""


def _tells_goal(node: Seen) -> bool:
    return node.message == GOAL_SENT and node.state == "R"


def message_differences(expected: Any, got: Any, tolerance: Tolerance, at: str = "") -> Iterator[tuple[str, str, str]]:
    """Where two messages differ: the field, what it is in the first, and in the second."""
    if isinstance(expected, genpy.Message) and isinstance(got, genpy.Message):
        if expected._type != got._type:
            yield at, expected._type, got._type
            return
        for name in expected.__slots__:
            if name not in _VOLATILE:
                path = f"{at}.{name}" if at else name
                yield from message_differences(getattr(expected, name), getattr(got, name), tolerance, path)
    elif isinstance(expected, list | tuple) and isinstance(got, list | tuple):
        if len(expected) != len(got):
            yield at, f"{len(expected)} values", f"{len(got)} values"
        for index, (wanted, found) in enumerate(zip(expected, got, strict=False)):
            yield from message_differences(wanted, found, tolerance, f"{at}[{index}]")
    elif not _same(expected, got, tolerance):
        yield at, _shown(expected), _shown(got)


def _same(expected: Any, got: Any, tolerance: Tolerance) -> bool:
    if isinstance(expected, genpy.TVal) and isinstance(got, genpy.TVal):
        return tolerance.close(expected.to_sec(), got.to_sec())
    if isinstance(expected, float) or isinstance(got, float):
        return isinstance(got, int | float) and tolerance.close(float(expected), float(got))
    if isinstance(expected, str) and isinstance(got, str):
        return same_text(expected, got, tolerance)
    return bool(expected == got)


def _shown(value: Any) -> str:
    text = " ".join(str(value).split())
    return text if len(text) <= 200 else f"{text[:200]}..."
