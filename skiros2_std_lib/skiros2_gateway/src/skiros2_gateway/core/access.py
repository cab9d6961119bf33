"""Access control: checks credentials, roles and rates, and writes the audit log."""

from __future__ import annotations

import asyncio
import hashlib
import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from skiros2_gateway.core.passwords import is_right
from skiros2_gateway.core.problems import Denied, StoreFailed, TooMany, Unauthenticated
from skiros2_gateway.core.refusals import Refusals
from skiros2_gateway.core.users import Role, User, sha256

__all__ = ["AGENTS", "Access", "AuditLog", "Caller", "RateLimit", "Role", "User"]

log = logging.getLogger(__name__)

#: The `way` of callers of agents' tools.
AGENTS = "mcp"

#: Failed logins that an address may make per second, and in a burst.
_FAILURES_RATE, _FAILURES_BURST = 1.0, 20
#: The kinds of credentials.
_TOKEN, _PASSWORD, _CERTIFICATE = "token ", "password ", "certificate "
#: How many rate limits are kept.
_MAX_LIMITS = 10_000


@dataclass(frozen=True)
class Caller:
    """A user of one connection.

    :param way: `rest`, `opcua`, `mqtt`, `mcp` or `browser`.
    :param person: whether a person, and no program, has the credentials.
    :param credential: identifies them.
    :param session: the id of the page's session; "" without one.
    """

    user: str
    role: Role
    way: str
    person: bool = False
    credential: str = ""
    session: str = ""

    @property
    def level(self) -> Role:
        """The role by which requests are checked. An agent, which only its tools admit, is an operator there."""
        return Role.OPERATE if self.role is Role.AGENT and self.way == AGENTS else self.role


