"""The pytest plugin: bags as tests.

    pytest_plugins = ["skiros2_bags.testing"]  # in the top conftest.py

    pytest --replay runs/pick.bag --replay-kind rerun --replay-workspace owl

    @pytest.mark.replay("runs/pick.bag", kind="rerun", workspace="owl")
    def test_pick_goes_as_recorded(replayed):
        assert replayed is None, replayed

Bags on the command line become tests of their own, one per kind. File names are relative to the folder of the test, or
to the working directory.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from skiros2_bags.testing.replay import KINDS, RERUN, replay
from skiros2_bags.testing.replay_program import WHILE_STDIN
from skiros2_bags.testing.replay_settings import Settings
from skiros2_runs.core.tolerance import NARROW, Tolerance

#: Exit status of the replay program after a divergence.
_DIVERGED = 1


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("replay", "recorded runs of skills")
    group.addoption("--replay", action="append", default=[], metavar="BAG", help="replay a bag as a test; repeatable")
    group.addoption(
        "--replay-kind", action="append", default=[], choices=sorted(KINDS),
        help="the kind of replay; repeatable (default: rerun)",
    )  # fmt: skip
    group.addoption("--replay-workspace", default="", metavar="FOLDER", help="folder of the ontologies of the scenes")


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line(
        "markers",
        "replay(bag, kind='rerun', workspace=None, played=(), launch=(), relative=..., absolute=...): the bag for the "
        "fixture `replayed`",
    )


def pytest_collection_modifyitems(session: pytest.Session, config: pytest.Config, items: list[pytest.Item]) -> None:
    workspace = config.getoption("--replay-workspace")
    settings = Settings(Path(workspace).resolve() if workspace else None)
    for bag in config.getoption("--replay"):
        for kind in config.getoption("--replay-kind") or [RERUN]:
            path = Path(bag).resolve()
            items.append(ReplayItem.from_parent(session, name=f"{bag}[{kind}]", bag=path, kind=kind, settings=settings))


class Diverged(AssertionError):
    """A replay differs from its recording."""


class ReplayItem(pytest.Item):
    """A bag from the command line."""

    def __init__(self, *, bag: Path, kind: str, settings: Settings, **more: Any) -> None:
        super().__init__(**more)
        self._bag = bag
        self._kind = kind
        self._settings = settings

    def runtest(self) -> None:
        found = replay_bag(self._bag, self._kind, self._settings)
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
    """The first divergence of the bag that the marker `replay` of the test names, as text; None without one."""
    marker = request.node.get_closest_marker("replay")
    if marker is None or len(marker.args) != 1:
        raise pytest.UsageError("the fixture `replayed` needs a marker: @pytest.mark.replay(BAG, kind=...)")
    given = dict(marker.kwargs)
    kind = given.pop("kind", RERUN)
    if kind not in KINDS:
        raise pytest.UsageError(f"replay kind {kind!r}: expected one of {', '.join(KINDS)}")
    yield replay_bag(_file(request, marker.args[0]), kind, _settings(request, given))


def replay_bag(bag: Path, kind: str, settings: Settings) -> str | None:
    """Replays a bag. Returns the first divergence as text; None without one.

    A trace runs in a separate process, since rospy can be initialised only once.

    :raises SkirosError: a re-run fails.
    :raises RuntimeError: a replay in a separate process fails.
    """
    if kind == RERUN:
        found = replay(bag, kind, settings)
        return None if found.divergence is None else str(found)
    program = (sys.executable, "-m", "skiros2_bags.testing.replay_program", WHILE_STDIN)
    status, output, errors = _run_bound_to_stdin([*program, str(bag), kind, *_arguments(settings)])
    if status not in (0, _DIVERGED):
        raise RuntimeError(f"{bag} ({kind}) cannot be played: {errors or output}")
    return output if status == _DIVERGED else None


def _run_bound_to_stdin(command: list[str]) -> tuple[int, str, str]:
    """Runs a program that exits when its standard input ends, which is also when this process ends.

    :returns: exit status, stdout and stderr.
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
            output, errors = program.communicate()
        finally:
            kept.close()
            program.wait()
    return program.returncode, output.strip(), errors.strip()


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
    candidate = request.path.parent / name
    return candidate if candidate.exists() else Path(name).resolve()
