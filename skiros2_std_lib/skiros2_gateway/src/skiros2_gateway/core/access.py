"""Who may do what: users with tokens or certificates, roles, rate limits, and the audit log."""

from __future__ import annotations

import hashlib
import logging
import os
import secrets
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Any, Protocol

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError, model_validator

from skiros2_common.core.errors import ConfigurationError
from skiros2_gateway.core.problems import Denied, StoreFailed, TooMany, Unauthenticated, problems_of
from skiros2_gateway.core.refusals import Refusals

log = logging.getLogger(__name__)

#: Failed logins that an address may make per second, and in a burst.
_FAILURES_RATE, _FAILURES_BURST = 1.0, 20
#: How many rate limits are kept.
_MAX_LIMITS = 10_000


class Role(IntEnum):
    """What a user may do; each role includes the lower ones."""

    VIEW = 1
    OPERATE = 2
    MAINTAIN = 3


@dataclass(frozen=True)
class Caller:
    """A user of one connection.

    :param way: `rest`, `opcua`, `mqtt`, `mcp` or `browser`.
    """

    user: str
    role: Role
    way: str


class User(BaseModel):
    """A user in the file of users.

    :param token: the secret itself; the file must be readable by its owner only.
    :param sha256: the token's SHA-256 as hexadecimal digits, instead of the token.
    :param certificate: the SHA-256 of an OPC UA client's certificate (DER), as hexadecimal digits.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str
    role: str
    token: str = ""
    sha256: str = ""
    certificate: str = ""

    @model_validator(mode="after")
    def _check(self) -> User:
        if self.role.upper() not in Role.__members__:
            raise ValueError(f"role {self.role!r} is unknown, expected view, operate or maintain")
        if self.token and len(self.token) < 16:
            raise ValueError("the token is too short, expected at least 16 characters")
        if not (self.token or self.sha256 or self.certificate):
            raise ValueError("expected a token, its sha256, or a certificate")
        return self

    @property
    def level(self) -> Role:
        return Role[self.role.upper()]


class _Users(BaseModel):
    model_config = ConfigDict(extra="forbid")
    users: list[User]


def read_users(path: Path) -> list[User]:
    """Reads the file of users; makes it, with a random token for each role, if it does not exist.

    :raises ConfigurationError: the file has mistakes, or others may read it.
    """
    if not path.exists():
        _make_users(path)
    if path.stat().st_mode & 0o077:
        raise ConfigurationError(f"{path} has tokens and may be read by others; expected: chmod 600 {path}")
    try:
        users = _Users.model_validate(yaml.safe_load(path.read_text())).users
    except yaml.YAMLError as error:
        raise ConfigurationError(f"{path}: {error}") from error
    except ValidationError as error:
        raise ConfigurationError(f"{path}: " + "; ".join(str(problem) for problem in problems_of(error))) from error
    names = [user.name for user in users]
    if len(set(names)) < len(names):
        raise ConfigurationError(f"{path}: two users have the same name")
    return users


def _make_users(path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    users = [
        {"name": name, "role": name, "token": secrets.token_urlsafe(24)} for name in ("view", "operate", "maintain")
    ]
    text = "# Users of the gateway. Roles: view, operate (jobs, goals, pause, stop), maintain (also the audit log).\n"
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
        file.write(text + yaml.safe_dump({"users": users}, sort_keys=False))
    log.warning("made %s with a random token for each role", path)


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

    def __init__(self, users: list[User], audit: AuditLog, rate: float = 100.0, burst: float = 300.0) -> None:
        with_token = [user for user in users if user.token or user.sha256]
        self._by_token = {user.sha256.lower() or _sha256(user.token): user for user in with_token}
        self._by_certificate = {user.certificate.lower(): user for user in users if user.certificate}
        self._audit = audit
        self._rate, self._burst = rate, burst
        self._limits: dict[tuple[str, str], RateLimit] = {}
        self._refusals = Refusals(self._write)

    def authenticate(self, token: str, way: str, address: str = "") -> Caller:
        """Returns the caller with a token.

        :param address: of the client.
        :raises Unauthenticated: the token is unknown.
        :raises TooMany: the token is unknown, and the address has sent too many of these.
        """
        user = self._by_token.get(_sha256(token))
        return self._admit(user, way, address, "the token is missing or unknown")

    def authenticate_signature(self, name: str, is_right: Callable[[str], bool], way: str, address: str = "") -> Caller:
        """Returns the caller with a name, whose signature is right; raises like `authenticate`.

        :param is_right: whether a signature was made with a key: the SHA-256 of the token, as hexadecimal digits.
        """
        users = [user for key, user in self._by_token.items() if user.name == name and is_right(key)]
        return self._admit(users[0] if users else None, way, address, "the user or the signature is wrong")

    def authenticate_certificate(self, der: bytes, way: str, address: str = "") -> Caller:
        """Returns the caller with a certificate (DER); raises like `authenticate`."""
        user = self._by_certificate.get(hashlib.sha256(der).hexdigest())
        return self._admit(user, way, address, "the certificate is unknown")

    def _admit(self, user: User | None, way: str, address: str, reason: str) -> Caller:
        if user is None:
            self._refusals.add(_entry("", way, "log in", address, reason))
            self._limit(("address", address), _FAILURES_RATE, _FAILURES_BURST).take()
            raise Unauthenticated(reason)
        return Caller(user.name, user.level, way)

    def count(self, caller: Caller) -> None:
        """Counts a request of a user.

        :raises TooMany: the user has sent too many requests.
        """
        self._limit(("user", caller.user), self._rate, self._burst).take()

    def check(self, caller: Caller, role: Role, action: str, thing: str = "") -> None:
        """Checks the role for an action.

        :raises Denied: the caller lacks the role. The denial is in the audit log.
        """
        if caller.role < role:
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


def _sha256(token: str) -> str:
    return hashlib.sha256(token.encode("utf-8", "surrogatepass")).hexdigest()
