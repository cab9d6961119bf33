"""Users, roles and sessions: what each credential is valid for, and how it is revoked while the gateway runs."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
import yaml

from skiros2_common.core.errors import ConfigurationError, UnknownName
from skiros2_gateway.core.access import Access, Role
from skiros2_gateway.core.passwords import hashed
from skiros2_gateway.core.problems import Denied, Unauthenticated
from skiros2_gateway.core.sessions import MAX_AGE, MAX_SESSIONS, Sessions
from skiros2_gateway.core.store import JobStore
from skiros2_gateway.core.users import User, UsersFile, read_users
from support.http_gateway import curl, served
from unit.skiros2_gateway.conftest import TOKENS

Run = Callable[..., None]
TOKEN = "a token of some length"


def write(path: Path, *users: dict[str, Any]) -> Path:
    """Writes a file of users, as an editor does."""
    new = path.with_suffix(".new")
    new.write_text(yaml.safe_dump({"users": [{"token": TOKEN + str(i), **user} for i, user in enumerate(users)]}))
    new.chmod(0o600)
    os.replace(new, path)
    return path


def test_agent_is_admitted_to_agents_tools_only(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        access = gateway.access
        assert access.authenticate(TOKENS["agent"], "mcp").level is Role.OPERATE
        for way in ("rest", "mqtt", "opcua", "browser"):
            with pytest.raises(Denied, match="agents' tools only"):
                access.authenticate(TOKENS["agent"], way)
        order = {"id": "a", "goal": "(at robot home)"}
        async with served(gateway.service) as address:
            assert (await curl(address, "/api/jobs", token=TOKENS["agent"], body=order))[0] == 403
            assert (await curl(address, "/api/state", token=TOKENS["agent"]))[0] == 403
            assert (await curl(address, "/api/session", body={"token": TOKENS["agent"]}))[0] == 403
        assert not gateway.cell.sent
        assert {entry["user"] for entry in gateway.store.audit_log()} == {"agent"}

    in_gateway(test)


def test_person_is_not_admitted_to_agents_tools(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        with pytest.raises(Denied, match="is a person"):
            gateway.access.authenticate(TOKENS["approve"], "mcp")

    in_gateway(test)


def test_first_file_of_users_has_a_user_for_each_role_and_marks_persons(tmp_path: Path) -> None:
    path = tmp_path / "folder" / "users.yaml"
    users = {user.name: user for user in read_users(path)}
    assert {name: (user.level.name.lower(), user.person) for name, user in users.items()} == {
        "agent": ("agent", False), "view": ("view", False), "operate": ("operate", False), "approve": ("approve", True),
        "maintain": ("maintain", True),
    }  # fmt: skip
    assert len({user.token for user in users.values()}) == 5
    assert path.stat().st_mode & 0o077 == 0


def test_users_of_an_earlier_version_keep_their_rights_with_a_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    names = ("view", "operate", "maintain")
    users = read_users(write(tmp_path / "users.yaml", *({"name": name, "role": name} for name in names)))
    assert [(user.level, user.person) for user in users] == [
        (Role.VIEW, False), (Role.OPERATE, False), (Role.MAINTAIN, True),
    ]  # fmt: skip
    assert "maintain may approve" in caplog.text and "person: true" in caplog.text


@pytest.mark.parametrize(
    ("users", "problem"),
    [
        ([{"name": "a", "role": "admin"}], "role 'admin' is unknown"),
        ([{"name": "a", "role": "agent", "person": True}], "an agent is not a person"),
        ([{"name": "a", "role": "view"}, {"name": "a", "role": "view"}], "the same name"),
        ([{"name": "a", "role": "agent"}, {"name": "b", "role": "view", "token": TOKEN + "0"}], "the same token"),
    ],
)
def test_wrong_users_are_refused(tmp_path: Path, users: Sequence[dict[str, Any]], problem: str) -> None:
    with pytest.raises(ConfigurationError, match=problem):
        read_users(write(tmp_path / "users.yaml", *users))


def test_changes_of_the_file_of_users_take_effect_and_mistakes_do_not(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    first = {"name": "first", "role": "operate"}
    path = write(tmp_path / "users.yaml", first, {"name": "second", "role": "view"})
    file = UsersFile(path)
    assert not file.read()
    write(path, first)
    assert file.read() and [user.name for user in file.users] == ["first"]
    for break_file in (lambda: path.write_text("users: ["), lambda: path.chmod(0o644), path.unlink):
        break_file()
        assert not file.read() and [user.name for user in file.users] == ["first"]
        assert "the users are unchanged" in caplog.text
        caplog.clear()
        write(path, first)
        assert file.read()


def test_revoked_token_is_refused_also_to_callers_admitted_before(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        caller = gateway.access.authenticate(TOKENS["operate"], "opcua")
        assert gateway.service.is_admitted(caller)
        gateway.access.set_users([User(name="operate", role="view", token=TOKENS["operate"])])
        assert gateway.service.renew(caller).role is Role.VIEW
        gateway.access.set_users([User(name="operate", role="operate", token="another-0123456789abcdef")])
        assert not gateway.service.is_admitted(caller)
        with pytest.raises(Unauthenticated):
            gateway.access.authenticate(TOKENS["operate"], "rest")

    in_gateway(test)


def test_session_of_the_page_is_ended_by_logout_by_a_maintainer_and_with_its_token(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        jar = str(gateway.path.parent / "cookies")
        command = ("-b", jar, "-H", "X-Gateway: 1")
        async with served(gateway.service) as address:

            async def log_in() -> None:
                login = {"token": TOKENS["operate"]}
                assert (await curl(address, "/api/session", "-c", jar, body=login))[0] == 200
                assert TOKENS["operate"] not in Path(jar).read_text()
                assert (await curl(address, "/api/state", "-b", jar))[0] == 200

            async def is_refused() -> bool:
                return (await curl(address, "/api/state", "-b", jar))[0] == 401

            await log_in()
            assert (await curl(address, "/api/session", *command, "-X", "DELETE"))[0] == 200
            assert await is_refused()

            await log_in()
            for user, status in (("view", 404), ("maintain", 200)):
                found = (await curl(address, "/api/sessions", "-b", jar))[1]["sessions"]
                assert [(each["user"], each["is_own"]) for each in found] == [("operate", True)]
                path = f"/api/sessions/{found[0]['id']}"
                assert (await curl(address, path, "-X", "DELETE", token=TOKENS[user]))[0] == status
            assert await is_refused()

            await log_in()
            gateway.access.set_users([User(name="operate", role="operate", token="another-0123456789abcdef")])
            assert await is_refused()

    in_gateway(test)


def test_sessions_survive_a_restart_and_end_by_age_and_number(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        now = 0.0
        secret, _ = gateway.service.sessions.start(TOKENS["view"], "address")
        gateway.store.close()
        gateway.restart()
        sessions = Sessions(gateway.store, gateway.access, lambda: now)
        caller = sessions.caller(secret)
        assert (caller.user, caller.role) == ("view", Role.VIEW)
        for _ in range(MAX_SESSIONS):
            newest, _ = sessions.start(TOKENS["view"], "address")
        assert len(sessions.open(caller)) == MAX_SESSIONS
        with pytest.raises(Unauthenticated):
            sessions.caller(secret)
        with pytest.raises(UnknownName):
            sessions.end(sessions.caller(newest), caller.session)
        now = MAX_AGE + 1.0
        with pytest.raises(Unauthenticated):
            sessions.caller(newest)

    in_gateway(test)


def test_access_without_users_admits_nobody() -> None:
    with pytest.raises(Unauthenticated):
        Access([], JobStore(":memory:")).authenticate("", "rest")


def test_user_logs_in_by_name_with_a_password_or_the_token(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        anna = User(name="anna", role="operate", password=hashed("a long password"))
        bert = User(name="bert", role="view", token="bert-0123456789abcdef")
        gateway.service.set_users([anna, bert])
        async with served(gateway.service) as address:

            async def login(user: str, password: str) -> tuple[int, Any]:
                return await curl(address, "/api/session", body={"user": user, "password": password})

            assert await login("anna", "a long password") == (200, {"user": "anna", "role": "operate"})
            assert await login("bert", "bert-0123456789abcdef") == (200, {"user": "bert", "role": "view"})
            for wrong in ("another password", "", anna.password, "bert-0123456789abcdef"):
                assert (await login("anna", wrong))[0] == 401, wrong
            for name in ("bert", "carl"):
                assert (await login(name, "a long password"))[0] == 401, name
            secret, caller = await gateway.service.sessions.start_by_password("anna", "a long password", "here")
            assert gateway.service.sessions.caller(secret).user == caller.user == "anna"
            gateway.service.set_users([anna.model_copy(update={"password": hashed("changed by anna")}), bert])
            with pytest.raises(Unauthenticated):  # a session ends with its password
                gateway.service.sessions.caller(secret)
            while (await login("anna", "guessed"))[0] == 401:
                pass
            assert (await login("anna", "guessed"))[0] == 429

    in_gateway(test)


def test_an_agent_has_no_password_and_a_password_is_a_hash() -> None:
    with pytest.raises(ValueError, match="an agent has no password"):
        User(name="agent", role="agent", token="agent-0123456789abcdef", password=hashed("a long password"))
    with pytest.raises(ValueError, match="password"):
        User(name="anna", role="view", password="a long password")
