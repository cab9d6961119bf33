"""Users of the gateway: their roles and credentials, in a file that takes effect while the gateway runs."""

from __future__ import annotations

import asyncio
import hashlib
import logging
import os
import secrets
from collections.abc import Callable, Sequence
from enum import IntEnum
from pathlib import Path

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from skiros2_common.core.errors import ConfigurationError
from skiros2_common.core.yaml_text import read_yaml
from skiros2_gateway.core.passwords import PATTERN
from skiros2_gateway.core.problems import problems_of

log = logging.getLogger(__name__)

#: How often the file is looked at (s).
_PERIOD = 0.5


class Role(IntEnum):
    """The rights of a user. Each role includes the lower ones, except that `AGENT` is included in none.

    An agent calls agents' tools as an operator does, and is refused everywhere else.
    """

    AGENT = 0
    VIEW = 1
    OPERATE = 2
    APPROVE = 3
    MAINTAIN = 4


_NAMES = ", ".join(role.name.lower() for role in sorted(Role))


class User(BaseModel):
    """A user in the file of users.

    :param person: whether a person, and no program, has the credentials. Only persons approve what agents ask for.
    :param token: the secret itself; the file must be readable by its owner only.
    :param sha256: the token's SHA-256 as hexadecimal digits, instead of the token.
    :param password: its hash, with which the user logs in to the page by name; see `skiros2_gateway.core.passwords`.
    :param certificate: the SHA-256 of an OPC UA client's certificate (DER), as hexadecimal digits.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str
    role: str
    person: bool = False
    token: str = ""
    sha256: str = ""
    password: str = Field("", pattern=PATTERN)
    certificate: str = ""

    @model_validator(mode="after")
    def _check(self) -> User:
        if self.role.upper() not in Role.__members__:
            raise ValueError(f"role {self.role!r} is unknown, expected one of: {_NAMES}")
        if self.person and self.level is Role.AGENT:
            raise ValueError("an agent is not a person")
        if self.token and len(self.token) < 16:
            raise ValueError("the token is too short, expected at least 16 characters")
        if not (self.token or self.sha256 or self.password or self.certificate):
            raise ValueError("expected a token, its sha256, a password, or a certificate")
        if self.password and self.level is Role.AGENT:
            raise ValueError("an agent has no password")
        return self

    @property
    def level(self) -> Role:
        return Role[self.role.upper()]

    @property
    def digest(self) -> str:
        """The SHA-256 of the token; "" without a token."""
        return self.sha256.lower() or (sha256(self.token) if self.token else "")


class _Users(BaseModel):
    model_config = ConfigDict(extra="forbid")
    users: list[User]


def sha256(token: str) -> str:
    """Returns the SHA-256 of a token as hexadecimal digits."""
    return hashlib.sha256(token.encode("utf-8", "surrogatepass")).hexdigest()


def read_users(path: Path) -> list[User]:
    """Reads the file of users; makes it, with a random token for each role, if it does not exist.

    A file of an earlier version marks no persons: there, whoever has the role maintain could approve, and still can.

    :raises ConfigurationError: the file has mistakes, or others may read it.
    """
    if not path.exists():
        _make_users(path)
    return _read(path)


def _read(path: Path) -> list[User]:
    try:
        if path.stat().st_mode & 0o077:
            raise ConfigurationError(f"{path} has tokens and may be read by others; expected: chmod 600 {path}")
        users = _Users.model_validate(read_yaml(path.read_text())).users
    except (OSError, ValueError) as error:
        reasons = problems_of(error) if isinstance(error, ValidationError) else [error]
        raise ConfigurationError(f"{path}: " + "; ".join(map(str, reasons))) from error
    names = [user.name for user in users]
    if len(set(names)) < len(names):
        raise ConfigurationError(f"{path}: two users have the same name")
    secrets_of = [digest for user in users for digest in (user.digest, user.certificate.lower()) if digest]
    if len(set(secrets_of)) < len(secrets_of):
        raise ConfigurationError(f"{path}: two users have the same token or certificate")
    if any("person" in user.model_fields_set or user.level in (Role.AGENT, Role.APPROVE) for user in users):
        return users
    found = [user.name for user in users if user.level is Role.MAINTAIN]
    log.warning(
        "%s is of an earlier version, without persons: %s may approve what agents ask for, as before. Mark persons with"
        " `person: true`, and give agents users of their own with the role agent",
        path,
        ", ".join(found) or "nobody",
    )
    return [user.model_copy(update={"person": user.level is Role.MAINTAIN}) for user in users]


def _make_users(path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    users: list[dict[str, object]] = [
        {"name": role.name.lower(), "role": role.name.lower(), "token": secrets.token_urlsafe(24)}
        for role in sorted(Role)
    ]
    for user in users:
        if user["name"] in ("approve", "maintain"):
            user["person"] = True
    text = (
        "# Users of the gateway; changes take effect within a second. Roles: view reads; operate also commands jobs and"
        " robots;\n# approve, for accounts with `person: true`, also answers what agents ask for; maintain also reads"
        " the audit log;\n# agent is valid for agents' tools only.\n"
    )
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
        file.write(text + yaml.safe_dump({"users": users}, sort_keys=False))
    log.warning("made %s with a random token for each role", path)


class UsersFile:
    """The file of users, read again when it has changed.

    :raises ConfigurationError: see `read_users`.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._state = self._read_state()  # before the file: no change is missed
        self.users = read_users(path)

    async def follow(self, changed: Callable[[Sequence[User]], None]) -> None:
        """Reports the users after each change, until it is cancelled."""
        while True:
            await asyncio.sleep(_PERIOD)
            if self.read():
                changed(self.users)

    def read(self) -> bool:
        """Reads the file if it has changed. Returns whether the users may be others.

        A file with mistakes changes nothing; the log has the reason.
        """
        state = self._read_state()
        if state == self._state:
            return False
        self._state = state
        try:
            self.users = _read(self._path)
        except ConfigurationError as error:
            log.error("the users are unchanged: %s", error)
            return False
        log.info("%s has changed: %d users", self._path, len(self.users))
        return True

    def _read_state(self) -> object:
        try:
            found = self._path.stat()
        except OSError as error:
            return error.errno
        return found.st_mtime_ns, found.st_size, found.st_ino, found.st_mode
