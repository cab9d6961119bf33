"""Whether an action server is there, and whether its answer still comes, asked without waiting."""

from __future__ import annotations

import time
from typing import Any

from actionlib import CommState

from skiros2_common.ros.subscribers import RegisteredSubscribers

#: Time after which the other listeners of an action's goals are not waited for any more (s).
_LISTENERS_TIMEOUT = 5.0


class ServerWatch:
    """Watches the server of one action client, from its creation on.

    :param client: an `actionlib.SimpleActionClient` or `ActionClient`.
    """

    def __init__(self, client: Any) -> None:
        self._client = getattr(client, "action_client", client)
        self._heard: Any = self._client.last_status_msg
        self._heard_at = self._made_at = time.monotonic()
        self._overdue: dict[int, float] = {}  # since when (s), by the state in which an answer is waited for
        self._listeners: RegisteredSubscribers | None = None

    @property
    def name(self) -> str:
        """The action's name."""
        return str(self._client.ns)

    def is_connected(self) -> bool:
        """Whether a goal would reach the server and all others that listen to goals, and its answer this client."""
        # As SimpleActionClient.wait_for_server, which sleeps, and for ever when simulated time stands still.
        client = self._client
        if not client.last_status_msg:
            return False
        server = client.last_status_msg._connection_header["callerid"]
        is_connected = (
            client.pub_goal.impl.has_connection(server)
            and client.pub_cancel.impl.has_connection(server)
            and any(c.callerid_pub == server for c in client.result_sub.impl.connections)
            and any(c.callerid_pub == server for c in client.feedback_sub.impl.connections)
        )
        if is_connected and self._listeners is None:
            self._listeners = RegisteredSubscribers(client.pub_goal)
        if not is_connected or self._listeners is None:
            return False
        return self.age() > _LISTENERS_TIMEOUT or self._listeners.are_connected()

    def age(self) -> float:
        """Time since the creation (s of wall time)."""
        return time.monotonic() - self._made_at

    def time_since_status(self) -> float:
        """For how long the server has said nothing, as seen by the calls of this method (s of wall time).

        A server publishes its status five times a second.
        """
        status = self._client.last_status_msg
        if status is not self._heard:
            self._heard, self._heard_at = status, time.monotonic()
        return time.monotonic() - self._heard_at

    def time_without_result(self, handle: Any) -> float:
        """For how long the server has said that a goal is ended without its result, likewise (s).

        A result is lost when the server was started anew under its name just before: the connections seem to be there.
        """
        return self._waiting(handle, CommState.WAITING_FOR_RESULT)

    def time_without_ack(self, handle: Any) -> float:
        """For how long the server has not said that it has got a goal that was sent, likewise (s).

        A goal is lost as a result is.
        """
        return self._waiting(handle, CommState.WAITING_FOR_GOAL_ACK)

    def _waiting(self, handle: Any, state: int) -> float:
        if handle.get_comm_state() != state:
            self._overdue.pop(state, None)
            return 0.0
        return time.monotonic() - self._overdue.setdefault(state, time.monotonic())
