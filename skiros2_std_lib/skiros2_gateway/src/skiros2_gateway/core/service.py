"""The functions for clients of REST, OPC UA, MQTT and for agents: each checks the role, counts, audits and executes."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Awaitable, Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

from skiros2_common.core.errors import SkirosError
from skiros2_gateway.core.access import Access, Caller, Role, User
from skiros2_gateway.core.alarms import Alarms
from skiros2_gateway.core.approvals import Approvals, Request
from skiros2_gateway.core.deadline import check_deadline
from skiros2_gateway.core.events import EventStream
from skiros2_gateway.core.job import Job, Method, read_order
from skiros2_gateway.core.job_control import JobControl
from skiros2_gateway.core.keys import Keep, Keys
from skiros2_gateway.core.problems import Denied, StoreFailed, TooMany, Unauthenticated
from skiros2_gateway.core.queue import move
from skiros2_gateway.core.received_responses import METHOD, receive
from skiros2_gateway.core.sessions import Sessions
from skiros2_gateway.core.store import JobStore

log = logging.getLogger(__name__)

T = TypeVar("T")

#: How many plans a user may ask for at once, and how many bags.
_AT_ONCE = 2

#: Actions on all tasks of a robot.
ROBOT_ACTIONS = ("stop", "pause", "resume")


class Service:
    """The gateway as its clients see it. To be used in the thread of the gateway's loop.

    Each method raises `Denied` if the caller lacks the role, and `TooMany` above the rate limit.
    """

    def __init__(
        self,
        store: JobStore,
        access: Access,
        control: JobControl,
        events: EventStream,
        approvals: Approvals | None = None,
    ) -> None:
        self.store = store
        self.access = access
        self.control = control
        self.events = events
        self.sessions = Sessions(store, access)
        self.keys = Keys(store)
        self.alarms = Alarms(store)
        self._waiting: Counter[tuple[str, str]] = Counter()
        self.approvals = approvals or Approvals(events)

    def stop_digests(self) -> dict[str, str]:
        """Returns who may stop robots: user names by the SHA-256 of tokens and of the secrets of sessions."""
        return {**self.access.digests(Role.OPERATE), **self.sessions.digests(Role.OPERATE)}

    def renew(self, caller: Caller) -> Caller:
        """Returns a caller who was admitted earlier, such as that of a stream, with the present role.

        :raises Unauthenticated: the credentials are no longer valid, or the session has ended.
        """
        if caller.session and not self.sessions.is_open(caller.session):
            raise Unauthenticated("the session has ended; log in again")
        return self.access.renew(caller)

    def is_admitted(self, caller: Caller, role: Role = Role.VIEW) -> bool:
        """Whether a caller who was admitted earlier, such as that of a stream, still has a role: may read."""
        try:
            return self.renew(caller).level >= role
        except (Unauthenticated, Denied):
            return False

    def set_users(self, users: Sequence[User]) -> None:
        """Replaces the users, and withdraws what those ask for who may not command any more."""
        self.access.set_users(users)
        self.approvals.withdraw(lambda caller: not self.is_admitted(caller, Role.OPERATE))

    async def approval(self, caller: Caller, asked: Request, *, by_person: bool = False) -> str:
        """Waits until a request is approved; see `Approvals.request`. Returns the name of the user who approves.

        :raises Unauthenticated, Denied: the caller was revoked, while the request was made or waited.
        """
        self.access.check(self.renew(caller), Role.OPERATE, "ask for an approval")
        by = await self.approvals.request(caller, asked, by_person=by_person)
        self.access.check(self.renew(caller), Role.OPERATE, "ask for an approval")
        return by

    async def once(
        self, caller: Caller, key: str, command: Any, do: Callable[[], Awaitable[T]], keep: Keep = Keep.BEFORE
    ) -> T:
        """Carries out a command once for each idempotency key of a user, and counts repeated ones; see `Keys.once`.

        :param do: counts the command itself, as all methods do.
        """
        is_first = False

        async def carry_out() -> T:
            nonlocal is_first
            is_first = True
            return await do()

        try:
            answer: T = await self.keys.once(caller.user, key, command, carry_out, keep)
        finally:
            if not is_first:
                self.access.count(caller)
        return answer

    # -- commands ----------------------------------------------------------------------------------------------

    async def put(self, caller: Caller, data: Any, comment: str = "", *, start: bool) -> tuple[Job, bool]:
        """Stores the order in JSON data; see `JobControl.put`."""
        name = Method.STORE_AND_START if start else Method.STORE
        thing = str(data.get("id", ""))[:200] if isinstance(data, dict) else ""

        async def put() -> tuple[Job, bool]:
            return await self.control.put(read_order(data), caller.user, comment, start=start)

        return await self.command(caller, name, thing, put)

    async def update(self, caller: Caller, data: Any, comment: str = "") -> Job:
        """Replaces the order of a job that has not started; see `JobControl.update`."""
        thing = str(data.get("id", ""))[:200] if isinstance(data, dict) else ""

        async def update() -> Job:
            return await self.control.update(read_order(data), caller.user, comment)

        return await self.command(caller, Method.UPDATE, thing, update)

    async def receive(self, caller: Caller, data: Any) -> Job:
        """Keeps a response to a job that another system has sent; see `skiros2_gateway.core.received_responses`."""
        with self.audited(caller, METHOD, str(data["job"])[:200]):
            job = receive(self.control, data, caller.user)
            await self.store.synced()
        return job

    async def move(self, caller: Caller, job_id: str, before: str) -> Job:
        """Moves a job of the queue; see `skiros2_gateway.core.queue`."""
        with self.audited(caller, "move", job_id):
            move(self.control, job_id, before, caller.user)
            await self.store.synced()
        return self.control.get(job_id)

    async def apply(self, caller: Caller, method: Method, job_id: str, comment: str = "") -> Job:
        """Applies a method to a job, on the disk; see `JobControl.apply`."""
        with self.audited(caller, method, job_id):
            job = self.control.apply(method, job_id, caller.user, comment)
            try:
                await self.store.synced()
            except StoreFailed as error:
                if method is Method.RESUME or not job.is_in_cell:
                    raise
                log.error("job %s: %s may be unknown after a power failure: %s", job_id, method, error)
        return job

    async def command_robots(self, caller: Caller, action: str, robots: Sequence[str]) -> dict[str, Any]:
        """Preempts, pauses or resumes all tasks of robots; none named: of all robots.

        :param action: one of `ROBOT_ACTIONS`.
        """
        with self.audited(caller, f"{action} robots", " ".join(robots)):
            return await self.control.cell.command_robots(action, robots, caller.user)

    async def command(self, caller: Caller, action: str, thing: str, do: Callable[[], Awaitable[T]]) -> T:
        """Carries out a command that needs the role operate, on the disk, and writes it to the audit log.

        :raises SkirosError: what `do` raises.
        """
        with self.audited(caller, action, thing):
            result = await do()
            await self.store.synced()
        return result

    @contextmanager
    def audited(self, caller: Caller, action: str, thing: str, role: Role = Role.OPERATE) -> Iterator[None]:
        """Counts and checks a command, and writes how it ended to the audit log."""
        self.access.count(caller)
        self.access.check(caller, role, action, thing)
        try:
            check_deadline()
            yield
        except SkirosError as error:
            self.access.record(caller, action, thing, f"{error.code}: {error}"[:500])
            raise
        self.access.record(caller, action, thing, "done")

    async def acknowledge(self, caller: Caller, alarms: Collection[str], known: Collection[str]) -> None:
        """Notes that a caller has seen alarms; see `Alarms.acknowledge`."""
        with self.audited(caller, "acknowledge alarms", " ".join(alarms)[:200]):
            self.alarms.acknowledge(alarms, known, caller.user)
            await self.store.synced()
        self.events.publish("alarm", {"acknowledged": list(alarms), "user": caller.user})

    # -- reading -----------------------------------------------------------------------------------------------

    def view(self, caller: Caller, role: Role = Role.VIEW, action: str = "read") -> None:
        """Counts and checks a request that changes nothing."""
        self.access.count(caller)
        self.access.check(caller, role, action)

    @contextmanager
    def planning(self, caller: Caller) -> Iterator[None]:
        """Counts and checks a request for a plan, which costs much, and lasts until the plan is there.

        :raises TooMany: the user waits for two others.
        """
        self.view(caller, Role.OPERATE, "plan")
        with self._few_at_once(caller.user, "plans"):
            yield

    @contextmanager
    def reading_bag(self, caller: Caller) -> Iterator[None]:
        """Counts and checks a request that reads a bag, as `planning` does; bags are read one after the other."""
        self.view(caller)
        with self._few_at_once(caller.user, "bags"):
            yield

    @contextmanager
    def _few_at_once(self, user: str, what: str) -> Iterator[None]:
        if self._waiting[user, what] >= _AT_ONCE:
            raise TooMany(f"{user} waits for {_AT_ONCE} {what} already", 1.0)
        self._waiting[user, what] += 1
        try:
            yield
        finally:
            self._waiting[user, what] -= 1

    def state(self, caller: Caller) -> dict[str, Any]:
        """Returns the state of the cell as JSON data, without `jobs`: see `GET /api/state` in
        `skiros2_gateway.http.app`.
        """
        self.view(caller)
        return {
            "event": self.events.last_id,
            "counts": self.store.counts(),
            "viewers": self.events.viewers,
            "role": caller.role.name.lower(),
            "user": caller.user,
            **self.control.cell.state(),
        }
