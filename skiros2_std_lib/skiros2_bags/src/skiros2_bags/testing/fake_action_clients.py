"""Fake action clients: they receive the recorded answers of the servers."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Collection, Iterator, Set
from typing import Any

import genpy
from actionlib import CommState
from actionlib_msgs.msg import GoalStatus

from skiros2_bags.testing.field_tolerances import FieldTolerances
from skiros2_bags.testing.recording import ActionMessage, Recording, ServerStatus, TaskProgress
from skiros2_runs.core.frame import NodeProgress
from skiros2_runs.core.states import ENDS, RUNNING, SUCCESS
from skiros2_runs.core.tolerance import Tolerance, same_text
from skiros2_skill.core.engine.hooks import PREEMPTED
from skiros2_std_skills.action_client_primitive import GOAL_SENT, WAITING

#: Largest time in the bag between a message of an action and the progress message of its tick (s). Recorders and nodes
#: on a busy machine lag; the progress of the node determines the tick.
LAG = 0.25
#: Largest time by which the recorder can have received an answer later than the client (s), if the client's progress
#: shows the answer.
RECORDER_LAG = 1.5

#: Returns the recorded nodes of a skill before and after a tick.
StatesOf = Callable[[Any], tuple[NodeProgress | None, NodeProgress | None]]

#: Fields of goals that differ in every run.
_IGNORED_FIELDS = frozenset({"header", "stamp", "goal_id", "seq"})


class RecordedActions:
    """The recorded actions, as the clients of a replay see them.

    Goals and cancel requests are matched with the recorded ones of the same sender, in order. `deliver_answers` passes
    the recorded answers to the clients before each tick. Not thread-safe.

    :param tolerances: of numbers in goals.
    :param lost: see `Ordering.lost`.
    """

    def __init__(self, recording: Recording, tolerances: FieldTolerances, lost: Set[int] = frozenset()) -> None:
        self._goals = [e for e in recording.action_messages if e.part == "goal"]
        self._cancels = [e for e in recording.action_messages if e.part == "cancel"]
        self._tolerances = tolerances
        self._sent: dict[str, FakeActionClient] = {}  # by the recorded goal's id
        self._answers: dict[str, list[ActionMessage]] = {}  # by the recorded goal's id
        for event in recording.action_messages:
            if event.part in ("feedback", "result") and event.order not in lost:
                self._answers.setdefault(event.goal_id, []).append(event)
        self._goals = sorted([*self._goals, *self._missed_goals()], key=lambda goal: goal.time)
        #: Goals and answers that are not compared, for people.
        self.gaps = [
            f"a feedback of {event.action}: it arrived while its goal was sent, and the recorded client has lost it"
            for event in recording.action_messages
            if event.order in lost
        ]
        self._matched: set[str] = set()  # ids of recorded goals
        self._status_since: dict[str, float] = {}  # time of the first status of a server (s) by action
        for status in (event for event in recording.events if isinstance(event, ServerStatus)):
            self._status_since.setdefault(status.action, status.time)
        self._now = 0.0  # time of the tick
        self._messages: set[str] = set()  # of running nodes
        self._sends_goal = False  # whether a node reports a sent goal in this tick
        #: The manager that is being ticked.
        self.sender = ""
        #: Differences between sent and recorded goals: (subject, recorded, sent).
        self.mismatches: list[tuple[str, str, str]] = []

    def client(self, name: str, kind: Any) -> FakeActionClient:
        """Replaces `actionlib.SimpleActionClient(name, kind)`."""
        return FakeActionClient(self, name if name.startswith("/") else f"/{name}")

    def deliver_answers(
        self, before: TaskProgress, progress: TaskProgress, states_of: StatesOf, has_result: bool, counts: bool = True
    ) -> None:
        """Delivers the answers that the servers had sent by a tick.

        :param before, progress: recorded progress before and after the tick; the same object in the first tick.
        :param states_of: returns the recorded node of a skill in `before` and in `progress`.
        :param has_result: see `Ordering.results`.
        :param counts: see `Ordering.counts`.
        """
        self._now = progress.time
        then, now = before.frame.nodes, progress.frame.nodes
        old = {path for path, node in then.items() if _reports_goal(node)} if before is not progress else set()
        self._messages = {node.message for node in now.values() if node.state == RUNNING}
        self._sends_goal = any(_reports_goal(node) and path not in old for path, node in now.items())
        for client in self._sent.values():
            client.deliver(progress, states_of, has_result, counts)

    # -- for the clients ---------------------------------------------------------------------------------------------

    def has_status(self, action: str) -> bool:
        """Whether the server of an action had published its status by the current tick."""
        return self._status_since.get(action, math.inf) <= self._now

    def is_due(self, action: str) -> bool:
        """Whether the recorded sender has sent its next goal to an action by the current tick."""
        goal = next(self._unmatched_goals(action), None)
        is_known = goal is not None and goal.content is not None
        if goal is None or (is_known and abs(goal.time - self._now) > LAG) or goal.time < self._now - LAG:
            return goal is not None and goal.time < self._now
        return self._sends_goal and f"{WAITING} {action}" not in self._messages  # sent close to the tick

    def send(self, client: FakeActionClient, goal: Any) -> None:
        """Matches a goal with the next recorded goal."""
        expected = next(self._unmatched_goals(client.ns), None)
        if expected is None:
            self.mismatches.append((f"a goal to {client.ns}", "no further goal", _format_value(goal)))
            return
        if expected.content is None:
            self.gaps.append(f"a goal to {client.ns}: the bag has its answers, but the recorder has missed the goal")
        differences = (
            []
            if expected.content is None
            else list(diff_messages(expected.content, goal, self._tolerances.of_goal(client.ns)))
        )
        if differences:
            field, wanted, found = differences[0]
            self.mismatches.append((f"a goal to {client.ns}, field {field}", wanted, found))
        self._sent = {i: c for i, c in self._sent.items() if c is not client}
        self._sent[expected.goal_id] = client
        self._matched.add(expected.goal_id)
        # Result and last feedback are on different topics: recorder and client may receive them in any order.
        client.awaited = sorted(self._answers.get(expected.goal_id, []), key=lambda event: event.part == "result")

    def cancel(self, action: str, which: str) -> None:
        """Matches a cancel request with the next recorded one.

        :param which: the id of the recorded goal; "" for all goals of the action.
        """
        mine = (e for e in self._cancels if (e.action, e.caller, e.goal_id) == (action, self.sender, which))
        expected = next(mine, None)
        if expected is None:
            what = f"a request to cancel {'a goal' if which else 'all goals'} of {action}"
            self.mismatches.append((what, "none", "sent"))
        else:
            self._cancels.remove(expected)

    def goal_id(self, client: FakeActionClient) -> str:
        """Returns the id of the recorded goal that stands for the present goal of a client; "" without one."""
        return next((gid for gid, each in self._sent.items() if each is client), "")

    def unsent(self, senders: Collection[str], since: int, until: float = math.inf) -> list[ActionMessage]:
        """Returns the recorded goals and cancel requests that were not sent, oldest first.

        :param senders: names of nodes.
        :param since: order of the first message that counts.
        :param until: the time before which they must have been sent (s since the epoch).
        """
        goals = (goal for goal in self._goals if goal.goal_id not in self._matched)
        found = [e for e in (*goals, *self._cancels) if e.caller in senders and e.order >= since and e.time < until]
        return sorted(found, key=lambda e: e.order)

    def _missed_goals(self) -> Iterator[ActionMessage]:
        """Yields a goal without content, at the time of its first answer, for each goal that only its answers show."""
        known = {goal.goal_id for goal in self._goals}
        for goal_id, (first, *_) in self._answers.items():
            if goal_id not in known:
                sender = goal_id.rsplit("-", 2)[0]  # as actionlib makes ids
                yield ActionMessage(first.order, first.time, first.action, "goal", goal_id, None, sender)

    def _unmatched_goals(self, action: str) -> Iterator[ActionMessage]:
        """Yields the recorded goals of the current sender that were not matched yet."""
        return (
            goal
            for goal in self._goals
            if goal.action == action and goal.caller == self.sender and goal.goal_id not in self._matched
        )


class FakeActionClient:
    """The non-blocking part of `actionlib.SimpleActionClient`."""

    _counter = itertools.count()

    def __init__(self, actions: RecordedActions, name: str) -> None:
        self.ns = name
        self.action_client = self
        self.gh: FakeActionClient | None = None  # the goal's handle, which is the client itself
        self._actions = actions
        #: Answers still to be delivered, in order.
        self.awaited: list[ActionMessage] = []
        self._result: ActionMessage | None = None
        self._done_cb: Callable[[int, Any], None] | None = None
        self._feedback_cb: Callable[[Any], None] | None = None

    # -- used by `ServerWatch` ---------------------------------------------------------------------------------------

    @property
    def last_status_msg(self) -> Any:
        """A different value at each access once the server is available, so that it never counts as silent."""
        is_there = self.gh is not None or self._actions.has_status(self.ns) or self.is_connected()
        return next(self._counter) + 1 if is_there else None

    def is_connected(self) -> bool:
        """Whether the recorded client was able to send its goal by now."""
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

    def deliver(self, progress: TaskProgress, states_of: StatesOf, has_result: bool, counts: bool) -> None:
        """Delivers the answers that the server had sent by a tick.

        An answer close to the tick may belong to it or to a later tick. The progress code decides: a primitive counts
        one step per feedback and one for the goal. A primitive that has ended has received its result.
        """
        surely = sum(event.time <= progress.time - LAG for event in self.awaited)
        at_most = sum(event.time <= progress.time + LAG for event in self.awaited)
        number = sum(event.order < progress.order for event in self.awaited)
        before, now = states_of(getattr(self._feedback_cb or self._done_cb, "__self__", None))
        if now is not None and now.state in ENDS:
            if now.code != PREEMPTED and not any(event.part == "result" for event in self.awaited[:at_most]):
                at_most = sum(event.time <= progress.time + RECORDER_LAG for event in self.awaited)
            number = at_most
            if now.state == SUCCESS and before is not None and before.state == RUNNING:
                number -= self._drop_late_feedback(at_most, now.code - before.code - 1)
        elif now is not None and before is not None and before.state == now.state == RUNNING:
            number = now.code - before.code - 1
            at_most = sum(event.time <= progress.time + RECORDER_LAG for event in self.awaited)
            if counts:
                surely = 0  # its steps are exact, however late a busy client has read
            if number == 0 and now.message != before.message:
                # the result; the primitive then continues with another goal
                number = 1
                self._drop_late_feedback(at_most, 0)
            elif has_result and any(event.part == "result" for event in self.awaited[number : number + 1]):
                number += 1  # it continues with another goal, with one step for the last feedback and the result
            elif not surely:
                number = min(number, sum(event.part == "feedback" for event in self.awaited))
        for _ in range(min(max(number, surely), at_most)):
            if self.awaited:
                self._deliver_one(self.awaited.pop(0))

    def _drop_late_feedback(self, arrived: int, delivered: int) -> int:
        """Drops feedback that the server sent after its result. Returns the number of dropped messages.

        :param arrived: number of answers that have arrived.
        :param delivered: number of feedback messages among them that the recorded client received.
        """
        feedback = [event for event in self.awaited[:arrived] if event.part == "feedback"]
        late = feedback[delivered:] if 0 <= delivered < len(feedback) < arrived else []
        self.awaited = [event for event in self.awaited if event not in late]
        return len(late)

    def _deliver_one(self, event: ActionMessage) -> None:
        if event.part == "feedback" and self._feedback_cb is not None:
            self._feedback_cb(event.content)
        if event.part == "result":
            self._result = event
            if self._done_cb is not None:
                self._done_cb(event.status, event.content)

    def cancel_goal(self) -> None:
        """Compares the request; the server's reaction is in the recording."""
        if self.gh is not None:
            self._actions.cancel(self.ns, self._actions.goal_id(self))

    def cancel_all_goals(self) -> None:
        """Compares the request; the server's reaction is in the recording."""
        self._actions.cancel(self.ns, "")

    def stop_tracking_goal(self) -> None:
        self.gh, self.awaited = None, []

    def stop(self) -> None:
        """Does nothing: there is no connection."""

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


