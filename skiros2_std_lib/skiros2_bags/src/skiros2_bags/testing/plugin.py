"""The plugin of pytest: bags as tests.

    pytest_plugins = ["skiros2_bags.testing"]  # in the top conftest.py

    pytest --replay runs/pick.bag --replay-kind rerun --replay-workspace owl

    @pytest.mark.replay("runs/pick.bag", kind="rerun", workspace="owl")
    def test_pick_goes_as_recorded(replayed):
        assert replayed is None, replayed

Bags on the command line become tests of their own, one for each kind. Names of files are relative to the folder of the
test, or to where pytest was started.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from skiros2_bags.core.normal import NARROW, Tolerance
from skiros2_bags.testing.kinds import KINDS, RERUN, Settings, replay
from skiros2_bags.testing.replay_program import WHILE_STDIN

#: What a program that tells a divergence ends with.
_DIVERGED = 1


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("replay", "recorded runs of skills")
    group.addoption("--replay", action="append", default=[], metavar="BAG", help="play a bag as a test; many times")
    group.addoption(
        "--replay-kind", action="append", default=[], choices=sorted(KINDS), help="how to play them; many times; rerun"
    )
    group.addoption("--replay-workspace", default="", metavar="FOLDER", help="of the ontologies of their scenes")


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line(
        "markers",
        "replay(bag, kind='rerun', workspace=None, played=(), launch=(), relative=..., absolute=...): the bag that the "
        "fixture `replayed` plays again",
    )


def pytest_collection_modifyitems(session: pytest.Session, config: pytest.Config, items: list[pytest.Item]) -> None:
    workspace = config.getoption("--replay-workspace")
    settings = Settings(Path(workspace).resolve() if workspace else None)
    for bag in config.getoption("--replay"):
        for kind in config.getoption("--replay-kind") or [RERUN]:
            path = Path(bag).resolve()
            items.append(ReplayItem.from_parent(session, name=f"{bag}[{kind}]", bag=path, kind=kind, settings=settings))


class Diverged(AssertionError):
    """A replay went another way than the recording."""


class ReplayItem(pytest.Item):
    """A bag of the command line."""

    def __init__(self, *, bag: Path, kind: str, settings: Settings, **more: Any) -> None:
        super().__init__(**more)
        self._bag = bag
        self._kind = kind
        self._settings = settings

    def runtest(self) -> None:
        found = played_again(self._bag, self._kind, self._settings)
        if found is not None:
            raise Diverged(found)

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        if isinstance(excinfo.value, Diverged):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, int | None, str]:
        return self._bag, None, self.name


@pytest.fixture
def replayed(request: pytest.FixtureRequest) -> Iterator[str | None]:
    """The first divergence of the bag that the test's marker `replay` names, in words; None: all goes as recorded."""
    marker = request.node.get_closest_marker("replay")
    if marker is None or len(marker.args) != 1:
        raise pytest.UsageError("the fixture `replayed` needs a marker: @pytest.mark.replay(BAG, kind=...)")
    given = dict(marker.kwargs)
    kind = given.pop("kind", RERUN)
    if kind not in KINDS:
        raise pytest.UsageError(f"replay kind {kind!r}: expected one of {', '.join(KINDS)}")
    yield played_again(_file(request, marker.args[0]), kind, _settings(request, given))


def played_again(bag: Path, kind: str, settings: Settings) -> str | None:
    """Plays a bag again. Returns the first divergence in words; None: all goes as recorded.

    Kinds with nodes run in a process of their own, since rospy can be initialised once.

    :raises SkirosError: a re-run cannot be played.
    :raises RuntimeError: another kind cannot be played.
    """
    if kind == RERUN:
        found = replay(bag, kind, settings)
        return None if found is None else str(found)
    program = (sys.executable, "-m", "skiros2_bags.testing.replay_program", WHILE_STDIN)
    status, told, complaint = _run_to_end([*program, str(bag), kind, *_arguments(settings)])
    if status not in (0, _DIVERGED):
        raise RuntimeError(f"{bag} ({kind}) cannot be played: {complaint or told}")
    return told if status == _DIVERGED else None


def _run_to_end(command: list[str]) -> tuple[int, str, str]:
    """Runs a program that ends itself when its standard input ends: that too when this process ends meanwhile.

    Returns its status, and what it wrote to stdout and stderr.
    """
    stdin, writing = os.pipe()
    with os.fdopen(writing, "wb") as kept:
        try:
            program = subprocess.Popen(
                command, stdin=stdin, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, errors="replace"
            )
        finally:
            os.close(stdin)
        try:
            told, complaint = program.communicate()
        finally:
            kept.close()
            program.wait()
    return program.returncode, told.strip(), complaint.strip()


def _arguments(settings: Settings) -> list[str]:
    arguments = ["--relative", str(settings.tolerance.relative), "--absolute", str(settings.tolerance.absolute)]
    if settings.workspace is not None:
        arguments += ["--workspace", str(settings.workspace)]
    if settings.launch:
        arguments += ["--launch", " ".join(settings.launch)]
    return arguments


def _settings(request: pytest.FixtureRequest, given: dict[str, Any]) -> Settings:
    known = {"workspace", "played", "launch", "relative", "absolute"}
    if not given.keys() <= known:
        raise pytest.UsageError(f"marker replay: unknown {', '.join(given.keys() - known)}; known: {', '.join(known)}")
    workspace = given.get("workspace")
    return Settings(
        _file(request, workspace) if workspace is not None else None,
        frozenset(given.get("played", ())),
        Tolerance(given.get("relative", NARROW.relative), given.get("absolute", NARROW.absolute)),
        tuple(given.get("launch", ())),
    )


def _file(request: pytest.FixtureRequest, name: str | Path) -> Path:
    beside = request.path.parent / name
    return beside if beside.exists() else Path(name).resolve()
