"""Sessions of the page: made at a login, kept by the gateway, and ended by a logout, an administrator or their age."""

from __future__ import annotations

import logging
import secrets
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from skiros2_common.core.errors import UnknownName
from skiros2_gateway.core.access import Access, Caller
from skiros2_gateway.core.problems import Denied, StoreFailed, Unauthenticated
from skiros2_gateway.core.store import JobStore
from skiros2_gateway.core.users import Role, sha256

log = logging.getLogger(__name__)

#: The `way` of callers with a session.
BROWSER = "browser"
#: How long a session lasts (s).
MAX_AGE = 7 * 24 * 3600.0
#: The sessions of one user; a further one ends the oldest.
MAX_SESSIONS = 20


@dataclass
class Session:
    """A session.

    :param id: names it; its secret is another text, of which only the SHA-256 is kept.
    :param caller: with the credentials of the login: the session ends with them.
    :param created: s since the epoch.
    :param deadline: when it ends (s, of the clock of `Sessions`).
    """

    id: str
    digest: str
    caller: Caller
    address: str
    created: float
    deadline: float

    def to_dict(self) -> dict[str, Any]:
        """Returns the session as JSON data."""
        ends = self.created + MAX_AGE
        return {"id": self.id, "user": self.caller.user, "address": self.address, "created": self.created, "ends": ends}


class Sessions:
    """The sessions, which survive a restart of the gateway. To be used in the thread of its loop.

    :param clock: returns the time (s), monotonic.
    """

    def __init__(self, store: JobStore, access: Access, clock: Callable[[], float] = time.monotonic) -> None:
        self._store = store
        self._access = access
        self._clock = clock
        self._sessions: dict[str, Session] = {}
        for row in store.sessions():
            left = min(MAX_AGE, row["created"] + MAX_AGE - time.time())
            caller = Caller(row["user"], Role.VIEW, BROWSER, credential=row["credential"])
            session = Session(row["id"], row["digest"], caller, row["address"], row["created"], clock() + left)
            self._sessions[session.digest] = session

    def start(self, token: str, address: str) -> tuple[str, Caller]:
        """Returns the secret of a new session, for the page's cookie, and its caller.

        :raises SkirosError: the token is not admitted; see `Access.authenticate`.
        """
        return self._start(self._access.authenticate(token, BROWSER, address), address)

    async def start_by_password(self, user: str, password: str, address: str) -> tuple[str, Caller]:
        """The same for a user's name and password."""
        return self._start(await self._access.authenticate_password(user, password, BROWSER, address), address)

    def _start(self, caller: Caller, address: str) -> tuple[str, Caller]:
        own = [each for each in self._sessions.values() if each.caller.user == caller.user]
        for old in own[: max(0, len(own) + 1 - MAX_SESSIONS)]:
            self._end(old)
        secret, now = secrets.token_urlsafe(32), time.time()
        session = Session(secrets.token_hex(6), sha256(secret), caller, address, now, self._clock() + MAX_AGE)
        self._sessions[session.digest] = session
        row = {**session.to_dict(), "digest": session.digest, "credential": caller.credential}
        try:
            self._store.put_session(row)
        except StoreFailed as error:  # who wants to stop robots gets in, whatever the disk does
            log.error("a session of %s ends with the gateway: %s", caller.user, error)
        return secret, caller

    def caller(self, secret: str) -> Caller:
        """Returns the caller of a session.

        :raises Unauthenticated: it has ended, or the credentials of its login are no longer valid.
        """
        session = self._find(secret)
        if session is None:
            raise Unauthenticated("the session has ended; log in again")
        try:
            caller = self._access.renew(session.caller)
        except (Unauthenticated, Denied):
            self._end(session)
            raise
        return replace(caller, session=session.id)

    def is_open(self, session_id: str) -> bool:
        return any(each.id == session_id and each.deadline > self._clock() for each in self._sessions.values())

    def digests(self, role: Role) -> dict[str, str]:
        """Returns the users of open sessions with a role or a higher one, by the SHA-256 of the sessions' secrets."""
        found = {}
        for session in self._sessions.values():
            try:
                level = self._access.renew(session.caller).level
            except (Unauthenticated, Denied):
                continue  # it ends when it is used next
            if session.deadline > self._clock() and level >= role:
                found[session.digest] = session.caller.user
        return found

    def open(self, caller: Caller) -> list[dict[str, Any]]:
        """Returns the sessions that a caller may end, as JSON data: their own, with the role maintain all."""
        return [{**each.to_dict(), "is_own": each.id == caller.session} for each in self._of(caller)]

    def end(self, caller: Caller, session_id: str) -> None:
        """Ends a session.

        :raises UnknownName: there is none that the caller may end.
        :raises StoreFailed: it has ended, but comes back after a restart of the gateway.
        """
        for session in self._of(caller):
            if session.id == session_id:
                del self._sessions[session.digest]
                self._store.delete_session(session.id)
                return
        raise UnknownName(f"there is no session {session_id!r} that {caller.user} may end")

    def _of(self, caller: Caller) -> Iterator[Session]:
        is_all = caller.level >= Role.MAINTAIN
        return (s for s in list(self._sessions.values()) if is_all or s.caller.user == caller.user)

    def _find(self, secret: str) -> Session | None:
        session = self._sessions.get(sha256(secret))
        if session is not None and session.deadline <= self._clock():
            self._end(session)
            return None
        return session

    def _end(self, session: Session) -> None:
        del self._sessions[session.digest]
        try:
            self._store.delete_session(session.id)
        except StoreFailed as error:  # after a restart of the gateway it ends for the same reason
            log.error("session %s of %s: %s", session.id, session.caller.user, error)