def _reports_goal(node: NodeProgress) -> bool:
    return node.message == GOAL_SENT and node.state == RUNNING


def diff_messages(
    expected: Any, got: Any, tolerance_of: Callable[[str], Tolerance], at: str = ""
) -> Iterator[tuple[str, str, str]]:
    """Yields the differences between two messages: field, first value, second value.

    :param tolerance_of: returns that of a field.
    """
    if isinstance(expected, genpy.Message) and isinstance(got, genpy.Message):
        if expected._type != got._type:
            yield at, expected._type, got._type
            return
        for name in expected.__slots__:
            if name not in _IGNORED_FIELDS:
                path = f"{at}.{name}" if at else name
                yield from diff_messages(getattr(expected, name), getattr(got, name), tolerance_of, path)
    elif isinstance(expected, list | tuple) and isinstance(got, list | tuple):
        if len(expected) != len(got):
            yield at, f"{len(expected)} values", f"{len(got)} values"
        for index, (wanted, found) in enumerate(zip(expected, got, strict=False)):
            yield from diff_messages(wanted, found, tolerance_of, f"{at}[{index}]")
    elif not _same(expected, got, tolerance_of(at)):
        yield at, _format_value(expected), _format_value(got)


def _same(expected: Any, got: Any, tolerance: Tolerance) -> bool:
    if isinstance(expected, genpy.TVal) and isinstance(got, genpy.TVal):
        return tolerance.close(expected.to_sec(), got.to_sec())
    if isinstance(expected, float) or isinstance(got, float):
        return isinstance(got, int | float) and tolerance.close(float(expected), float(got))
    if isinstance(expected, str) and isinstance(got, str):
        return same_text(expected, got, tolerance)
    return bool(expected == got)


def _format_value(value: Any) -> str:
    text = " ".join(str(value).split())
    return text if len(text) <= 200 else f"{text[:200]}..."