class RateLimit:
    """A token bucket.

    :param rate: requests per second.
    :param burst: requests at once.
    """

    def __init__(self, rate: float, burst: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._rate, self._burst, self._clock = rate, burst, clock
        self._left, self._time = burst, clock()

    def refill(self) -> float:
        """Returns how many requests are allowed now."""
        now = self._clock()
        self._left = min(self._burst, self._left + (now - self._time) * self._rate)
        self._time = now
        return self._left

    def take(self) -> None:
        """Counts a request.

        :raises TooMany: it is over the limit.
        """
        if self.refill() < 1.0:
            wait = (1.0 - self._left) / self._rate
            raise TooMany(f"too many requests, expected at most {self._rate:g} per second", wait)
        self._left -= 1.0


class AuditLog(Protocol):
    """Where audited requests are written to, and read from."""

    def audit(self, entry: Mapping[str, Any]) -> None: ...

    def audit_log(self, since: int = 0, limit: int = 1000) -> list[dict[str, Any]]: ...


class Access:
    """Authenticates callers, checks roles and rates, and writes the audit log.

    :param rate, burst: limit of requests per second and user.
    """

    def __init__(self, users: Sequence[User], audit: AuditLog, rate: float = 100.0, burst: float = 300.0) -> None:
        self._by_credential: dict[str, User] = {}
        self._audit = audit
        self._rate, self._burst = rate, burst
        self._limits: dict[tuple[str, str], RateLimit] = {}
        self._refusals = Refusals(self._write)
        self.set_users(users)

    def set_users(self, users: Sequence[User]) -> None:
        """Replaces the users. Callers whose credentials are gone are refused from now on; see `renew`."""
        self._by_credential = {_TOKEN + user.digest: user for user in users if user.digest}
        self._by_credential |= {_PASSWORD + user.password: user for user in users if user.password}
        self._by_credential |= {_CERTIFICATE + user.certificate.lower(): user for user in users if user.certificate}

    def authenticate(self, token: str, way: str, address: str = "") -> Caller:
        """Returns the caller with a token.

        :param address: of the client.
        :raises Unauthenticated: the token is unknown.
        :raises TooMany: the token is unknown, and the address has sent too many of these.
        :raises Denied: an agent's token is valid for agents' tools only, and a person's is not valid there.
        """
        return self._admit(_TOKEN + sha256(token), way, address, "the token is missing or unknown")

    def authenticate_signature(self, name: str, is_right: Callable[[str], bool], way: str, address: str = "") -> Caller:
        """Returns the caller with a name, whose signature is right; raises like `authenticate`.

        :param is_right: whether a signature was made with a key: the SHA-256 of the token, as hexadecimal digits.
        """
        tokens = {key.removeprefix(_TOKEN): key for key in self._by_credential if key.startswith(_TOKEN)}
        found = [key for digest, key in tokens.items() if self._by_credential[key].name == name and is_right(digest)]
        return self._admit(found[0] if found else "", way, address, "the user or the signature is wrong")

    async def authenticate_password(self, name: str, password: str, way: str, address: str = "") -> Caller:
        """Returns the caller with a name and a password, or their token instead; raises like `authenticate`."""
        own = [key for key, user in self._by_credential.items() if user.name == name]
        if (token := _TOKEN + sha256(password)) in own:
            return self._admit(token, way, address, "")
        key = next((key for key in own if key.startswith(_PASSWORD)), "")
        limit = self._limit(("address", address), _FAILURES_RATE, _FAILURES_BURST)
        if limit.refill() < 1.0:
            limit.take()  # before the hash, which costs
        is_known = await asyncio.to_thread(is_right, password, key.removeprefix(_PASSWORD))
        return self._admit(key if is_known else "", way, address, "the user or the password is wrong")

    def authenticate_certificate(self, der: bytes, way: str, address: str = "") -> Caller:
        """Returns the caller with a certificate (DER); raises like `authenticate`."""
        return self._admit(_CERTIFICATE + hashlib.sha256(der).hexdigest(), way, address, "the certificate is unknown")

    def digests(self, role: Role) -> dict[str, str]:
        """Returns the names of the users with a role or a higher one, by the SHA-256 of their tokens."""
        users = self._by_credential.items()
        return {key.removeprefix(_TOKEN): u.name for key, u in users if key.startswith(_TOKEN) and u.level >= role}

    def renew(self, caller: Caller) -> Caller:
        """Returns an earlier caller with the present role.

        :raises Unauthenticated: the credentials are no longer valid.
        """
        user = self._by_credential.get(caller.credential)
        if user is None or user.name != caller.user:
            raise Unauthenticated(f"the credentials of {caller.user} are no longer valid")
        return self._caller(user, caller.way, caller.credential, "")

    def _admit(self, credential: str, way: str, address: str, reason: str) -> Caller:
        user = self._by_credential.get(credential)
        if user is None:
            self._refusals.add(_entry("", way, "log in", address, reason))
            self._limit(("address", address), _FAILURES_RATE, _FAILURES_BURST).take()
            raise Unauthenticated(reason)
        return self._caller(user, way, credential, address)

    def _caller(self, user: User, way: str, credential: str, address: str) -> Caller:
        caller = Caller(user.name, user.level, way, user.person, credential)
        reason = ""
        if user.level is Role.AGENT and way != AGENTS:
            reason = f"{user.name} is an agent; its role is valid for agents' tools only"
        elif user.person and way == AGENTS:
            reason = f"{user.name} is a person; an agent needs a user of its own with the role agent"
        if reason:
            self._refusals.add(_entry(caller.user, way, "log in", address, f"denied: {reason}"))
            raise Denied(reason)
        return caller

    def count(self, caller: Caller) -> None:
        """Counts a request of a user.

        :raises TooMany: the user has sent too many requests.
        """
        self._limit(("user", caller.user), self._rate, self._burst).take()

    def check(self, caller: Caller, role: Role, action: str, thing: str = "") -> None:
        """Checks the role for an action.

        :raises Denied: the caller lacks the role. The denial is in the audit log.
        """
        if caller.level < role:
            outcome = f"denied: needs the role {role.name.lower()}"
            self._refusals.add(_entry(caller.user, caller.way, action, thing, outcome))
            raise Denied(f"{action} needs the role {role.name.lower()}, {caller.user} has {caller.role.name.lower()}")

    def record(self, caller: Caller, action: str, thing: str, outcome: str) -> None:
        """Writes an entry of the audit log."""
        self._write(_entry(caller.user, caller.way, action, thing, outcome))

    def audit_log(self, since: int = 0, limit: int = 1000) -> list[dict[str, Any]]:
        """Returns entries of the audit log with a higher number, the oldest first."""
        self._refusals.write_ended(also_open=True)
        return self._audit.audit_log(since, limit)

    def close(self) -> None:
        """Writes what is only counted so far."""
        self._refusals.write_ended(also_open=True)

    def _write(self, entry: Mapping[str, Any]) -> None:
        try:
            self._audit.audit(entry)
        except StoreFailed as error:  # what was done is done: it is in the node's log instead
            log.error("not in the audit log: %s: %s", entry, error)

    def _limit(self, key: tuple[str, str], rate: float, burst: float) -> RateLimit:
        limit = self._limits.get(key)
        if limit is None:
            if len(self._limits) >= _MAX_LIMITS:  # full ones would be the same when they are made again
                self._limits = {k: each for k, each in self._limits.items() if each.refill() < 1.0}
            limit = self._limits[key] = RateLimit(rate, burst)
        return limit


def _entry(user: str, way: str, action: str, thing: str, outcome: str) -> dict[str, Any]:
    fields = {"user": user, "way": way, "action": action, "object": thing[:200], "outcome": outcome}
    return {"time": time.time(), **fields}
